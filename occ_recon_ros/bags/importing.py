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
from .exposure import ends_of, listed, nothing_to_see
from .frames import Frame
from .images import bits_used, orientation, read_image, turned
from .mask_files import (
    INVERTED,
    masks_may_go,
    misdrawn,
    read_cut_out,
    read_mask_as,
    refuse_misdrawn,
)
from .mask_layout import masks_laid_out
from .mask_shadow import hold_shadows, without_shadow
from .mask_shift import masks_in_place
from .photographs import image_size
from .poses import OBJECT_FRAME
from .views import Progress
from .writer import choose_storage, new_bag

CAMERA_FRAME = "camera_optical_frame"
_NAMED = 3  # masks that are left out: of more the first


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
    shadowed, unshaded = masks and hold_shadows(frames), 0
    maskless, uncut = list[str](), list[str]()
    wrong, empty, fitted, upright, cut_outs = list[str](), list[str](), 0, 0, 0
    bits = bits_used(frame.image for frame in frames)
    names, taken = _names(folder, frames), dict[int, str]()
    ends: list[tuple[float, float]] = []
    with new_bag(bag, storage, overwrite) as writer:
        for done, frame in enumerate(frames, 1):
            try:
                with wrong_in(frame.image):
                    check_precision(frame.camera)
                image = read_image(frame.image, bits)
                size = frame.camera.width, frame.camera.height
                if image.shape[:2] == size != image.shape[1::-1]:
                    image = turned(image, orientation(frame.image))
                    upright += image.shape[1::-1] == size
                _refuse_other_size(image, frame)
            except UserError as error:
                left_out.append(str(error))
                continue
            mask, cut_out = None, False
            try:
                mask, cut_out = _mask(frame) if masks else (None, False)
            except UserError as error:
                maskless.append(str(error))
            cut_outs += cut_out
            if mask is None and frame.mask is None:
                uncut.append(names[frame.image])
            if mask is not None:
                if not (mask > 127).any():
                    empty.append(names[frame.image])
                wrong.append(misdrawn(mask))
                if wrong[-1] == INVERTED:  # of some of them, for of most they are refused
                    mask = ~mask
                elif wrong[-1]:
                    how = wrong[-1].removeprefix("masks are ")
                    maskless.append(f"{frame.mask or frame.image} is {how}")
                    mask = None
            if mask is not None:
                if shadowed:
                    whole, mask = mask, without_shadow(mask)
                    unshaded += mask is not whole
                fitted += (image_size(frame.mask or frame.image) or image.shape[1::-1]) != (
                    image.shape[1::-1]
                )
            for topic, message in _messages(frame, image, mask):
                writer.put(topic, message, frame.stamp_ns)
            ends.append(ends_of(image))
            taken[frame.stamp_ns] = names[frame.image]
            progress(done, len(frames))
        writer.name_images(taken)
        refuse_too_few(writer.counts["/image"], left_out)
        with masks_may_go():
            refuse_misdrawn(wrong, folder)
            refuse_too_few(writer.counts["/mask"], maskless)
    if len(maskless) > _NAMED:
        left_out.append(f"{len(maskless)} masks, but not their images; the first: {maskless[0]}")
    else:
        left_out += [f"{why}; its image is taken" for why in maskless]
    own = {frame.image for frame in frames if frame.mask is None}
    if 0 < len(uncut) < len(own):
        said = f"{len(uncut)} of {len(own)} images that should hold their masks"
        remarks = [*remarks, f"{said} have none, no transparency that cuts out: {listed(uncut)}"]
    if empty:
        said = f"{len(empty)} of {len(wrong)} masks are black, and show no object"
        remarks = [*remarks, said + (f": {listed(empty)}" if len(empty) < len(wrong) else "")]
    remarks = [*remarks, *nothing_to_see([*taken.values()], ends)]
    if cut_outs:
        said = f"{cut_outs} masks are photographs cut out on a plain colour"
        remarks = [*remarks, f"{said}: what is left of each is taken for the object"]
    if unshaded:
        said = (
            f"{unshaded} masks half cover a shadow beside the object, along no edge of their images"
        )
        remarks = [*remarks, f"{said}: it is left out"]
    if fitted:
        remarks = [*remarks, f"{fitted} masks are of another size than their images, and made so"]
    if turned_back := wrong.count(INVERTED):
        said = f"{turned_back} of {len(wrong)} masks are white along the border and black within"
        remarks = [*remarks, f"{said}, unlike the others: they are taken inverted"]
    if upright:
        why = "as their EXIF data say: their calibration is of that"
        remarks = [*remarks, f"{upright} images are turned {why}"]
    return dict(writer.counts), left_out, remarks


def _names(folder: Path, frames: Sequence[Frame]) -> dict[Path, str]:
    """What to call each image: its name, or where another has that, its place in the folder."""
    images = dict.fromkeys(frame.image for frame in frames)
    if len({image.name for image in images}) == len(images):
        return {image: image.name for image in images}
    return {image: Path(os.path.relpath(image, folder)).as_posix() for image in images}


def _mask(frame: Frame) -> tuple[NDArray[np.uint8] | None, bool]:
    """(h, w) that came with a frame, or that its image holds in itself; and whether it is a file
    of the photograph cut out."""
    if frame.mask is None:
        return read_cut_out(frame.image), False
    size = frame.camera.width, frame.camera.height
    return read_mask_as(frame.mask, size, frame.image, frame.layout)


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
