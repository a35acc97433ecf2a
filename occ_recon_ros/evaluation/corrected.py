"""Cameras that a replay corrected, kept in the report beside its surface."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.geometry import Camera


def camera_rows(cameras: Mapping[int, Camera], given: Mapping[int, Camera]) -> list[dict[str, Any]]:
    """Cameras by stamp (ns) as report.json holds them; metres and pixels.

    Args:
        cameras: corrected.
        given: by the same stamps, as the recording has them.
    """
    return [
        {
            "stamp_ns": stamp,
            "width": camera.width,
            "height": camera.height,
            "K": camera.K.tolist(),
            "D": camera.D.tolist(),
            "distortion": camera.distortion,
            "R": camera.R_camera_object.tolist(),
            "t_m": camera.t_camera_object.tolist(),
            "of": _fingerprint(given[stamp]),
        }
        for stamp, camera in sorted(cameras.items())
    ]


def cameras_beside(mesh: Path, views: BagViews) -> dict[int, Camera] | None:
    """The cameras by stamp that a surface was made with, if they are not those of its bag.

    Args:
        mesh: the surface; report.json of the replay that wrote it may be beside it.
        views: that it is to be held against: the recording that was replayed, or one of the same
            stamps and cameras (as one with masks is beside one without).

    Returns:
        None where there is no such report, it is of other cameras, or nothing was corrected.
    """
    try:
        report = json.loads((mesh.parent / "report.json").read_text(encoding="utf-8"))
        source = report["source"]
        rows = (source.get("shifted_poses", {}) | source["refinement"])["cameras"]
        if mesh.name not in report["files"]:
            return None
        given = {stamp: _fingerprint(camera) for stamp, camera in views.cameras().items()}
        known = {int(row["stamp_ns"]): row["of"] for row in rows}
        blank = source.get("blank_images", {}).get("stamps_ns", ())  # not among the rows
        if not known or given.keys() - known.keys() - {*blank}:
            return None
        if any(given.get(stamp) != of for stamp, of in known.items()):
            return None
        return {
            int(row["stamp_ns"]): Camera(
                np.array(row["K"]),
                row["width"],
                row["height"],
                np.array(row["R"]),
                np.array(row["t_m"]),
                np.array(row["D"]),
                row["distortion"],
            )
            for row in rows
        }
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _fingerprint(camera: Camera) -> str:
    """The same for the same camera alone."""
    parts = (camera.K, camera.D, camera.R_camera_object, camera.t_camera_object)
    size = f"{camera.width}x{camera.height} {camera.distortion}"
    content = b"".join(part.tobytes() for part in parts) + size.encode()
    return hashlib.sha256(content).hexdigest()[:16]
