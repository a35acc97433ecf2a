"""Poses that all look at the object and yet are meant another way are told by its outlines."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from recorded import real_frames
from scenes import hand_held_cameras
from scipy.spatial.transform import Rotation

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.cli.refining import refinement_lines
from occ_recon_ros.evaluation.advice import of_remark
from occ_recon_ros.evaluation.misread import misread, misread_by_masks, resized, resized_so
from occ_recon_ros.evaluation.refinement import Refine
from occ_recon_ros.evaluation.segmentation import Segmentation
from occ_recon_ros.geometry import contours_from_loops
from occ_recon_ros.imaging import ContourSettings, ContourTracker
from occ_recon_ros.poses.refine import Refinement
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras


@pytest.fixture(scope="module")
def seen():
    cameras = turntable_cameras(TurntableSettings(frames=8, step=np.pi / 4))
    figure = make_object("figure")
    return [figure.exact_contours(c, 6.0, k + 1) for k, c in enumerate(cameras)], cameras


def transposed(camera):
    return replace(camera, R_camera_object=camera.R_camera_object.T)


def by_place(camera):
    return replace(camera, t_camera_object=camera.centre)


def of_larger(camera, times=2.0):
    """Of images whose pixels are parts of those: edges of the image stay edges."""
    K = np.diag([times, times, 1.0]) @ camera.K
    K[:2, 2] += 0.5 * times - 0.5
    return replace(camera, K=K)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (transposed, "rotations seem to be transposed"),
        (by_place, "t seems to be the place of the camera"),
        (of_larger, "K seems to be of images 2 times as large"),
    ],
)
def test_what_is_meant_another_way_is_named(seen, change, words):
    contours, cameras = seen
    assert words in misread(contours, [change(camera) for camera in cameras])


@pytest.mark.parametrize(
    ("times", "beside"),
    [
        (2, (-60, 40)),
        *[pytest.param(x, (0, 0), marks=pytest.mark.slow) for x in (4, 1.5, 1 / 2, 2.5)],
        pytest.param(1 / 3, (-60, 40), marks=pytest.mark.slow),
    ],
)
def test_images_that_were_resized_are_taken_with_k_of_their_size(seen, times, beside):
    """Beside the middle the principal point tells another factor than the usual."""
    contours, cameras = shifted(*seen, beside)
    poses = Refine()
    given = [of_larger(camera, times) for camera in cameras]
    changes = poses(Masked(contours, given), lambda *_: None)
    assert f" {times:.2g} times as large as these" in poses.report["warnings"][0]
    assert poses.report["notes"][0].endswith("as large as these: K is taken so")
    assert refinement_lines(poses.report)[0].startswith("taken so: K seems to be of images")
    for camera, right in zip(changes.cameras.values(), cameras, strict=True):
        np.testing.assert_allclose(camera.K, right.K, rtol=0.01, atol=2)


def test_a_table_that_turns_the_other_way_is_named(seen):
    contours, cameras = seen
    assert "turns the other way" in misread(contours, cameras[::-1])


@pytest.mark.parametrize("way", ["clockwise", "counter-clockwise"])
def test_images_that_were_turned_against_k_are_named(seen, way):
    given, turned = [], []
    for contours, camera in zip(*seen, strict=True):
        given.append(replace(camera, width=camera.height, height=camera.width))
        (u, v), (w, h) = contours.uv.T, (camera.width, camera.height)
        uv = np.column_stack([h - 1 - v, u] if way == "clockwise" else [v, w - 1 - u])
        loops = [contours.by_loop(part) for part in (uv, contours.sigma)]
        names = list(range(len(loops[0])))
        turned.append(contours_from_loops(given[-1], loops[0], names, loops[1], 1, "object"))
    assert f"turned by 90 degrees {way} against K" in misread(turned, given)


@pytest.mark.parametrize(
    ("left", "right", "said"),
    [
        (60, 0, "cut by 60 px on the left, with K of whole ones: take 60 off cx"),
        (30, 30, "cut by 30 px on the left and as much on the other side, with K"),
        (0, 60, None),
    ],
)
def test_images_that_were_cut_with_k_of_whole_ones_are_named(seen, left, right, said):
    contours, given = cut_off(*seen, left, right)
    words = misread(contours, given)
    if said is None:
        assert words is None
        return
    assert said in words
    for camera, whole in zip(resized(given)[words](given), seen[1], strict=True):
        np.testing.assert_allclose(camera.K[:2, 2], whole.K[:2, 2] - [left, 0])


def cut_off(contours, cameras, left, right):
    """Of images that lack so many columns, in cameras whose K nobody changed."""
    given = [replace(c, width=c.width - left - right) for c in cameras]
    return [moved(c, k, [-left, 0]) for c, k in zip(contours, given, strict=True)], given


def shifted(contours, cameras, px):
    """In images whose middle is elsewhere, and with it the principal point."""
    shift = np.zeros((3, 3))
    shift[:2, 2] = px
    there = [replace(c, K=c.K + shift) for c in cameras]
    return [moved(c, k, px) for c, k in zip(contours, there, strict=True)], there


def moved(contours, camera, px):
    loops = [contours.by_loop(part) for part in (contours.uv + px, contours.sigma)]
    names = list(range(len(loops[0])))
    return contours_from_loops(camera, loops[0], names, loops[1], 1, "object")


def test_images_that_were_cut_are_taken_for_parts_of_whole_ones(seen):
    contours, given = cut_off(*seen, 60, 0)
    poses = Refine()
    changes = poses(Masked(contours, given), lambda *_: None)
    assert "cut by 60 px on the left" in poses.report["warnings"][0]
    assert refinement_lines(poses.report)[0].startswith("taken so: the images seem to be cut")
    for camera, whole in zip(changes.cameras.values(), seen[1], strict=True):
        assert abs(camera.K[0, 2] - whole.K[0, 2] + 60) < 2


@pytest.mark.parametrize(
    ("lost", "left", "resized", "named"),
    [
        (0.15, 0.055, False, True),
        (0.15, 0.07, False, False),  # explains a little more
        (0.6, 0.19, False, True),
        (0.6, 0.22, False, False),  # so much agrees by chance
        (0.6, 0.04, True, True),
        (0.6, 0.1, True, False),  # as another size does of images that were cut
    ],
)
def test_what_is_left_of_another_reading_is_little(seen, monkeypatch, lost, left, resized, named):
    contours, given = seen
    others = {"K of another size": lambda cameras: [*cameras]}
    there = "occ_recon_ros.evaluation.misread."
    monkeypatch.setattr(there + "_others", lambda _: others)
    monkeypatch.setattr(there + "_scalings", lambda _: others if resized else {})
    monkeypatch.setattr(there + "parted_at", lambda *_: None)
    shares = iter([lost, left])
    monkeypatch.setattr(there + "_lost", lambda *_: next(shares))
    assert misread(contours, given) == ("K of another size" if named else None)


def test_what_was_cut_is_known_of_all_views_by_those_that_were_looked_at(seen, monkeypatch):
    # Words that are made of some views of a K each are not those that are made of all.
    monkeypatch.setattr("occ_recon_ros.evaluation.misread._VIEWS", 7)
    contours, cameras = seen
    off = np.random.default_rng(1).normal(0, 6, len(cameras))
    px = np.column_stack([off, np.zeros(len(cameras))])
    pairs = [shifted([c], [k], by) for c, k, by in zip(contours, cameras, px, strict=True)]
    there = [c for (c,), _ in pairs], [k for _, (k,) in pairs]
    contours, given = cut_off(*there, 60, 0)
    words = misread(contours, given)
    assert "cut by" in words
    (whole,) = resized_so(words, contours, given)(given[:1])
    assert whole.K[0, 2] < given[0].K[0, 2]


def test_how_k_is_taken_is_noted_beside_what_is_said_of_its_lens(seen, monkeypatch):
    common = np.append(np.zeros(8), [np.log(1.3), 0.0, 0.0])
    monkeypatch.setattr(
        "occ_recon_ros.evaluation.refinement.refine",
        lambda contours, cameras, *_: Refinement(
            list(cameras), ("common", "focal"), 1.3, 0.06, 9.0, 0.5, common=common
        ),
    )
    poses = Refine()
    poses(Masked(*cut_off(*seen, 60, 0)), lambda *_: None)
    taken, lens = poses.report["notes"]
    assert taken.endswith("K is taken so")
    assert lens.startswith("the focal length was made 1.30 times")


@pytest.mark.slow
def test_an_object_that_was_exchanged_makes_two_scans():
    """Of what fell over the motion is found (``find_break``); where none is, it is told so."""
    cameras = turntable_cameras(TurntableSettings(frames=12, step=np.pi / 6))
    figure, vase = make_object("figure"), make_object("vase")
    shown = [figure] * 7 + [vase] * 5
    contours = [o.exact_contours(c, 6.0, 1) for o, c in zip(shown, cameras, strict=True)]
    some = [k for k in range(12) if k != 7]
    images = [{"name": f"{k}.jpg" if k != 6 else ""} for k in range(12)]
    words = misread(*([whole[k] for k in some] for whole in (contours, cameras)), some, images)
    said = "the images seem to be of two scans, up to view 6 and from view 8 (8.jpg) on"
    assert words.startswith(said)
    assert of_remark(words, "") == "give the images of one of them alone"


def test_right_cameras_and_cameras_of_something_else_are_not_named(seen):
    contours, cameras = seen
    assert misread(contours, cameras) is None
    assert misread([*contours[:2], *[None] * 6], cameras) is None
    others = hand_held_cameras(frames=8, step=np.pi / 4)
    assert misread(contours, others[3:] + others[:3]) is None


@pytest.mark.parametrize("sigma", [0.05, 0.4])
def test_cameras_that_are_merely_wrong_are_told_nothing(seen, sigma):
    contours, cameras = seen
    turns = Rotation.from_rotvec(np.random.default_rng(0).normal(0, sigma, (8, 3))).as_matrix()
    shaken = [
        replace(c, R_camera_object=R @ c.R_camera_object, t_camera_object=R @ c.t_camera_object)
        for R, c in zip(turns, cameras, strict=True)
    ]
    assert misread(contours, shaken) is None


@pytest.mark.parametrize("order", [[6, 5, 7, 2, 3, 4, 0, 1], [0, 6, 7, 2, 4, 5, 1, 3]])
def test_what_explains_a_little_more_is_told_neither(seen, order):
    contours, cameras = seen
    assert misread(contours, [cameras[i] for i in order]) is None


class Masked:
    """Views that came with masks, of a bag."""

    changes = Changes()

    def __init__(self, contours, cameras):
        self.cameras, self.masks = cameras, []
        for c, camera in zip(contours, cameras, strict=True):
            mask = np.zeros((camera.height, camera.width), np.uint8)
            rings = [np.rint(c.uv[c.loop == k]).astype(np.int32) for k in np.unique(c.loop)]
            self.masks.append(cv2.fillPoly(mask, rings, 255))

    def __len__(self):
        return len(self.cameras)

    def masked(self):
        return True

    def images(self):
        return []

    @property
    def recorded_cameras(self):
        return {k + 1: camera for k, camera in enumerate(self.cameras)}

    def __iter__(self):
        return self.some(range(len(self)))

    def some(self, numbers):
        for k in numbers:
            mask = self.masks[k]
            yield SimpleNamespace(image=mask, mask=mask, camera=self.cameras[k], stamp_ns=k + 1)


def test_masks_that_came_tell_of_larger_images_before_anything_else_is_tried(seen):
    contours, cameras = seen
    assert misread_by_masks(Masked(contours, cameras)) is None
    masks = Segmentation()
    assert masks(Masked(contours, [*map(of_larger, cameras)]), lambda *_: None) == Changes()
    assert masks.misread
    (words,) = masks.report["warnings"]
    assert words.startswith("K seems to be of images 2 times as large")


@pytest.mark.slow
def test_a_recorded_turn_whose_images_are_in_the_opposite_order_is_named(shared_data):
    frames = list(real_frames(shared_data / "dino_ring"))[::3]
    tracker = ContourTracker(ContourSettings(refine="none"))
    contours = [
        tracker.process(image, camera, k + 1, "object", mask)
        for k, (image, mask, camera) in enumerate(frames)
    ]
    cameras = [camera for _, _, camera in frames]
    assert "turns the other way" in misread(contours, cameras[::-1])
