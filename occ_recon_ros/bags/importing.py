"""Image folder and cameras.json -> rosbag2."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters import encode_camera_info, encode_image, encode_pose
from occ_recon_ros.errors import UserError

from .dataset import Frame, load_dataset
from .images import read_cut_out, read_image, read_mask
from .views import OBJECT_FRAME, Progress
from .writer import choose_storage, new_bag

CAMERA_FRAME = "camera_optical_frame"


def import_folder(
    folder: Path,
    bag: Path,
    masks: bool = True,
    storage: str | None = None,
    overwrite: bool = False,
    progress: Progress = lambda done, total: None,
) -> dict[str, int]:
    """Write the images, calibration and poses of a folder as one bag.

    Args:
        folder: with cameras.json, see ``load_dataset``.
        bag: to be written.
        masks: those that cameras.json names, else what an image's own transparency says.
        storage: mcap or sqlite3; None: by the suffix of the bag.
        overwrite: replace what is there.
        progress: told how many frames are done.

    Returns:
        Number of messages written by topic.

    Raises:
        UserError: something in the folder is missing or wrong, or the bag cannot be
            written. There is no new bag then.
    """
    storage = choose_storage(bag, storage)
    frames = load_dataset(folder, masks)
    with new_bag(bag, storage, overwrite) as writer:
        for done, frame in enumerate(frames, 1):
            for topic, message in _messages(frame, masks):
                writer.put(topic, message, frame.stamp_ns)
            progress(done, len(frames))
    return dict(writer.counts)


def _messages(frame: Frame, masks: bool) -> Iterator[tuple[str, Any]]:
    """The messages of one frame; the image comes last, when all that it needs is there."""
    image = _sized(read_image(frame.image), frame, frame.image)
    yield "/camera_info", encode_camera_info(frame.camera, frame.stamp_ns, CAMERA_FRAME)
    yield "/camera_pose", encode_pose(frame.camera, frame.stamp_ns, OBJECT_FRAME)
    mask = read_mask(frame.mask) if frame.mask is not None else None
    if mask is None and masks:
        mask = read_cut_out(frame.image)
    if mask is not None:
        mask = _sized(mask, frame, frame.mask or frame.image)
        yield "/mask", encode_image(mask, frame.stamp_ns, CAMERA_FRAME)
    yield "/image", encode_image(image, frame.stamp_ns, CAMERA_FRAME)


def _sized(pixels: NDArray[Any], frame: Frame, path: Path) -> NDArray[np.uint8]:
    height, width = pixels.shape[:2]
    expected = (frame.camera.width, frame.camera.height)
    if (width, height) != expected:
        raise UserError(
            f"{path} is {width}x{height}, cameras.json says {expected[0]}x{expected[1]}: "
            "correct width, height and K, or take the right file"
        )
    return pixels
