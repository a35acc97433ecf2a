"""Thin stalks before a plain backdrop: of a body that all views leave, little poses take much."""

from dataclasses import replace

import numpy as np

from occ_recon_ros.scene import TurntableSettings, render, turntable_cameras
from occ_recon_ros.scene.objects import SceneObject
from occ_recon_ros.scene.shapes import limb

_ENDS = ((0.05, 0.0, 0.03), (-0.04, 0.03, -0.03), (-0.05, 0.0, 0.0))  # x and y below, y above
_TURN = TurntableSettings(frames=8, step=np.pi / 4, width=320, height=240, focal_px=400.0)


def stalks():
    """Three of them, that lean through each other."""
    feet = [limb((x, y, -0.06), (-0.7 * x, above, 0.07), 0.012) for x, y, above in _ENDS]
    return SceneObject("stalks", tuple(feet))


def views_of_stalks(off_px=0.0, bitten=False):
    """Eight cameras and images.

    Args:
        off_px: by which the principal point that is told is off.
        bitten: whether in each image a little of a stalk looks as the backdrop, at another place.
    """
    thing, found = stalks(), []
    for k, camera in enumerate(turntable_cameras(_TURN)):
        image = render(thing, camera)
        if bitten:
            u, v = np.rint(camera.project(np.array([[0, 0, 0.05 - 0.013 * k]]))[0]).astype(int)
            image[v - 3 : v + 4, u - 45 : u + 46] = image[0, 0]
        K = camera.K + np.array([[0, 0, off_px], [0, 0, 0], [0, 0, 0]])
        found.append((replace(camera, K=K), image))
    return found
