"""Outlines along an edge of the room, and those as still that are of the object."""

import cv2
import numpy as np
import pytest
from discs import camera_for

from occ_recon_ros.imaging.joint.room import SOME_ALONG_ROOM, RoomEdges
from occ_recon_ros.streams.alone import Outlines

SHAPE = 240, 320
EVERYWHERE = np.ones(SHAPE, np.bool_)
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]]
WALL, FLOOR = (110, 60, 45), (55, 58, 60)
COLUMN = (np.abs(X - 160) < 20) & (Y > 100) & (Y < 200)
PLATE = ((X - 160) / 75) ** 2 + ((Y - 145) / 18) ** 2 < 1
SHADE = ((X - 110) / 70) ** 2 + ((Y - 200) / 12) ** 2 < 1


def turning(k):
    """(h, w) of a body on its side, which turns."""
    return ((X - 160) / (45 + 25 * np.cos(0.4 * k))) ** 2 + ((Y - 80) / 35) ** 2 < 1


def view(kind, k):
    """An image before a room, and the mask that ends with the wall, or is whole."""
    slope, moved = 0.15 * (kind == "slanting"), (9 * k - 36) * (kind == "moving camera")
    above = Y - slope * (X - 160) - moved < 150
    image = np.where(above[..., None], WALL, FLOOR).astype(np.float64)
    if kind == "shade":
        image = WALL + np.clip((Y - 110) / 80, 0, 1)[..., None] * np.subtract(FLOOR, WALL)
    image *= np.where(SHADE, 0.7, 1.0)[..., None]
    under = PLATE if kind == "plate" else COLUMN
    image[under] = (60, 61, 62) if kind == "grey" else (190, 195, 200)
    image[turning(k)] = 50, 90, 50
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    image += np.random.default_rng(k).normal(0, 2, image.shape)
    whole = turning(k) | under
    mask = whole if kind in ("whole", "plate") else whole & above
    return np.clip(image, 0, 255).astype(np.uint8), mask


@pytest.mark.parametrize(
    ("kind", "along"),
    [
        ("cut", 1),
        ("slanting", 1),
        ("whole", 0),
        ("plate", 0),
        ("shade", 0),
        ("moving camera", 0),
    ],
)
def test_an_outline_that_ends_where_an_edge_goes_on_is_of_the_room(kind, along):
    room = RoomEdges()
    for k in range(8):
        room.add(*view(kind, k), EVERYWHERE)
    shares = room.shares()
    assert ((shares > SOME_ALONG_ROOM) if along else (shares < 0.1 * SOME_ALONG_ROOM)).all()


def test_views_of_different_sizes_have_no_room_in_common():
    room = RoomEdges()
    for k in range(6):
        shown = slice(0, SHAPE[1] - 10 * (k == 5))
        image, mask = (part[:, shown] for part in view("cut", k))
        room.add(image, mask, EVERYWHERE[:, shown])
    assert not room.shares().any()


def test_single_images_that_are_cut_by_the_room_say_so():
    seen = Outlines()
    for k in range(4):
        image = view("grey", k)[0]
        assert seen.add(image, camera_for(image), k)
    assert "along an edge of the room" in seen.doubt()
