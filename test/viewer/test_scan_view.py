"""What the page makes of the messages of a scan."""

import cv2
import numpy as np
import pytest

from occ_recon_ros.geometry import Contours, Rim
from occ_recon_ros.scene import TurntableSettings, make_object, render, turntable_cameras
from occ_recon_ros.surface import Strip
from occ_recon_ros.viewer.panel import panel_html
from occ_recon_ros.viewer.placing import place
from occ_recon_ros.viewer.scan_view import ScanView, StateWords

SMALL = TurntableSettings(frames=36, width=160, height=120, focal_px=200.0)
CAMERAS = turntable_cameras(SMALL)


def contours_of(camera, stamp, n=40):
    """A circle about the middle of the image, as the camera sees it."""
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    uv = np.column_stack([80 + 30 * np.cos(t), 60 - 30 * np.sin(t)])
    T = camera.viewing_directions(uv)
    out = np.cross(T, np.roll(T, -1, 0) - T)
    N = out / np.linalg.norm(out, axis=1, keepdims=True)
    loop, sigma = np.zeros(n, np.uint16), np.full(n, 1e-4)
    return Contours(stamp, "turntable", camera.centre, T, N, uv, loop, sigma)


def rim_of(camera, stamp, good=30, n=40):
    angles = np.linspace(0, 6, n)
    points = 0.05 * np.column_stack([np.cos(angles), np.sin(angles), angles - 3])
    none = np.full(n, np.nan)
    status = np.where(np.arange(n) < good, 0, 3).astype(np.uint8)
    return Rim(
        stamp, "turntable", camera.centre, points, points, none, none, np.zeros(n, np.uint16),
        none, status,
    )  # fmt: skip


def strip_of(stamp, triangles=10):
    corners = np.random.default_rng(stamp).random((triangles, 3, 3), np.float32)
    return Strip(stamp, "turntable", corners, corners, corners[..., 0])


def scanned(frames):
    view = ScanView()
    for k, camera in enumerate(CAMERAS[:frames]):
        view.add_contours(contours_of(camera, k + 1), 0.1 * k)
        view.add_rim(rim_of(camera, k + 1))
        view.add_strip(strip_of(k + 1), 0.1 * k)
    return view


def test_the_ring_fills_with_the_turn():
    assert np.rad2deg(scanned(10).covered()) == pytest.approx(90, abs=1)
    assert np.rad2deg(scanned(36).covered()) == pytest.approx(360, abs=1)

    def lit(view):
        return panel_html(view, 0.0).count("#2b8a3e") - panel_html(view, 0.0).count("color:#2b8a3e")

    assert lit(scanned(1)) == 0
    assert 16 <= lit(scanned(10)) <= 20  # of 72
    assert lit(scanned(36)) == 72


def test_the_frame_rate_is_that_of_the_last_seconds():
    view = scanned(36)
    assert view.frame_rate(3.5) == pytest.approx(10, rel=0.01)
    assert view.frame_rate(60) == 0


def test_the_share_of_good_samples():
    counts = scanned(4).counts
    assert (counts["frames"], counts["good"], counts["samples"]) == (4, 120, 160)


def test_a_scan_that_waits_says_for_what():
    view = ScanView()
    assert view.state(0).word == "waiting"
    assert "running" in view.state(0).sentence
    view.add_report("/rig/contour_tracker", 1, "no images on /rig/image", {}, 0.0)
    view.add_report("/rig/mesher", 1, "no rims", {}, 0.0)
    assert view.state(1).sentence == "contour_tracker: no images on /rig/image"


def test_states_without_a_mesher_that_tells():
    view = scanned(5)
    assert view.state(0.5).word == "scanning"
    view.add_report("/mesher", 0, "OK", {}, 59.0)
    assert view.state(60.0).word == "waiting"
    assert view.state(600.0).word == "ended"  # and nobody is there any more
    view.finished = True
    assert view.state(60.0).word == "turn closed"
    view.saved = "/tmp/mesh.ply: 50 triangles"
    assert view.state(60.0) == StateWords("saved", "/tmp/mesh.ply: 50 triangles")
    view.told = StateWords("scanning", "as the mesher says")
    assert view.state(60.0) is view.told
    view.paused = True
    assert view.state(60.0).word == "paused"


def test_drops_are_named_with_their_node():
    view = ScanView()
    values = {"dropped paused": "3", "image rate": "5.0 Hz", "dropped bad_image": "0"}
    view.add_report("/contour_tracker", 1, "paused: 3 <b>", values, 0.0)
    assert view.drops() == [("contour_tracker", "paused", 3), ("contour_tracker", "bad_image", 0)]
    html = panel_html(view, 0.0)
    assert "contour_tracker dropped 3: paused" in html
    assert "&lt;b&gt;" in html  # what a node says is text


def test_the_camera_is_placed_by_its_contours_alone():
    view, camera = ScanView(), CAMERAS[7]
    view.add_contours(contours_of(camera, 5), 0.0)
    assert view.drawable([4, 5, 6]) == 5
    calibration = CAMERAS[0]  # the same camera, elsewhere
    image = render(make_object("sphere"), camera)
    frame = view.add_image(5, image, calibration)
    np.testing.assert_allclose(frame.R_object_camera, camera.R_camera_object.T, atol=1e-6)
    assert frame.field_of_view == pytest.approx(2 * np.arctan(60 / 200))
    drawn = cv2.imdecode(np.frombuffer(frame.jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert drawn.shape == (120, 160, 3)
    assert view.drawable([4, 5, 6]) is None
    x, y, z, w = frame.quaternion()
    assert np.linalg.norm([x, y, z, w]) == pytest.approx(1)


def test_images_without_contours_are_left_out():
    view = ScanView()
    assert view.add_image(5, np.zeros((4, 4), np.uint8), None) is None
    assert view.drawable([5]) is None


def test_back_through_the_turn():
    view = scanned(12)
    assert [len(view.past(k)) for k in (0, 1, 6, 12)] == [0, 10, 60, 120]
    assert view.frame_at(6).stamp_ns == 6
    assert view.frame_at(0) is None


def test_memory_of_the_past_is_bounded(monkeypatch):
    monkeypatch.setattr("occ_recon_ros.viewer.scan_view._HISTORY_BYTES", 10_000)
    view = scanned(36)
    kept = sum(frame.strip.nbytes for frame in view.frames.values())
    assert 5_000 < kept <= 10_000
    assert max(view.frames) == 36


def test_a_new_scan_begins_when_time_goes_back():
    view = scanned(12)
    none = np.zeros((0, 3))
    loop = np.zeros(0, np.uint16)
    empty = Contours(3, "turntable", np.zeros(3), none, none, none[:, :2], loop, none[:, 0])
    view.add_contours(empty, 2.0)
    assert (len(view.frames), view.counts["frames"], view.covered()) == (0, 0, 0)
    assert list(view.rims) == []


def test_a_page_looks_at_the_object_from_aside_with_the_axis_up():
    view, camera = ScanView(), CAMERAS[0]
    assert place(view) is None
    view.add_contours(contours_of(camera, 1), 0.0)
    view.add_rim(rim_of(camera, 1))
    view.add_image(1, np.zeros((120, 160), np.uint8), camera)
    placing = place(view)
    np.testing.assert_array_equal(placing.up, [0, 0, 1])
    away = placing.position - placing.target
    assert 2 < np.linalg.norm(away) / placing.radius < 5
    to_camera = placing.scale * camera.centre - placing.target
    assert np.linalg.norm(to_camera) == pytest.approx(1)
    cosine = away @ to_camera / np.linalg.norm(away)
    assert 20 < np.rad2deg(np.arccos(cosine)) < 60
