"""poses_bounds.npy of LLFF (https://github.com/Fyusion/LLFF), the poses of forward-facing scenes.

A row an image, in the order of their names: 3x5 numbers by rows, and the nearest and farthest depth
of what it sees, of no matter here. The columns are the axes of the camera, down, right and back, in
the world, its place there, and height, width and focal length in pixels, of the images in full
size: one focal length, the principal point in the middle.
"""

from functools import partial
from pathlib import Path

import numpy as np

from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.poses.convention import nearest_rotation

from .foreign import Lens, View, listed
from .foreign_files import image_folders
from .frames import Listing
from .photographs import images_in, is_mask_name

POSES = "poses_bounds.npy"
_NUMBERS = 17


def read_poses_bounds(folder: Path, masks: bool) -> Listing:
    """The frames of such a file.

    Args:
        folder: holds it, and the images or a folder of them.
        masks: leave them out if False.

    Raises:
        UserError: it is another file, or there are not as many images.
    """
    path = folder / POSES
    rows = _rows(path)
    images = _images(folder, path, len(rows))
    views = [
        (image.name, partial(_view, image, f"{path}: row {k} ({image.name})", row))
        for k, (image, row) in enumerate(zip(images, rows, strict=True))
    ]
    way = "its poses must lead from camera to world"
    listing = listed(path, way, views, folder if masks else None)
    listing.remarks.append(
        f"{path}: its rows are of the images in {images[0].parent} in the order of their names, "
        f"from {images[0].name} to {images[-1].name}; no distortion is told of, and none assumed, "
        "and the principal point is the middle"
    )
    return listing


def _rows(path: Path) -> Array:
    """(n, 17) float64."""
    try:
        rows = np.asarray(np.load(path, allow_pickle=False), float)
    except (OSError, ValueError, EOFError) as error:
        raise UserError(f"{path} cannot be read: {error}") from None
    if rows.ndim != 2 or rows.shape[1] != _NUMBERS or not len(rows):
        shape = "x".join(map(str, rows.shape))
        raise UserError(f"{path} must have {_NUMBERS} numbers an image, not {shape} in all")
    return rows


def _images(folder: Path, path: Path, wanted: int) -> list[Path]:
    """The images, in the order in which LLFF takes them: by their names as text."""
    counts: dict[str, int] = {}
    for place in image_folders(folder):
        images = images_in(place) if place.is_dir() else []
        images = [image for image in images if not is_mask_name(image.name)]
        if len(images) == wanted:
            return sorted(images, key=lambda image: image.name)
        if images:
            counts[str(place)] = len(images)
    there = ", ".join(f"{count} in {place}" for place, count in counts.items()) or "there are none"
    raise UserError(
        f"{path} has {wanted} rows, one an image in the order of their names: as many images must "
        f"be in {folder / 'images'}; {there}. Leave there those alone that it was made of, or give "
        "the model of COLMAP that it was made from"
    )


def _view(image: Path, where: str, row: Array) -> View:
    down, right, back, centre, (height, width, focal) = row[:15].reshape(3, 5).T
    with wrong_in(where):
        if not np.isfinite(row[:15]).all() or min(height, width, focal) <= 0:
            raise ValueError(f"it must be finite, with sizes above 0, not {row[:15].tolist()}")
        R = nearest_rotation(np.array([right, down, -back]))
    middle = {"cx": width / 2, "cy": height / 2}
    lens = Lens((round(width), round(height)), {"fx": float(focal), "fy": float(focal), **middle})
    return View(image, lens, (R, -R @ centre), where)
