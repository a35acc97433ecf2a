"""cameras.json of 3D Gaussian splatting (https://github.com/graphdeco-inria/gaussian-splatting).

A list of ``img_name``, ``width``, ``height``, ``fx``, ``fy`` in pixels, and of the camera's place
``position`` and its axes ``rotation`` in the world, x right, y down and z forward as ours. The
principal point is the middle. It has the name of our own file, which is no list.
"""

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from occ_recon_ros.errors import UserError, wrong_in
from occ_recon_ros.poses.convention import nearest_rotation

from .foreign import Lens, View, listed
from .foreign_files import find_images, image_folders
from .frames import Listing
from .json_fields import array, file_name, number, pixels


def splats_of(path: Path) -> list[dict[str, Any]]:
    """Such a list; an empty one of a file that is another."""
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return []
    rows = content if isinstance(content, list) else []
    return rows if all(isinstance(row, dict) and "img_name" in row for row in rows) else []


def read_splats(path: Path, masks: bool) -> Listing:
    """The frames of such a file.

    Args:
        path: of the file; the images are in its folder, or a folder there.
        masks: leave them out if False.

    Raises:
        UserError: none of its images is there.
    """
    folder, content = path.parent, splats_of(path)
    names = [str(row["img_name"]) for row in content]
    files = find_images(image_folders(folder), names)
    if not files:
        raise UserError(
            f"{path} is of Gaussian splatting, and none of its images ({names[0]}, ...) is in "
            f"{folder / 'images'}: put those there that it was made of"
        )
    views = [
        (name, partial(_view, files.get(name, folder / name), f"{path}: {name}", row))
        for name, row in zip(names, content, strict=True)
    ]
    way = "its rotation and position must lead from camera to world"
    listing = listed(path, way, views, folder if masks else None)
    listing.remarks.append(
        f"{path} is of Gaussian splatting: no distortion is told of, and none assumed, and the "
        "principal point is the middle"
    )
    return listing


def _view(image: Path, where: str, row: dict[str, Any]) -> View:
    file_name(row, "img_name", where)
    if not image.is_file():
        raise UserError(f"{where}: there is no such image")
    size = pixels(row, "width", where), pixels(row, "height", where)
    focal = {name: number(row, name, where) for name in ("fx", "fy")}
    with wrong_in(where):
        R = nearest_rotation(array(row, "rotation", (3, 3), where).T)
    t = -R @ np.asarray(array(row, "position", (3,), where))
    return View(image, Lens(size, focal | {"cx": size[0] / 2, "cy": size[1] / 2}), (R, t), where)
