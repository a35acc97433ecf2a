"""camera_info that changes in mid-scan is named once, by how much, and doubted for the scan."""

from dataclasses import replace

import numpy as np
import pytest

from occ_recon_ros.geometry import Camera
from occ_recon_ros.streams.camera_watch import CameraWatch

S = 1_000_000_000
K = np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]])
CAMERA = Camera(K, 640, 480, np.eye(3), np.array([0, 0, 1.0]))


def zoomed(share):
    return replace(
        CAMERA, K=K * [[share], [share], [1]] + (1 - share) * K * [[0, 0, 1]] * [[1], [1], [0]]
    )


def watched(*cameras):
    watch = CameraWatch()
    return watch, [watch.add(camera, k * S) for k, camera in enumerate(cameras)]


def test_another_focal_length_is_said_once_and_stays_in_doubt():
    watch, said = watched(CAMERA, CAMERA, *[zoomed(1.06)] * 3)
    assert said[:2] + said[3:] == [""] * 4
    assert "at stamp 2.000: f 530.0 px instead of 500.0 (+6.0%)" in said[2]
    assert watch.doubt == said[2]
    assert "only if zoom or focus were really changed" in watch.doubt


def test_the_widest_change_is_the_doubt():
    watch, _ = watched(CAMERA, zoomed(1.01), zoomed(1.2), zoomed(1.05), CAMERA)
    assert "(+20.0%)" in watch.doubt


def test_half_the_resolution_is_said_and_no_doubt():
    half = K * [[0.5], [0.5], [1]]
    half[:2, 2] = (K[:2, 2] + 0.5) / 2 - 0.5
    watch, said = watched(CAMERA, replace(CAMERA, K=half, width=320, height=240))
    assert said[1].endswith("images of 320x240 px instead of 640x480")
    assert watch.doubt == ""


def test_half_the_resolution_with_the_k_of_before_is_a_doubt():
    watch, _ = watched(CAMERA, replace(CAMERA, width=320, height=240))
    assert "320x240 px instead of 640x480, f 500.0 px instead of 250.0 (+100.0%)" in watch.doubt


@pytest.mark.parametrize("camera", [CAMERA, zoomed(1.0005)])
def test_a_camera_that_stays_is_in_no_doubt(camera):
    watch, said = watched(CAMERA, camera)
    assert (watch.doubt, said) == ("", ["", ""])


def test_another_distortion_is_a_doubt():
    watch, _ = watched(CAMERA, replace(CAMERA, D=[0.1, 0, 0, 0], distortion="plumb_bob"))
    assert "another D" in watch.doubt
