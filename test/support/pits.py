"""A smooth body with pits that look as the backdrop: each view has its own, and shows a surface
where the others have theirs."""

import cv2
import numpy as np

from occ_recon_ros.scene import TurntableSettings, make_object, render, turntable_cameras

_TURN = TurntableSettings(frames=12, step=np.pi / 6, width=640, height=480, focal_px=800.0)
_PITS, _SIZE, _AWAY = 12, 0.04, 0.3  # of them a view; radius and place, of the size of the outline


def views_of_pits(pitted=True):
    """Twelve cameras and images; ``pitted``: with pits."""
    body, found = make_object("ellipsoid"), []
    for k, camera in enumerate(turntable_cameras(_TURN)):
        image = render(body, camera)
        outline = body.exact_contours(camera, stamp_ns=k + 1).uv
        for angle in 2 * np.pi * (np.arange(_PITS if pitted else 0) + 0.37 * k) / _PITS:
            aside = _AWAY * np.ptp(outline, axis=0) * [np.cos(angle), np.sin(angle)]
            middle = np.rint(16 * (outline.mean(axis=0) + aside)).astype(int)
            radius = round(16 * _SIZE * np.ptp(outline[:, 1]))
            cv2.circle(image, middle.tolist(), radius, image[0, 0].tolist(), -1, cv2.LINE_AA, 4)
        found.append((camera, image))
    return found
