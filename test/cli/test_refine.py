"""Poses and calibration that a pass over a recording corrects."""

import json
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from plaster import imported, views_in, write_mask
from scipy.spatial.transform import Rotation

from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.poses.another_lens import AnotherLens
from occ_recon_ros.poses.refine import Refinement
from occ_recon_ros.poses.refine_trials import Trial


@pytest.fixture(scope="module")
def masked(toy, tmp_path_factory):
    """What is known of a dinosaur's views, with masks."""
    folder = tmp_path_factory.mktemp("masked")
    content = json.loads((toy / "cameras.json").read_text())
    for k, (frame, (_, mask, _)) in enumerate(zip(content["frames"], views_in(toy), strict=True)):
        frame["file"] = str(toy / frame["file"])
        frame["mask"] = str(folder / write_mask(folder, f"{k}.png", mask))
    return content


@pytest.fixture
def shifted(masked):
    """The same, with a principal point that is said to be 2 px to the right."""
    content = deepcopy(masked)
    for frame in content["frames"]:
        frame["K"][0][2] += 2.0
    return content


@pytest.mark.slow
def test_a_shifted_principal_point_is_corrected_in_the_bag(command, shifted, tmp_path):
    plain, refined = imported(command, shifted, tmp_path), tmp_path / "refined.mcap"
    code, out, error = command("refine", plain, refined)
    assert code == 0, error
    assert "what all views share" in out
    assert "doubtful" not in out
    before, after = list(BagViews(plain)), list(BagViews(refined))
    assert [v.stamp_ns for v in before] == [v.stamp_ns for v in after]
    assert all((a.image == b.image).all() for a, b in zip(before, after, strict=True))
    # A turn of the camera and a shift of its principal point look the same; both move the image.
    middle = np.array([v.camera.project(np.zeros((1, 3)))[0] for v in before])
    moved = np.array([v.camera.project(np.zeros((1, 3)))[0] for v in after]) - middle
    assert np.median(moved[:, 0]) == pytest.approx(-2, abs=0.5)


@pytest.mark.slow
def test_a_correction_as_large_as_a_part_of_the_object_is_a_doubt(command, shifted, tmp_path):
    # Outlines make up for a principal point that lies where no lens has it, but not for all.
    del shifted["frames"][::3]
    for frame in shifted["frames"]:
        frame["K"][0][2] -= 30.0  # more would be told as images that were cut
    given = imported(command, shifted, tmp_path)
    code, out, error = command("refine", given, tmp_path / "refined.mcap")
    assert code == 0, error
    assert "doubtful: views were" in out
    assert "px apart in the cameras as given" in out
    assert "what all views share" in out


@pytest.mark.slow
def test_what_moved_in_the_middle_is_named_and_taken_back(command, masked, tmp_path):
    # The encoder slipped once: all later poses are told turned about the axis of the table.
    content = deepcopy(masked)
    true = [np.array(frame["R"]) for frame in content["frames"]]
    slip = Rotation.from_rotvec(np.deg2rad(6) * common_axis_of(content["frames"])).as_matrix()
    for k, frame in enumerate(content["frames"]):
        if k >= 5:
            frame["R"] = (true[k] @ slip).tolist()
    given = imported(command, content, tmp_path)
    code, out, error = command("refine", given, tmp_path / "refined.mcap")
    assert code == 0, error
    name = Path(content["frames"][5]["file"]).name
    assert f"  that the object moved before view 5 ({name}), by " in out
    views = BagViews(tmp_path / "refined.mcap")
    turned = [v.camera.R_camera_object @ R.T for v, R in zip(views, true, strict=True)]
    assert np.rad2deg(Rotation.from_matrix(turned[5] @ turned[4].T).magnitude()) < 0.5


def common_axis_of(frames):
    """(3,) the direction about which their cameras go around."""
    centres = np.array([-np.array(f["R"]).T @ np.array(f["t"]) for f in frames])
    return np.linalg.svd(centres - centres.mean(axis=0))[2][2]


@pytest.mark.slow
def test_a_focal_length_that_is_another_across_than_along_is_a_doubt(command, shifted, tmp_path):
    # The body is as much wider, and agrees with all outlines.
    del shifted["frames"][::3]
    for frame in shifted["frames"]:
        frame["K"][0][0] = frame["K"][1][1] / 1.2
    given = imported(command, shifted, tmp_path)
    code, out, error = command("refine", given, tmp_path / "refined.mcap")
    assert code == 0, error
    assert "doubtful: fx is 0.83 times fy" in out


def test_refine_is_a_flag_and_its_opposite(command, tmp_path):
    for flag in ("--refine", "--no-refine"):
        code, _, error = command("replay", tmp_path / "none.mcap", "--out", tmp_path, flag)
        assert code == 2
        assert "none.mcap" in error
    code, _, error = command("replay", tmp_path, "--out", tmp_path, "--refine=guess")
    assert code == 2
    assert "does not take a value" in error


@pytest.mark.parametrize("command_name", ["refine", "segment"])
def test_a_bag_that_is_there_is_refused_before_minutes_of_work(command, tmp_path, command_name):
    (there := tmp_path / "there.mcap").write_bytes(b"somebody's")
    # That the source cannot be read would be said first, were it looked at first.
    code, _, error = command(command_name, tmp_path / "none.mcap", there)
    assert code == 2
    assert "there.mcap exists already" in error
    assert there.read_bytes() == b"somebody's"


@pytest.mark.parametrize(
    ("whole", "said"), [(True, "the outlines ask for another lens (pixels 1.06"), (False, "note: ")]
)
def test_another_lens_that_the_outlines_ask_for_is_a_doubt_if_it_explains_all(
    command, bag, monkeypatch, tmp_path, whole, said
):
    lens = np.array([0, 0, 0, np.log(1.06), 0]), np.array([3, 3, 0.015, 0.003, 0.03])
    trial = Trial(("common", "lens"), 0.1, 6.3, False, "beyond", AnotherLens.of(*lens, whole))
    monkeypatch.setattr(
        "occ_recon_ros.evaluation.refinement.refine",
        lambda contours, cameras, *_: Refinement(
            list(cameras), (), 0.4, 0.4, 4.0, 4.0, trials=[trial]
        ),
    )
    code, out, error = command("refine", bag, tmp_path / "refined.mcap")
    assert code == 0, error
    assert said in out
    assert ("corrected: the outlines ask for another lens" in out) == whole
    assert "given" not in out.replace("as given", "")


@pytest.mark.parametrize(
    ("group", "factor", "told"),
    [("focal", 1.29, True), ("lens", 0.97, True), ("lens", 1.004, False)],
)
def test_a_focal_length_that_was_corrected_is_noted(
    command, bag, monkeypatch, tmp_path, group, factor, told
):
    common = np.append(np.zeros(8), [np.log(factor), 0.0, 0.0])
    monkeypatch.setattr(
        "occ_recon_ros.evaluation.refinement.refine",
        lambda contours, cameras, *_: Refinement(
            list(cameras), ("common", group), 1.3, 0.06, 9.0, 0.5, common=common
        ),
    )
    code, out, error = command("refine", bag, tmp_path / "refined.mcap")
    assert code == 0, error
    assert ("  the focal length\n" in out) == (group == "focal")
    note = f"  note: the focal length was made {factor:.2f} times what it was"
    assert (note in out) == told
    assert ("sizes may be off by as much" in out) == told
    assert "doubtful" not in out
