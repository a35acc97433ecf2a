"""The closed body of a whole scan, made alike offline and live."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from trimesh.visual import ColorVisuals

from ..geometry import Contours, Rim
from ..geometry.arrays import thinned
from .closing import ClosedSurface, ClosingSettings, close_views
from .colour import ViewColours

PREVIEW_VIEWS = 40
_PREVIEW_CELLS = 64


def closing_settings(cells: int, preview: bool = False) -> ClosingSettings:
    """Of a body so many grid cells long; a preview has no more of them than are quick."""
    if preview:
        return ClosingSettings(cells=min(cells, _PREVIEW_CELLS), weighed=False)
    return ClosingSettings(cells=cells)


def body_views(
    contours: Mapping[int, Contours], rims: Mapping[int, Rim], most: int | None = None
) -> tuple[list[Contours], list[Rim]]:
    """The views that a body is made of.

    Args:
        contours: by stamp.
        rims: by stamp; the last that came of each.
        most: as many at most, evenly over those that have both; None for all.
    """
    stamps = sorted(set(contours) & set(rims))
    if most is not None:
        stamps = list(thinned(stamps, most))
    return [contours[stamp] for stamp in stamps], [rims[stamp] for stamp in stamps]


def closed_views(
    contours: Sequence[Contours],
    rims: Sequence[Rim],
    colours: ViewColours | None = None,
    settings: ClosingSettings | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> ClosedSurface:
    """One watertight body, metres, object frame, coloured if there are views to do so, and
    which views it was made from.

    ``progress`` is told of parts done, and of all.

    Raises:
        ValueError: the views do not bound an object; says why.
    """
    closed = close_views(contours, rims, settings, progress=progress)
    if colours:
        mesh = closed.mesh
        colours.hide_behind(np.asarray(mesh.triangles))
        rgb = colours.of(mesh.vertices, mesh.vertex_normals)
        mesh.visual = ColorVisuals(mesh, vertex_colors=rgb)
    return closed
