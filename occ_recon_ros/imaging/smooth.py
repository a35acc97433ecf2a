"""Smoothing of closed curves that does not shrink them.

Minimises sum w |p - q|^2 + sum k |third difference of p|^2 over the closed curve p: a
Whittaker smoother (a discrete smoothing spline), one banded linear system. It keeps
quadratics exactly; a wave of angular frequency f (rad a sample) is kept by the factor
1 / (1 + (f/f0)^6), f0 = (w/k)^(1/6), so that a circle of radius R loses R (1/(R f0))^6.
P. H. C. Eilers, "A perfect smoother", Anal. Chem. 75, 2003, doi:10.1021/ac034173t.
"""

import numpy as np
from numpy.typing import NDArray

from ..geometry.compiled import compiled

Array = NDArray[np.floating]

_PAD, _DECAYED = 120, 12.0  # samples the loop is gone on with at both ends, at least; in 1 / f0
_STIFF = 1e7  # from which on rounding would tell

# Integral of (1 + x^6)^-2 over x > 0, over pi: variance left of white noise, per f0.
NOISE_GAIN = 5.0 / 18.0


def stiffness(cutoff: Array) -> Array:
    """k for weight 1 from the cut-off frequency f0, rad a sample."""
    third = cutoff * cutoff * cutoff  # a power of -6 takes ten times as long
    return 1 / (third * third)


def smooth_closed(points: Array, weight: Array, k: Array) -> Array:
    """Smooth a closed curve.

    Args:
        points: (n, d) float64, measured positions, evenly spaced along the curve.
        weight: (n,) float64, >= 0; 0 where there is no measurement.
        k: (n,) float64, stiffness at each sample; 0 lets the curve go there.

    Returns:
        (n, d) float64.

    Raises:
        ValueError: where stiffness beyond all weights leaves no curve but by rounding.
    """
    most = float(k.max())
    pad = max(_PAD, round(_DECAYED * most ** (1 / 6)))
    arrays = (np.ascontiguousarray(each, np.float64) for each in (points, weight, k))
    found: Array = compiled("imaging.kernels").smoothed(*arrays, pad, 2 if most > _STIFF else 1)
    return found
