"""Which of the bodies of a mesh are real."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from trimesh.graph import connected_component_labels

from occ_recon_ros.geometry.arrays import Array, Index

_SPECK = 1e-3  # of the volume of the largest body
_SHARE = 5e-3  # of the rim points that lie on a real body, at least


def without_specks(vertices: Array, faces: Index) -> tuple[Array, Index]:
    """The bodies that are more than a speck, which noise leaves where cones nearly meet."""
    body = _bodies(faces, len(vertices))
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = np.bincount(body[faces[:, 0]], (a * np.cross(b, c)).sum(axis=1))
    return _kept(vertices, faces, body, volume >= _SPECK * volume.max())


def without_phantoms(vertices: Array, faces: Index, points: Array) -> tuple[Array, Index]:
    """The bodies that surface points lie on.

    A hull may have bodies where there is nothing, as before and behind the hole of a ring
    seen from above; no rim is ever found on them.

    Args:
        vertices, faces: (n, 3) and (m, 3), the hull.
        points: (k, 3) points on the true surface; if there are none, all bodies stay.
    """
    body = _bodies(faces, len(vertices))
    if not len(points) or not body.any():
        return vertices, faces
    on = np.bincount(body[cKDTree(vertices).query(points)[1]], minlength=body.max() + 1)
    return _kept(vertices, faces, body, on >= _SHARE * len(points))


def _bodies(faces: Index, n: int) -> Index:
    """(n,) the number of the body that each vertex belongs to."""
    return np.asarray(connected_component_labels(faces[:, [0, 1, 1, 2]].reshape(-1, 2), n), np.intp)


def _kept(
    vertices: Array, faces: Index, body: Index, keep: NDArray[np.bool_]
) -> tuple[Array, Index]:
    kept: Index = faces[keep[body[faces[:, 0]]]]
    used, inverse = np.unique(kept, return_inverse=True)
    return vertices[used], inverse.reshape(-1, 3)


def stood_on(vertices: Array, point: Array, normal: Array) -> Array:
    """(n, 3) of a closed body that stands on a plane, without what views from above leave beneath.

    No silhouette tells where an object ends below: from above, the hull runs on under the plane,
    ever narrower, as far as the flattest ray. So each point there lies below one of the foot, and
    is lifted to it; the triangles stay the same.

    Args:
        vertices: (n, 3), metres.
        point: (3,) of the plane, metres.
        normal: (3,) of the plane, of length 1, to the side of the object.
    """
    below = np.minimum((vertices - point) @ normal, 0.0)
    return np.asarray(vertices - below[:, None] * normal) if below.max() == 0 else vertices
