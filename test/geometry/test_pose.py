"""The way between two poses of a camera."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry.pose import CameraPose

AXIS = np.array([0.2, -0.3, 0.9]) / np.linalg.norm([0.2, -0.3, 0.9])
POINT = np.array([0.02, -0.05, 0.1])
START = CameraPose(
    Rotation.from_euler("xyz", [1.9, 0.2, -0.4]).as_matrix(), np.array([0.4, 0, 0.2])
)


def turned(angle: float, shift: float = 0.0) -> CameraPose:
    """The start carried about the axis, and along it."""
    R = Rotation.from_rotvec(angle * AXIS).as_matrix()
    return CameraPose(R, POINT - R @ POINT + shift * AXIS) @ START


@pytest.mark.parametrize("step", np.deg2rad([1e-7, 1e-3, 0.006, 1.0, 10.0, 90.0, 179.0]))
def test_a_camera_that_goes_around_an_axis_stays_on_its_circle(step: float) -> None:
    """Along the chord of 10 degrees it would be 1.7 mm nearer to the axis half-way."""
    for shift in (0.0, 0.03):
        for fraction in (0.0, 0.3, 0.5, 1.0):
            between = START.towards(turned(step, shift), fraction)
            truth = turned(fraction * step, fraction * shift)
            np.testing.assert_allclose(between.centre, truth.centre, atol=1e-12)
            np.testing.assert_allclose(between.R_object_camera, truth.R_object_camera, atol=1e-12)


@pytest.mark.parametrize(
    "tremble", [lambda: np.zeros(3), lambda: np.array([1e-5, -2e-5, 1e-5])], ids=["still", "tiny"]
)
def test_without_a_turn_the_way_is_straight(tremble: Callable[[], NDArray[np.float64]]) -> None:
    R = START.R_object_camera @ Rotation.from_rotvec(tremble()).as_matrix()
    way = np.array([0.1, -0.2, 0.05])
    between = START.towards(CameraPose(R, START.centre + way), 0.25)
    np.testing.assert_allclose(between.centre, START.centre + 0.25 * way, atol=1e-6)
