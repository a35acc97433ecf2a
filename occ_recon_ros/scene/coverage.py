"""Exact area coverage of pixels by polygons, as font rasterisers compute it."""

from collections.abc import Sequence

import numpy as np

from occ_recon_ros.geometry.arrays import Array, repeated


def coverage(loops_uv: Sequence[Array], width: int, height: int) -> Array:
    """The share of each pixel's square that lies inside some polygons.

    By Green's theorem each side adds to a pixel the signed area between itself and the
    pixel's right-hand side, and to all pixels right of it its height there.

    Args:
        loops_uv: one (n, 2) float64 closed polygon a loop, pixels, the inside on the left
            as displayed (outer loops counter-clockwise, holes clockwise); they may leave
            the image. Pixel (0, 0) is centred on (0, 0).
        width, height: of the image, pixels.

    Returns:
        (height, width) float64, 0 to 1.
    """
    a = np.concatenate([np.zeros((0, 2)), *loops_uv]) + 0.5
    b = np.concatenate([np.zeros((0, 2)), *(np.roll(uv, -1, axis=0) for uv in loops_uv)]) + 0.5
    # What lies left of the image counts as on its border; what lies right never counts.
    a, b = _split(a, b, axis=1)
    middle = 0.5 * (a[:, 1] + b[:, 1])
    rows = (middle > 0) & (middle < height)
    a, b = _split(a[rows], b[rows], axis=0)
    a[:, 0], b[:, 0] = np.clip(a[:, 0], 0, width), np.clip(b[:, 0], 0, width)
    middle = 0.5 * (a + b)
    column = np.minimum(middle[:, 0].astype(np.intp), width)
    row = np.minimum(middle[:, 1].astype(np.intp), height - 1)
    rise = b[:, 1] - a[:, 1]
    share = rise * (middle[:, 0] - column)
    cell = row * (width + 2) + column
    sums = np.bincount(cell, rise - share, minlength=height * (width + 2))
    sums += np.bincount(cell + 1, share, minlength=height * (width + 2))
    # Walking down the screen has the inside on the right-hand side of the image.
    inside = np.cumsum(sums.reshape(height, width + 2)[:, :width], axis=1)
    return np.clip(inside, 0.0, 1.0)


def _split(a: Array, b: Array, axis: int) -> tuple[Array, Array]:
    """Cut segments a-b (n, 2) at the whole numbers of one coordinate."""
    low, high = np.minimum(a, b)[:, axis], np.maximum(a, b)[:, axis]
    first = np.floor(low) + 1
    cuts = np.maximum(np.ceil(high) - first, 0).astype(np.intp)
    which, rank = repeated(cuts + 1)
    start, stop = a[which], b[which]
    # Count the pieces from the lower end, whichever way the segment runs.
    up = (b[:, axis] >= a[:, axis])[which]
    d = stop - start
    with np.errstate(divide="ignore", invalid="ignore"):
        low_cut = (first[which] + rank - 1 - start[:, axis]) / d[:, axis]
        high_cut = (first[which] + rank - start[:, axis]) / d[:, axis]
    from_low, to_high = rank == 0, rank == cuts[which]
    s = np.where(from_low, np.where(up, 0.0, 1.0), low_cut)
    t = np.where(to_high, np.where(up, 1.0, 0.0), high_cut)
    s, t = np.where(up, s, t), np.where(up, t, s)
    return start + s[:, None] * d, start + t[:, None] * d
