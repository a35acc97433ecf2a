"""Photographs of an object on a turntable, without a board -> rosbag2 with poses."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters import encode_camera_info, encode_image, encode_pose
from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.imaging import ContourError, ContourTracker
from occ_recon_ros.poses.camera_yaml import read_camera
from occ_recon_ros.poses.turn_axis import FEWEST, TOO_FEW, TurnAxis, find_turn_axis
from occ_recon_ros.scene import coverage

from .importing import CAMERA_FRAME
from .photographs import FolderPictures, Pictures, find_masks, mask_of, usual_size
from .views import OBJECT_FRAME, Progress
from .writer import choose_storage, new_bag

_FRAMES = 72  # of a video that are used
_NAMED = 8  # images that are named of those left out
_EXIF = 0.1  # 1 sigma of the focal length that photographs tell, of itself
_RATE = 0.1  # 1 sigma of the turn of a video that was told: it was begun and ended by hand
_STILL = 0.2  # of the usual difference of two outlines, when nothing has turned
_SMALL = 400  # px, long side of the images in which outlines are compared
_USUAL = 1.2  # focal length of the longer side of an image, to begin with


@dataclass(frozen=True)
class TurnPoses:
    """What a look at all images gave.

    Attributes:
        axis: the cameras, a row an image that is used.
        names: of these images.
        images: how many there were.
        still: of these, images that are left out because the table stood still.
        left_out: names of others that are, and why.
        turn_deg: by how much the table was said to turn in all.
        turned_deg: by how much it turned from the first image that is used to the last.
        distance: of the camera from the axis that was assumed, metres.
    """

    axis: TurnAxis
    names: list[str]
    images: int
    still: int
    turn_deg: float
    turned_deg: float
    distance: float
    left_out: Mapping[str, str] = field(default_factory=dict)

    @property
    def report(self) -> dict[str, Any]:
        """As report.json holds it; ``warnings`` are doubts, in words."""
        axis, camera = self.axis, self.axis.cameras[0]
        return {
            "turn_deg": self.turn_deg,
            "turned_deg": self.turned_deg,
            "still_images": self.still,
            "assumed_distance_m": self.distance,
            "elevation_deg": axis.elevation_deg,
            "focal_px": float(camera.K[0, 0]),
            "apart_px": axis.apart_px,
            "rotation_sigma_deg": axis.rotation_deg,
            "focal_sigma_percent": 100 * axis.focal,
            "left_out": dict(self.left_out),
            "warnings": list(axis.doubts),
        }

    @property
    def lines(self) -> list[str]:
        """The result in words."""
        axis, camera = self.axis, self.axis.cameras[0]
        focal = "as given" if not axis.focal else "found too"
        found = [f"left out: {name}: {why}" for name, why in self.left_out.items()]
        if len(found) > _NAMED:
            found[_NAMED:] = [f"left out: {len(found) - _NAMED} images more"]
        if self.still:
            found.append(f"in {self.still} images the table stood still: they are left out")
        if axis.rate != 1.0:
            found.append(
                f"from the first image that is used to the last the table turned by "
                f"{self.turned_deg:.1f} degrees"
            )
        return [
            *found,
            f"{len(self.names)} of {self.images} images are used; the axis was found from their "
            f"outlines: the camera looks down by {axis.elevation_deg:.1f} degrees, focal length "
            f"{camera.K[0, 0]:.0f} px ({focal}); outlines {axis.apart_px:.2f} px apart",
            f"the unit is arbitrary: outlines know no scale, so that the camera was taken to be "
            f"{self.distance:g} m from the axis (--distance)",
        ]


def find_turn(
    pictures: Pictures,
    camera_file: Path | None,
    masks: Path | None,
    turn_deg: float,
    distance: float,
    progress: Progress,
) -> TurnPoses:
    """Look at all images and find the axis that they turned about.

    Args:
        pictures: the images, in equal steps.
        camera_file: camera_info YAML; None: the focal length is found too.
        masks: folder of masks, or None to find the outlines in the images.
        turn_deg: by how much the table turned, as many steps as images; in either direction.
        distance: of the camera from the axis, metres.
        progress: told the images so far, and all of them.

    Raises:
        UserError: no axis can be had, in words.
    """
    if not 0 < distance < 1e3 or not 0 < abs(turn_deg) <= 3600:
        raise UserError("--distance must be above 0 (metres), --turn a number of degrees")
    every = 1 if isinstance(pictures, FolderPictures) else -(-len(pictures) // _FRAMES) or 1
    tracker, camera, sigma = ContourTracker(), None, 0.0
    files: Mapping[str, Path] | None = None
    if masks is not None and isinstance(pictures, FolderPictures):
        files = find_masks(masks, [file.name for file in pictures.files])
    names: list[str] = []
    contours: list[Contours] = []
    numbers: list[int] = []
    apart: list[float] = []
    last: NDArray[np.float32] | None = None
    left_out: dict[str, str] = {}
    count, others, usual = 0, 0, usual_size(pictures)
    for count, (name, stamp, image) in enumerate(pictures, 1):
        progress(count, max(len(pictures), count))
        if (count - 1) % every:
            continue
        if files is not None and name not in files:
            left_out[name] = "without a mask"
            continue
        if not image.size:
            left_out[name] = "truncated or damaged"
            continue
        size = image.shape[1::-1]
        if camera is None:
            with wrong_in(pictures.name):
                first = usual if any(usual) else size
                camera, sigma = _lens(camera_file, pictures.focal_px(), first)
        if size != (camera.width, camera.height):
            left_out[name] = f"{size[0]}x{size[1]} and not {camera.width}x{camera.height}"
            others += 1
            continue
        try:
            mask = mask_of(files[name], size) if files is not None else None
            found = tracker.process(image, camera, stamp, OBJECT_FRAME, mask)
        except (ContourError, UserError) as error:
            left_out[name] = str(error)
            continue
        numbers.append(count - others - 1)
        names.append(name)
        contours.append(found)
        small = _small(found, size)
        if last is not None:
            apart.append(float(np.abs(small - last).mean()))
        last = small
    if camera is None:
        raise UserError(f"{pictures.name} holds no images")
    if len(contours) < FEWEST:
        raise UserError(f"{pictures.name}: {TOO_FEW.format(len(contours))}")
    by_hand = not isinstance(pictures, FolderPictures)
    turned, kept = _turned(np.array(apart), np.diff(numbers), by_hand)
    # As many steps as images of that size: of a whole turn the last leads on to the first.
    unseen = numbers[0] + count - others - numbers[-1]
    whole = turned[-1] + unseen * float(turned[-1] > turned[-2])
    angles = np.deg2rad(turn_deg) * turned / whole
    rate = _RATE if by_hand else 0.0
    without = "; ".join(f"{name}: {why}" for name, why in left_out.items())
    with wrong_in(f"{pictures.name} (left out: {without})" if without else pictures.name):
        axis = find_turn_axis(
            [contours[k] for k in kept], camera, angles[kept], sigma, distance, rate
        )
    still = len(contours) - len(kept)
    turned_deg = float(np.rad2deg(axis.rate * np.ptp(angles[kept])))
    used = [names[k] for k in kept]
    return TurnPoses(axis, used, count, still, turn_deg, turned_deg, distance, left_out)


def _small(contours: Contours, size: tuple[int, int]) -> NDArray[np.float32]:
    """(h, w) the share of each pixel that the outlines hold, in little."""
    scale = min(1.0, _SMALL / max(size))
    width, height = (max(1, round(scale * side)) for side in size)
    loops = [scale * (uv + 0.5) - 0.5 for uv in contours.by_loop(contours.uv)]
    return coverage(loops, width, height).astype(np.float32)


def _turned(apart: Array, steps: NDArray[np.intp], by_hand: bool) -> tuple[Array, NDArray[np.intp]]:
    """(n,) by how much the table has turned at each image, in images, and which to use.

    Args:
        apart: (n - 1,) how far apart the outlines of one image and the next are.
        steps: (n - 1,) images from one of them to the next.
        by_hand: the table starts and stops at any time, and not at an image.
    """
    usual = float(np.percentile(apart, 75))
    still = apart < _STILL * usual
    before, after = np.append(False, still), np.append(still, False)
    part = np.where(still, 0.0, 1.0)
    if by_hand:
        beside = ~still & (before[:-1] | after[1:])
        part[beside] = np.minimum(apart[beside] / usual, 1.0)
    turned = np.append(0.0, np.cumsum(part * steps))
    return turned, np.flatnonzero(~before & ~after if by_hand else ~before)


def _lens(
    camera_file: Path | None, focal_px: float | None, size: tuple[int, int]
) -> tuple[Camera, float]:
    """The camera, and the sigma of the logarithm of its focal length."""
    if camera_file is not None:
        camera = read_camera(camera_file)
        if (camera.width, camera.height) != size:
            raise ValueError(
                f"the images are {size[0]}x{size[1]}, {camera_file} is of "
                f"{camera.width}x{camera.height}"
            )
        return camera, 0.0
    f = focal_px or _USUAL * max(size)
    K = np.array([[f, 0, 0.5 * (size[0] - 1)], [0, f, 0.5 * (size[1] - 1)], [0, 0, 1]])
    camera = Camera(K, *size, R_camera_object=np.eye(3), t_camera_object=np.zeros(3))
    return camera, _EXIF if focal_px else np.inf


def write_turn(
    pictures: Pictures, found: TurnPoses, bag: Path, masks: Path | None, progress: Progress
) -> None:
    """Write the images that are used, with calibration, poses and masks, as one bag.

    Raises:
        UserError: a mask that cannot be used, or the bag cannot be written.
    """
    cameras = dict(zip(found.names, found.axis.cameras, strict=True))
    files = find_masks(masks, found.names) if masks is not None else {}
    with new_bag(bag, choose_storage(bag, None)) as writer:
        for name, stamp, image in pictures:
            if name not in cameras:
                continue
            camera = cameras[name]
            writer.put("/camera_info", encode_camera_info(camera, stamp, CAMERA_FRAME), stamp)
            writer.put("/camera_pose", encode_pose(camera, stamp, OBJECT_FRAME), stamp)
            if name in files:
                size = (camera.width, camera.height)
                mask = encode_image(mask_of(files[name], size), stamp, CAMERA_FRAME)
                writer.put("/mask", mask, stamp)
            writer.put("/image", encode_image(image, stamp, CAMERA_FRAME), stamp)
            progress(writer.counts["/image"], len(cameras))
