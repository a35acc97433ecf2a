"""Photographs with cameras and masks -> the bag of a scan."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from msg_adapters import encode_camera_info, encode_image, encode_pose
from msg_adapters.pose import encode_pose_covariance
from occ_recon_ros.geometry import Camera

from .importing import CAMERA_FRAME
from .mask_files import read_mask
from .poses import OBJECT_FRAME
from .views import Progress
from .writer import choose_storage, new_bag

LONG_SIDE = 2048  # px, of the images that are kept: lenses of phones resolve no more


@dataclass(frozen=True)
class PosedPicture:
    """A photograph and where it was taken from.

    Attributes:
        image: (h, w) or (h, w, 3) BGR uint8.
        camera: the view, of the size of the image.
        stamp_ns: its stamp.
        mask: file of its mask, None where it has none.
        covariance: (6, 6) of the pose, as camera_pose_cov has it; None: not known.
        name: of its file, or which frame of a video it is.
        file: that it is from, None: a video.
    """

    image: NDArray[np.uint8]
    camera: Camera
    stamp_ns: int
    mask: Path | None = None
    covariance: NDArray[np.float64] | None = None
    name: str = ""
    file: Path | None = None


def write_scan_bag(
    pictures: Iterable[PosedPicture], count: int, bag: Path, progress: Progress, long_side: int
) -> None:
    """Write images with calibration, poses and masks as one bag.

    Args:
        pictures: in their order.
        count: how many they are.
        bag: where to.
        progress: told the images so far, and all of them.
        long_side: px; larger images, their cameras and masks are made so small. 0: none is.

    Raises:
        UserError: a mask that cannot be used, or the bag cannot be written.
    """
    names: dict[int, str] = {}
    with new_bag(bag, choose_storage(bag, None)) as writer:
        for picture in pictures:
            camera, stamp = picture.camera, picture.stamp_ns
            whole = camera.width, camera.height
            if (size := _kept_size(camera, long_side)) != whole:
                camera = camera.resized(*size)
            writer.put("/camera_info", encode_camera_info(camera, stamp, CAMERA_FRAME), stamp)
            if picture.covariance is not None:
                known = encode_pose_covariance(camera.pose, picture.covariance, stamp, OBJECT_FRAME)
                writer.put("/camera_pose_cov", known, stamp)
            writer.put("/camera_pose", encode_pose(camera, stamp, OBJECT_FRAME), stamp)
            if picture.mask is not None:
                mask = _made_small(read_mask(picture.mask, whole, picture.file), size)
                writer.put("/mask", encode_image(mask, stamp, CAMERA_FRAME), stamp)
            image = _made_small(picture.image, size)
            writer.put("/image", encode_image(image, stamp, CAMERA_FRAME), stamp)
            names[stamp] = picture.name
            progress(writer.counts["/image"], count)
        writer.name_images(names)


def made_small_lines(camera: Camera, long_side: int) -> list[str]:
    """That photographs are made smaller, in words; nothing where they are not.

    Args:
        camera: of the photographs.
        long_side: px; 0: they stay as they are.
    """
    longer, kept = max(camera.width, camera.height), max(_kept_size(camera, long_side))
    if kept == longer:
        return []
    return [
        f"photographs of {longer} px are made {kept} px small for all that follows (--size; "
        "0: as they are, which takes longer)"
    ]


def _kept_size(camera: Camera, long_side: int) -> tuple[int, int]:
    """Width and height that photographs are kept in, px; ``long_side`` as of ``write_scan_bag``."""
    width, height = camera.width, camera.height
    scale = min(1.0, long_side / max(width, height)) if long_side else 1.0
    return max(1, round(scale * width)), max(1, round(scale * height))


def _made_small(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    if image.shape[1::-1] == size:
        return image
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
