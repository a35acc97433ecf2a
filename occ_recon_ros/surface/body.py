"""The closed body of a whole scan, made alike offline and live."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import trimesh
from trimesh.visual import ColorVisuals

from ..geometry import Contours, Rim
from .closing import ClosingSettings, close_surface
from .colour import ViewColours

MOST_VIEWS = 120
"""Of very many views some say all; a rim whose neighbour is left out still counts itself."""

PREVIEW_VIEWS = 40
PREVIEW = ClosingSettings(cells=64)


def body_views(
    contours: Mapping[int, Contours], rims: Mapping[int, Rim], most: int = MOST_VIEWS
) -> tuple[list[Contours], list[Rim]]:
    """The views that a body is made of.

    Args:
        contours: by stamp.
        rims: by stamp; the last that came of each.
        most: as many at most, evenly over those that have both.
    """
    stamps = sorted(set(contours) & set(rims))
    stamps = stamps[:: -(-len(stamps) // most) or 1]
    return [contours[stamp] for stamp in stamps], [rims[stamp] for stamp in stamps]


def closed_body(
    contours: Sequence[Contours],
    rims: Sequence[Rim],
    colours: ViewColours | None = None,
    settings: ClosingSettings | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> trimesh.Trimesh:
    """One watertight body, metres, object frame, coloured if there are views to do so.

    ``progress`` is told of parts done, and of all.

    Raises:
        ValueError: the views do not bound an object; says why.
    """
    mesh = close_surface(contours, rims, settings, progress=progress)
    if colours:
        colours.hide_behind(np.asarray(mesh.triangles))
        rgb = colours.of(mesh.vertices, mesh.vertex_normals)
        mesh.visual = ColorVisuals(mesh, vertex_colors=rgb)
    return mesh
