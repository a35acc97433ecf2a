"""Poses or calibration that are off are told from wrong matches, by their size."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from spheres import Sphere, ring

from occ_recon_ros.geometry import RimReconstructor, RimSettings, Status

SPHERE = Sphere(np.array([0.03, -0.05, 0.02]), 0.2)
CENTRES = ring(np.radians(10) * np.arange(36))


def turned(contours, across_px, along_px):
    """The view of a camera that is thought to look that many pixels beside and above."""
    forward = contours.T.mean(axis=0) / np.linalg.norm(contours.T.mean(axis=0))
    x = np.cross(forward, [0, 0, 1])
    x = x / np.linalg.norm(x)
    angle = contours.radians_per_pixel
    vector = angle * (across_px * np.cross(forward, x) + along_px * x)
    R = Rotation.from_rotvec(vector).as_matrix()
    return replace(contours, T=contours.T @ R.T, N=contours.N @ R.T)


def scan(offsets):
    reconstructor = RimReconstructor()
    rims = {}
    for k, (C, offset) in enumerate(zip(CENTRES, offsets, strict=True)):
        contours = turned(SPHERE.contours(C, 500, stamp_ns=k + 1), *offset)
        rims.update({r.stamp_ns: r for r in reconstructor.add(contours)})
    rims.update({r.stamp_ns: r for r in reconstructor.finish()})
    status = np.concatenate([r.status for r in rims.values()])
    return reconstructor, (status == Status.GOOD).mean()


def test_exact_poses_raise_no_doubt():
    reconstructor, good = scan(np.zeros((36, 2)))
    assert good > 0.9
    assert reconstructor.calibration.size_px < 0.05
    assert reconstructor.tolerance_px == RimSettings().silhouette_tolerance


@pytest.mark.parametrize("error_px", [1, 5])
@pytest.mark.parametrize("kind", ["each view its own", "all the same, across the axis"])
def test_the_size_of_the_error_is_said_and_most_points_are_kept(kind, error_px):
    offsets = np.tile([1.0, 0.0], (36, 1))
    if kind == "each view its own":
        offsets = np.random.default_rng(5).standard_normal((36, 2))
    reconstructor, good = scan(error_px * offsets)
    size = reconstructor.calibration.size_px
    print(f"{kind}, {error_px} px: said {size:.2f} px, {good:.0%} good")
    assert 0.6 * error_px < size < 1.5 * error_px
    assert good > 0.5


def test_wrong_matches_are_not_taken_for_an_error_of_the_poses():
    """A tenth of the views have a dent: points of all others there fall outside, by any
    amount."""
    reconstructor = RimReconstructor()
    for k, C in enumerate(CENTRES):
        contours = SPHERE.contours(C, 500, stamp_ns=k + 1)
        if k % 10 == 5:
            dent = np.zeros(500)
            dent[200:300] = -0.05 * np.sin(np.linspace(0, np.pi, 100))
            T = contours.T + dent[:, None] * contours.N
            contours = replace(contours, T=T / np.linalg.norm(T, axis=1)[:, None])
        reconstructor.add(contours)
    reconstructor.finish()
    assert reconstructor.calibration.size_px < 0.3
