"""Pictures of a result for people: photographs with contours above, the surface below."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.visual import ColorVisuals

from occ_recon_ros.bags.views import BagViews, Progress
from occ_recon_ros.geometry import Contours
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.imaging import draw_contours
from occ_recon_ros.surface import Strip

from .heard import Heard
from .shading import Box, Shader
from .solid import Solid, error_colours, error_limit_m

Picture = NDArray[Any]  # (h, w, 3) uint8 BGR

_PANEL_HEIGHT = 480
_MOST_ENLARGED = 2.0
_WIDEST_PANEL = 640
_GAP = 10
_MARGIN = 0.06
_PAPER = (255, 255, 255)
_EDGE = (0, 255, 255)
_MASK = (0, 0, 255)
_TILE = 240  # px, the width of a picture on the sheet of all masks
_COLUMNS = 6  # of them


def write_pictures(
    heard: Heard,
    solids: Sequence[Solid],
    folder: Path,
    progress: Progress,
    edge: Array | None = None,
) -> list[Path]:
    """views.png (photographs, strips, surface drawn into them), contours.png (one, whole) and
    where the truth is known errors.png.

    Args:
        heard: has kept some whole frames.
        solids: the best surface first, the strips last.
        folder: to write into.
        progress: told how many pictures are drawn of how many.
        edge: (k, 3) metres, a curve to be drawn into contours.png.

    Returns:
        The files written: none where no image was kept with its contours.
    """
    stamps = sorted(set(heard.views) & set(heard.contours))
    if not stamps:
        return []
    views = [(heard.views[stamp], heard.contours[stamp]) for stamp in stamps]
    box = _common_box([contours for _, contours in views])
    height = round(min(_PANEL_HEIGHT, _MOST_ENLARGED * (box[3] - box[1])))
    best, distance_m = solids[0].mesh, solids[0].distance_m
    strips, surface = Shader(as_strip(solids[-1].mesh)), Shader(as_strip(best))
    coloured = [] if distance_m is None else [Shader(_by_error(best, distance_m))]
    columns, errors = [], []
    for count, (view, contours) in enumerate(views):
        progress(count, len(views))
        photograph, camera = _crop(as_bgr8(view.pixels()), box, height), view.camera()
        panels = [_crop(draw_contours(view.pixels(), contours), box, height)]
        if camera is not None:
            panels.append(strips.draw(camera, box, height))
            panels.append(surface.draw(camera, box, height, photograph))
            errors += [shader.draw(camera, box, height) for shader in coloured]
        columns.append(_stacked(panels))
    progress(len(views), len(views))
    _write(folder / "views.png", _side_by_side(columns))
    view, contours = views[0]
    whole, camera = draw_contours(view.pixels(), contours), view.camera()
    if edge is not None and camera is not None:
        curve = np.rint(camera.project(edge)).astype(np.int32)
        cv2.polylines(whole, [curve], True, _EDGE, 2, cv2.LINE_AA)
    _write(folder / "contours.png", whole)
    written = [folder / "views.png", folder / "contours.png"]
    if errors:
        _write(folder / "errors.png", _side_by_side(errors))
        written.append(folder / "errors.png")
    return written


def write_mask_sheet(views: BagViews, path: Path, edge: Array | None = None) -> None:
    """All masks over their images, small, with the numbers of the views and their images' names.

    Args:
        views: with masks.
        path: PNG file.
        edge: (k, 3) metres, a closed curve to be drawn into all of them.
    """
    tiles, names = [], [image["name"] for image in views.images()]
    for k, view in enumerate(views):
        size = _TILE, max(1, round(_TILE * view.camera.height / view.camera.width))
        tile = cv2.resize(as_bgr8(view.image), size, interpolation=cv2.INTER_AREA)
        if view.mask is not None:
            small = cv2.resize(view.mask, size, interpolation=cv2.INTER_AREA) > 127
            how = cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE
            cv2.drawContours(tile, cv2.findContours(small.astype(np.uint8), *how)[0], -1, _MASK, 1)
        if edge is not None:
            shape = view.camera.width, view.camera.height
            curve = (view.camera.project(edge) + 0.5) * size / np.array(shape) - 0.5
            cv2.polylines(tile, [np.rint(curve).astype(np.int32)], True, _EDGE, 1)
        for row, words in enumerate((str(k), *names[k : k + 1]), 1):
            cv2.putText(tile, words, (4, 16 * row), cv2.FONT_HERSHEY_SIMPLEX, 0.5, _EDGE, 1)
        tiles.append(tile)
    tallest = max(len(tile) for tile in tiles)
    tiles = [np.pad(tile, ((0, tallest - len(tile)), (0, 0), (0, 0))) for tile in tiles]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % _COLUMNS)
    rows = [np.hstack(tiles[k : k + _COLUMNS]) for k in range(0, len(tiles), _COLUMNS)]
    _write(path, np.vstack(rows))


def _stacked(panels: Sequence[Picture]) -> Picture:
    gap = np.full((_GAP, panels[0].shape[1], 3), _PAPER, np.uint8)
    parts = [part for panel in panels for part in (panel, gap)]
    return np.vstack(parts[:-1])


def _by_error(mesh: trimesh.Trimesh, distance_m: Array) -> Strip:
    colours = error_colours(distance_m, error_limit_m(distance_m))[:, :3]
    return replace(as_strip(mesh), rgb=colours[mesh.faces])


def _common_box(all_contours: Sequence[Contours]) -> Box:
    """A box about all contours, not wider than panels may be."""
    uv = np.concatenate([contours.uv for contours in all_contours])
    low, high = uv.min(axis=0), uv.max(axis=0)
    margin = _MARGIN * (high - low).max() + 2
    (left, top), (right, bottom) = low - margin, high + margin
    shortest = (right - left) * _PANEL_HEIGHT / _WIDEST_PANEL
    extra = max(0.0, shortest - (bottom - top)) / 2
    return float(left), float(top - extra), float(right), float(bottom + extra)


def _crop(picture: Picture, box: Box, height: int) -> Picture:
    """A box of a picture, enlarged or reduced to the height of a panel."""
    scale = height / (box[3] - box[1])
    width = round((box[2] - box[0]) * scale)
    # Pixel centres are whole numbers: the corner of the box lies at -0.5 of the panel.
    shift = 0.5 * (scale - 1)
    M = np.array([[scale, 0, shift - scale * box[0]], [0, scale, shift - scale * box[1]]])
    flags = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
    return cv2.warpAffine(picture, M, (width, height), flags=flags, borderValue=_PAPER)


def _side_by_side(columns: Sequence[Picture]) -> Picture:
    height = max(column.shape[0] for column in columns)
    parts: list[Picture] = []
    for column in columns:
        below = ((0, height - column.shape[0]), (0, _GAP), (0, 0))
        parts.append(np.pad(column, below, constant_values=255))
    return np.hstack(parts)[:, :-_GAP]


def as_bgr8(image: NDArray[Any]) -> NDArray[np.uint8]:
    """(h, w, 3) of an image of any kind."""
    if image.dtype == np.uint16:
        image = (image / max(1, image.max()) * 255).round().astype(np.uint8)
    image = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
    return np.asarray(image, np.uint8)


def as_strip(mesh: trimesh.Trimesh) -> Strip:
    """A mesh in the flat form, with its vertex colours if it has any."""
    corners = np.asarray(mesh.triangles, np.float32)
    normals = np.asarray(mesh.vertex_normals, np.float32)[mesh.faces]
    sigma = np.zeros(corners.shape[:2], np.float32)
    rgb = None
    if isinstance(mesh.visual, ColorVisuals) and mesh.visual.kind == "vertex":
        rgb = np.asarray(mesh.visual.vertex_colors, np.uint8)[mesh.faces, :3]
    return Strip(0, "", corners, normals, sigma, rgb)


def _write(path: Path, picture: Any) -> None:
    # As small as by the default, and in two thirds of the time.
    run_lengths = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
    if not cv2.imwrite(str(path), picture, [cv2.IMWRITE_PNG_COMPRESSION, 4, *run_lengths]):
        raise OSError(f"cannot write {path}")
