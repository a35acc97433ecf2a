"""Large photographs are kept smaller, and their cameras and masks with them."""

import cv2
import numpy as np
import pytest

from occ_recon_ros.bags.scan_bag import PosedPicture, write_scan_bag
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.geometry import Camera

WIDTH, HEIGHT = 800, 600
POINT = np.array([0.11, -0.07, 0.0])


def picture(tmp_path, D=()):
    """A photograph of one white spot about ``POINT``, and a mask that is that spot."""
    K = np.array([[700.0, 0, 390.0], [0, 705.0, 310.0], [0, 0, 1]])
    distortion = "plumb_bob" if len(D) else "none"
    camera = Camera(K, WIDTH, HEIGHT, np.eye(3), np.array([0, 0, 1.0]), np.array(D), distortion)
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    x, y = camera.project(POINT[None])[0]
    spot = np.clip(30.5 - np.hypot(u - x, v - y), 0, 1)
    cv2.imwrite(str(tmp_path / "m.png"), np.where(spot > 0.5, 255, 0))
    image = np.rint(255 * np.repeat(spot[..., None], 3, axis=2)).astype(np.uint8)
    return PosedPicture(image, camera, 10**9, tmp_path / "m.png")


def middle(image):
    weight = np.asarray(image, float).reshape(*image.shape[:2], -1).mean(axis=2)
    v, u = np.indices(weight.shape)
    return np.array([(u * weight).sum(), (v * weight).sum()]) / weight.sum()


@pytest.mark.parametrize("D", [(), (-0.2, 0.1, 0.001, -0.002)], ids=["no lens", "lens"])
@pytest.mark.parametrize(
    ("long_side", "size"), [(0, (800, 600)), (2048, (800, 600)), (333, (333, 250))]
)
def test_a_point_is_where_its_camera_has_it(tmp_path, D, long_side, size) -> None:
    bag = tmp_path / "scan.mcap"
    write_scan_bag([picture(tmp_path, D)], 1, bag, lambda *_: None, long_side)
    (view,) = BagViews(bag)
    assert view.image.shape[1::-1] == (view.camera.width, view.camera.height) == size
    assert view.mask is not None
    assert view.mask.shape == view.image.shape[:2]
    at = view.camera.project(POINT[None])[0]
    assert np.abs(middle(view.image) - at).max() < 0.02
    assert np.abs(middle(view.mask) - at).max() < 0.1
