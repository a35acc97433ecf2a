"""Image folder and what it says of the cameras -> rosbag2."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters import check_precision, encode_camera_info, encode_image, encode_pose
from occ_recon_ros.errors import UserError, wrong_in

from .dataset import load_dataset, refuse_too_few
from .exposure import ends_of, nothing_to_see
from .frames import Frame
from .images import bits_used, orientation, read_image, turned
from .mask_layout import masks_laid_out
from .mask_shift import masks_in_place
from .poses import OBJECT_FRAME
from .taken_masks import TakenMasks
from .views import Progress
from .writer import choose_storage, new_bag

CAMERA_FRAME = "camera_optical_frame"


def import_folder(
    folder: Path,
    bag: Path,
    masks: bool = True,
    storage: str | None = None,
    overwrite: bool = False,
    progress: Progress = lambda done, total: None,
) -> tuple[dict[str, int], list[str], list[str]]:
    """Write the images, calibration and poses of a folder as one bag.

    Args:
        folder: see ``load_dataset``.
        bag: to be written.
        masks: those of the folder, else what an image's own transparency says.
        storage: mcap or sqlite3; None: by the suffix of the bag.
        overwrite: replace what is there.
        progress: told how many frames are done.

    Returns:
        Number of messages written by topic; a sentence for each frame, and for each mask, that
        cannot be used and was left out; and remarks on how the rest was taken.

    Raises:
        UserError: the folder is wrong as a whole, or too much of it, or the bag cannot be
            written. There is no new bag then.
    """
    storage = choose_storage(bag, storage)
    frames, left_out, remarks = load_dataset(folder, masks)
    if masks:
        frames, shaped = masks_laid_out(frames)
        frames, shifted = masks_in_place(frames)
        remarks = [*remarks, *shaped, *shifted]
    names = _names(folder, frames)
    taken = TakenMasks(frames, names) if masks else None
    bits = bits_used(frame.image for frame in frames)
    named, upright = dict[int, str](), 0
    ends: list[tuple[float, float]] = []
    with new_bag(bag, storage, overwrite) as writer:
        for done, frame in enumerate(frames, 1):
            try:
                image, as_read = _image(frame, bits)
            except UserError as error:
                left_out.append(str(error))
                continue
            upright += not as_read
            mask = None if taken is None else taken.take(frame, image)
            for topic, message in _messages(frame, image, mask):
                writer.put(topic, message, frame.stamp_ns)
            ends.append(ends_of(image))
            named[frame.stamp_ns] = names[frame.image]
            progress(done, len(frames))
        writer.name_images(named)
        refuse_too_few(writer.counts["/image"], left_out)
        if taken is not None:
            taken.refuse(folder)
    remarks += nothing_to_see([*named.values()], ends)
    if taken is not None:
        left_out += taken.left_out()
        remarks += taken.remarks()
    if upright:
        why = "as their EXIF data say: their calibration is of that"
        remarks.append(f"{upright} images are turned {why}")
    return dict(writer.counts), left_out, remarks


def _names(folder: Path, frames: Sequence[Frame]) -> dict[Path, str]:
    """What to call each image: its name, or where another has that, its place in the folder."""
    images = dict.fromkeys(frame.image for frame in frames)
    if len({image.name for image in images}) == len(images):
        return {image: image.name for image in images}
    return {image: Path(os.path.relpath(image, folder)).as_posix() for image in images}


def _image(frame: Frame, bits: int) -> tuple[NDArray[Any], bool]:
    """(h, w) or (h, w, 3) of the size that the calibration is of, and whether it was so as read."""
    with wrong_in(frame.image):
        check_precision(frame.camera)
    image = read_image(frame.image, bits)
    size, as_read = (frame.camera.width, frame.camera.height), True
    if image.shape[:2] == size != image.shape[1::-1]:
        image = turned(image, orientation(frame.image))
        as_read = image.shape[1::-1] != size
    _refuse_other_size(image, frame)
    return image, as_read


def _messages(
    frame: Frame, image: NDArray[Any], mask: NDArray[np.uint8] | None
) -> Iterator[tuple[str, Any]]:
    """The messages of one frame; the image comes last, when all that it needs is there."""
    yield "/camera_info", encode_camera_info(frame.camera, frame.stamp_ns, CAMERA_FRAME)
    yield "/camera_pose", encode_pose(frame.camera, frame.stamp_ns, OBJECT_FRAME)
    if mask is not None:
        yield "/mask", encode_image(mask, frame.stamp_ns, CAMERA_FRAME)
    yield "/image", encode_image(image, frame.stamp_ns, CAMERA_FRAME)


def _refuse_other_size(pixels: NDArray[Any], frame: Frame) -> None:
    (height, width), camera = pixels.shape[:2], frame.camera
    if (width, height) != (camera.width, camera.height):
        raise UserError(
            f"{frame.image} is {width}x{height}, its calibration is of {camera.width}x"
            f"{camera.height}: correct width, height and K, or take the right file"
        )
