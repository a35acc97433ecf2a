"""Poses that are those of the next images are given back, in the flow of a replay."""

from dataclasses import replace

import numpy as np
import pytest

from msg_adapters import View
from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.evaluation.refinement import Refine
from occ_recon_ros.evaluation.shifted import ShiftedPoses
from occ_recon_ros.evaluation.shifted_masks import given_back, masks_of_others
from occ_recon_ros.poses.pose_shift import PoseShift, placed_as
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.streams.alone import filled

VIEWS, FIRST = 12, 7
QUIET = lambda done, total: None  # noqa: E731


class Turn:
    """Stands for the views of a bag, as far as the step looks at them."""

    def __init__(self, views):
        self.views, self.meant, self.changes = views, Changes(), Changes()

    def __len__(self):
        return len(self.views)

    def __iter__(self):
        return iter(self.views)

    def masked(self):
        return True

    def images(self):
        return [{"stamp_ns": view.stamp_ns, "name": f"{view.stamp_ns}.jpg"} for view in self.views]

    @property
    def recorded_cameras(self):
        return {view.stamp_ns: view.camera for view in self.views}


@pytest.fixture(scope="module")
def views():
    size = {"width": 240, "height": 180, "focal_px": 300}
    settings = TurntableSettings(frames=36, step=2 * np.pi / 36, elevation=0.5, **size)
    steps = [0, 2, 6, 9, 12, 14, 17, 20, 23, 26, 28, 32]
    figure, found = make_object("figure"), []
    for k, camera in enumerate(np.array(turntable_cameras(settings))[steps]):
        loops = figure.exact_contours(camera)
        mask = filled(loops.by_loop(loops.uv), (camera.height, camera.width))
        found.append(View(k, camera, mask, mask))
    return found


def shifted(views):
    """From an image on each has the pose of the next."""
    after = [*views[1:], views[0]]
    return [
        view if k < FIRST else replace(view, camera=placed_as(view.camera, after[k].camera))
        for k, view in enumerate(views)
    ]


def test_each_image_is_given_its_own_pose_and_the_one_that_has_none_is_placed(views):
    turn = Turn(shifted(views))
    step = ShiftedPoses(Refine())
    assert step(turn, QUIET) == Changes()
    assert turn.meant.masks is None
    for k, view in enumerate(views):
        off = turn.meant.cameras[k].centre - view.camera.centre
        assert np.linalg.norm(off) < (0.02 if k == FIRST else 1e-12)
    (note,) = step.report["notes"]
    assert note == (
        f"from view {FIRST} ({FIRST}.jpg) on each image has the pose of the next, by the outlines "
        f"of all: each was given its own; view {FIRST} ({FIRST}.jpg), of which there is none, "
        "placed by the outlines of the others"
    )
    assert [row["stamp_ns"] for row in step.report["cameras"]] == list(range(VIEWS))


@pytest.mark.slow
def test_an_image_that_fits_nowhere_is_left_out(views):
    given = shifted(views)
    other = views[FIRST].mask[:, ::-1].copy()
    other[::3] = 0
    given[FIRST] = replace(given[FIRST], mask=other)
    turn = Turn(given)
    step = ShiftedPoses(Refine())
    step(turn, QUIET)
    assert not turn.meant.masks[FIRST].any()
    assert turn.meant.masks[0].any()
    assert step.report["notes"][0].endswith(
        f"view {FIRST} ({FIRST}.jpg), of which there is none, left out"
    )


def test_it_is_told_alone_where_poses_are_to_be_left(views):
    turn, step = Turn(shifted(views)), ShiftedPoses(Refine("off"))
    assert step(turn, QUIET) == turn.meant == Changes()
    (doubt,) = step.report["warnings"]
    assert doubt.startswith(
        f"from view {FIRST} ({FIRST}.jpg) on each image has the pose of the next"
    )


@pytest.mark.parametrize("last", [VIEWS - 2, VIEWS - 1])
def test_masks_of_the_next_images_are_given_back_and_poses_are_left(views, last):
    # A network's masks were a frame late: right poses were shifted.
    first = 5
    late = [
        replace(view, mask=views[(k + 1) % VIEWS].mask) if first <= k <= last else view
        for k, view in enumerate(views)
    ]
    turn, step = Turn(late), ShiftedPoses(Refine())
    assert step(turn, QUIET) == Changes()
    assert turn.meant.cameras is None
    for k, view in enumerate(views):
        if k != first:  # of which there is none
            assert (turn.meant.masks[k] == view.mask).all()
    assert first not in turn.meant.masks
    (note,) = step.report["notes"]
    assert note == (
        f"from view {first} ({first}.jpg) to view {VIEWS - 2} ({VIEWS - 2}.jpg) each mask is that "
        "of the next image, by the edges of both: each was given its own; "
        f"view {first} ({first}.jpg), of which there is none, left without one"
    )


def test_masks_are_not_given_to_images_of_another_shape(views):
    # Of a turn of two sizes, a replay ended at the mask of the one with the camera of the other.
    first, small, low = 5, 8, 174
    late = [
        replace(view, mask=views[(k + 1) % VIEWS].mask) if first <= k < VIEWS - 1 else view
        for k, view in enumerate(views)
    ]
    camera = replace(late[small].camera, height=low)
    late[small] = View(small, camera, late[small].image[:low], late[small].mask[:low])
    found = PoseShift(first, -1, tuple(k + (first <= k < VIEWS - 1) for k in range(VIEWS)))
    moved = masks_of_others(Turn(late), found)
    apart = dict.fromkeys((small - 1, small), -1)
    assert moved == {k: k + 1 for k in range(first, VIEWS - 1)} | apart
    given = given_back({k: view.mask for k, view in enumerate(late)}, moved)
    assert {*range(VIEWS)} - {*given} == {first, small, small + 1}
    assert all(given[k].shape == late[k].image.shape for k in given)


def test_right_poses_are_left(views):
    turn, step = Turn(views), ShiftedPoses(Refine())
    assert step(turn, QUIET) == turn.meant == Changes()
    assert step.report == {}
