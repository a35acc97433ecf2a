"""What turns with the object is found by its shape, and named; the foot of a figure is not."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from occ_recon_ros.evaluation.base import base_under
from occ_recon_ros.evaluation.evidence import Evidence
from occ_recon_ros.evaluation.verdict import judge
from occ_recon_ros.imaging import ContourSettings, ContourTracker
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras

SIZE = (320, 240)
RIG = TurntableSettings(
    frames=10,
    step=2 * np.pi / 10,
    elevation=0.4,
    width=SIZE[0],
    height=SIZE[1],
    focal_px=300.0,
)
CAMERAS = turntable_cameras(RIG)
CUT, UNCUT = np.zeros((3, 3)), np.zeros((3, 3))
CUT[0, 2] = 100.0  # px, of the principal point
FIGURE = make_object("figure")
LOWEST = -0.1  # of the figure, metres


def prism(corners, top, height):
    """(2 k, 3) corners of an upright prism over a convex polygon (k, 2), metres."""
    return np.concatenate(
        [np.column_stack([corners, np.full(len(corners), z)]) for z in (top, top - height)]
    )


def disc(radius):
    angle = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def outlines(cameras, *convex, shown=FIGURE):
    """Outlines of a figure (or of nothing) and of convex bodies with it."""
    tracker, found = ContourTracker(ContourSettings(refine="none", spacing_px=2.0)), []
    for k, (camera, still) in enumerate(zip(cameras, CAMERAS, strict=True)):
        mask = np.zeros(SIZE[::-1], np.uint8)
        if shown is not None:
            exact = shown.exact_contours(still, stamp_ns=k + 1)
            loops = np.split(exact.uv, exact.loop_starts[1:-1])
            cv2.fillPoly(mask, [np.rint(loop).astype(np.int32) for loop in loops], 255)
        for points in convex:
            hull = cv2.convexHull(camera.project(points).astype(np.float32))
            cv2.fillPoly(mask, [np.rint(hull).astype(np.int32)], 255)
        found.append(tracker.process(mask, camera, k + 1, "turntable", mask))
    return found


@pytest.mark.parametrize("height", [0.004, 0.03])
def test_a_plate_under_a_figure_is_found_where_it_is(height):
    base = base_under(outlines(CAMERAS, prism(disc(0.11), LOWEST, height)))
    assert base is not None
    assert not base.bare
    assert base.top[2] == pytest.approx(LOWEST, abs=0.006)
    assert base.width == pytest.approx(0.22, rel=0.08)
    np.testing.assert_allclose(base.axis, [0, 0, 1], atol=1e-3)
    assert np.linalg.norm(base.edge[:, :2], axis=1) == pytest.approx(0.11, rel=0.1)


def test_a_book_that_lies_askew_is_found_too():
    corners = np.array([[-0.1, -0.07], [0.1, -0.07], [0.1, 0.07], [-0.1, 0.07]])
    corners = corners @ Rotation.from_euler("z", 0.4).as_matrix()[:2, :2] + [0.01, 0.02]
    base = base_under(outlines(CAMERAS, prism(corners, LOWEST, 0.015)))
    assert base is not None
    assert base.top[2] == pytest.approx(LOWEST, abs=0.006)


@pytest.mark.parametrize(
    "convex",
    [[], [prism(disc(0.03), LOWEST, 0.01)], [prism(disc(0.06), LOWEST, 0.06)]],
    ids=["on its feet", "on a foot", "on a pedestal"],
)
def test_what_belongs_to_a_figure_is_no_base(convex):
    assert base_under(outlines(CAMERAS, *convex)) is None


def test_a_flat_dish_is_doubted_for_what_lies_in_it_cannot_be_seen():
    base = base_under(outlines(CAMERAS, prism(disc(0.1), 0.0, 0.005), shown=None))
    assert base is not None
    assert base.bare


def test_what_lies_low_on_a_plate_is_doubted_for_outlines_show_hardly_more_than_the_plate():
    heap = prism(np.add(disc(0.05), [0.02, 0.0]), 0.035, 0.035)
    base = base_under(outlines(CAMERAS, prism(disc(0.1), 0.0, 0.005), heap, shown=None))
    assert base is not None
    assert base.bare
    assert base.share < 0.9


def test_a_cube_is_no_dish():
    corners = 0.05 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    assert base_under(outlines(CAMERAS, prism(corners, 0.05, 0.1), shown=None)) is None


def test_the_verdict_gives_the_options_that_leave_the_plate_out():
    contours = outlines(CAMERAS, prism(disc(0.11), LOWEST, 0.004))
    evidence = Evidence(contours, [SIZE] * len(contours), len(contours), 0.8)
    verdict = judge(evidence)
    assert verdict.word == "doubtful"
    assert "flat" in verdict.reasons[0]
    (advice,) = verdict.advice
    options = dict(o.split("=") for o in advice.split() if "=" in o)
    assert options.keys() == {"contour_tracker.volume_kind", "contour_tracker.volume_z"}
    assert float(options["contour_tracker.volume_z"]) == pytest.approx(LOWEST, abs=0.006)
    assert judge(replace(evidence, bounded=True)).word == "good"


def test_another_frame_gives_the_same_plane():
    """Rigid motion of the scene moves the plane with it, and the options name it whole."""
    turn, shift = Rotation.from_euler("xyz", [0.7, -0.4, 1.1]).as_matrix(), np.array([0.3, 0, 1.0])
    cameras = []
    for c in CAMERAS:
        R = c.R_camera_object @ turn.T
        cameras.append(replace(c, R_camera_object=R, t_camera_object=c.t_camera_object - R @ shift))
    points = prism(disc(0.11), LOWEST, 0.004) @ turn.T + shift
    base = base_under(outlines(cameras, points))
    assert base is not None
    np.testing.assert_allclose(base.axis, turn[:, 2], atol=1e-3)
    options = dict(o.split("=") for o in base.options().split() if "=" in o)
    point = np.array([float(options[f"contour_tracker.volume_{n}"]) for n in "xyz"])
    normal = np.array([float(options[f"contour_tracker.volume_axis_{n}"]) for n in "xyz"])
    top = turn @ [0, 0, LOWEST] + shift
    assert (top - point) @ normal == pytest.approx(0, abs=0.006)


def test_cameras_in_a_row_stand_around_nothing():
    contours = outlines(CAMERAS, prism(disc(0.11), LOWEST, 0.004))
    assert base_under([contours[0]] * 10) is None
    assert base_under(contours[:4]) is None


def test_a_sheet_that_a_hand_photographed_from_around_another_axis_is_flat():
    # The cameras stand about an axis 7 degrees off that of the sheet, and some cut a corner off.
    higher = replace(RIG, elevation=1.0, focal_px=900.0)
    tilt = Rotation.from_euler("x", 7, degrees=True).as_matrix()
    cameras = [
        replace(camera, R_camera_object=camera.R_camera_object @ tilt, K=camera.K + aside)
        for camera, aside in zip(turntable_cameras(higher), [CUT, *[UNCUT] * 4] * 2, strict=True)
    ]
    sheet = prism(np.array([[-0.1, -0.07], [0.1, -0.07], [0.1, 0.07], [-0.1, 0.07]]), 0.0, 0.0005)
    seen = outlines(cameras, sheet, shown=None)
    assert [bool(view.linked.all()) for view in seen] == [False, *[True] * 4] * 2
    base = base_under(seen)
    assert base is not None
    assert base.bare
    np.testing.assert_allclose(base.axis, [0, 0, 1], atol=1e-3)
    assert base.top[2] == pytest.approx(0.0, abs=0.006)
