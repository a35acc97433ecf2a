"""A patch as binary glTF 2.0, which browsers draw as it is."""

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from .patch import Patch


def encode_glb(patch: Patch, colours: NDArray[np.uint8], scale: float) -> bytes:
    """A patch, lit from both sides.

    Args:
        patch: with at least one triangle.
        colours: (v, 3) uint8, red green blue as displayed (sRGB).
        scale: the vertices are multiplied with it.
    """
    material = PBRMaterial(doubleSided=True, metallicFactor=0.0, roughnessFactor=0.7)
    visual = TextureVisuals(material=material)
    # Colours of vertices count as linear light.
    visual.vertex_attributes["color"] = np.insert(_LINEAR[colours], 3, 255, axis=1)
    mesh = trimesh.Trimesh(
        vertices=scale * patch.vertices,
        faces=patch.faces,
        vertex_normals=np.nan_to_num(patch.normals),
        visual=visual,
        process=False,
    )
    return bytes(mesh.export(file_type="glb", include_normals=True))


def _srgb_to_linear() -> NDArray[np.uint8]:
    level = np.arange(256) / 255
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return (255 * linear).round().astype(np.uint8)


_LINEAR = _srgb_to_linear()
