"""Frames of a live scan that are kept, and what the outlines found in them say together."""

from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest
from pits import views_of_pits
from scipy.spatial.transform import Rotation
from stalks import views_of_stalks

from occ_recon_ros.geometry import Camera
from occ_recon_ros.imaging import ContourSettings, ContourTracker
from occ_recon_ros.scene import TurntableSettings, make_object, render, turntable_cameras
from occ_recon_ros.streams.kept_frames import KeptFrames, PackedFrame
from occ_recon_ros.streams.learning import _alone, learn

TURN = TurntableSettings(frames=12, step=np.pi / 6, width=320, height=240, focal_px=400.0)


def packed(change=lambda k, camera, image: (camera, image)):
    """A turn as the tracker keeps it; ``change``: what came instead of a camera and its image."""
    tracker, vase, frames = ContourTracker(), make_object("mug"), []
    for k, camera in enumerate(turntable_cameras(TURN)):
        seen, image = change(k, camera, render(vase, camera))
        frames.append(PackedFrame.of(image, seen, k, tracker.process(image, seen, k, "object")))
    return frames


def test_outlines_that_agree_need_nothing_learnt():
    lesson = learn(packed(), ContourSettings())
    assert (lesson.masks, lesson.failed) == (None, False)
    assert lesson.words == "what single images say agrees"


def test_poses_that_are_a_little_off_are_no_reason_to_doubt_images():
    def off(k, camera, image):
        turn = Rotation.from_rotvec([0, 0.006 * (-1) ** k, 0]).as_matrix()
        return replace(camera, R_camera_object=turn @ camera.R_camera_object), image

    frames = packed(off)
    assert _alone(frames, frames).why == ""


@pytest.mark.parametrize(
    ("views", "why"),
    [
        (partial(views_of_stalks, off_px=2.0), ""),
        (partial(views_of_stalks, bitten=True), "the body that all outlines leave covers"),
        (views_of_pits, "which others refute"),
    ],
    ids=["poses that are off", "bitten", "pits"],
)
def test_a_body_that_little_is_left_of_is_asked_in_corrected_poses(views, why):
    tracker, frames = ContourTracker(), []
    for k, (camera, image) in enumerate(views()):
        frames.append(PackedFrame.of(image, camera, k, tracker.process(image, camera, k, "object")))
    assert bool(why) == bool(found := _alone(frames, frames).why)
    assert why in found


def test_a_view_that_contradicts_the_others_is_told_from_those_that_hold():
    def moved(k, camera, image):
        return camera, np.roll(image, 40, axis=1) if k == 7 else image

    frames = packed(moved)
    alone = _alone(frames, frames)
    assert alone.why == "the outlines of 1 of 12 single images contradict the others"
    assert (alone.right, alone.contrary) == ({*range(12)} - {7}, {7})


def test_a_kept_frame_has_the_outline_that_was_found_in_it():
    frame = packed()[0]
    outline = frame.outline()
    found = ContourTracker().process(frame.image, frame.camera, 0, "object")
    assert outline.loop_starts[-1] == len(outline) > 100
    assert frame.nbytes > frame.code.nbytes + 4 * len(outline)
    filled = np.zeros(frame.mask().shape, np.uint8)
    loops = [np.rint(loop).astype(np.int32) for loop in found.by_loop(found.uv)]
    cv2.fillPoly(filled, loops, 255)
    assert np.mean((filled > 0) != (frame.mask() > 127)) < 0.01
    assert frame.bare.outline() is not None
    assert frame.bare.nbytes < frame.nbytes - 1000


def test_kept_frames_stay_even_within_their_memory():
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (48, 64, 3), np.uint8)
    angles = np.concatenate([np.linspace(0, 1, 60), np.linspace(1, 6.1, 60)])
    cameras = [
        Camera(np.eye(3), 64, 48, np.eye(3), -np.array([np.cos(a), np.sin(a), 0])) for a in angles
    ]
    size = PackedFrame.of(image, cameras[0], 0).code.nbytes
    for kept in (KeptFrames(24, 10**9), KeptFrames(1000, 24 * size + 1)):
        for k, camera in enumerate(cameras):
            kept.add(PackedFrame.of(image, camera, k))
        assert len(kept) == 24
        assert kept.nbytes == 24 * size
        x, y, _ = kept.centres.T
        steps = np.diff(np.unwrap(np.arctan2(y, x)))
        assert (steps > 0).all()
        assert steps.max() < 3 * 6.1 / 24
