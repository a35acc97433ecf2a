"""Rendered views of a table that turns."""

from dataclasses import replace
from functools import cache

import numpy as np

from occ_recon_ros.scene import TurntableSettings, make_object, render, turntable_cameras

VIEWS = 12
RIG = TurntableSettings(
    frames=VIEWS,
    step=-2 * np.pi / VIEWS,
    elevation=np.deg2rad(30),
    width=320,
    height=240,
    focal_px=400.0,
)


@cache
def moving(turn_deg, frames):
    """Rendered frames of a turn, that nobody changes."""
    step = np.deg2rad(turn_deg) / frames
    cameras = turntable_cameras(replace(RIG, frames=frames, step=step, elevation=np.deg2rad(20)))
    return [render(make_object("gourd"), camera) for camera in cameras]


def images_of(turn_deg, frames, still=(0, 0)):
    """The same, with frames before and after in which nothing moves."""
    images = moving(turn_deg, frames)
    return [images[0]] * still[0] + images + [images[-1]] * still[1]
