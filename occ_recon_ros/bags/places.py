"""Where results go: whole or not at all, and never over somebody's files unasked."""

import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from occ_recon_ros.errors import UserError, writing


def refuse_existing(paths: Iterable[Path], overwrite: bool) -> None:
    """Keep files that are there, if nobody has said that they may be replaced.

    Raises:
        UserError: one of them is there.
    """
    for path in paths:
        if path.exists() and not overwrite:
            raise UserError(f"{path} exists: choose another --out or add --overwrite")


def refuse_full(folder: Path, overwrite: bool) -> None:
    """Keep to a new or empty folder, if nobody has said that its files may be replaced.

    Raises:
        UserError: it is not empty, or is a file.
    """
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder} is not a folder: choose another --out")
    if folder.is_dir() and any(folder.iterdir()) and not overwrite:
        raise UserError(f"{folder} is not empty: choose another --out or add --overwrite")


def make_folder(folder: Path) -> None:
    """
    Raises:
        UserError: it cannot be made.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)


def write_file(path: Path, content: bytes) -> None:
    """Write a file whole or not at all, in a folder that is made if it is not there.

    Raises:
        UserError: it cannot be written.
    """
    from occ_recon_ros.surface import write_whole  # here: it brings SciPy

    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path.absolute(), content, overwrite=True)


@contextmanager
def work_beside(path: Path, suffix: str) -> Iterator[Path]:
    """A temporary folder on the disk of a path, gone when the block ends.

    Raises:
        UserError: it cannot be made.
    """
    make_folder(path.parent)
    with writing(path.parent):
        work = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=suffix, dir=path.parent))
    try:
        yield work
    finally:
        shutil.rmtree(work, ignore_errors=True)
