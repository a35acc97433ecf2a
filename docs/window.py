"""docs/window.svg: how three contours give a rim point, computed, not sketched.

python docs/window.py > docs/window.svg
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]

SCALE, SIZE = 130.0, (1000, 430)
LEFT, RIGHT = np.array([150.0, 275.0]), np.array([760.0, 130.0])  # where the object is drawn
STEP = np.deg2rad(30.0)
DISTANCE = 2.2
INK, SOFT, ACCENT, GREEN = "#222", "#999", "#c2410c", "#15803d"


def support(theta: float) -> tuple[float, float]:
    """Support function of the section, and its derivative."""
    return 0.85 + 0.13 * np.cos(2 * theta - 0.5), -0.26 * np.sin(2 * theta - 0.5)


def normal(theta: float) -> Array:
    return np.array([np.cos(theta), np.sin(theta)])


def contact(theta: float) -> Array:
    """Point of the section where the tangent has this normal."""
    h, slope = support(theta)
    return h * normal(theta) + slope * normal(theta + np.pi / 2)


def tangent_from(centre: Array, near: float) -> float:
    """Normal angle of the tangent through a camera centre, within 1 rad of another."""
    return brentq(lambda theta: normal(theta) @ centre - support(theta)[0], near - 1, near + 1)


def crossing(a: Array, b: Array, u: Array, v: Array) -> Array:
    """Where the lines a + s u and b + t v meet."""
    s, _ = np.linalg.solve(np.column_stack([u, -v]), b - a)
    return a + s * u


def on_page(points: Array, origin: Array) -> str:
    flat = origin + SCALE * np.atleast_2d(points) * [1, -1]
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in flat)


def path(points: Array, origin: Array, colour: str, width: float = 1.5, more: str = "") -> str:
    return (
        f'<polyline points="{on_page(points, origin)}" fill="none" stroke="{colour}" '
        f'stroke-width="{width}" {more}/>'
    )


def dot(point: Array, origin: Array, colour: str, radius: float = 4.5, more: str = "") -> str:
    x, y = on_page(point, origin).split(",")
    return f'<circle cx="{x}" cy="{y}" r="{radius}" fill="{colour}" {more}/>'


def words(point: Array, origin: Array, text: str, shift: tuple = (8, 4), colour: str = INK) -> str:
    x, y = (float(value) for value in on_page(point, origin).split(","))
    return f'<text x="{x + shift[0]:.1f}" y="{y + shift[1]:.1f}" fill="{colour}">{text}</text>'


def sub(base: str, index: str) -> str:
    return f'{base}<tspan dy="4" font-size="11">{index}</tspan>'


def section() -> Array:
    return np.array([contact(theta) for theta in np.linspace(0, 2 * np.pi, 181)])


def epipolar_plane() -> Iterator[str]:
    """Three view lines that touch the section, the parabola that touches all of them."""
    angles = np.deg2rad(24.0) + STEP * np.array([-1, 0, 1])
    centres = DISTANCE * np.array([normal(a) for a in angles])
    thetas, near = [], angles[1] + 1.1
    for centre in centres:
        thetas.append(tangent_from(centre, near))
    points = np.array([contact(theta) for theta in thetas])
    rays = (points - centres) / np.linalg.norm(points - centres, axis=1)[:, None]
    yield f'<polygon points="{on_page(section(), LEFT)}" fill="#eef1f5" stroke="{SOFT}"/>'
    names = ("-1", "", "1")
    for k in range(3):
        end = points[k] + 0.75 * rays[k]
        colour, width = (INK, 2.0) if k == 1 else (SOFT, 1.3)
        yield path(np.array([centres[k], end]), LEFT, colour, width)
    met = [crossing(centres[1], centres[k], rays[1], rays[k]) for k in (0, 2)]
    for k, point in zip((0, 2), met, strict=True):
        yield dot(point, LEFT, "#fff", 4, f'stroke="{INK}" stroke-width="1.5"')
        yield words(point, LEFT, sub("d", names[k]), (-8, 22))
    yield path(parabola(points[1], rays[1], normal(thetas[1]), thetas[1]), LEFT, ACCENT, 2.5)
    for k in range(3):
        yield dot(centres[k], LEFT, INK, 5)
        yield words(centres[k], LEFT, sub("C", names[k]), (10, 5))
    yield dot(points[1], LEFT, ACCENT, 5.5)
    yield words(points[1], LEFT, "P = C + λT", (14, -12), ACCENT)
    yield path(np.array([points[1], points[1] + 0.38 * normal(thetas[1])]), LEFT, GREEN, 2)
    yield words(points[1] + 0.38 * normal(thetas[1]), LEFT, "N", (6, 2), GREEN)


def parabola(point: Array, ray: Array, n: Array, theta: float) -> Array:
    """The parabola of the section's curvature at a point."""
    eps = 1e-4
    radius = np.linalg.norm(contact(theta + eps) - contact(theta - eps)) / (2 * eps)
    s = np.linspace(-0.75, 0.75, 40)[:, None]
    return point + s * ray - s**2 / (2 * radius) * n


def window() -> Iterator[str]:
    """The camera's path from above, and the two partners of one frame."""
    yield f'<polygon points="{on_page(0.5 * section(), RIGHT)}" fill="#eef1f5" stroke="{SOFT}"/>'
    now, steps = np.deg2rad(-90.0), np.deg2rad([-37, -28, -21, -14, -9, -4, 0, 5, 9, 16, 23, 33])
    ring = np.array([1.75 * normal(now + a) for a in np.linspace(-1.25, 1.25, 60)])
    yield path(ring, RIGHT, "#ccc", 1)
    least = np.deg2rad(12.0)
    for a in (-least, least):
        yield path(
            np.array([[0, 0], 1.95 * normal(now + a)]), RIGHT, SOFT, 1, 'stroke-dasharray="5 4"'
        )
    arc = np.array([0.95 * normal(now + a) for a in np.linspace(0, least, 20)])
    yield path(arc, RIGHT, INK, 1.5)
    yield words(arc[-1], RIGHT, "baseline", (4, -4))
    before, after = max(a for a in steps if a <= -least), min(a for a in steps if a >= least)
    for a in steps:
        point = 1.75 * normal(now + a)
        partner = a in (before, after, 0)
        yield dot(point, RIGHT, INK if partner else "#c8ccd2", 6 if partner else 4)
    for a, name in ((before, "-1"), (0.0, ""), (after, "1")):
        point = 1.75 * normal(now + a)
        yield path(np.array([point, 0.42 * normal(now + a)]), RIGHT, SOFT, 1.2)
        yield words(point, RIGHT, sub("C", name), (-8, 24))


def figure() -> str:
    """The whole file."""
    width, height = SIZE
    captions = (
        (250, "In an epipolar plane: three view lines touch the surface."),
        (RIGHT[0], "From above: the nearest views at least a baseline away."),
    )
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="sans-serif" font-size="16">',
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
        *epipolar_plane(),
        *window(),
        *(
            f'<text x="{x}" y="26" text-anchor="middle" fill="{INK}">{text}</text>'
            for x, text in captions
        ),
        "</svg>",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print(figure())
