"""Where a closed sheet is folded or crosses itself, and how it is brought apart."""

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from occ_recon_ros.geometry.arrays import Array, Index, repeated

_FOLDED = -0.5  # cosine between the normals of two neighbours: sharper than any edge of a grid
_UNFOLDINGS = 30
_BOX = 2.0  # usual edges, the side of the boxes in which triangles are looked for
_ALIKE = 0.9  # length of the mean normal in a box through which no sheet crosses another
_RETREATS = 12


def unfolded(x: Array, faces: Index, links: csr_matrix) -> Array:
    """Vertices of triangles that are folded back upon their neighbours moved towards the
    middle of theirs.

    Args:
        x, faces: (n, 3) and (m, 3), a closed sheet.
        links: (n, n), as of ``fairing.mean_of_neighbours``.
    """
    x = x.copy()
    pairs = trimesh.graph.face_adjacency(faces)
    asked = np.arange(len(pairs))
    for _ in range(_UNFOLDINGS):
        one, two = (_face_normals(x, faces[pairs[asked, k]]) for k in (0, 1))
        folded = pairs[asked[np.einsum("nk,nk->n", one, two) < _FOLDED]]
        if not len(folded):
            break
        rows = np.unique(faces[folded])
        x[rows] = 0.5 * (x[rows] + links[rows] @ x)
        asked = np.flatnonzero(_touching(faces, rows, len(x))[pairs].any(axis=1))
    return x


def uncrossed(x: Array, faces: Index, apart: Array) -> Array:
    """A closed sheet that crosses itself nowhere.

    Args:
        x, faces: (n, 3) and (m, 3), a sheet that crosses itself in places.
        apart: (n, 3) where its vertices lie on a sheet that does not: where it does they go back
            there, half of the way each time.
    """
    x = x.copy()
    for k in range(_RETREATS):
        crossing = crossing_triangles(x, faces)
        if not len(crossing):
            break
        rows = np.unique(faces[crossing])
        for _ in range(k // 3):  # what does not come apart by itself takes others along
            rows = np.unique(faces[_touching(faces, rows, len(x))])
        x[rows] = 0.5 * (x[rows] + apart[rows])
    return x


def crossing_triangles(x: Array, faces: Index) -> Index:
    """(k,) the triangles that cross others of opposite sides of the sheet, ascending. Two sheets
    that face the same way cross nowhere unless one that faces the other way is between."""
    one, two = _near_pairs(x, faces)
    crossing = np.zeros(len(one), bool)
    for mine, other in ((faces[one], faces[two]), (faces[two], faces[one])):
        for k in range(3):
            a, b = mine[:, k], mine[:, k - 1]
            shared = (other == a[:, None]).any(axis=1) | (other == b[:, None]).any(axis=1)
            crossing |= ~shared & _pierced(x[a], x[b], x[other])
    return np.unique(np.concatenate([one[crossing], two[crossing]]))


def _near_pairs(x: Array, faces: Index) -> tuple[Index, Index]:
    """Pairs of triangles that share a box and no edge, and whose normals differ; a pair comes
    once for each box that it shares."""
    low, high = (extreme(x[faces], axis=1) for extreme in (np.min, np.max))
    side = _BOX * float(np.median(np.linalg.norm(x[faces[:, 0]] - x[faces[:, 1]], axis=1)))
    first = np.floor((low - x.min(axis=0)) / side).astype(np.intp)
    size = np.floor((high - x.min(axis=0)) / side).astype(np.intp) - first + 1
    count = size.prod(axis=1)
    triangle, place = repeated(count)
    size = size[triangle]
    at = np.stack([place % size[:, 0], place // size[:, 0] % size[:, 1], 0 * place], axis=1)
    at[:, 2] = place // (size[:, 0] * size[:, 1])
    boxes = first.max(axis=0) + size.max(axis=0) + 1
    box = np.ravel_multi_index(tuple((first[triangle] + at).T), tuple(boxes))
    order = np.argsort(box, kind="stable")
    box, triangle = box[order], triangle[order]

    normals = _face_normals(x, faces)
    starts = np.flatnonzero(np.diff(box, prepend=-1))
    held = np.diff(starts, append=len(box))
    length = np.linalg.norm(np.add.reduceat(normals[triangle], starts), axis=1) / held
    kept = np.repeat(length < _ALIKE, held)
    box, triangle = box[kept], triangle[kept]
    pairs = [np.zeros((2, 0), np.intp)]
    for shift in range(1, int(held[length < _ALIKE].max(initial=0))):
        same = np.flatnonzero(box[shift:] == box[:-shift])
        one, two = triangle[same], triangle[same + shift]
        meet = np.einsum("nk,nk->n", normals[one], normals[two]) < 0.5
        meet &= (low[one] <= high[two]).all(axis=1) & (low[two] <= high[one]).all(axis=1)
        one, two = one[meet], two[meet]
        shared = (faces[one][:, :, None] == faces[two][:, None, :]).sum(axis=(1, 2))
        pairs.append(np.stack([one, two])[:, shared < 2])
    found = np.concatenate(pairs, axis=1)
    return found[0], found[1]


def _pierced(a: Array, b: Array, corners: Array) -> NDArray[np.bool_]:
    """(n,) whether segments from a to b, (n, 3) each, pass through triangles (n, 3, 3)."""
    p, q, r = corners[:, 0], corners[:, 1], corners[:, 2]
    across = _volume(p, q, r, a) * _volume(p, q, r, b) < 0
    sides = [_volume(a, b, p, q), _volume(a, b, q, r), _volume(a, b, r, p)]
    signs = np.sign(np.stack(sides))
    return across & (np.abs(signs.sum(axis=0)) == 3)


def _volume(a: Array, b: Array, c: Array, d: Array) -> Array:
    """(n,) six times the signed volume of tetrahedra."""
    return np.einsum("nk,nk->n", np.cross(b - a, c - a), d - a)


def _touching(faces: Index, rows: Index, n: int) -> NDArray[np.bool_]:
    """(m,) which triangles have one of some of the n vertices."""
    marked = np.zeros(n, bool)
    marked[rows] = True
    return np.asarray(marked[faces].any(axis=1))


def _face_normals(x: Array, faces: Index) -> Array:
    """(m, 3) unit normals of triangles."""
    a, b, c = (x[faces[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    return across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
