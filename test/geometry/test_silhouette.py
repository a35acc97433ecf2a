"""Inside and outside of an outline, against a disc and OpenCV's polygons."""

import cv2
import numpy as np
import pytest
from spheres import Sphere, unit

from occ_recon_ros.geometry import Camera, Silhouette
from occ_recon_ros.geometry.viewing import contours_from_loops

SPHERE = Sphere(np.array([0.0, 0.1, 0.0]), 0.2)
C = np.array([1.3, 0.0, 0.3])


def test_distance_to_a_round_outline():
    silhouette = Silhouette(SPHERE.contours(C, 1000))
    axis = unit(SPHERE.centre - C)
    rim = np.arcsin(0.2 / np.linalg.norm(SPHERE.centre - C))
    x = unit(np.cross(axis, [0, 0, 1.0]))
    rng = np.random.default_rng(0)
    angle = rng.uniform(0, 2 * rim, 3000)
    around = rng.uniform(0, 2 * np.pi, 3000)[:, None]
    out = np.cos(around) * x + np.sin(around) * np.cross(axis, x)
    ray = np.cos(angle)[:, None] * axis + np.sin(angle)[:, None] * out
    found = silhouette.outside(C + rng.uniform(0.5, 3, 3000)[:, None] * ray)
    # On the plane at distance 1, as the class measures.
    expected = np.tan(angle) - np.tan(rim)
    # Outside, up to half a cell of the grid from the outline. Pixels are 6e-4.
    near = (expected > 1e-4) & (expected < 0.0022)
    assert near.sum() > 10
    np.testing.assert_allclose(found[near], expected[near], atol=3e-6)
    around_it = expected < 0.5 * np.tan(rim)
    np.testing.assert_allclose(found[around_it], expected[around_it], atol=0.05 * np.tan(rim))
    assert (found > 0.9 * expected)[~around_it].all()
    assert (np.sign(found) == np.sign(expected))[np.abs(expected) > 1e-5].all()


def test_unknown_points_stay_unknown():
    silhouette = Silhouette(SPHERE.contours(C, 500))
    behind = C - unit(SPHERE.centre - C)
    found = silhouette.outside(np.array([[np.nan, 0, 0], behind, SPHERE.centre]))
    assert np.isnan(found[:2]).all()
    assert found[2] < 0


def star(middle, reach):
    """(n, 2) px, a star of five arms with a sample a pixel, object on the left as displayed."""
    angle = -np.linspace(0, 2 * np.pi, 20001)
    radius = reach * (0.55 + 0.45 * np.abs(np.cos(2.5 * angle)))
    uv = middle + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    along = np.append(0, np.cumsum(np.linalg.norm(np.diff(uv, axis=0), axis=1)))
    at = np.arange(0.5, along[-1] - 0.5)
    return np.column_stack([np.interp(at, along, x) for x in uv.T])


CAMERA = Camera(
    np.array([[800, 0, 320], [0, 800, 240], [0, 0, 1.0]]), 640, 480, np.eye(3), np.zeros(3)
)
PX = 1 / 800


def outside_px(loops, uv):
    """What the silhouette says of pixels, and what OpenCV's polygon test says."""
    sigma = [np.full(len(loop), 0.1) for loop in loops]
    contours = contours_from_loops(CAMERA, loops, range(len(loops)), sigma, 1, "turntable")
    depth = np.linspace(0.5, 2, len(uv))[:, None]
    found = Silhouette(contours).outside(depth * CAMERA.viewing_directions(uv)) / PX
    inner = [
        [cv2.pointPolygonTest(np.float32(loop), (float(u), float(v)), True) for u, v in uv]
        for loop in loops
    ]
    # A point is inside of the first loop and outside of the holes.
    return found, -np.minimum(inner[0], -np.max(inner[1:], axis=0) if loops[1:] else np.inf)


@pytest.mark.parametrize("holes", [[], [(330, 200, 40), (310, 275, 12)]])
def test_an_outline_with_notches_and_holes_against_another_polygon_test(holes):
    loops = [star([320, 240], 200)]
    for u, v, radius in holes:
        angle = np.linspace(0, 2 * np.pi, int(6 * radius), endpoint=False)
        loops.append([u, v] + radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    rng = np.random.default_rng(0)
    samples = np.concatenate(loops)
    close = samples[rng.integers(0, len(samples), 3000)] + rng.normal(0, 6, (3000, 2))
    uv = np.concatenate([close, rng.uniform([90, 10], [550, 470], (2000, 2))])
    found, expected = outside_px(loops, uv)
    # Tangents round a corner off by as much as lies between two samples.
    clear = np.abs(expected) > 1
    assert (np.sign(found) == np.sign(expected))[clear].all()
    near, far = (expected > 0.1) & (expected < 2), expected < -0.1
    assert near.sum() > 300
    error = np.abs(found - expected)
    print(f"within 2 px: {error[near].mean():.3f} px, worst {error[near].max():.2f} px;", end=" ")
    print(f"farther inside worst {error[far].max():.1f} px")
    assert error[near].mean() < 0.05
    # In a sharp notch the nearer of two edges may be missed by a cell.
    assert (error[near] > 1.0).mean() < 0.01
    assert error[near].max() < 400 / 192
    assert error[far].max() < 400 / 192 * 1.5


def test_beyond_a_gap_nothing_is_known_and_elsewhere_all():
    disc = star([320, 240], 100)
    cut = disc[disc[:, 1] < 290]
    cut = np.roll(cut, -1 - np.argmax(np.linalg.norm(np.roll(cut, -1, 0) - cut, axis=1)), axis=0)
    uv = np.array([[320.0, 240], [320, 285], [320, 300], [320, 100], [150, 200]])
    found, _ = outside_px([cut], uv)
    assert (found[:2] < 0).all()
    assert np.isnan(found[2])
    assert (found[3:] > 10).all()
