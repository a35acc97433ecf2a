"""The folder of results: whole or not at all, and never over somebody's files unasked."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from occ_recon_ros.bags.places import refuse_full, work_beside

OWN_FILES = (
    "mesh.ply",
    "closed.ply",
    "rims.ply",
    "report.json",
    "report.html",
    "views.png",
    "contours.png",
    "errors.png",
)


def results_only(folder: Path) -> dict[str, Any]:
    """Parameters of a mesher that writes mesh.ply into a folder when asked to, and no more: the
    command itself says when the turn is over and closes the body."""
    return {
        "output_dir": str(folder.parent),
        "scan_name": folder.name,
        "output_format": "ply",
        "finish_when_closed": False,
        "close_body": False,
        "save_on_shutdown": False,
    }


@contextmanager
def results_folder(out: Path, command: str, overwrite: bool) -> Iterator[Path]:
    """A temporary folder whose files appear in ``out`` when the block ends well.

    ``out`` may be new or empty. Results of an earlier ``demo`` are replaced by those of a
    ``demo``; any other content only with ``overwrite``, and then only OWN_FILES are touched.

    Raises:
        UserError: ``out`` is in use, is a file, or cannot be written.
    """
    refuse_results(out, command, overwrite)
    with work_beside(out.absolute(), ".part") as work:
        yield work
        out.mkdir(exist_ok=True)
        for name in OWN_FILES:
            if (work / name).exists():
                (work / name).replace(out / name)
            else:
                (out / name).unlink(missing_ok=True)


def refuse_results(out: Path, command: str, overwrite: bool) -> None:
    """Keep to a folder that ``results_folder`` may fill.

    Raises:
        UserError: it may not.
    """
    expendable = command == "demo" and _made_by(out) == "demo"
    refuse_full(out, overwrite or expendable)


def _made_by(out: Path) -> str | None:
    """The command whose results are in a folder, None if it holds something else."""
    try:
        content = json.loads((out / "report.json").read_text(encoding="utf-8"))
        return str(content["command"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
