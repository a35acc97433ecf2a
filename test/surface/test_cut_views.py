"""Outlines that the border of the image cuts, or that have a gap: what a view cannot show it
does not carve, and what no view shows is not there."""

from dataclasses import replace

import numpy as np
import pytest
from exact_turns import exact_turn, surface_points

from occ_recon_ros.geometry import Contours
from occ_recon_ros.imaging import ContourSettings, ContourTracker
from occ_recon_ros.scene import coverage
from occ_recon_ros.surface.agreement import silhouette_agreement
from occ_recon_ros.surface.closing import ClosingSettings, close_surface
from occ_recon_ros.surface.hull import Hull

VIEWS, CELLS = 24, 64


def kept(contours: Contours, keep: np.ndarray) -> Contours:
    rows = ("T", "N", "uv", "loop", "sigma")
    return replace(contours, **{name: getattr(contours, name)[keep] for name in rows})


def windowed(contours: Contours, left=-1e9, top=-1e9, right=1e9, bottom=1e9) -> Contours:
    """The contours as an image sees them that ends there."""
    u, v = contours.uv.T
    return kept(contours, (u > left) & (u < right) & (v > top) & (v < bottom))


def part_of(contours: Contours, axis: int, share: float) -> float:
    low, high = contours.uv[:, axis].min(), contours.uv[:, axis].max()
    return low + share * (high - low)


CUTS = {
    "left": lambda c: windowed(c, left=part_of(c, 0, 0.3)),
    "right": lambda c: windowed(c, right=part_of(c, 0, 0.55)),
    "top": lambda c: windowed(c, top=part_of(c, 1, 0.4)),
    "bottom": lambda c: windowed(c, bottom=part_of(c, 1, 0.9)),
    "a corner": lambda c: windowed(c, left=part_of(c, 0, 0.4), bottom=part_of(c, 1, 0.6)),
    "top and bottom": lambda c: windowed(c, top=part_of(c, 1, 0.3), bottom=part_of(c, 1, 0.7)),
    "three sides": lambda c: windowed(
        c, left=part_of(c, 0, 0.2), top=part_of(c, 1, 0.3), right=part_of(c, 0, 0.6)
    ),
}


@pytest.mark.parametrize("cut", CUTS)
def test_a_view_cut_by_the_border_carves_no_true_surface(cut):
    truth, _, contours = exact_turn("sphere", VIEWS)
    contours[4] = CUTS[cut](contours[4])
    hull = Hull(contours)
    assert hull.cones[4].cut
    points = surface_points(truth.name)
    assert hull.outside(points).max() < 0.1 * hull.pixel
    assert hull.outside(points).max() < 0.1 * hull.pixel


@pytest.mark.parametrize(
    ("name", "left", "top", "width", "height"),
    [
        *(("figure", *c) for c in [(0.4, 0, 0, 0), (0, 0, 0.5, 0.5), (0.45, 0.4, 0, 0)]),
        *(("mug", *c) for c in [(0, 0.45, 0, 0), (0, 0.4, 0, 0.2)]),
        *(("torus", *c) for c in [(0, 0, 0.5, 0.5), (0.45, 0.4, 0, 0)]),
    ],
)
def test_what_the_tracker_cuts_carves_no_true_surface(name, left, top, width, height):
    truth, cameras, contours = exact_turn(name, VIEWS, width=1280)
    camera = cameras[4]
    mask = 255 * (
        coverage(
            np.split(contours[4].uv, contours[4].loop_starts[1:-1]), camera.width, camera.height
        )
        > 0.5
    )
    (u0, v0), (u1, v1) = contours[4].uv.min(axis=0), contours[4].uv.max(axis=0)
    roi = ContourSettings(
        roi_x=int(u0 + left * (u1 - u0)) if left else 0,
        roi_y=int(v0 + top * (v1 - v0)) if top else 0,
        roi_width=int(width * (u1 - u0) + u0) if width else 0,
        roi_height=int(height * (v1 - v0) + (0 if top else v0)) if height else 0,
    )
    image = mask.astype(np.uint8)
    contours[4] = ContourTracker(roi).process(image, camera, 5, "turntable", image)
    hull = Hull(contours)
    assert hull.cones[4].cut
    # Near the edge of a mask the outline is found to about a third of a pixel.
    assert hull.outside(surface_points(truth.name)).max() < hull.pixel


@pytest.mark.parametrize("cut", CUTS)
def test_what_a_cut_view_does_show_still_carves(cut):
    truth, _, contours = exact_turn("sphere", VIEWS)
    whole, part = contours[4], CUTS[cut](contours[4])
    # Just outside of the sphere, where the samples that are left see its rim.
    away = whole.centre - truth.mesh(32).centroid
    depth = np.linalg.norm(away)
    points = part.centre + part.T * depth + 2e-3 * part.N
    gap = np.flatnonzero(~part.linked)
    ends = part.uv[np.concatenate([gap, part.next_row[gap]])]
    clear = np.linalg.norm(part.uv[:, None] - ends, axis=-1).min(axis=1) > 10
    found = Hull([part, part]).outside(points[clear])
    assert found.min() > 1.5e-3


def test_a_cut_that_a_lens_has_bent_carves_no_true_surface():
    truth, cameras, _ = exact_turn("figure", VIEWS)
    lens = {"D": np.array([-0.3, 0.1, 0.001, 0.001, 0.0]), "distortion": "plumb_bob"}
    cameras = [replace(c, **lens) for c in cameras]
    contours = [truth.exact_contours(c, stamp_ns=k + 1) for k, c in enumerate(cameras)]
    contours[4] = windowed(contours[4], left=part_of(contours[4], 0, 0.4))
    hull = Hull(contours)
    assert hull.outside(surface_points(truth.name)).max() < 0.1 * hull.pixel


def test_a_tail_cut_off_in_six_views_keeps_its_length():
    _, _, contours = exact_turn("figure", VIEWS)
    tip = max(c.uv[:, 0].max() for c in contours)
    cut = [windowed(c, right=tip - 40) for c in contours]
    gone = [k for k, c in enumerate(cut) if len(c) < len(contours[k])]
    assert len(gone) >= 6
    whole = close_surface(contours, [], ClosingSettings(cells=CELLS))
    found = close_surface(cut, [], ClosingSettings(cells=CELLS))
    pixel = Hull(contours).pixel
    for direction in np.random.default_rng(0).normal(size=(50, 3)):
        direction /= np.linalg.norm(direction)
        reach = [float((mesh.vertices @ direction).max()) for mesh in (whole, found)]
        assert abs(reach[1] - reach[0]) < pixel


def test_a_body_that_every_image_cuts_ends_there():
    truth, _, contours = exact_turn("vase", VIEWS)
    low = truth.mesh(64).bounds[0, 2]
    cut = [windowed(c, bottom=part_of(c, 1, 0.7)) for c in contours]
    mesh = close_surface(cut, [], ClosingSettings(cells=CELLS))
    assert mesh.is_watertight
    assert mesh.body_count == 1
    assert mesh.bounds[0, 2] > low
    assert truth.distance(mesh.vertices).max() < 0.02


def test_beyond_a_gap_within_the_image_nothing_is_carved():
    truth, _, contours = exact_turn("sphere", VIEWS)
    rows = np.arange(len(contours[4]))
    contours[4] = kept(contours[4], (rows < 100) | (rows > 220))
    hull = Hull(contours)
    assert hull.outside(surface_points(truth.name)).max() < 0.1 * hull.pixel


@pytest.mark.parametrize("side", ["left", "top"])
def test_silhouettes_cut_by_the_border_agree_with_the_others(side):
    _, _, contours = exact_turn("figure", VIEWS)
    for k in (3, 4, 5, 14):
        contours[k] = CUTS[side](contours[k])
    assert silhouette_agreement(contours).share.max() < 0.005
