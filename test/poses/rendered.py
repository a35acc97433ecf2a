"""Rendered views of a printed board, whose corners and cameras are known exactly."""

from dataclasses import replace

import cv2
import numpy as np
from scenes import looking_at
from scenes.printed import printed_sheet

from occ_recon_ros.poses.board import BoardSpec

CHARUCO = BoardSpec()
GRID = BoardSpec("aruco_grid", 5, 7, marker_m=0.03, gap_m=0.008, dictionary="DICT_5X5_100")
CHESS = BoardSpec("chessboard", 7, 10, square_m=0.025)


def view(azimuth=0.3, elevation=0.8, distance=0.5, f=900.0, size=(960, 720), D=(), at=(0, 0, 0)):
    """A camera that looks at a point of the board; angles in radians, metres."""
    direction = np.array(
        [
            np.cos(azimuth) * np.cos(elevation),
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ]
    )
    at = np.asarray(at, np.float64)
    aimed = looking_at(at + distance * direction, at, focal_px=f, size=size)
    K = np.array([[f, 0, size[0] / 2 + 3.3], [0, f, size[1] / 2 - 5.1], [0, 0, 1]])
    return replace(aimed, K=K, D=np.array(D), distortion="plumb_bob" if len(D) else "none")


def photograph(board, camera, blur=0.8, noise=2.0, seed=0, hide=None, samples=3):
    """An image of a board, uint8; ``hide`` is a mask of what covers it."""
    light = printed_sheet(board.black, board.size_m, 0.015, camera, samples)
    image = 30 + 190 * light
    if hide is not None:
        image = np.where(hide, 110.0, image)
    image = cv2.GaussianBlur(image, (0, 0), blur) if blur else image
    image = image + np.random.default_rng(seed).normal(0, noise, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)
