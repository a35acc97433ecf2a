"""The closed surface of a finished turn, beside the mesh of the strips."""

import time
from pathlib import Path

import numpy as np

from occ_recon_ros.bags.views import Progress
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.imaging.joint import Volume
from occ_recon_ros.surface import ViewColours, exported, write_whole
from occ_recon_ros.surface.bodies import stood_on
from occ_recon_ros.surface.body import body_views, closed_views, closing_settings
from occ_recon_ros.surface.closing import ClosedSurface

from .listener import Listener


def write_closed(
    listener: Listener,
    path: Path,
    cells: int,
    colours: ViewColours | None = None,
    volume: Volume | None = None,
    progress: Progress = lambda done, total: None,
) -> tuple[Report, ClosedSurface | None]:
    """Close the surface over all that was heard and write it.

    Args:
        listener: has heard contours and rims.
        path: .ply file.
        cells: along its longest side.
        colours: views that colour it, None for none.
        volume: where the object is; nothing of it is beneath a plane.
        progress: told how much of the work is done, of how much.

    Returns:
        What is to be said of it, with a ``reason`` where there is none, and the surface.
    """
    started = time.monotonic()
    contours, rims = body_views(listener.heard.contours, listener.heard.rims)
    try:
        closed = closed_views(contours, rims, colours, closing_settings(cells), progress)
    except ValueError as error:
        return {"reason": str(error)}, None
    mesh = closed.mesh
    if volume is not None and volume.kind == "plane":
        mesh.vertices = stood_on(np.asarray(mesh.vertices), volume.centre, volume.axis)
    write_whole(path, exported(mesh, path.suffix), overwrite=True)
    seconds = time.monotonic() - started
    stamps = [view.stamp_ns for view in contours]
    report = {
        "file": path.name,
        "views": len(contours),
        "views_left_out": [stamps.index(stamp) for stamp in closed.left_out],
        "views_mended": [stamps.index(stamp) for stamp in closed.mended],
        "views_contradict_each_other": closed.undecided,
        "triangles": len(mesh.faces),
        "vertices": len(mesh.vertices),
        "watertight": bool(mesh.is_watertight and mesh.is_winding_consistent),
        "bodies": int(mesh.body_count),
        "genus": int(mesh.body_count - mesh.euler_number // 2),
        "volume_m3": float(mesh.volume),
        "area_m2": float(mesh.area),
        "outside_silhouettes_p99_px": max(0.0, float(np.percentile(closed.outside_px, 99))),
        "seconds": seconds,
    }
    return report, closed
