"""Scenes of ``path_traced.py``: as galleries, sellers and laboratories photograph things."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from path_traced_studio import Shot, Studio


def temple(s: Studio) -> Shot:
    """A stone model with columns before black; lamps and camera go around, its inside is dark."""
    stone = s.material((0.42, 0.37, 0.3), 0.8, other=(0.25, 0.21, 0.17), scale=9, bump=0.35)
    for k, wide in enumerate((1.0, 0.9, 0.82)):
        s.box(stone, (0, 0, 0.04 + 0.07 * k), (1.5 * wide, wide, 0.08))
    for x in (-0.5, -0.17, 0.17, 0.5):
        for y in (-0.27, 0.27):
            s.rod(stone, (x, y, 0.55), 0.07, 0.75)
    s.box(stone, (0.1, 0, 0.5), (0.5, 0.3, 0.65))
    s.box(stone, (0, 0, 0.96), (1.25, 0.75, 0.12))
    s.box(stone, (-0.1, 0, 1.05), (1.0, 0.45, 0.1))
    s.add("cone", stone, (0.1, 0, 1.19), (1, 0.55, 1), vertices=4, radius1=0.6, depth=0.26)
    s.ball(stone, (-0.62, -0.38, 0.26), 0.09, (1, 1, 1.6))
    s.cloth(s.material((0.004, 0.004, 0.004), 0.9), 7)
    s.sky((0.004, 0.004, 0.004), 1)
    s.lamp((2.5, -4, 3), 0.6, 260)
    s.lamp((-3, -3, 1.5), 0.5, 40)
    return Shot(elevation=14, look=(0, 0, 0.55), moves="rig", noise=2)


def shoe(s: Studio) -> Shot:
    """Half white, on a white sweep that is lit to the end of the scale, as shops show them."""
    cloth = s.material((0.1, 0.16, 0.4), 0.8, other=(0.16, 0.24, 0.5), scale=8)
    white = s.material((0.85, 0.85, 0.83), 0.5)
    s.ball(white, (0, 0, 0.09), 0.2, (3.1, 1.15, 0.45))
    s.box(white, (-0.1, 0, 0.06), (0.8, 0.36, 0.12))
    s.ball(cloth, (-0.28, 0, 0.27), 0.24, (1.1, 0.75, 1.15), -0.15)
    s.ball(cloth, (0.2, 0, 0.16), 0.2, (1.9, 0.95, 0.75), 0.15)
    s.add("torus", cloth, (-0.3, 0, 0.52), turned=(0, -0.2, 0), major_radius=0.15,
          minor_radius=0.05)  # fmt: skip
    for x in (0.0, 0.08, 0.16):
        s.rod(white, (x, 0, 0.33 - 0.25 * x), 0.018, 0.22, turned=(np.pi / 2, 0, 0))
    s.ball(s.material((0.8, 0.3, 0.05), 0.4), (-0.52, 0, 0.22), 0.08, (0.5, 1, 1.4))
    s.floor(s.material((0.92, 0.92, 0.92), 0.9), wall=s.material((0.92, 0.92, 0.92), 0.9))
    s.sky((1, 1, 1), 0.75)
    s.lamp((2, -2, 5), 3, 210)
    s.lamp((-3, 2, 5), 3, 110)
    return Shot(640, 480, 1500, elevation=15, look=(0, 0, 0.22), views=24, noise=1.5, jpeg=82)


def sampled(s: Studio) -> Shot:
    """A tin and a lid, small, on a checked board that turns, in a laboratory; the sheet unknown."""
    tin = s.material((0.5, 0.12, 0.06), 0.3, other=(0.75, 0.65, 0.4), scale=3)
    steel = s.material((0.7, 0.7, 0.7), 0.25, 1.0)
    s.rod(tin, (0, 0, 0.26), 0.2, 0.5)
    s.rod(steel, (0, 0, 0.52), 0.2, 0.03)
    s.ball(s.material((0.04, 0.04, 0.045), 0.4), (0.26, 0.1, 0.12), 0.11)
    s.box(s.material((0.85, 0.85, 0.85), 0.8), (0, 0, -0.01), (1.9, 1.9, 0.02), of=s.turning)
    ink = s.material((0.02, 0.02, 0.02), 0.8)
    for i in range(8):
        for j in range(8):
            if (i + j) % 2:
                at = (0.22 * (i - 3.5), 0.22 * (j - 3.5), 0.002)
                s.box(ink, at, (0.22, 0.22, 0.001), of=s.turning)
    s.floor(s.material((0.28, 0.27, 0.26), 0.6), -0.1, s.material((0.45, 0.46, 0.44), 0.9), 5)
    rng = np.random.default_rng(4)
    for k in range(7):
        tone = s.material(tuple(rng.uniform(0.05, 0.6, 3)), 0.5)
        at = (-3 + k + rng.uniform(-0.3, 0.3), rng.uniform(2.6, 4.2), 0.5)
        s.box(tone, at, (0.6, 0.5, rng.uniform(0.8, 1.6)), of=s.room)
    s.sky((0.55, 0.58, 0.6), 0.6)
    s.lamp((1, -2, 4), 1.5, 150)
    return Shot(640, 480, 900, elevation=32, look=(0, 0, 0.15), noise=3, jpeg=85)


def lizard(s: Studio) -> Shot:
    """Painted, before dark cloth on a dark plate; its tail leaves the picture; black above and
    below."""
    skin = s.material((0.2, 0.32, 0.1), 0.35, other=(0.45, 0.42, 0.16), scale=6, bump=0.2)
    pale = s.material((0.6, 0.55, 0.35), 0.5)
    for k in range(17):
        x = -1.25 + 0.12 * k
        thick = 0.05 + 0.19 * np.exp(-(((x - 0.1) / 0.42) ** 2))
        high = 0.36 + 0.35 * max(x - 0.25, 0) - 0.08 * np.sin(3 * x)
        s.ball(skin, (x, 0.25 * np.sin(2.2 * x) * (x < 0), high), thick, (1.3, 0.8, 1))
    s.ball(skin, (0.82, 0, 0.62), 0.15, (1.5, 0.8, 0.7), 0.2)
    s.ball(pale, (0.9, 0, 0.55), 0.1, (1.5, 0.75, 0.5), 0.2)
    for x in (-0.12, 0.38):
        for y in (-0.17, 0.17):
            s.rod(skin, (x, y, 0.16), 0.055, 0.34, turned=(0.25 * np.sign(y), 0, 0))
    for x in np.linspace(-0.6, 0.55, 9):
        s.add("cone", pale, (x, 0, 0.55 + 0.1 * np.exp(-(((x - 0.1) / 0.4) ** 2))),
              vertices=8, radius1=0.05, depth=0.2)  # fmt: skip
    s.rod(s.material((0.02, 0.02, 0.022), 0.35), (0, 0, -0.02), 0.7, 0.06, of=s.turning)
    s.cloth(s.material((0.012, 0.012, 0.03), 0.95, other=(0.03, 0.03, 0.06), scale=1.3, bump=1))
    s.box(s.material((0.02, 0.02, 0.02), 0.6), (0, 0, -0.12), (12, 12, 0.1), of=s.room)
    s.sky((0.1, 0.1, 0.1), 0.4)
    s.lamp((3, -3, 4), 1, 260)
    s.lamp((-3, -1, 2), 1, 100)
    return Shot(560, 480, 1420, elevation=16, look=(0.05, 0, 0.35), views=24, noise=3, jpeg=85)


def keyed(s: Studio) -> Shot:
    """A grey and green robot before a green screen that shines back on it; the wall ends."""
    grey = s.material((0.5, 0.5, 0.52), 0.25, 0.8)
    green = s.material((0.12, 0.3, 0.14), 0.4)
    s.box(grey, (0, 0, 0.55), (0.42, 0.3, 0.5))
    s.box(green, (0, -0.155, 0.55), (0.3, 0.02, 0.3))
    s.ball(grey, (0, 0, 0.95), 0.17)
    s.rod(grey, (0, 0, 1.2), 0.02, 0.2)
    s.ball(s.material((0.7, 0.1, 0.1), 0.3), (0, 0, 1.31), 0.04)
    for x in (-1, 1):
        s.rod(green, (0.28 * x, 0, 0.55), 0.06, 0.5, turned=(0, -0.25 * x, 0))
        s.ball(grey, (0.35 * x, 0, 0.28), 0.08)
        s.rod(grey, (0.12 * x, 0, 0.17), 0.07, 0.34)
    screen = s.material((0.03, 0.45, 0.08), 0.9)
    s.box(screen, (0, 0, -0.05), (5, 9, 0.1), of=s.room)
    s.box(screen, (0, 4, 2), (5, 0.1, 5), of=s.room)
    s.box(s.material((0.5, 0.48, 0.44), 0.8), (0, 6, 2), (16, 0.1, 8), of=s.room)
    s.sky((0.6, 0.6, 0.6), 0.5)
    s.lamp((2, -3, 4), 1.5, 220)
    s.lamp((-2, 2, 4), 1.5, 150)
    return Shot(480, 600, 1050, elevation=14, look=(0, 0, 0.62), noise=2.5, jpeg=85)


SELLER: dict[str, Callable[[Studio], Shot]] = {
    scene.__name__: scene for scene in (temple, shoe, sampled, lizard, keyed)
}
