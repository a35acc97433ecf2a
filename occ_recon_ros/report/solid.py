"""A surface small enough to lie in a page, to be turned there."""

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.visual import ColorVisuals

from occ_recon_ros.geometry.arrays import Array

MOST_TRIANGLES = 200_000
"""Of one surface: 6 MB of the page at most, with colour and error."""


@dataclass(frozen=True)
class Solid:
    """A surface to be shown.

    Attributes:
        name: for the button.
        mesh: metres.
        distance_m: (v,) float64 signed distance of each vertex to the true surface, metres,
            None where it is not known.
    """

    name: str
    mesh: trimesh.Trimesh
    distance_m: Array | None = None


def pack(solid: Solid) -> dict[str, Any]:
    """A surface as the script of the page takes it.

    Positions are 16 bits of the bounding box, normals 8 bits, an error 8 bits of its range:
    far below what a screen shows. A surface of more than MOST_TRIANGLES is thinned.
    """
    mesh = solid.mesh
    vertices = np.asarray(mesh.vertices, np.float64)
    faces = np.asarray(mesh.faces, np.int64)
    keep, faces = thinned(vertices, faces, MOST_TRIANGLES)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    size = float((high - low).max()) or 1.0
    q = ((vertices[keep] - low) / size * 65535).round().astype("<u2")
    normals = np.nan_to_num(np.asarray(mesh.vertex_normals, np.float64)[keep])
    out: dict[str, Any] = {
        "name": solid.name,
        "low": low.tolist(),
        "size": size,
        "box": (high - low).tolist(),
        "triangles": len(mesh.faces),
        "shown": len(faces),
        "position": _base64(np.pad(q, ((0, 0), (0, 1)))),
        "normal": _base64(np.pad((127 * normals).round().astype(np.int8), ((0, 0), (0, 1)))),
        "faces": _base64(faces.astype("<u4")),
    }
    if isinstance(mesh.visual, ColorVisuals) and mesh.visual.kind == "vertex":
        out["colour"] = _base64(np.asarray(mesh.visual.vertex_colors, np.uint8)[keep])
    if solid.distance_m is not None and len(solid.distance_m):
        limit = error_limit_m(solid.distance_m)
        out["error"] = _base64(error_colours(solid.distance_m[keep], limit))
        out["error_limit_mm"] = 1e3 * limit
    return out


def error_limit_m(distance_m: Array) -> float:
    """The error at the ends of the colour map: four times the median, within which 99 % of
    normally distributed errors lie, so that full colour is what is not usual."""
    return 4 * float(np.median(np.abs(distance_m))) or 1e-9


def error_colours(distance_m: Array, limit_m: float) -> NDArray[np.uint8]:
    """(n, 4) uint8 RGBA: blue inside the true surface, red outside, white on it."""
    x = np.clip(np.nan_to_num(distance_m) / limit_m, -1, 1)
    red, blue = np.array([178.0, 24.0, 43.0]), np.array([33.0, 102.0, 172.0])
    end = np.where(x[:, None] > 0, red, blue)
    strength = np.abs(x)[:, None] ** 0.8
    rgb = (1 - strength) * np.array([247.0, 247.0, 247.0]) + strength * end
    return np.column_stack([rgb.round(), np.full(len(x), 255)]).astype(np.uint8)


def thinned(
    vertices: Array, faces: NDArray[np.int64], most: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Fewer triangles, by one vertex for all in a cell of a grid (Rossignac and Borrel 1993).

    For the eye alone: what is measured is measured on the surface itself.

    Returns:
        Rows of the vertices that stay, and (m, 3) faces over those rows, m at most ``most``.
    """
    rows = np.arange(len(vertices))
    cells = 0.6 * np.sqrt(most)
    while len(faces) > most:
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        step = (high - low).max() / cells
        place = ((vertices - low) / step).astype(np.int64)
        key = (place[:, 0] << 42) + (place[:, 1] << 21) + place[:, 2]
        _, cell = np.unique(key, return_inverse=True)
        middle = _nearest_to_means(vertices, cell)
        small = cell[faces]
        whole = (small != np.roll(small, 1, axis=1)).all(axis=1)
        if whole.sum() <= most:
            rows, faces = middle, _unfolded(vertices, middle, small[whole], faces[whole])
        cells *= 0.85
    used, faces = np.unique(faces, return_inverse=True)
    return rows[used], faces.reshape(-1, 3)


def _nearest_to_means(vertices: Array, cell: NDArray[np.int64]) -> NDArray[np.int64]:
    """For each cell the row of its vertex that is nearest to the mean of all in it."""
    count = np.bincount(cell)
    mean = np.column_stack([np.bincount(cell, vertices[:, k]) / count for k in range(3)])
    square = ((vertices - mean[cell]) ** 2).sum(axis=1)
    order = np.lexsort((square, cell))
    return np.asarray(order[np.searchsorted(cell[order], np.arange(len(count)))])


def _unfolded(
    vertices: Array, rows: NDArray[np.int64], thin: NDArray[np.int64], whole: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Thinned triangles, those that were turned over in it turned back."""
    one, other = vertices[rows][thin], vertices[whole]
    folded = (trimesh.triangles.cross(one) * trimesh.triangles.cross(other)).sum(axis=1) < 0
    return np.where(folded[:, None], thin[:, ::-1], thin)


def _base64(values: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
