"""Meshes that a user names."""

from pathlib import Path

import numpy as np
import trimesh

from occ_recon_ros.errors import UserError

_STRAY = 1e6  # times the usual distance of a vertex from the middle: no part of any object


def read_mesh(path: Path) -> trimesh.Trimesh:
    """The triangles of a mesh file, vertices as the file has them, metres.

    Raises:
        UserError: not there, of a kind that trimesh does not read, without triangles, or broken.
    """
    if not path.exists():
        raise UserError(f"mesh {path} does not exist: give a .ply, .glb, .obj or .stl file")
    if path.is_dir():
        raise UserError(f"mesh {path} is a folder: give a file in it, as {path / 'closed.ply'}")
    try:
        mesh = trimesh.load_mesh(path, process=False)
    except Exception as error:  # of many kinds: whatever the parser stumbles over
        why = " ".join(str(error).split()) or type(error).__name__
        raise UserError(f"mesh {path} cannot be read: {why}") from None
    if isinstance(mesh, trimesh.Scene):
        mesh = mesh.to_mesh()
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise UserError(f"mesh {path} has no triangles")
    what = "a broken export: write it again, or delete them in a mesh editor"
    if not np.isfinite(mesh.vertices).all():
        raise UserError(f"mesh {path} has vertices that are not finite, {what}")
    away = np.abs(mesh.vertices - np.median(mesh.vertices, axis=0)).max(axis=1)
    usual = float(np.median(away))
    if usual > 0 and (stray := away > _STRAY * usual).any():
        raise UserError(
            f"mesh {path} has {stray.sum()} vertices up to {away.max():.1g} m away from the rest, "
            f"{what}"
        )
    if not mesh.area > 0:
        raise UserError(f"mesh {path} has no triangles with an area: write it again")
    return mesh


def joined(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The surface alone, corners at one place made one: .stl has each triangle for itself, and
    textures are cut along seams, which leaves what is closed open."""
    whole = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    _, first, same = np.unique(whole.vertices, axis=0, return_index=True, return_inverse=True)
    faces = same.reshape(-1)[whole.faces]
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return trimesh.Trimesh(whole.vertices[first], faces[distinct], process=False)
