"""Minimum cuts on grids of pixels and of voxels."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

Array = NDArray[np.floating]

_UNITS = 100.0  # capacities are integers: hundredths of a nat
_LARGEST = 1e5


def minimum_cut(
    evidence: Array, nodes: NDArray[np.integer], pairs: Sequence[tuple[NDArray, NDArray, Array]]
) -> NDArray[np.bool_]:
    """Labels of least energy: the evidence against a label, and the pairs that it parts.

    The energy is sum of -evidence over the nodes of label 1, and of the weights of the pairs
    with two labels; its minimum is the minimum cut of a graph (Greig, Porteous, Seheult 1989,
    doi:10.1111/j.2517-6161.1989.tb01764.x).

    Args:
        evidence: (m,) nats for label 1, over all grid points.
        nodes: (n,) grid points that are free; all others hold to the sign of their evidence.
        pairs: grid points (k,), neighbours (k,) and weights (k,) >= 0.

    Returns:
        (m,) label of each grid point.
    """
    labels = evidence > 0
    count = len(nodes)
    if not count:
        return labels
    place = np.full(len(evidence), -1, np.int32)
    place[nodes] = np.arange(count, dtype=np.int32)
    pull = np.asarray(evidence[nodes], np.float64)
    heads, tails, weights = [], [], []
    for a, b, weight in pairs:
        ia, ib = place[a], place[b]
        both = (ia >= 0) & (ib >= 0)
        heads.append(ia[both])
        tails.append(ib[both])
        weights.append(weight[both])
        # A neighbour that is held pulls like evidence.
        for free, held, other in (((ia >= 0) & (ib < 0), b, ia), ((ia < 0) & (ib >= 0), a, ib)):
            side = np.where(labels[held[free]], weight[free], -weight[free])
            np.add.at(pull, other[free], side)
    source, sink = count, count + 1
    capacity = np.round(_UNITS * np.clip(pull, -_LARGEST, _LARGEST)).astype(np.int32)
    to, of = np.flatnonzero(capacity > 0), np.flatnonzero(capacity < 0)
    a, b = np.concatenate(heads), np.concatenate(tails)
    w = np.round(_UNITS * np.concatenate(weights)).astype(np.int32)
    rows = np.concatenate([a, b, np.full(len(to), source), of])
    columns = np.concatenate([b, a, to, np.full(len(of), sink)])
    values = np.concatenate([w, w, capacity[to], -capacity[of]])
    graph = csr_array((values, (rows, columns)), shape=(count + 2, count + 2), dtype=np.int32)
    residual = graph - maximum_flow(graph, source, sink).flow
    residual.data = (residual.data > 0).astype(np.int8)
    residual.eliminate_zeros()
    reached = np.zeros(count + 2, np.bool_)
    reached[breadth_first_order(residual, source, return_predecessors=False)] = True
    labels[nodes] = reached[:count]
    return labels


def neighbours(shape: tuple[int, ...], offsets: Sequence[tuple[int, ...]]) -> list[tuple]:
    """Pairs of grid points (flat indices) that lie an offset apart, a (k,) (k,) pair each."""
    index = np.arange(int(np.prod(shape)), dtype=np.int32).reshape(shape)
    found = []
    for offset in offsets:
        here = tuple(slice(max(0, -o), n - max(0, o)) for o, n in zip(offset, shape, strict=True))
        there = tuple(slice(max(0, o), n + min(0, o)) for o, n in zip(offset, shape, strict=True))
        found.append((index[here].ravel(), index[there].ravel()))
    return found


def cut_volume(evidence: Array, stiffness: float) -> NDArray[np.bool_]:
    """Occupied voxels by the evidence of each and an even price of surface.

    Args:
        evidence: (nx, ny, nz) nats that a voxel is occupied.
        stiffness: nats a face between a voxel that is occupied and one that is not.

    Returns:
        (nx, ny, nz) bool.
    """
    flat = evidence.ravel()
    # Six faces cannot outweigh more evidence than this: such voxels need no node of their own.
    free = np.flatnonzero(np.abs(flat) < 6 * stiffness)
    steps = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    pairs = [(a, b, np.full(len(a), stiffness)) for a, b in neighbours(evidence.shape, steps)]
    return minimum_cut(flat, free, pairs).reshape(evidence.shape)


def cut_image(
    evidence: Array, free: NDArray[np.bool_], image: NDArray[np.uint8], stiffness: float
) -> NDArray[np.bool_]:
    """Object pixels by the evidence of each and a price of outline that is low along edges.

    The weights are those of Boykov and Jolly 2001 (doi:10.1109/ICCV.2001.937505) on eight
    neighbours.

    Args:
        evidence: (h, w) nats that a pixel is of the object.
        free: (h, w) pixels to be decided; the others hold to the sign of their evidence.
        image: (h, w) or (h, w, 3) uint8.
        stiffness: nats a pixel of outline across which colour does not change.

    Returns:
        (h, w) bool.
    """
    if not free.any():
        return np.asarray(evidence > 0)
    rows, columns = np.flatnonzero(free.any(axis=1)), np.flatnonzero(free.any(axis=0))
    part = (
        slice(max(0, rows[0] - 1), rows[-1] + 2),
        slice(max(0, columns[0] - 1), columns[-1] + 2),
    )
    colours = image[part].astype(np.float32).reshape(*evidence[part].shape, -1)
    flat, nodes = evidence[part].ravel(), np.flatnonzero(free[part].ravel())
    pixels = colours.reshape(-1, colours.shape[2])
    chosen = free[part].ravel()
    pairs = []
    steps = ((0, 1), (1, 0), (1, 1), (1, -1))
    found = neighbours(evidence[part].shape, steps)
    found = [(a[chosen[a] | chosen[b]], b[chosen[a] | chosen[b]]) for a, b in found]
    apart = [((pixels[a] - pixels[b]) ** 2).sum(axis=1) for a, b in found]
    scale = max(2.0 * float(np.mean(np.concatenate(apart))), 1.0)
    for step, (a, b), square in zip(steps, found, apart, strict=True):
        weight = stiffness * np.exp(-square / scale) / np.hypot(*step) / 2.0
        pairs.append((a, b, weight.astype(np.float64)))
    labels = evidence > 0
    labels[part] = minimum_cut(flat, nodes, pairs).reshape(evidence[part].shape)
    return np.asarray(labels)
