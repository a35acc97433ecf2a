"""A surface drawn into the images that it was made from."""

from pathlib import Path

import cv2
import numpy as np

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.places import make_folder, refuse_full
from occ_recon_ros.bags.views import BagViews, Progress
from occ_recon_ros.errors import UserError
from occ_recon_ros.evaluation.corrected import cameras_beside
from occ_recon_ros.evaluation.meshes import read_mesh

from .pictures import as_bgr8, as_strip
from .shading import Shader

_GAP = 8


def render(
    mesh_path: Path, views: BagViews, out: Path, chosen: str, overwrite: bool, progress: Progress
) -> list[Path]:
    """Write a picture a view: the image, and beside it the shaded surface drawn into it.

    As in figures 11 to 13, e and f, of Boyer and Berger 1997.

    Args:
        mesh_path: drawn in its vertex colours where it has any.
        views: give images and calibrated cameras, unless the replay that wrote the mesh has
            corrected these.
        out: folder for view_0000.png and so on, by the number of the view in the bag.
        chosen: numbers of views with commas between, or "all".
        overwrite: whether pictures that are there may be replaced.

    Raises:
        UserError: a file that cannot be used, a view that is not there, a folder in use.
    """
    mesh = read_mesh(mesh_path)
    views.changes = Changes(cameras=cameras_beside(mesh_path, views))
    wanted = _numbers(chosen, len(views))
    refuse_full(out, overwrite)
    make_folder(out)
    shader = Shader(as_strip(mesh))
    written = []
    for number, view in enumerate(views):
        if number not in wanted:
            continue
        photograph = as_bgr8(view.image)
        height, width = photograph.shape[:2]
        drawn = shader.draw(view.camera, (0, 0, width, height), height, photograph)
        gap = np.full((height, _GAP, 3), 255, np.uint8)
        path = out / f"view_{number:04d}.png"
        if not cv2.imwrite(str(path), np.hstack([photograph, gap, drawn])):
            raise UserError(f"cannot write {path}")
        written.append(path)
        progress(len(written), len(wanted))
    if not written:
        missing = "image, camera_info and camera_pose must meet"
        raise UserError(f"{views.bag.path} has no whole frame: {missing}")
    return written


def _numbers(chosen: str, count: int) -> set[int]:
    """The views that are asked for."""
    if chosen == "all":
        return set(range(count))
    try:
        numbers = {int(part) for part in chosen.split(",")}
    except ValueError:
        raise UserError(f"--views {chosen}: write numbers with commas between, or all") from None
    beyond = sorted(n for n in numbers if not 0 <= n < count)
    if beyond:
        raise UserError(f"--views {chosen}: there is no view {beyond[0]}, the last is {count - 1}")
    return numbers
