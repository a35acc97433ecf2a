"""Scenes of ``path_traced.py`` as strangers send them: glass, chrome, things cut short."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from path_traced_studio import Shot, Studio


def bottle(s: Studio) -> Shot:
    """Green glass with a label, before a grey wall; what is behind it shows through."""
    s.scene.cycles.max_bounces = s.scene.cycles.transmission_bounces = 8
    glass = s.material((0.25, 0.55, 0.3), 0.02)
    shader = glass.node_tree.nodes["Principled BSDF"]
    shader.inputs["Transmission Weight"].default_value = 1.0
    shader.inputs["IOR"].default_value = 1.45
    s.rod(glass, (0, 0, 0.45), 0.3, 0.9)
    s.ball(glass, (0, 0, 0.9), 0.3, (1, 1, 0.8))
    s.rod(glass, (0, 0, 1.25), 0.1, 0.5)
    s.rod(s.material((0.6, 0.45, 0.25), 0.8), (0, 0, 1.54), 0.095, 0.12)
    paper = s.material((0.85, 0.8, 0.65), 0.8, other=(0.5, 0.12, 0.1), scale=6)
    s.rod(paper, (0, 0, 0.42), 0.303, 0.4)
    s.ball(s.material((0.7, 0.1, 0.1), 0.3), (0.34, 0.05, 0.12), 0.12)
    table = s.material((0.45, 0.42, 0.4), 0.6)
    s.floor(table, wall=s.material((0.42, 0.44, 0.46), 0.9, other=(0.5, 0.5, 0.5), scale=0.6))
    s.sky((0.6, 0.65, 0.7), 0.6)
    s.lamp((3, -2, 4), 1.2, 240)
    return Shot(480, 640, 1150, elevation=18, look=(0, 0, 0.75), noise=2.5, jpeg=88)


def chrome(s: Studio) -> Shot:
    """A polished fitting that mirrors the room, on a dark wooden table."""
    metal = s.material((0.75, 0.75, 0.77), 0.04, 1.0)
    s.rod(metal, (0, 0, 0.12), 0.4, 0.24)
    s.rod(metal, (0, 0, 0.5), 0.17, 0.8)
    s.ball(metal, (0, 0, 0.95), 0.24)
    s.rod(metal, (0.36, 0, 0.95), 0.1, 0.6, turned=(0, np.pi / 2, 0))
    s.rod(metal, (0.62, 0, 0.82), 0.09, 0.3)
    s.rod(metal, (-0.1, 0, 1.28), 0.05, 0.3, turned=(0, -0.4, 0))
    table = s.material((0.1, 0.05, 0.025), 0.35, other=(0.16, 0.08, 0.04), scale=4)
    s.floor(table, wall=s.material((0.55, 0.5, 0.42), 0.9, other=(0.3, 0.33, 0.4), scale=0.5))
    s.box(s.material((0.5, 0.1, 0.1), 0.5), (-3, -6, 1), (1.2, 1, 2), of=s.room)
    s.sky((0.5, 0.55, 0.6), 0.5)
    s.lamp((2, -3, 4), 1.5, 240)
    s.lamp((-3, -1, 3), 1, 120)
    return Shot(600, 500, 1050, elevation=20, look=(0.05, 0, 0.65), noise=2.5, jpeg=92)


def small(s: Studio) -> Shot:
    """A pot of a tenth of the image's width on a table in a room full of things."""
    clay = s.material((0.5, 0.22, 0.1), 0.7, other=(0.38, 0.16, 0.08), scale=5)
    s.ball(clay, (0, 0, 0.3), 0.3, (1, 1, 0.95))
    s.rod(clay, (0, 0, 0.58), 0.16, 0.2)
    s.add("torus", clay, (0.28, 0, 0.42), turned=(np.pi / 2, 0, 0), major_radius=0.15,
          minor_radius=0.04)  # fmt: skip
    s.ball(clay, (-0.36, 0, 0.42), 0.1, (1.5, 0.7, 0.7), 0.6)
    s.floor(
        s.material((0.6, 0.5, 0.36), 0.4, other=(0.5, 0.4, 0.28), scale=2),
        wall=s.material((0.66, 0.64, 0.58), 0.9),
        away=6,
    )
    rng = np.random.default_rng(8)
    for k in range(9):
        tone = s.material(tuple(rng.uniform(0.05, 0.7, 3)), 0.5)
        high = rng.uniform(0.5, 2.0)
        at = (-4 + k + rng.uniform(-0.3, 0.3), rng.uniform(3.2, 5.4), high / 2)
        s.box(tone, at, (0.7, 0.6, high), turned=(0, 0, rng.uniform(0, 1)), of=s.room)
    s.box(s.material((0.25, 0.2, 0.5), 0.8), (1.5, 5.9, 3.0), (2.4, 0.1, 1.4), of=s.room)
    s.sky((0.6, 0.6, 0.62), 0.6)
    s.lamp((2, -2, 5), 1.5, 260)
    return Shot(800, 600, 800, 7.0, 18, (0, 0, 0.35), noise=2.5, jpeg=85)


def porcelain(s: Studio) -> Shot:
    """White and glazed on a plate that turns, before dark folds; two thirds of a turn, cameras
    off by a pixel and a half, black on all sides."""
    white = s.material((0.82, 0.82, 0.84), 0.08)
    s.ball(white, (0, 0, 0.5), 0.3, (1, 0.8, 1.3))
    s.ball(white, (0, -0.08, 1.02), 0.2)
    s.ball(white, (0, -0.3, 0.98), 0.07, (0.8, 1.6, 0.8))
    for x in (-1, 1):
        s.ball(white, (0.13 * x, 0, 1.3), 0.07, (0.8, 0.6, 2.2))
        s.rod(white, (0.14 * x, 0, 0.12), 0.09, 0.24)
        s.ball(white, (0.3 * x, -0.12, 0.62), 0.08, (1, 1.8, 0.8))
    s.rod(s.material((0.12, 0.12, 0.13), 0.3), (0, 0, -0.03), 0.6, 0.06, of=s.turning)
    s.cloth(s.material((0.03, 0.03, 0.05), 0.95, other=(0.1, 0.1, 0.13), scale=1.2, bump=1))
    s.box(s.material((0.05, 0.05, 0.055), 0.8), (0, 0, -0.12), (12, 12, 0.1), of=s.room)
    s.sky((0.1, 0.1, 0.11), 0.5)
    s.lamp((3, -3, 4), 1, 240)
    s.lamp((-3, -2, 2), 1, 80)
    return Shot(
        480, 600, 1200, elevation=14, look=(0, 0, 0.65), noise=3, jpeg=80, bars=90,
        share=0.66, off=1.5,
    )  # fmt: skip


ROUGH: dict[str, Callable[[Studio], Shot]] = {
    scene.__name__: scene for scene in (bottle, chrome, small, porcelain)
}
