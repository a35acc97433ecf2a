"""Loading what the first rims would else have to wait for."""

from functools import cache

import numpy as np

from .camera import Camera
from .reconstruct import RimReconstructor
from .viewing import contours_from_loops

_OFF_PX = 2.0
_VIEWS, _STEP, _AWAY = 4, 0.2, 4.0  # views of a ball, rad from one to the next, its radii away


@cache  # once a process
def warm_up() -> None:
    """Compute a few small rims, so that the compiled loops are there: half a second, or some
    seconds where they are compiled for the first time, in which a live scan would lose frames."""
    angle = np.linspace(0, -2 * np.pi, 64, endpoint=False)
    loop = 200 + 100 * np.column_stack([np.cos(angle), np.sin(angle)])
    f = 100 * np.sqrt(_AWAY**2 - 1)
    K = np.array([[f, 0, 200], [0, f, 200], [0, 0, 1]])
    reconstructor = RimReconstructor()
    for k in range(_VIEWS):
        cos, sin = np.cos(k * _STEP), np.sin(k * _STEP)
        R = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
        camera = Camera(K, 400, 400, R, np.array([0, 0, _AWAY]))
        sigma = np.full(len(loop), 0.1)
        # One outline is off, so that points are outside of it.
        seen = loop + (_OFF_PX if k == 1 else 0)
        reconstructor.add(contours_from_loops(camera, [seen], [0], [sigma], k + 1, "object"))
    reconstructor.finish()
