"""Meshes that a user names."""

from pathlib import Path

import numpy as np
import trimesh

from occ_recon_ros.errors import UserError


def read_mesh(path: Path) -> trimesh.Trimesh:
    """The triangles of a mesh file, vertices as the file has them, metres.

    Raises:
        UserError: not there, of a kind that trimesh does not read, or without triangles.
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
    if not np.isfinite(mesh.vertices).all():
        raise UserError(f"mesh {path} has vertices that are not finite")
    return mesh
