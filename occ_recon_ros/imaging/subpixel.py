"""The edge in the image across a curve, to a fraction of a pixel.

Across each sample the grey profile is fitted with a blurred step, m + c erf((u - x)/(s sqrt 2)),
under a taper centred on the edge; the blur s is shared by neighbours. Blur of variance s^2
moves the edge of a curve of curvature k inwards by k s^2/2 (every level of the image obeys the
heat equation), which is put back: compare P. W. Verbeek and L. J. van Vliet, IEEE PAMI
16(7), 1994, doi:10.1109/34.297954.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import median
from ..geometry.compiled import compiled
from .curves import along, for_loops

Array = NDArray[np.floating]

_FINE, _COARSE = 0.5, 1.0
# Half-width of the profiles, in blurs: without the levels to either side, the place of an edge
# in noise is anyone's guess.
_SPAN = 3.2
_NOISY, _NOISY_SHARE = 10.0, 9


@dataclass(frozen=True)
class Edge:
    """Edges found across a curve; each array has one row a sample.

    Attributes:
        offset: (n,) float64, px along the outward normal from the curve to the edge.
        sigma: (n,) float64, 1 sigma of the offset, px; infinite where there is no edge.
        blur: (n,) float64, sigma of the blur of the edge, px.
        contrast: (n,) float64, grey levels (or colour distance) across the edge, >= 0.
    """

    offset: Array
    sigma: Array
    blur: Array
    contrast: Array


def profiles(
    image: NDArray, points: Array, out: Array, reach: float, spacing: float
) -> tuple[Array, Array]:
    """Values across the curve as one scalar, bright outside.

    Colour is projected on the direction from the object's to the background's colour, as
    seen at the ends of the profiles of the neighbours.

    Returns:
        u: (m,) float32, offsets along the outward normal, px.
        values: (n, m) float32.
    """
    count = int(np.ceil(reach / spacing))
    u = (np.arange(-count, count + 1) * spacing).astype(np.float32)
    values = across(image, points, out, u)
    loops = compiled("imaging.pixel_kernels")
    direction = along(loops.change_across(values), 15)
    length = np.sqrt((direction * direction).sum(axis=1, keepdims=True))
    return u, loops.seen_along(values, direction / np.where(length > 0, length, 1.0))


def across(image: NDArray, points: Array, out: Array, u: Array) -> Array:
    """(n, m, channels) float32 values of an image (h, w[, channels]) at distances u (m,), px,
    along unit vectors (n, 2) from points (n, 2)."""
    u = u.astype(np.float32)
    found: Array = compiled("imaging.pixel_kernels").across(for_loops(image), points, out, u)
    return found


def find_edges(
    image: NDArray,
    points: Array,
    out: Array,
    reach: float,
    iterations: int = 4,
    blur: float | None = None,
) -> Edge:
    """Locate the edge across each sample of a closed curve.

    Args:
        image: (h, w) or (h, w, 3), uint8 or uint16.
        points: (n, 2) float64, samples of the curve, px.
        out: (n, 2) float64, unit normals out of the object.
        reach: half-width of the search, px.
        iterations: Gauss-Newton steps, at least 2; these are enough for a tenth of a pixel.
            Where noise is low, one is left out.
        blur: sigma of the edges, px, where the curve is known to lie on them but for a few
            tenths of a pixel; None: look for the steepest place first.
    """
    spacing = _FINE if iterations > 2 else _COARSE
    u, values = profiles(image, points, out, max(reach, _SPAN * (blur or 0.0)), spacing)
    width, half = np.full(len(points), blur or 1.0), np.full(len(points), np.nan)
    step = compiled("imaging.kernels").edge_step
    # In heavy noise the way to the edge goes by the mean of neighbouring profiles, and only
    # the last step, linear in the noise, by each profile alone.
    share = _share_of(values)
    mean = along(values, share).astype(np.float32) if share > 1 else values
    x = np.zeros(len(points)) if blur else _steepest(u, mean)
    for _ in range(iterations - 1 if share > 1 else iterations - 2):
        half[:] = np.nan
        step(u, mean, x, width, half)
    if share == 1:
        half[:] = np.nan
    # Samples closer than a pixel say the same.
    sigma = step(u, values, x, width, half) / np.sqrt(spacing)
    lost = (np.abs(x) > reach - 1.0) | (half <= 0) | ~np.isfinite(sigma) | (sigma > reach / 2)
    return Edge(
        offset=np.where(lost, 0.0, x),
        sigma=np.where(lost, np.inf, sigma),
        blur=width,
        contrast=np.maximum(2 * half, 0.0),
    )


def interpolation_error(blur: Array) -> float:
    """How much edges of a blur (n,), px, scatter where there is no noise, px: values between
    the pixels of a sharp edge are not those of a blurred step. Measured on discs."""
    return float(0.29 * np.exp(-3.5 * median(blur)))


def _share_of(values: Array) -> int:
    """Over how many neighbours to average profiles: 1 where noise is low."""
    third = max(1, values.shape[1] // 3)
    every = max(8, len(values) // 100)
    few, next_to_them = values[2::every], values[: len(values) - 2 : every]
    contrast = median(np.abs(few[:, -third:].mean(axis=1) - few[:, :third].mean(axis=1)))
    noise = 1.4826 / np.sqrt(2) * median(np.abs(few - next_to_them))
    return _NOISY_SHARE if noise * _NOISY > contrast else 1


def _steepest(u: Array, values: Array) -> Array:
    """First guess: the centre of the steepest part of each profile."""
    near = np.exp(-0.5 * (u / (0.6 * u[-1])) ** 2) ** 3
    first: Array = compiled("imaging.kernels").steepest(u, values, near)
    return first
