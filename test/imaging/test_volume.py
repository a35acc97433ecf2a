"""The scan volume bounds the contours of an image."""

import numpy as np
import pytest
from discs import camera_for, coverage, photograph

from occ_recon_ros.imaging import ContourError, ContourSettings, ContourTracker
from occ_recon_ros.imaging.volume import Volume

SHAPE, CENTRE = (240, 320), np.array([160.0, 120.0])
IMAGE = photograph(coverage(SHAPE, CENTRE, np.array([90.0, 90.0]), 0.0))
CAMERA = camera_for(IMAGE)


def found(**volume):
    return ContourTracker(ContourSettings(**volume)).process(IMAGE, CAMERA, 1, "turntable")


@pytest.mark.parametrize("kind", ["box", "cylinder"])
def test_its_region_is_where_rays_meet_it(kind):
    volume = Volume(kind, np.zeros(3), np.array([0.08, 0.06, 0.05]), np.array([0.3, 0.1, 1.0]))
    region = volume.region(CAMERA) > 0
    y, x = np.mgrid[: SHAPE[0] : 7, : SHAPE[1] : 7]
    rays = CAMERA.viewing_directions(np.column_stack([x.ravel(), y.ravel()]).astype(float))
    depths = np.linspace(0.9, 1.1, 401)
    points = CAMERA.centre + rays[:, None] * depths[:, None]
    meets = volume.contains(points.reshape(-1, 3)).reshape(len(rays), -1).any(axis=1)
    wrong = meets != region[y.ravel(), x.ravel()]
    assert wrong.mean() < 0.01
    assert 0 < meets.sum() < len(meets)


def test_samples_on_its_border_are_marked_and_the_others_are_not():
    # 0.08 m at 1 m is 128 px: the disc of 180 px is cut on its left and right.
    contours = found(volume_kind="box", volume_width=0.08, volume_depth=1.0, volume_height=0.001)
    on_border = np.abs(np.abs(contours.uv[:, 0] - CENTRE[0]) - 64) < 2
    assert on_border.sum() > 100
    assert np.isinf(contours.sigma[on_border]).all()
    assert np.isfinite(contours.sigma[np.abs(contours.uv[:, 0] - CENTRE[0]) < 50]).mean() > 0.9


def test_a_plane_bounds_no_single_image():
    np.testing.assert_array_equal(found(volume_kind="plane").uv, found().uv)


def test_an_axis_of_no_length_is_named():
    with pytest.raises(ContourError, match="axis"):
        found(volume_kind="cylinder", volume_axis_z=0.0)
