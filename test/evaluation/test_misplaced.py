"""Views whose poses alone are wrong, in the flow of a replay."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from msg_adapters import View
from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.cli.refining import refinement_lines
from occ_recon_ros.evaluation import misplaced
from occ_recon_ros.evaluation.misplaced import Misplaced
from occ_recon_ros.evaluation.refinement import Refine
from occ_recon_ros.imaging.joint.judge import STRANGE
from occ_recon_ros.poses.placed_anew import Placed
from occ_recon_ros.report.result import _placed_anew
from occ_recon_ros.scene import TurntableSettings, make_object, render, turntable_cameras
from occ_recon_ros.streams.alone import filled

VIEWS, K = 14, 5
QUIET = lambda done, total: None  # noqa: E731


class Turn:
    """Stands for the views of a bag, as far as a step looks at them."""

    def __init__(self, views):
        self.views, self.changes = views, Changes()

    def __len__(self):
        return len(self.views)

    def __iter__(self):
        masks, cameras = self.changes.masks, self.changes.cameras
        for view in self.views:
            stamp = view.stamp_ns
            mask = view.mask if masks is None else masks.get(stamp)
            camera = view.camera if cameras is None else cameras.get(stamp)
            yield replace(view, mask=mask, camera=camera)

    def cameras(self):
        return {view.stamp_ns: view.camera for view in self}

    @property
    def recorded_cameras(self):
        return {view.stamp_ns: view.camera for view in self.views}

    def masked(self):
        return self.changes.masks is not None or self.views[0].mask is not None


@pytest.fixture(scope="module")
def views():
    size = {"width": 240, "height": 180, "focal_px": 300}
    settings = TurntableSettings(frames=VIEWS, step=2 * np.pi / VIEWS, elevation=0.5, **size)
    mug, found = make_object("mug"), []
    for k, camera in enumerate(turntable_cameras(settings), 1):
        loops = mug.exact_contours(camera)
        mask = filled(loops.by_loop(loops.uv), (camera.height, camera.width))
        found.append(View(k, camera, render(mug, camera), mask))
    return found


def elsewhere(view, deg=4.0, share=0.02):
    """The same view in a wrong pose."""
    camera = view.camera
    R = Rotation.from_rotvec([0, 0, np.deg2rad(deg)]).as_matrix()
    t = camera.t_camera_object + share * np.array([0.8, 0.6, 0.0])
    R = camera.R_camera_object @ R.T
    return replace(view, camera=replace(camera, R_camera_object=R, t_camera_object=t))


def placed(turn, way="auto", bad_views=None, elsewhere=None):
    """What the step changes, and the reports on masks and poses."""
    masks = SimpleNamespace(
        report={"bad_views": bad_views or {}}, misread=False, elsewhere=elsewhere or {}
    )
    poses = Refine(way)
    known = turn.changes
    found = Misplaced(masks, poses)(turn, QUIET)
    assert turn.changes is known
    return found, masks.report, poses.report


def off(camera, truth):
    """Degrees, and shares of the distance of 1 m, between two poses."""
    R = camera.R_camera_object @ truth.R_camera_object.T
    t = camera.t_camera_object - truth.t_camera_object
    return np.rad2deg(Rotation.from_matrix(R).magnitude()), np.linalg.norm(t)


def test_a_view_of_a_wrong_pose_is_placed_anew_and_the_others_stay(views):
    given = [elsewhere(view) if k == K else view for k, view in enumerate(views)]
    found, _, report = placed(Turn(given))
    assert found.masks is None
    for k, view in enumerate(views):
        camera = found.cameras[view.stamp_ns]
        if k == K:
            assert np.all(off(camera, view.camera) < np.array([0.5, 2e-3]))
        else:
            assert camera is view.camera
    ((number, row),) = report["placed_anew"].items()
    assert number == K
    assert row["deg"] == pytest.approx(4, abs=0.5)
    assert row["of_distance"] == pytest.approx(0.02, abs=2e-3)
    assert row["all_told"]
    assert [row["stamp_ns"] for row in report["cameras"]] == [view.stamp_ns for view in views]
    assert "warnings" not in report


def test_a_view_that_was_left_out_is_used_again(views):
    given = [elsewhere(view) if k == K else view for k, view in enumerate(views)]
    turn, stamp = Turn(given), views[K].stamp_ns
    masks = {view.stamp_ns: view.mask for view in views} | {stamp: np.zeros_like(views[K].mask)}
    turn.changes = Changes(masks=masks)
    found, masks_report, _ = placed(turn, bad_views={K: "left out", 1: "drawn anew"})
    assert np.all(off(found.cameras[stamp], views[K].camera) < np.array([0.5, 2e-3]))
    wrong = (found.masks[stamp] > 127) != (views[K].mask > 127)
    assert wrong.mean() < 1e-3
    assert masks_report["bad_views"] == {1: "drawn anew"}


@pytest.mark.parametrize("out", [False, True], ids=["kept", "left out"])
def test_what_something_stands_before_is_not_placed_by_its_outline(views, out):
    # A hand that takes the object away: its outline fitted in the pose of another such view.
    given = [elsewhere(view) if k == K else view for k, view in enumerate(views)]
    turn, strange = Turn(given), f"{STRANGE} that no other view shows (20% of the object's area)"
    if out:
        masks = {view.stamp_ns: view.mask for view in views}
        turn.changes = Changes(masks=masks | {views[K].stamp_ns: np.zeros_like(views[K].mask)})
    found, masks_report, report = placed(turn, bad_views={K: strange})
    assert found.cameras is None
    assert "placed_anew" not in report
    assert masks_report["bad_views"] == {K: strange}


def test_views_whose_poses_are_exchanged_get_them_back(views):
    other, given = K + 4, list(views)
    given[K] = replace(views[K], camera=views[other].camera)
    given[other] = replace(views[other], camera=views[K].camera)
    turn = Turn(given)
    masks = {v.stamp_ns: v.mask * (k not in (K, other)) for k, v in enumerate(views)}
    turn.changes = Changes(masks=masks)
    found, _, report = placed(turn, bad_views={K: "left out", other: "left out"})
    for view in views:
        np.testing.assert_array_equal(
            found.cameras[view.stamp_ns].R_camera_object, view.camera.R_camera_object
        )
    words = {k: row["words"] for k, row in report["placed_anew"].items()}
    assert f"the pose that view {other} was given" in words.pop(K)
    assert f"the pose that view {K} was given" in words.pop(other)
    assert not words


def test_views_without_masks_get_exchanged_poses_back_by_what_they_show_elsewhere(views):
    other, given = K + 4, [replace(v, image=np.zeros_like(v.image)) for v in views]
    given[K] = replace(given[K], camera=views[other].camera)
    given[other] = replace(given[other], camera=views[K].camera)
    turn = Turn([replace(view, mask=None) for view in given])
    turn.changes = Changes(
        {v.stamp_ns: v.mask * (k not in (K, other)) for k, v in enumerate(views)}
    )
    found, masks_report, _ = placed(
        turn,
        bad_views={K: "its pose is wrong", other: "its pose is wrong"},
        elsewhere={views[k].stamp_ns: views[k].mask for k in (K, other)},
    )
    for view in views:
        np.testing.assert_array_equal(
            found.cameras[view.stamp_ns].R_camera_object, view.camera.R_camera_object
        )
        assert found.masks[view.stamp_ns].any()
    assert not masks_report["bad_views"]


def test_a_mask_that_lacks_something_is_no_wrong_pose(views):
    bitten = views[K].mask.copy()
    rows = np.flatnonzero(bitten.any(axis=1))
    bitten[rows[2 * len(rows) // 3] :] = 0
    turn, stamp = (
        Turn([replace(v, mask=bitten) if k == K else v for k, v in enumerate(views)]),
        K + 1,
    )
    masks = {view.stamp_ns: view.mask for view in views} | {stamp: np.zeros_like(bitten)}
    turn.changes = Changes(masks=masks)
    found, masks_report, report = placed(turn, bad_views={K: "left out"})
    assert found == Changes()
    assert masks_report["bad_views"] == {K: "left out"}
    assert "placed_anew" not in report


def test_nothing_is_placed_where_poses_are_to_be_left(views):
    given = [elsewhere(view) if k == K else view for k, view in enumerate(views)]
    assert placed(Turn(given), way="off")[0] == Changes()


def test_many_wrong_poses_are_a_doubt(views, monkeypatch):
    monkeypatch.setattr(misplaced, "_MANY", 0.5 / VIEWS)
    given = [elsewhere(view) if k == K else view for k, view in enumerate(views)]
    (doubt,) = placed(Turn(given))[2]["warnings"]
    assert doubt == (
        "1 of 14 views stood where the others contradict them, and were placed anew by the "
        "outlines of the others"
    )


def test_it_is_named_by_its_image_with_how_far_it_was_moved():
    untold = np.array([0.0, 1.0, 0.0])
    one = Placed(None, np.deg2rad(3.21), np.array([0.0, 0.001, 0.0]), 1.0, None, True, 1.0, 1.0)
    words = misplaced._words(one)
    assert words == "stood 3.2 degrees off and was placed anew by the outlines of the others"
    far = misplaced._words(replace(one, shift=np.array([0.02, 0, 0]), untold=untold))
    assert far.startswith("stood 3.2 degrees and 2.0% of its distance off and was placed anew")
    assert far.endswith(
        "; one turn of it, which they do not tell, is as the even steps of the others have it"
    )
    given = misplaced._words(replace(one, untold=untold, predicted=False))
    assert given.endswith("which they do not tell, is as it was given")
    report = {"placed_anew": {1: {"words": words}}, "note": "too few"}
    images = [{"name": "a.jpg"}, {"name": "b.jpg"}]
    assert _placed_anew({"refinement": report, "images": images}) == [f"view 1 (b.jpg) {words}"]
    assert refinement_lines(report | {"images": images})[0] == f"view 1 (b.jpg) {words}"
    assert refinement_lines(report) == [
        f"view 1 {words}",
        "in the other poses, nothing corrected: too few",
    ]
