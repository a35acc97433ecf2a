"""Corners in images whose noise alone limits them: exact prints, blurred by a Gaussian."""

import numpy as np
import pytest
from scenes.printed import printed_sheet
from scipy.special import erf, ndtr

from occ_recon_ros.geometry import Camera
from occ_recon_ros.poses.marker_edges import side_corners
from occ_recon_ros.poses.saddles import refine_saddles

SIZE, SQUARE, BLUR, NOISE, BLACK, WHITE = 240, 22.0, 0.85, 2.0, 30.0, 220.0
MIDDLE = np.array([119.3, 120.85])
ANGLES = [0.0, 0.3, np.pi / 4]


def turned(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def on_print(angle: float) -> np.ndarray:
    """(2, SIZE, SIZE) px from the middle, along the sides of the print."""
    v, u = np.mgrid[:SIZE, :SIZE]
    return np.einsum("ij,jvu->ivu", turned(angle).T, np.stack([u, v]) - MIDDLE[:, None, None])


def taken(image: np.ndarray, seed: int) -> np.ndarray:
    noisy = image + np.random.default_rng(seed).normal(0, NOISE, image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def chessboard(angle: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An image without noise, where its corners are, and where they are on the board, squares."""
    edges = np.arange(-3, 4)
    waves = [
        sum((-1.0) ** k * erf((x - SQUARE * k) / (np.sqrt(2) * BLUR)) for k in edges)
        for x in on_print(angle)
    ]
    xy = np.stack(np.meshgrid(edges, edges), axis=2).reshape(-1, 2).astype(np.float64)
    image = (WHITE + BLACK) / 2 + (WHITE - BLACK) / 2 * waves[0] * waves[1]
    return image, MIDDLE + SQUARE * xy @ turned(angle).T, xy


def bound_px(image: np.ndarray, uv: np.ndarray, radius: int = 5) -> float:
    """The least sigma of a corner of which the pixels so near are known (Cramer and Rao)."""
    u, v = np.rint(uv).astype(int)
    near = image[v - radius - 1 : v + radius + 2, u - radius - 1 : u + radius + 2]
    g = np.stack(np.gradient(near), axis=-1)[1:-1, 1:-1].reshape(-1, 2)
    return NOISE * np.sqrt(np.trace(np.linalg.inv(g.T @ g)) / 2)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_saddle_is_found_as_well_as_its_pixels_allow(angle: float) -> None:
    image, uv, xy = chessboard(angle)
    errors = []
    for seed in range(4):
        start = uv + np.random.default_rng(seed).normal(0, 0.3, uv.shape)
        found, good = refine_saddles(taken(image, seed), start, xy, 0.4)
        assert good.all()
        errors.append(found - uv)
    assert np.sqrt(np.mean(np.square(errors))) < 1.15 * bound_px(image, uv[24])


def test_a_saddle_that_is_covered_in_part_is_told() -> None:
    image, uv, xy = chessboard(0.3)
    x, y = on_print(0.3)
    image[(x > 4) & (y > 4)] = 110.0  # a quarter of the board, 4 px from the corner in the middle
    found, good = refine_saddles(taken(image, 0), uv, xy, 0.4)
    bare = (xy < 0).any(axis=1)
    assert not good[24]
    assert good[bare].all()
    assert np.linalg.norm(found - uv, axis=1)[good].max() < 0.05


def test_corners_in_a_row_are_left_as_they_are() -> None:
    image, uv, xy = chessboard(0.0)
    found, good = refine_saddles(taken(image, 0), uv[:5], xy[:5], 0.4)
    assert not good.any()
    assert found == pytest.approx(uv[:5])


@pytest.mark.parametrize("shade", [0.0, 1.5e-3], ids=["even", "in a light from the side"])
@pytest.mark.parametrize("angle", ANGLES)
def test_the_corner_of_a_marker_is_as_good_as_its_sides(angle: float, shade: float) -> None:
    side = 70.0
    x, y = on_print(angle)
    inside = [ndtr((a + side / 2) / BLUR) - ndtr((a - side / 2) / BLUR) for a in (x, y)]
    light = 1 + shade * (np.arange(SIZE) - SIZE)
    image = light * (WHITE - (WHITE - BLACK) * inside[0] * inside[1])
    square = side / 2 * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    uv = MIDDLE + square @ turned(angle).T
    errors = []
    for seed in range(12):
        start = uv + np.random.default_rng(seed).normal(0, 0.3, uv.shape)
        errors.append(side_corners(taken(image, seed), start[None], 9)[0] - uv)
    # A row of pixels across an edge tells its place to this, and two dozen of them in the middle
    # four fifths of a line tell its end to so many times their mean's.
    contrast = (WHITE - BLACK) * light[int(MIDDLE[0] - side)]  # where it is least
    a_row = NOISE / contrast * np.sqrt(2 * np.sqrt(np.pi) * BLUR)
    at_the_end = np.sqrt(1 + 0.5**2 / (0.8**2 / 12))
    assert np.sqrt(np.mean(np.square(errors))) < 1.3 * at_the_end * a_row / np.sqrt(24)


def test_a_rendered_edge_along_the_pixels_is_as_exact_as_any() -> None:
    K, R = np.array([[500.0, 0, 80], [0, 500, 60], [0, 0, 1]]), np.diag([1.0, -1, -1])
    strip = np.array([[0, 0, 0.06, 0.03]])
    black = []
    for shift in np.linspace(0, 1e-3, 41):  # up to a pixel
        camera = Camera(K, 160, 120, R, -R @ [0, shift, 0.5])
        light = printed_sheet(strip, (0.06, 0.06), 0.05, camera, 4)
        black.append((1 - light[45:, 80]).sum())  # the strip ends between rows 60 and 61
    assert black == pytest.approx(np.linspace(black[0], black[0] + 1, 41), abs=0.03)
