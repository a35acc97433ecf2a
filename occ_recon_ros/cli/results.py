"""The folder of results: whole or not at all, and never over somebody's files unasked."""

import json
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from occ_recon_ros.errors import UserError

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


def refuse_existing(paths: Iterable[Path], overwrite: bool) -> None:
    """Keep files that are there, if nobody has said that they may be replaced.

    Raises:
        UserError: one of them is there.
    """
    for path in paths:
        if path.exists() and not overwrite:
            raise UserError(f"{path} is there: choose another --out or add --overwrite")


def write_file(path: Path, content: bytes) -> None:
    """Write a file, in a folder that is made if it is not there.

    Raises:
        UserError: it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}") from None


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
    if out.exists() and not out.is_dir():
        raise UserError(f"{out} is not a folder: choose another --out")
    expendable = command == "demo" and _made_by(out) == "demo"
    if out.is_dir() and any(out.iterdir()) and not (overwrite or expendable):
        raise UserError(f"{out} is not empty: choose another --out or add --overwrite")
    parent = out.absolute().parent
    try:
        parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=f".{out.name}.", suffix=".part", dir=parent))
    except OSError as error:
        raise UserError(f"cannot write to {parent}: {error.strerror}") from None
    try:
        yield work
        out.mkdir(exist_ok=True)
        for name in OWN_FILES:
            if (work / name).exists():
                (work / name).replace(out / name)
            else:
                (out / name).unlink(missing_ok=True)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _made_by(out: Path) -> str | None:
    """The command whose results are in a folder, None if it holds something else."""
    try:
        content = json.loads((out / "report.json").read_text(encoding="utf-8"))
        return str(content["command"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
