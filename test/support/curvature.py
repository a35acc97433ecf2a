"""Principal curvatures of a scene object, which tests alone ask for."""

import numpy as np


def principal_curvatures(scene_object, points):
    """k_min and k_max, (n,) 1/m and positive where convex, at points (n, 3) on the surface."""
    _, S = scene_object.shape(points)
    # The third eigenvalue is the 0 of the normal: trace and second invariant give the two others
    # without deciding which is which.
    mean = 0.5 * np.trace(S, axis1=1, axis2=2)
    gauss = 0.5 * (4 * mean**2 - np.einsum("nij,nji->n", S, S))
    spread = np.sqrt(np.maximum(mean**2 - gauss, 0))
    return mean - spread, mean + spread
