"""Cameras that a replay corrected, kept in the report beside its surface."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from occ_recon_ros.geometry import Camera


def camera_rows(cameras: Mapping[int, Camera]) -> list[dict[str, Any]]:
    """Cameras by stamp (ns) as report.json holds them; metres and pixels."""
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
        }
        for stamp, camera in sorted(cameras.items())
    ]


def cameras_beside(mesh: Path, bag: Path) -> dict[int, Camera] | None:
    """The cameras by stamp that a surface was made with, if they are not those of its bag.

    Args:
        mesh: the surface; report.json of the replay that wrote it may be beside it.
        bag: the recording that it is to be held against.

    Returns:
        None where there is no such report, it is of another recording, or nothing was corrected.
    """
    try:
        report = json.loads((mesh.parent / "report.json").read_text(encoding="utf-8"))
        source = report["source"]
        if source["name"] != bag.name or mesh.name not in report["files"]:
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
            for row in source["refinement"]["cameras"]
        }
    except (OSError, ValueError, KeyError, TypeError):
        return None
