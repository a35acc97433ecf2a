"""The smoothest surface that follows what rims show and stays inside of all silhouettes.

Where rims come the hull's mesh is moved on to what they show, as smoothly as can be. Where none
comes only the envelope of the silhouettes is known: the edges in which the cones of single views
meet, teeth between two views and shelves in hollows, are no part of any surface. There the sheet
itself is made as smooth as can be instead of its move, bent by no more than it must to stay
inside (an obstacle problem): it leans on the cones and spans their edges.
"""

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.linalg import cg

from occ_recon_ros.geometry.arrays import Array, Index

from .hull import Hull

_RIM_PULL = 30.0  # of what rims show, against smoothness 1
# Of the hull, against smoothness 1. About an edge that the rims show but do not agree on, waves
# longer than 8 cells are left as they are; where no rim comes, those longer than 25: teeth between
# views 10 degrees apart are 17 long on a body 200 cells wide.
_EDGE_PULL = 0.02
_HULL_PULL = 3e-4
_HELD = 1.0  # pull of the cones, on vertices that would leave them
_ROUNDS = 4
_TOLERANCE = 1e-4


def mean_of_neighbours(faces: Index, n: int) -> csr_matrix:
    """(n, n) that takes values of vertices to the mean over the neighbours of each."""
    i, j = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    ones = coo_matrix((np.ones(len(i)), (i, j)), shape=(n, n)).tocsr()
    count = np.asarray(ones.sum(axis=1)).ravel()
    return diags(1 / np.maximum(count, 1)) @ ones


def vertex_normals(x: Array, faces: Index) -> Array:
    """(n, 3) unit normals of vertices (n, 3), faces weighted by area."""
    across = np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])
    sums = [np.bincount(faces.ravel(), np.repeat(a, 3), minlength=len(x)) for a in across.T]
    normals = np.stack(sums, axis=1)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.maximum(length, 1e-300)


def faired(
    x: Array, faces: Index, target: Array, trust: Array, covered: Array, hull: Hull, cell: float
) -> Array:
    """Vertices on what rims show, and smooth between.

    Least squares with the graph Laplacian L of the mesh (bi-Laplacian deformation: Botsch and
    Kobbelt 2004, doi:10.1145/1015706.1015772): the move m of the vertices minimises

        |L (x + m) - covered L x|^2 + pull |m - (target - x)|^2 + rest |m|^2.

    Args:
        x, faces: (n, 3) and (m, 3), the hull's mesh.
        target: (n, 3) where rims show the surface, metres.
        trust: (n,) 0 to 1, how far that is to be believed.
        covered: (n,) 0 to 1, whether rims come there, agreeing or not.
        hull: what the sheet is to stay inside of.
        cell: metres, the mesh's usual edge.

    Returns:
        (n, 3) vertices. Some may still lie outside, by little.
    """
    L = (diags(np.ones(len(x))) - mean_of_neighbours(faces, len(x))).tocsr()
    pull = _RIM_PULL * trust**2
    rest = covered * _EDGE_PULL * (1 - trust) ** 2 + (1 - covered) * _HULL_PULL
    A = (L.T @ L + diags(pull + rest)).tocsr()
    b = pull[:, None] * (target - x) - L.T @ ((1 - covered)[:, None] * (L @ x))
    move = _solved(A, b, trust[:, None] * (target - x))

    # From here on the rest stays; what would leave the cones is held on them.
    free = np.flatnonzero(covered < 1)
    if not len(free):
        return x + move
    others = np.setdiff1d(np.arange(len(x)), free)
    A_free = A[free]
    b_free = b[free] - A_free[:, others] @ move[others]
    A_free = A_free[:, free]
    held, place = np.zeros(len(free)), np.zeros((len(free), 3))
    for _ in range(_ROUNDS):
        y = x + move
        out = hull.outside(y[free])
        left = np.flatnonzero(out > 0)
        if not len(left):
            break
        normals = vertex_normals(y, faces)[free[left]]
        held[left] = _HELD
        place[left] = move[free[left]] - np.minimum(out[left], cell)[:, None] * normals
        move[free] = _solved(A_free + diags(held), b_free + held[:, None] * place, move[free])
    return x + move


def _solved(A: csr_matrix, b: Array, start: Array) -> Array:
    """(n, 3) of A x = b (n, 3), by conjugate gradients."""
    scale = diags(1 / A.diagonal())
    columns = zip(b.T, start.T, strict=True)
    return np.stack([cg(A, y, x0=x, rtol=_TOLERANCE, M=scale)[0] for y, x in columns], axis=1)
