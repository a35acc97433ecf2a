"""A calibration whose distortion folds back within the image is of no lens."""

import numpy as np
import pytest

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.lens import folded_share, refuse_folded


def lens(size, focal, D, model="plumb_bob", middle=(0.5, 0.5)):
    fx, fy = np.broadcast_to(focal, 2)
    return Camera(
        K=[[fx, 0, middle[0] * size[0] - 0.5], [0, fy, middle[1] * size[1] - 0.5], [0, 0, 1]],
        width=size[0],
        height=size[1],
        R_camera_object=np.eye(3),
        t_camera_object=np.zeros(3),
        D=np.array(D, float),
        distortion=model,
    )


VGA = (640, 480)
WIDE_RATIONAL = [0.5, -2.69, 8e-4, -3e-4, 1.55, 0.378, -2.51, 1.48]
LENSES = {
    "none": lens(VGA, 500, [], "none"),
    "folds beyond the corners": lens(VGA, 700, [-0.4, 0, 0, 0]),
    "wide, 77 degrees": lens(VGA, 400, [-0.4, 0.15, 1e-3, -1e-3]),
    "wide, folds soon beyond the corners": lens(
        (1392, 512), 984.2, [-0.3728, 0.2037, 2.2e-3, 1.4e-3, -0.0723]
    ),
    "pincushion": lens(VGA, 500, [0.3, 0.1, 0, 0]),
    "rational": lens((1280, 720), 605, WIDE_RATIONAL, "rational_polynomial"),
    "rational, very wide": lens(
        (640, 576), 504, [5.2, 3.46, 0, 0, 0.165, 5.54, 5.13, 0.9], "rational_polynomial"
    ),
    "fisheye of 163 degrees": lens((848, 800), 280, [-0.005, 0.04, -0.04, 0.007], "equidistant"),
    "fisheye with its circle in the image": lens((1920, 960), 300, [0] * 4, "equidistant"),
    "fisheye that sees what is behind": lens((960, 960), 270, [0] * 4, "equidistant"),
}
FOLDS = {
    "as of a smooth can": lens(
        (1500, 2000), (3429, 9755), [46.637, -3690.19, 0.442, 2.436], middle=(0.431, 0.443)
    ),
    "barrel": lens(VGA, 400, [-0.4, 0, 0, 0]),
    "barrel that shows the middle upside down": lens(VGA, 400, [-60, 0, 0, 0]),
    "tangential": lens(VGA, 600, [0, 0, 0.5, 0.5]),
    "a pole": lens(VGA, 400, [0, 0, 0, 0, 0, -12, 0, 0], "rational_polynomial"),
    "out of all measure": lens(VGA, 400, [1e200, 0, 0, 0]),
    "fisheye": lens((960, 960), 300, [-0.3, -0.1, 0, 0], "equidistant"),
}


@pytest.mark.parametrize("name", LENSES)
def test_a_lens_passes(name):
    assert folded_share(LENSES[name]) == 0
    refuse_folded(LENSES[name])


@pytest.mark.parametrize("name", FOLDS)
def test_what_folds_back_within_the_image_is_refused(name):
    with pytest.raises(ValueError, match="folds back within the image"):
        refuse_folded(FOLDS[name])


def test_corners_may_fold():
    corners = lens(VGA, 600, [-0.4, 0, 0, 0])
    assert 0 < folded_share(corners) < 0.1
    refuse_folded(corners)
