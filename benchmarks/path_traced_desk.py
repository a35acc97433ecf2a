"""Scenes of ``path_traced.py``: things on a printed sheet on a desk, for ``occ-recon scan``."""

from collections.abc import Callable
from pathlib import Path
from tempfile import gettempdir

import cv2
import numpy as np
from path_traced_studio import Shot, Studio

# As `occ-recon board` writes it; a unit of the scenes is 0.1 m.
BOARD = """kind: charuco
columns: 7
rows: 10
square_m: 0.025
marker_m: 0.018
dictionary: DICT_5X5_100
first_id: 0
"""
_PX_PER_M = 8000
_PAPER_M = (0.297, 0.21)
_INK, _PAPER = 22, 235  # grey levels
LENS = (0.06, -0.11, 0.0006, -0.0004, 0.0)


def jug(s: Studio) -> Shot:
    """Glazed, blue and shiny; a hand-held camera walks around it, high and low in turn."""
    glaze = s.material((0.03, 0.07, 0.2), 0.12, other=(0.1, 0.22, 0.35), scale=3)
    s.ball(glaze, (0, 0, 0.42), 0.46, (1, 1, 0.9))
    s.rod(glaze, (0, 0, 0.95), 0.22, 0.5)
    ring = {"major_radius": 0.24, "minor_radius": 0.06}
    s.add("torus", glaze, (0.34, 0, 0.8), turned=(np.pi / 2, 0, 0), **ring)
    s.rod(glaze, (0, 0, 0.04), 0.28, 0.08)
    s.rod(glaze, (0, 0, 1.2), 0.27, 0.06)
    desk(s, -0.05, 5)
    s.sky((0.6, 0.65, 0.7), 0.5)
    s.lamp((3, -2, 4), 1.5, 300)
    s.lamp((-4, 1, 3), 1, 120)
    sheet(s, s.room)
    return _shot("hand")


def plaster(s: Studio) -> Shot:
    """White on white paper, on a table that is turned before a fixed camera."""
    white = s.material((0.8, 0.78, 0.74), 0.7, bump=0.1, other=(0.74, 0.72, 0.68), scale=8)
    s.ball(white, (0, 0, 0.45), 0.38, (1.35, 1, 1))
    s.ball(white, (0.5, 0, 0.85), 0.25, (1.1, 0.9, 0.9))
    s.ball(white, (-0.6, 0, 0.6), 0.09, (2.2, 1, 1), 0.6)
    for y in (-1, 1):
        s.add("cone", white, (0.45, 0.15 * y, 1.1), radius1=0.08, depth=0.25)
        for x in (-0.3, 0.3):
            s.rod(white, (x, 0.2 * y, 0.15), 0.1, 0.3)
    s.rod(s.material((0.2, 0.2, 0.22), 0.4), (0, 0, -0.06), 1.9, 0.1, of=s.turning)
    sheet(s, s.turning)
    desk(s, -0.16, 4)
    s.sky((0.6, 0.62, 0.66), 0.6)
    s.lamp((2, -3, 4), 1.5, 260)
    return _shot("table")


def tool(s: Studio) -> Shot:
    """Red, black as the print, and bare metal; the camera in the hand."""
    red, black = s.material((0.6, 0.05, 0.03), 0.3), s.material((0.02, 0.02, 0.022), 0.5)
    s.rod(red, (0, 0, 0.3), 0.18, 0.6)
    s.rod(red, (0.35, 0, 0.45), 0.07, 0.7, turned=(0, 0.5, 0))
    s.rod(black, (0, 0, 0.65), 0.2, 0.12)
    s.box(black, (0.15, 0, 0.1), (0.5, 0.3, 0.2))
    s.rod(s.material((0.6, 0.6, 0.6), 0.25, 1.0), (0, 0, 1.0), 0.05, 0.6)
    desk(s, -0.05, 5)
    s.sky((0.65, 0.65, 0.6), 0.6)
    s.lamp((-2, -3, 4), 1.0, 250)
    sheet(s, s.room)
    return _shot("hand")


def _shot(moves: str) -> Shot:
    table = moves == "table"
    distance, elevation = (6.2, 28.0) if table else (5.6, 39.0)
    return Shot(
        900, 675, 960, distance, elevation, (0, 0, 0.45), moves=moves, noise=2.5, jpeg=90,
        lens=LENS, board=BOARD, exposure=0.08,
    )  # fmt: skip


def sheet(s: Studio, of: list) -> None:
    """The printed board, its middle in the origin."""
    board = cv2.aruco.CharucoBoard(
        (7, 10), 0.025, 0.018, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    )
    paper = np.full([round(_PX_PER_M * side) for side in _PAPER_M], _PAPER, np.uint8)
    drawn = board.generateImage((round(0.175 * _PX_PER_M), round(0.25 * _PX_PER_M)), None, 0, 1)
    y, x = ((a - b) // 2 for a, b in zip(paper.shape, drawn.shape, strict=True))
    part = paper[y : y + drawn.shape[0], x : x + drawn.shape[1]]
    part[:] = np.where(drawn > 127, _PAPER, _INK)
    path = Path(gettempdir()) / "path_traced_sheet.png"
    cv2.imwrite(str(path), paper)
    material = s.material((0.8, 0.8, 0.8), 0.7, image=path)
    s.add("plane", material, (0, 0, 0.001), (2.1, 2.97, 1), of=of, size=1.0)


def desk(s: Studio, z: float, away: float) -> None:
    """Wood, a wall, and what lies about."""
    wood = s.material((0.42, 0.25, 0.12), 0.4, other=(0.27, 0.14, 0.06), scale=3)
    wall = s.material((0.62, 0.6, 0.55), 0.9, other=(0.45, 0.45, 0.47), scale=0.4)
    s.floor(wood, z, wall, away)
    red, blue = s.material((0.5, 0.08, 0.06), 0.5), s.material((0.1, 0.2, 0.4), 0.5)
    s.box(red, (-2.6, 1.6, 0.2), (1.6, 2.2, 0.4), turned=(0, 0, 0.3), of=s.room)
    s.box(blue, (-2.5, 1.5, 0.5), (1.4, 2.0, 0.25), turned=(0, 0, -0.1), of=s.room)
    s.rod(s.material((0.9, 0.9, 0.88), 0.15), (2.3, 1.9, 0.5), 0.4, 1.0, of=s.room)
    phone = s.material((0.04, 0.04, 0.045), 0.2)
    s.box(phone, (2.6, -1.2, 0.05), (0.8, 1.6, 0.08), turned=(0, 0, 0.5), of=s.room)
    s.ball(s.material((0.7, 0.35, 0.05), 0.5), (-2.2, -1.7, 0.36), 0.36)
    s.room.append(s.figure.pop())
    s.rod(s.material((0.1, 0.35, 0.12), 0.4), (0.5, 3.0, 0.7), 0.35, 1.4, of=s.room)


DESK: dict[str, Callable[[Studio], Shot]] = {
    scene.__name__: scene for scene in (jug, plaster, tool)
}
