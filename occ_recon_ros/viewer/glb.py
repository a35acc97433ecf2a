"""A patch as binary glTF 2.0, which browsers draw as it is.

https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html
"""

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .patch import Patch

_FLOAT, _UNSIGNED_INT, _UNSIGNED_BYTE = 5126, 5125, 5121
_ARRAY, _ELEMENTS = 34962, 34963


def encode_glb(patch: Patch, colours: NDArray[np.uint8], scale: float = 1.0) -> bytes:
    """A patch, lit from both sides.

    Args:
        patch: with at least one triangle.
        colours: (v, 3) uint8, red green blue as displayed (sRGB).
        scale: the vertices are multiplied with it.
    """
    n = len(patch.vertices)
    vertices = np.ascontiguousarray(patch.vertices * np.float32(scale), "<f4")
    rgba = np.full((n, 4), 255, np.uint8)
    # Colours of vertices count as linear light.
    rgba[:, :3] = _LINEAR[colours]
    parts = [
        (vertices.tobytes(), _ARRAY, _FLOAT, n, "VEC3"),
        (np.ascontiguousarray(patch.normals, "<f4").tobytes(), _ARRAY, _FLOAT, n, "VEC3"),
        (rgba.tobytes(), _ARRAY, _UNSIGNED_BYTE, n, "VEC4"),
        (patch.faces.astype("<u4").tobytes(), _ELEMENTS, _UNSIGNED_INT, patch.faces.size, "SCALAR"),
    ]
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    offset = 0
    for data, target, kind, count, shape in parts:
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": len(data), "target": target})
        accessor: dict[str, Any] = {
            "bufferView": len(accessors),
            "componentType": kind,
            "count": count,
            "type": shape,
        }
        if kind == _UNSIGNED_BYTE:
            accessor["normalized"] = True
        accessors.append(accessor)
        offset += len(data)
    accessors[0] |= {"min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist()}
    attributes = {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2}
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 3, "material": 0}]}],
        "materials": [
            {
                "doubleSided": True,
                "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.7},
            }
        ],
        "buffers": [{"byteLength": offset}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    body = b"".join(part[0] for part in parts)  # each a multiple of four bytes long
    length = 12 + 8 + len(text) + 8 + len(body)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, length),
            struct.pack("<I4s", len(text), b"JSON"),
            text,
            struct.pack("<I4s", len(body), b"BIN\0"),
            body,
        ]
    )


def _srgb_to_linear() -> NDArray[np.uint8]:
    level = np.arange(256) / 255
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return (255 * linear).round().astype(np.uint8)


_LINEAR = _srgb_to_linear()
