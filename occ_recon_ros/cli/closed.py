"""The closed surface of a finished turn, beside the mesh of the strips."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import trimesh
from trimesh.visual import ColorVisuals

from occ_recon_ros.bags.views import Progress
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.surface import ViewColours, write_whole
from occ_recon_ros.surface.closing import close_surface
from occ_recon_ros.surface.hull import Hull

from .listener import Listener

_MOST_VIEWS = 120


def write_closed(
    listener: Listener,
    path: Path,
    colours: ViewColours | None = None,
    progress: Progress = lambda done, total: None,
) -> tuple[Report, trimesh.Trimesh | None]:
    """Close the surface over all that was heard and write it.

    Args:
        listener: has heard contours and rims.
        path: .ply file.
        colours: views that colour it, None for none.
        progress: told how much of the work is done, of how much.

    Returns:
        What is to be said of it, with a ``reason`` where there is none, and the surface.
    """
    started = time.monotonic()
    stamps = sorted(set(listener.heard.contours) & set(listener.heard.rims))
    # Of very many views some say all; a rim whose neighbour is left out still counts itself.
    stamps = stamps[:: -(-len(stamps) // _MOST_VIEWS) or 1]
    contours = [listener.heard.contours[stamp] for stamp in stamps]
    try:
        rims = [listener.heard.rims[stamp] for stamp in stamps]
        mesh = close_surface(contours, rims, progress=progress)
    except ValueError as error:
        return {"reason": str(error)}, None
    if colours:
        colours.hide_behind(mesh.triangles)
        rgb = colours.of(mesh.vertices, mesh.vertex_normals)
        mesh.visual = ColorVisuals(mesh, vertex_colors=rgb)
    write_whole(path, _as_ply(mesh), overwrite=True)
    seconds = time.monotonic() - started
    hull = Hull(contours)
    outside = hull.roughly_outside(np.asarray(mesh.vertices)) / hull.pixel
    report = {
        "file": path.name,
        "views": len(contours),
        "triangles": len(mesh.faces),
        "vertices": len(mesh.vertices),
        "watertight": bool(mesh.is_watertight and mesh.is_winding_consistent),
        "bodies": int(mesh.body_count),
        "genus": int(mesh.body_count - mesh.euler_number // 2),
        "volume_m3": float(mesh.volume),
        "area_m2": float(mesh.area),
        "outside_silhouettes_p99_px": max(0.0, float(np.percentile(outside, 99))),
        "seconds": seconds,
    }
    return report, mesh


def _as_ply(mesh: trimesh.Trimesh) -> bytes:
    data = mesh.export(file_type="ply")
    assert isinstance(data, bytes)
    return data
