"""Scenes of ``path_traced.py`` as people at home take them: a window in the picture, pieces that
stand apart, leaves out of focus, a pedestal that turns too, a glossy toy in a tent of light."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from path_traced_studio import Shot, Studio, Vector


def kitchen(s: Studio) -> Shot:
    """A cream teapot on a wooden lazy Susan, on a kitchen table before an overexposed window."""
    cream = s.material((0.78, 0.68, 0.47), 0.18, other=(0.7, 0.58, 0.38), scale=3)
    red = s.material((0.5, 0.06, 0.04), 0.25)
    s.ball(cream, (0, 0, 0.34), 0.34, (1.1, 1, 0.95))
    s.rod(cream, (0, 0, 0.04), 0.2, 0.1)
    s.ball(cream, (0, 0, 0.66), 0.17, (1, 1, 0.35))
    s.ball(red, (0, 0, 0.75), 0.055)
    s.add("torus", cream, (-0.42, 0, 0.38), (1, 1, 1.25), (np.pi / 2, 0, 0), major_radius=0.17,
          minor_radius=0.04)  # fmt: skip
    for k in range(9):
        s.ball(cream, (0.32 + 0.038 * k, 0, 0.27 + 0.004 * k * k), 0.095 - 0.005 * k)
    s.add("cone", red, (0.05, 0, 0.86), (0.4, 1, 1), radius1=0.1, depth=0.16)
    wood = s.material((0.33, 0.17, 0.07), 0.4, other=(0.2, 0.1, 0.04), scale=2.5)
    s.rod(wood, (0, 0, -0.03), 0.8, 0.06, of=s.turning)
    s.rod(s.material((0.1, 0.1, 0.1)), (0, 0, -0.08), 0.4, 0.05, of=s.room)
    table = s.material((0.5, 0.36, 0.22), 0.35, other=(0.38, 0.26, 0.15), scale=1.5)
    s.box(table, (0, 1.2, -0.15), (9, 4.6, 0.1), of=s.room)
    s.box(s.material((0.62, 0.6, 0.5), 0.9), (0, 4.6, 1), (16, 0.1, 8), of=s.room)
    s.box(_shining(s, (1, 0.98, 0.94), 6), (-1.1, 4.5, 1.2), (1.5, 0.05, 1.7), of=s.room)
    frame = s.material((0.7, 0.7, 0.68), 0.4)
    s.box(frame, (-1.1, 4.45, 1.2), (0.08, 0.1, 1.7), of=s.room)
    s.box(frame, (-1.1, 4.45, 0.32), (1.8, 0.3, 0.09), of=s.room)
    s.box(frame, (1.3, 4.3, 0.45), (2.0, 0.5, 0.06), of=s.room)
    rng = np.random.default_rng(12)
    for k in range(8):
        tone = s.material(tuple(rng.uniform(0.03, 0.7, 3)), 0.4)
        high = rng.uniform(0.2, 0.5)
        s.rod(
            tone, (0.5 + 0.23 * k, 4.3, 0.48 + high / 2), rng.uniform(0.07, 0.11), high, of=s.room
        )
    for x, y, tone in ((-0.9, 2.6, (0.5, 0.3, 0.05)), (1.0, 2.2, (0.1, 0.25, 0.4))):
        s.rod(s.material(tone, 0.3), (x, y, 0.05), 0.2, 0.3, of=s.room)
    s.sky((0.6, 0.62, 0.66), 0.45)
    s.lamp((1.5, -2.5, 4), 1.5, 150)
    return Shot(
        640, 480, 1150, elevation=17, look=(0, 0, 0.35), views=24, noise=3, jpeg=85, exposure=0.03,
        fstop=0.8,
    )  # fmt: skip


def pieces(s: Studio) -> Shot:
    """Seven men of a game of chess, ivory and dark, apart, on a dark plate before dark folds."""
    ivory = s.material((0.7, 0.6, 0.42), 0.3, other=(0.6, 0.5, 0.33), scale=6)
    brown = s.material((0.07, 0.03, 0.015), 0.25, other=(0.1, 0.05, 0.02), scale=6)
    for k in range(7):
        around = 2 * np.pi * k / 6 + 0.2 * np.sin(5.0 * k)
        far = 0.0 if k == 6 else 0.58 + 0.07 * np.cos(3.0 * k)
        x, y = far * np.cos(around), far * np.sin(around)
        _man(s, brown if k % 2 else ivory, (x, y), (0.42, 0.55, 0.48, 0.7)[k % 4])
    s.rod(s.material((0.045, 0.045, 0.048), 0.5), (0, 0, -0.03), 0.95, 0.06, of=s.turning)
    s.cloth(s.material((0.016, 0.015, 0.018), 0.95, other=(0.04, 0.038, 0.042), scale=1.3, bump=1))
    s.box(s.material((0.02, 0.02, 0.02), 0.8), (0, 0, -0.15), (12, 12, 0.1), of=s.room)
    s.sky((0.1, 0.1, 0.1), 0.5)
    s.lamp((2.5, -3, 4), 1, 260)
    s.lamp((-3, -1, 3), 1, 120)
    return Shot(640, 480, 1300, elevation=20, look=(0, 0, 0.2), noise=3, jpeg=85)


def plant(s: Studio) -> Shot:
    """Pointed leaves in a terracotta pot on a paper sweep, the farther ones out of focus."""
    leaf = s.material((0.16, 0.27, 0.13), 0.45, other=(0.24, 0.36, 0.2), scale=4)
    clay = s.material((0.5, 0.2, 0.09), 0.8, other=(0.42, 0.16, 0.07), scale=5)
    earth = s.material((0.06, 0.04, 0.03), 0.9, other=(0.1, 0.07, 0.05), scale=20)
    s.add("cone", clay, (0, 0, 0.2), radius1=0.22, radius2=0.3, depth=0.4, vertices=48)
    s.rod(clay, (0, 0, 0.4), 0.33, 0.1)
    s.ball(earth, (0, 0, 0.44), 0.28, (1, 1, 0.2))
    rng = np.random.default_rng(9)
    for k in range(26):
        around = 2.4 * k + rng.normal(0, 0.1)
        lean = 0.15 + 1.05 * (k / 26) + rng.normal(0, 0.05)
        long = rng.uniform(0.5, 0.75)
        away = np.array(
            [np.cos(around) * np.sin(lean), np.sin(around) * np.sin(lean), np.cos(lean)]
        )
        at = np.array([0, 0, 0.45]) + 0.5 * long * away
        s.add("cone", leaf, at.tolist(), (0.35, 1, 1), (0, lean, around), radius1=0.06, depth=long,
              vertices=16)  # fmt: skip
    _sweep(s, s.material((0.52, 0.49, 0.44), 0.95))
    s.sky((0.7, 0.7, 0.72), 0.55)
    s.lamp((-2, -2, 4), 2.5, 170)
    return Shot(
        560, 600, 1300, elevation=17, look=(0, 0, 0.52), noise=6, jpeg=75, exposure=0.03, fstop=0.35
    )


def bust(s: Studio) -> Shot:
    """Bronze gone green on a slim white pedestal, both turning, before a dark blue wall with the
    glow of a lamp; three quarters of a turn, a view every 18 degrees."""
    green = s.material((0.1, 0.15, 0.11), 0.55, 0.5, (0.07, 0.085, 0.05), 5, 0.2)
    for at, r, size, dent in (
        ((0, 0, 1.32), 0.25, (0.85, 1, 1.2), 0.04),
        ((0, 0.05, 1.45), 0.25, (0.95, 1, 0.8), 0.1),
        ((0, 0, 0.83), 0.3, (1.5, 0.75, 0.75), 0.08),
    ):
        _dented(s, green, at, r, size, dent)
    s.ball(green, (0, -0.26, 1.29), 0.05, (0.7, 1.2, 1.7))
    for x in (-0.215, 0.215):
        s.ball(green, (x, 0.02, 1.3), 0.06, (0.4, 1, 1.5))
    s.rod(green, (0, 0, 1.05), 0.12, 0.35)
    white = s.material((0.75, 0.74, 0.72), 0.5)
    s.rod(white, (0, 0, 0.3), 0.17, 0.75)
    s.rod(white, (0, 0, 0.655), 0.22, 0.05)
    wall = s.material((0.02, 0.04, 0.12), 0.8)
    s.floor(s.material((0.07, 0.06, 0.055), 0.5), -0.12, wall, 3)
    s.sky((0.5, 0.5, 0.55), 0.2)
    s.lamp((2.5, -3, 4), 1, 220)
    s.lamp((-0.7, 1.8, 1.5), 0.3, 14)
    s.lamps[-1].rotation_euler, s.lamps[-1].visible_camera = (np.pi / 2, 0, 0), False  # to the wall
    return Shot(
        480, 640, 1150, elevation=9, look=(0, 0, 0.8), views=15, noise=3, jpeg=82, share=0.75
    )


def car(s: Studio) -> Shot:
    """A glossy dark red toy, black tyres and chrome, on a glossy white turntable in a tent."""
    red = s.material((0.22, 0.01, 0.012), 0.08)
    glass = s.material((0.02, 0.022, 0.025), 0.03)
    tyre = s.material((0.012, 0.012, 0.012), 0.7)
    chrome = s.material((0.8, 0.8, 0.82), 0.06, 1.0)
    body = s.box(red, (0, 0, 0.2), (1.25, 0.5, 0.2))
    cabin = s.box(glass, (-0.08, 0, 0.37), (0.6, 0.42, 0.2))
    roof = s.box(red, (-0.08, 0, 0.475), (0.5, 0.4, 0.05))
    for made, wide in ((body, 0.07), (cabin, 0.08), (roof, 0.02)):
        soft = made.modifiers.new("soft", "BEVEL")
        soft.width, soft.segments = wide, 5
    for x in (-0.38, 0.38):
        for y in (-0.24, 0.24):
            s.rod(tyre, (x, y, 0.13), 0.13, 0.1, turned=(np.pi / 2, 0, 0))
            s.rod(chrome, (x, 1.03 * y, 0.13), 0.07, 0.1, turned=(np.pi / 2, 0, 0))
        s.box(chrome, (1.68 * x, 0, 0.14), (0.05, 0.5, 0.05))
    for y in (-0.252, 0.252):
        s.box(chrome, (0, y, 0.2), (1.1, 0.012, 0.025))
        s.ball(chrome, (0.61, 0.65 * y, 0.23), 0.05, (0.5, 1, 1))
    gloss = s.material((0.86, 0.86, 0.86), 0.08)
    s.rod(gloss, (0, 0, -0.04), 0.95, 0.08, of=s.turning)
    s.floor(s.material((0.88, 0.88, 0.88), 0.8), -0.15, s.material((0.9, 0.9, 0.9), 0.9))
    s.sky((1, 1, 1), 0.8)
    s.lamp((2, -2, 5), 3, 190)
    s.lamp((-3, 1, 4), 3, 130)
    return Shot(640, 480, 1450, elevation=18, look=(0, 0, 0.15), noise=2, jpeg=85)


def _man(s: Studio, material: Any, at: tuple[float, float], high: float) -> None:
    """A turned figure of a game."""
    x, y = at
    s.rod(material, (x, y, 0.03), 0.13, 0.06)
    s.add("cone", material, (x, y, 0.5 * high), radius1=0.1, radius2=0.045, depth=0.9 * high,
          vertices=32)  # fmt: skip
    s.rod(material, (x, y, 0.85 * high), 0.085, 0.025)
    s.ball(material, (x, y, high), 0.075, (1, 1, 1.1))


def _dented(s: Studio, material: Any, at: Vector, r: float, size: Vector, depth: float) -> None:
    """An ellipsoid with dents and swellings."""
    made = s.ball(material, at, r, size)
    finer = made.modifiers.new("finer", "SUBSURF")
    finer.levels = finer.render_levels = 1
    dents = made.modifiers.new("dents", "DISPLACE")
    dents.texture = s.bpy.data.textures.new("dents", "CLOUDS")
    dents.texture.noise_scale, dents.strength = 0.5 * r, depth


def _shining(s: Studio, colour: Vector, strength: float) -> Any:
    """A surface that gives light."""
    made = s.material(colour)
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Emission Color"].default_value = (*colour, 1)
    shader.inputs["Emission Strength"].default_value = strength
    return made


def _sweep(s: Studio, material: Any, r: float = 1.5, away: float = 4.0) -> None:
    """Paper on a table that rises behind in a bend, with no edge."""
    bend = [(away - r + r * np.sin(a), r - r * np.cos(a)) for a in np.linspace(0, np.pi / 2, 25)]
    line = [(-6.0, 0.0), *bend, (away, 8.0)]
    points = [(x, float(y), float(z)) for y, z in line for x in (-8.0, 8.0)]
    mesh = s.bpy.data.meshes.new("sweep")
    faces = [(2 * k, 2 * k + 1, 2 * k + 3, 2 * k + 2) for k in range(len(line) - 1)]
    mesh.from_pydata(points, [], faces)
    mesh.materials.append(material)
    for polygon in mesh.polygons:
        polygon.use_smooth = True
    made = s.bpy.data.objects.new("sweep", mesh)
    s.bpy.context.collection.objects.link(made)
    s.room.append(made)


HOME: dict[str, Callable[[Studio], Shot]] = {
    scene.__name__: scene for scene in (kitchen, pieces, plant, bust, car)
}
