"""The outlines in photographs or a video of a turn, and in which of them the table stood still."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.imaging import ContourError, ContourTracker
from occ_recon_ros.poses.camera_yaml import read_camera
from occ_recon_ros.scene import coverage

from .mask_files import read_mask
from .photographs import FolderPictures, Pictures, cut_outs, find_masks
from .poses import OBJECT_FRAME
from .views import Progress

_FRAMES = 72  # of a video that are used
_EXIF = 0.1  # 1 sigma of the focal length that photographs tell, of itself
_STILL = 0.2  # of the usual difference of two outlines, or photographs, when nothing has turned
_AGAIN = 0.5  # of the same, nearer than which no image is but that of the same angle
_MANY, _END, _SLOW = 11, 0.1, 0.5  # steps; share of them at an end; of those in the middle
_SMALL = 100  # px, long side of the images in which they are compared, all with all
_NOISE = 1.0  # px of these, 1 sigma of the blur without which noise would be all they differ by
_USUAL = 1.2  # focal length of the longer side of an image, to begin with


@dataclass(frozen=True)
class TurnOutlines:
    """Images in which there is an outline, a row each.

    Attributes:
        camera: the lens, with one focal length for all.
        focal_sigma: of the logarithm of that; 0 where it is known, infinite where it is not.
        names: of the images.
        contours: in them.
        numbers: their places among the images of that size.
        apart: (n, n, 2) float32, how far each outline is from that of each other row, and the same
            of the images themselves.
        images: how many there were.
        unseen: of them, those of that size before the first row and from the last row on.
        masks: file of each photograph that has one, by name.
        left_out: names of images without an outline, and why.
    """

    camera: Camera
    focal_sigma: float
    names: list[str]
    contours: list[Contours]
    numbers: list[int]
    apart: NDArray[np.float32]
    images: int
    unseen: int
    masks: Mapping[str, Path]
    left_out: Mapping[str, str]

    @property
    def outlines_apart(self) -> Array:
        """(n - 1,) float64, how far each outline is from that of the row before."""
        return self._from_before(0)

    @property
    def pixels_apart(self) -> Array:
        """(n - 1,) float64, the same of the images themselves."""
        return self._from_before(1)

    @property
    def alike(self) -> Array:
        """(n, n, 2) float64, how far both are from each other row, in usual differences of
        neighbours. There are two rows at least."""
        usual = np.maximum(_usual(self), np.finfo(np.float32).tiny)
        return np.asarray(self.apart / usual, np.float64)

    def _from_before(self, which: int) -> Array:
        return np.diagonal(self.apart[..., which], 1).astype(np.float64)


def find_outlines(
    pictures: Pictures, camera_file: Path | None, masks: Path | None, progress: Progress
) -> TurnOutlines:
    """Look for the outline in all photographs, or in some frames of a video.

    Args:
        pictures: the images.
        camera_file: camera_info YAML; None: the focal length is that of EXIF, or a guess.
        masks: folder of masks; None: photographs that the object was cut out of are their own.
        progress: told the images so far, and all of them.

    Raises:
        UserError: there are no images, or the camera or the masks are not theirs.
    """
    every, tracker, camera = 1, ContourTracker(), None
    files: Mapping[str, Path] = {}
    if not isinstance(pictures, FolderPictures):
        every = -(-len(pictures) // _FRAMES) or 1
    elif masks is not None:
        files = find_masks(masks, [file.name for file in pictures.files])
    else:
        files = cut_outs(pictures)
    names: list[str] = []
    contours: list[Contours] = []
    numbers: list[int] = []
    small: list[NDArray[np.float32]] = []
    left_out: dict[str, str] = {}
    count, others = 0, 0
    for count, (name, stamp, image) in enumerate(pictures, 1):
        progress(count, max(len(pictures), count))
        if (count - 1) % every:
            continue
        if masks is not None and files and name not in files:
            left_out[name] = "without a mask"
            continue
        if not image.size:
            left_out[name] = "truncated or damaged"
            continue
        size = image.shape[1::-1]
        if camera is None:
            with wrong_in(pictures.name):
                usual = pictures.size if any(pictures.size) else size
                camera, sigma = _lens(camera_file, pictures.focal_px(), usual)
        if size != (camera.width, camera.height):
            left_out[name] = f"{size[0]}x{size[1]} and not {camera.width}x{camera.height}"
            others += 1
            continue
        try:
            mask = read_mask(files[name], size, pictures.file(name)) if name in files else None
            found = tracker.process(image, camera, stamp, OBJECT_FRAME, mask)
        except (ContourError, UserError) as error:
            left_out[name] = str(error)
            continue
        numbers.append(count - others - 1)
        names.append(name)
        contours.append(found)
        small.append(np.stack([_small_outline(found, size), _small_image(image)]))
    if camera is None:
        raise UserError(f"{pictures.name} holds no images")
    return TurnOutlines(
        camera=camera,
        focal_sigma=sigma,
        names=names,
        contours=contours,
        numbers=numbers,
        apart=_all_apart(small),
        images=count,
        unseen=numbers[0] + count - others - numbers[-1] if numbers else 0,
        masks=files,
        left_out=left_out,
    )


def turned_by(seen: TurnOutlines, by_hand: bool) -> tuple[Array, NDArray[np.intp]]:
    """(n,) by how much the table has turned at each row, in images, and which rows to use.

    Args:
        seen: the outlines.
        by_hand: the table starts and stops at any time, and not at an image.
    """
    if len(seen.names) < 2:
        return np.zeros(len(seen.names)), np.arange(len(seen.names))
    usual, as_usual = _usual(seen)
    still = seen.outlines_apart < _STILL * usual
    if not by_hand:  # outlines that are wrong, all of the image, may be alike
        still &= seen.pixels_apart < _STILL * as_usual
    before, after = np.append(False, still), np.append(still, False)
    part = np.where(still, 0.0, 1.0)
    if by_hand:
        beside = ~still & (before[:-1] | after[1:])
        part[beside] = np.minimum(seen.outlines_apart[beside] / usual, 1.0)
    turned = np.append(0.0, np.cumsum(part * np.diff(seen.numbers)))
    return turned, np.flatnonzero(~before & ~after if by_hand else ~before)


def comes_round(seen: TurnOutlines) -> bool:
    """Whether the last image is the first again, taken when a whole turn was over."""
    if len(seen.names) < 3 or seen.unseen > 1:
        return False
    return bool((seen.alike[-1, 0] < _STILL).all())


def first_again(seen: TurnOutlines) -> int | None:
    """The row before the last whose image is nearly the first again: the turn went on beyond it.
    None where none is nearer to the first than the last."""
    count = len(seen.names)
    if count < _MANY:
        return None
    row = count // 2 + int(np.argmin(seen.apart[count // 2 :, 0, 0]))
    alike = (seen.alike[row, 0] < _AGAIN).all()
    return row if alike and row < count - 1 else None


def nearest_before(seen: TurnOutlines, row: int) -> int:
    """The earlier row that a row is clearly nearest to; that before it where none is."""
    alike = seen.alike[row, :row].max(axis=1)
    nearest = int(np.argmin(alike))
    return nearest if alike[nearest] < _AGAIN * alike[-1] else row - 1


def places_again(seen: TurnOutlines) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """(n,) where the table was at each row, in images, if it may have been there before, and (n,)
    the row before that shows it there, -1 at places that are new.

    A place that is new is the next one to that of the row before.
    """
    alike, numbers = seen.alike, np.array(seen.numbers, np.intp)
    places, shown = np.zeros(len(alike), np.intp), np.full(len(alike), -1)
    for k in range(1, len(alike)):
        nearest = int(np.argmin(alike[k, :k].sum(axis=1)))
        if (alike[k, nearest] < (_STILL, _AGAIN)).all():
            shown[k] = nearest if shown[nearest] < 0 else shown[nearest]
            places[k] = places[nearest]
        else:
            places[k] = places[k - 1] + numbers[k] - numbers[k - 1]
    return places, shown


def slow_at_its_ends(seen: TurnOutlines) -> bool:
    """Whether images differ by little from their neighbours at both ends, by much in the middle."""
    count = len(seen.pixels_apart)
    if count < _MANY:
        return False
    few = max(2, round(_END * count))
    middle = float(np.median(seen.pixels_apart[count // 4 : -(count // 4)]))
    ends = seen.pixels_apart[:few], seen.pixels_apart[-few:]
    return all(float(np.median(end)) < _SLOW * middle for end in ends)


def _usual(seen: TurnOutlines) -> tuple[float, float]:
    """How far outlines, and images, are from those before when the table has turned."""
    a, b = (float(np.percentile(d, 75)) for d in (seen.outlines_apart, seen.pixels_apart))
    return a, b


def _all_apart(small: list[NDArray[np.float32]]) -> NDArray[np.float32]:
    """(n, n, 2) mean differences of n (2, h, w) outlines and images in little."""
    every = np.array(small)
    rows = [np.abs(every - one).mean(axis=(2, 3)) for one in small]
    return np.array(rows, np.float32).reshape(len(small), len(small), 2)


def _small_outline(contours: Contours, size: tuple[int, int]) -> NDArray[np.float32]:
    """(h, w) the share of each pixel that the outlines hold, in little."""
    scale = min(1.0, _SMALL / max(size))
    width, height = (max(1, round(scale * side)) for side in size)
    loops = [scale * (uv + 0.5) - 0.5 for uv in contours.by_loop(contours.uv)]
    return coverage(loops, width, height).astype(np.float32)


def _small_image(image: NDArray[Any]) -> NDArray[np.float32]:
    """(h, w) an image in grey and in little, of its mean: exposures may differ."""
    grey = image.mean(axis=2) if image.ndim == 3 else image
    scale = min(1.0, _SMALL / max(grey.shape))
    size = [max(1, round(scale * side)) for side in grey.shape[::-1]]
    small = cv2.resize(grey.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), _NOISE)
    return np.asarray(small / max(1.0, float(small.mean())), np.float32)


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
