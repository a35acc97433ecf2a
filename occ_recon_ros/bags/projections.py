"""Cameras of the data sets of multi-view stereo, each one matrix or three: Middlebury's *_par.txt
(https://vision.middlebury.edu/mview/data/), and cameras.npz of IDR and NeuS.

Where the first pixel is they do not say: it is taken to be where OpenCV has it, by which such
matrices are made. The scale_mat of cameras.npz, which moves the object into a sphere, is of no
matter here: the world is theirs, and its unit arbitrary.
"""

import re
from collections.abc import Callable, Collection, Sequence
from functools import partial
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.poses.convention import (
    FIRST_PIXEL,
    OTHER_CONVENTIONS,
    from_projection,
    nearest_rotation,
)

from .foreign import Lens, View, listed
from .foreign_files import find_images, image_folders
from .frames import Listing
from .mask_files import read_mask
from .photographs import by_number, image_size, images_in

PARAMETERS, MATRICES = "*_par.txt", "cameras*.npz"
_NUMBERS = 21  # of a line of Middlebury's: K and R by rows, t
_SKEW_PX = 0.1  # by which rows may be aslant that are taken to be straight
_NPZ_IMAGES, _NPZ_MASKS = ("image", "images", "rgb"), ("mask", "masks")
_LOOKED_AT = 3  # masks, whether they show anything
_MATRIX = re.compile(r"world_mat_(\d+)")
_Read = Callable[[], tuple[Array, Array, Array]]


def find_projections(folder: Path) -> Path | None:
    """The file of such cameras in a folder; of several the shortest name, for others are of parts
    of the images or of before something was refined."""
    found = [path for path in folder.glob(PARAMETERS) if _lines(path)]
    found = found or [
        path for path in folder.glob(MATRICES) if any(map(_MATRIX.fullmatch, npz_names(path)))
    ]
    return min(found, key=lambda path: (len(path.name), path.name), default=None)


def npz_names(path: Path) -> list[str]:
    """Names of the arrays of a file of NumPy; none of one that cannot be read."""
    try:
        with np.load(path) as file:
            return list(file.files)
    except (OSError, ValueError, BadZipFile, EOFError, AttributeError):
        return []


def read_projections(folder: Path, path: Path, masks: bool) -> Listing:
    """The frames of such a file.

    Args:
        folder: holds the images, or a folder that does.
        path: of the file.
        masks: leave them out if False.

    Raises:
        UserError: the file as a whole is wrong, or none of its images is there.
    """
    read = _from_npz if path.suffix == ".npz" else _from_lines
    views = [(one[0].name, partial(_view, *one)) for one in read(folder, path)]
    way = "its poses must lead from world to camera"
    listing = listed(path, way, views, folder if masks else None, ways=OTHER_CONVENTIONS)
    order = "its world_mat are of the images by their number; " if path.suffix == ".npz" else ""
    listing.remarks.append(f"{path}: {order}no distortion is told of, and none assumed")
    return listing


def _view(image: Path, where: str, read: _Read, mask: Path | None) -> View:
    with wrong_in(where):
        K, R, t = read()
        if abs(K[0, 1]) > _SKEW_PX or not (np.isfinite(K).all() and np.isfinite(t).all()):
            raise ValueError(f"K must be finite, with rows that are not aslant, not {K.tolist()}")
    size = image_size(image)
    if size is None:
        raise UserError(f"{where}: its image {image} cannot be read, or is not there")
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2] + FIRST_PIXEL, K[1, 2] + FIRST_PIXEL
    lens = Lens(size, {"fx": float(fx), "fy": float(fy), "cx": float(cx), "cy": float(cy)})
    return View(image, lens, (R, t), where, mask)


def _lines(path: Path) -> list[tuple[str, Array]]:
    """Name and numbers of each image of Middlebury's; none of a file that is another."""
    found = []
    try:
        for line in path.read_text(encoding="utf-8-sig").splitlines():
            name, *numbers = line.rsplit(maxsplit=_NUMBERS) or [""]
            if len(numbers) == _NUMBERS:
                found.append((name.strip(), np.array(numbers, float)))
    except (OSError, ValueError):
        return []
    return found


def _from_lines(folder: Path, path: Path) -> list[tuple[Path, str, _Read, Path | None]]:
    lines = _lines(path)
    files = find_images([folder, *image_folders(folder)], [name for name, _ in lines])
    if not files:
        raise UserError(f"{path}: none of its images ({lines[0][0]}, ...) is in {folder}")
    return [
        (files.get(name, folder / name), f"{path}: {name}", partial(_by_rows, numbers), None)
        for name, numbers in lines
    ]


def _by_rows(numbers: Array) -> tuple[Array, Array, Array]:
    K = numbers[:9].reshape(3, 3)
    return K / K[2, 2], nearest_rotation(numbers[9:18].reshape(3, 3)), numbers[18:]


def _from_npz(folder: Path, path: Path) -> list[tuple[Path, str, _Read, Path | None]]:
    with np.load(path) as file:
        matrices = {
            int(found[1]): np.asarray(file[name], float)
            for name in file.files
            if (found := _MATRIX.fullmatch(name))
        }
    images = _numbered(folder, _NPZ_IMAGES, matrices)
    if not images:
        raise UserError(
            f"{path} has {len(matrices)} world_mat: that many images, or images of their numbers, "
            f"must be in {folder / _NPZ_IMAGES[0]}"
        )
    masks = _numbered(folder, _NPZ_MASKS, images)
    if all(map(_is_white, [*masks.values()][:_LOOKED_AT])):  # as where the object is not told
        masks = {}
    return [
        (image, f"{path}: world_mat_{k}", partial(_of_matrix, matrices[k]), masks.get(k))
        for k, image in images.items()
    ]


def _is_white(mask: Path) -> bool:
    try:
        return bool(read_mask(mask).all())
    except UserError:
        return False


def _of_matrix(matrix: Array) -> tuple[Array, Array, Array]:
    if matrix.shape not in ((3, 4), (4, 4)):
        raise ValueError(f"it must be 4x4 numbers, not {'x'.join(map(str, matrix.shape))}")
    return from_projection(matrix[:3])


def _numbered(folder: Path, places: Sequence[str], wanted: Collection[int]) -> dict[int, Path]:
    """The files of the first of these folders that there is, by the number of their matrix: as
    many as there are in their order, else those whose names are such numbers."""
    for place in places:
        if (folder / place).is_dir() and (files := images_in(folder / place)):
            files.sort(key=lambda file: by_number(file.name))
            if len(files) == len(wanted):
                return dict(zip(sorted(wanted), files, strict=True))
            numbers = {int(f.stem): f for f in files if f.stem.isdecimal()}
            return {k: numbers[k] for k in sorted(wanted) if k in numbers}
    return {}
