"""Scenes of ``path_traced.py``: figures of materials that rooms have."""

from collections.abc import Callable

import numpy as np
from path_traced_studio import Shot, Studio


def bird(s: Studio) -> Shot:
    """Clouded wood on dark legs and a dark foot, on a white table in a hard shadow."""
    wood = s.material((0.36, 0.19, 0.07), 0.45, other=(0.72, 0.5, 0.25))
    dark = s.material((0.05, 0.03, 0.02), 0.4)
    s.ball(wood, (0, 0, 0.55), 0.3, (1.5, 1, 1), -0.4)
    s.ball(wood, (0.42, 0, 0.85), 0.17)
    s.ball(wood, (-0.5, 0, 0.42), 0.18, (1.6, 0.7, 0.35), -0.3)
    s.add("cone", dark, (0.64, 0, 0.85), turned=(0, np.pi / 2, 0), radius1=0.06, depth=0.22)
    for y in (-0.09, 0.09):
        s.ball(dark, (0.53, y, 0.92), 0.03)
        s.rod(dark, (0.03, 0.9 * y, 0.2), 0.03, 0.35)
    s.rod(dark, (0, 0, 0.025), 0.22, 0.05)
    s.floor(
        s.material((0.78, 0.77, 0.74)),
        wall=s.material((0.5, 0.5, 0.5), other=(0.62, 0.61, 0.6), scale=0.5),
    )
    s.sky((0.6, 0.65, 0.7), 0.6)
    s.lamp((3, -2, 4), 1.2, 260)
    return Shot(600, 450, 1125, elevation=17, views=21, jpeg=88)


def pig(s: Studio) -> Shot:
    """Glazed, small in the image, on grey paper, the camera anywhere above."""
    pink = s.material((0.75, 0.32, 0.30), 0.12)
    s.ball(pink, (0, 0, 0.28), 0.25, (1.4, 1, 1))
    s.ball(pink, (0.33, 0, 0.36), 0.15)
    s.rod(pink, (0.47, 0, 0.36), 0.06, 0.1, turned=(0, np.pi / 2, 0))
    for y in (-1, 1):
        s.ball(pink, (0.3, 0.11 * y, 0.5), 0.06, (0.5, 1, 1.2))
        for x in (-0.2, 0.2):
            s.rod(pink, (x, 0.12 * y, 0.1), 0.05, 0.2)
    s.floor(s.material((0.3, 0.31, 0.33), 0.9))
    s.sky((0.6, 0.6, 0.65), 0.4)
    s.lamp((2, -2, 4), 2, 180)
    look = (0, 0, 0.3)
    return Shot(675, 506, 862, 6.5, 30, look, moves="hemisphere", noise=2.5, jpeg=90)


def fruit(s: Studio) -> Shot:
    """On a black plate that turns with it."""
    green = s.material((0.25, 0.42, 0.06), 0.25, other=(0.5, 0.35, 0.06), scale=4)
    red = s.material((0.5, 0.04, 0.03), 0.2, other=(0.6, 0.35, 0.1), scale=3)
    s.ball(green, (0.2, 0, 0.3), 0.3, (1, 1, 0.95))
    s.ball(red, (-0.3, 0.1, 0.25), 0.25)
    s.ball(s.material((0.8, 0.55, 0.06), 0.45), (-0.1, -0.32, 0.18), 0.18, (1.5, 1, 1))
    s.rod(s.material((0.1, 0.06, 0.03), 0.8), (0.2, 0, 0.62), 0.02, 0.18)
    s.rod(s.material((0.03, 0.03, 0.03), 0.25), (0, 0, -0.03), 0.85, 0.06, of=s.turning)
    s.floor(s.material((0.5, 0.45, 0.4), 0.5), -0.12, s.material((0.55, 0.6, 0.62), 0.9), 4)
    s.sky((0.6, 0.6, 0.6), 0.6)
    s.lamp((2, -3, 4), 1.5, 220)
    return Shot(600, 450, 1125, elevation=20, look=(0, 0, 0.3))


def cup(s: Studio) -> Shot:
    """Clouded blue and white on a wooden table."""
    glaze = s.material((0.85, 0.85, 0.85), 0.1, other=(0.06, 0.12, 0.45), scale=4)
    s.rod(glaze, (0, 0, 0.375), 0.34, 0.75)
    turned, ring = (np.pi / 2, 0, 0), {"major_radius": 0.2, "minor_radius": 0.045}
    s.add("torus", glaze, (0.42, 0, 0.4), turned=turned, **ring)
    table = s.material((0.3, 0.17, 0.08), 0.3, other=(0.16, 0.08, 0.035), scale=3)
    s.floor(table, wall=s.material((0.7, 0.68, 0.6), 0.9), away=6)
    s.sky((0.6, 0.6, 0.6), 0.6)
    s.lamp((-2, -2, 4), 1.5, 200)
    return Shot(600, 450, 1125, elevation=25, look=(0, 0, 0.38))


def casting(s: Studio) -> Shot:
    """Bare aluminium on a green mat with lines that turns with it, before a table as grey."""
    bare = s.material((0.62, 0.62, 0.63), 0.42, 1.0, (0.5, 0.5, 0.51), 20, 0.1)
    for at, size in (
        ((0, 0, 0.06), (1.0, 0.5, 0.1)),
        ((-0.4, 0, 0.4), (0.1, 0.5, 0.7)),
    ):
        s.box(bare, at, size)
    s.rod(bare, (0.2, 0, 0.3), 0.16, 0.4)
    s.rod(bare, (0.2, 0, 0.5), 0.24, 0.06)
    s.box(s.material((0.05, 0.3, 0.09), 0.7), (0, 0, -0.01), (2.4, 2.4, 0.03), of=s.turning)
    line = s.material((0.6, 0.8, 0.6), 0.7)
    for k in np.linspace(-1.1, 1.1, 12):
        s.box(line, (k, 0, 0.006), (0.01, 2.4, 0.002), of=s.turning)
        s.box(line, (0, k, 0.006), (2.4, 0.01, 0.002), of=s.turning)
    s.floor(s.material((0.5, 0.48, 0.45), 0.5), -0.08)
    s.sky((0.6, 0.65, 0.7), 0.7)
    s.lamp((1, -2, 4), 1.5, 200)
    return Shot(600, 450, 1125, elevation=30, look=(0, 0, 0.3), noise=2.5)


def bronze(s: Studio) -> Shot:
    """Dark and shiny on a brown table."""
    metal = s.material((0.20, 0.11, 0.05), 0.32, 1.0, (0.06, 0.05, 0.03), 6, 0.15)
    s.add("monkey", metal, (0, 0, 0.75), size=0.9)
    s.rod(metal, (0, 0, 0.2), 0.12, 0.4)
    s.rod(metal, (0, 0, 0.04), 0.35, 0.08)
    table = s.material((0.32, 0.17, 0.08), 0.35, other=(0.18, 0.09, 0.04), scale=4)
    s.floor(table, wall=s.material((0.5, 0.47, 0.42), 0.9))
    s.sky((0.5, 0.55, 0.6), 0.35)
    s.lamp((2, -3, 4), 1, 220)
    s.lamp((-3, 1, 3), 1, 90)
    return Shot(600, 450, 1012, jpeg=85, noise=3)


def black(s: Studio) -> Shot:
    """A black casting before black cloth that goes round with the camera."""
    s.add("monkey", s.material((0.02, 0.02, 0.022), 0.25, 0.3), (0, 0, 0.6), size=1.0)
    s.cloth(s.material((0.01, 0.01, 0.01), 0.95), 8)
    s.sky((0.01, 0.01, 0.01), 1)
    s.lamp((3, -3, 3), 2, 500)
    s.lamp((-3.5, -1, 2), 2, 300)
    s.lamp((0, 2.5, 3.5), 2, 250)
    return Shot(elevation=12, look=(0, 0, 0.6), moves="rig")


def head(s: Studio) -> Shot:
    """Rough stone before dark cloth; bars left and right."""
    stone = s.material((0.33, 0.30, 0.26), 0.85, other=(0.16, 0.145, 0.13), scale=14, bump=0.4)
    for at, r, size in (
        ((0, 0, 1.0), 0.36, (0.85, 1, 1.15)),
        ((0, -0.36, 0.98), 0.08, (0.7, 1.2, 1.6)),
        ((0.31, 0, 1.0), 0.09, (0.4, 1, 1.5)),
        ((-0.31, 0, 1.0), 0.09, (0.4, 1, 1.5)),
        ((0, -0.2, 0.72), 0.17, (1, 1, 1)),
        ((0, 0.02, 0.22), 0.4, (1.25, 0.65, 0.6)),
    ):
        s.ball(stone, at, r, size)
    s.rod(stone, (0, 0, 0.55), 0.17, 0.5)
    s.box(stone, (0, 0, 0.07), (0.7, 0.5, 0.14))
    s.cloth(s.material((0.02, 0.016, 0.014), 0.95, other=(0.06, 0.05, 0.045), scale=1.5, bump=1))
    s.sky((0.02, 0.02, 0.022), 0.5)
    s.lamp((3, -3, 3), 0.8, 220)
    s.lamp((-4, -1, 2), 1, 30)
    return Shot(640, 600, 1300, elevation=10, look=(0, 0, 0.75), views=24, noise=3, bars=120)


def skull(s: Studio) -> Shot:
    """With deep sockets, before black, on a dark stand that does not turn."""
    bone = s.material((0.62, 0.52, 0.36), 0.5, other=(0.35, 0.26, 0.15), scale=7, bump=0.3)
    dome = s.ball(bone, (0, 0.05, 0.75), 0.4, (0.85, 1.1, 0.9))
    for at, r in (((0.15, -0.36, 0.72), 0.13), ((-0.15, -0.36, 0.72), 0.13)):
        s.hollow(dome, at, r)
    s.ball(bone, (0, -0.2, 0.42), 0.2, (1, 0.9, 0.8))
    s.box(bone, (0, -0.15, 0.25), (0.3, 0.3, 0.16))
    for x in (-0.26, 0.26):
        s.ball(bone, (x, -0.2, 0.55), 0.09)
    s.box(s.material((0.03, 0.03, 0.03), 0.4), (0, 0, 0.08), (0.5, 0.5, 0.18), of=s.room)
    s.cloth(s.material((0.006, 0.006, 0.007), 0.95), 6)
    s.sky((0, 0, 0), 0)
    s.lamp((2, -4, 3), 0.8, 200)
    s.lamp((-3, 2, 3), 0.7, 130)
    return Shot(elevation=12, look=(0, 0, 0.6))


SCENES: dict[str, Callable[[Studio], Shot]] = {
    scene.__name__: scene for scene in (bird, pig, fruit, cup, casting, bronze, black, head, skull)
}
