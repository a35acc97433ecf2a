"""Surfaces and rims to files."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..geometry import Rim, Status
from .accumulate import Surface

if TYPE_CHECKING:
    import trimesh

SUFFIXES = (".ply", ".glb", ".stl", ".obj")

_RIM_FIELDS = ("x", "y", "z", "nx", "ny", "nz", "curvature", "depth_sigma")


def write_surface(surface: Surface, path: str | Path, overwrite: bool = False) -> Path:
    """Write the surface as it is, in metres, in the format that the suffix names.

    The file appears whole or not at all.

    Returns:
        The absolute path.

    Raises:
        ValueError: another suffix than SUFFIXES, or a surface without triangles.
        FileExistsError: the file is there and ``overwrite`` is False.
        OSError: the place cannot be written; names it.
    """
    path = Path(path).expanduser().absolute()
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"cannot write '{path.name}': use one of {', '.join(SUFFIXES)}")
    if not len(surface):
        raise ValueError("the surface has no triangles yet")
    return write_whole(path, exported(surface.mesh(), path.suffix), overwrite)


def exported(mesh: trimesh.Trimesh, suffix: str) -> bytes:
    """The file of a mesh.

    Args:
        mesh: metres.
        suffix: one of SUFFIXES.
    """
    data = mesh.export(file_type=suffix.lower().lstrip("."))
    return data.encode() if isinstance(data, str) else bytes(data)


def write_rims(rims: Iterable[Rim], path: str | Path, overwrite: bool = False) -> Path:
    """Write the good points of rims as a binary PLY cloud.

    Fields x y z (metres), nx ny nz, curvature (1/m), depth_sigma (m), all float32.

    Returns:
        The absolute path.

    Raises:
        FileExistsError: the file is there and ``overwrite`` is False.
        OSError: the place cannot be written.
    """
    rows = []
    for rim in rims:
        columns = np.column_stack([rim.points, rim.normals, rim.curvature, rim.depth_sigma])
        rows.append(columns[rim.status == Status.GOOD].astype("<f4").tobytes())
    count = sum(map(len, rows)) // (4 * len(_RIM_FIELDS))
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    header += [f"property float {name}" for name in _RIM_FIELDS]
    text = "\n".join([*header, "end_header", ""])
    data = b"".join([text.encode(), *rows])
    return write_whole(Path(path).expanduser().absolute(), data, overwrite)


def write_whole(path: Path, data: bytes, overwrite: bool) -> Path:
    """Write a file under a temporary name beside its place, then rename it."""
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} exists: choose another name or allow overwriting")
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with open(temporary, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        # Of the place that was asked for, not of a name that nobody knows.
        missing = isinstance(error, FileNotFoundError)
        place = path.parent if missing else path
        raise type(error)(error.errno, error.strerror, str(place)) from None
    finally:
        temporary.unlink(missing_ok=True)
    return path
