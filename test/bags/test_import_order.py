"""import: frames without stamps that do not follow each other, and poses that do not change."""

import json
import random

import cv2
import numpy as np
import pytest

from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.scene import TurntableSettings, turntable_cameras

SAID = "in the order of their places around the object"


@pytest.fixture
def frames(tmp_path):
    """36 of a turn, of grey pictures: only where the cameras are matters here."""
    settings = TurntableSettings(frames=36, step=np.pi / 18, width=64, height=48, focal_px=100)
    for k in range(108):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((48, 64), k, np.uint8))
    return [
        {
            "file": "0.png",
            "width": 64,
            "height": 48,
            "K": camera.K.tolist(),
            "R": camera.R_camera_object.tolist(),
            "t": camera.t_camera_object.tolist(),
        }
        for camera in turntable_cameras(settings)
    ]


@pytest.fixture
def imported(command, tmp_path):
    """Numbers that the listed frames have among those of the turn, in the order of the bag; and
    what was said."""

    def run(listed, frames):
        listed = [frame | {"file": f"{k}.png"} for k, frame in enumerate(listed)]
        (tmp_path / "cameras.json").write_text(json.dumps({"frames": listed}))
        code, out, err = command("import", tmp_path, tmp_path / "a.mcap", "--overwrite")
        assert (code, err) == (0, "")
        t = np.array([frame["t"] for frame in frames])
        R = np.array([frame["R"] for frame in frames])
        turn = -np.einsum("nji,nj->ni", R, t)
        stamped = sorted(BagViews(tmp_path / "a.mcap").cameras().items())
        taken = [camera.centre for _, camera in stamped]
        return [int(np.linalg.norm(turn - c, axis=1).argmin()) for c in taken], out

    return run


def test_frames_listed_in_no_order_are_taken_around_the_object(imported, frames):
    order, out = imported(random.Random(1).sample(frames, 36), frames)
    assert SAID in out
    assert sorted(order) == list(range(36))
    assert set(np.diff(order) % 36) in ({1}, {35})


def test_stamps_that_are_given_are_kept(imported, frames):
    mixed = random.Random(1).sample(range(36), 36)
    listed = [frames[k] | {"stamp": float(i)} for i, k in enumerate(mixed)]
    order, out = imported(listed, frames)
    assert SAID not in out
    assert order == mixed


@pytest.mark.parametrize(
    "sensible",
    [
        list(range(36)),
        list(range(35, -1, -1)),
        list(range(20, 36)) + list(range(20)),
        [k // 3 for k in range(108)],  # a table at rest between its steps
        list(range(36)) * 2,  # a second turn
        list(range(0, 36, 2)) + list(range(1, 36, 2)),  # between the steps of the first
        list(range(0, 36, 12)),
    ],
)
def test_a_folder_in_sensible_order_stays_as_it_is(imported, frames, sensible):
    order, out = imported([frames[k] for k in sensible], frames)
    assert SAID not in out
    assert order == sensible


@pytest.mark.parametrize("count", [2, 3, 36])
def test_one_pose_of_all_frames_is_that_of_a_camera_that_stands_still(
    command, tmp_path, frames, count
):
    (tmp_path / "cameras.json").write_text(json.dumps({"frames": [frames[4]] * count}))
    code, _, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert code == (0 if count == 2 else 2)
    if count > 2:
        assert f"all {count} frames have the same pose" in err
        assert "turns with the object" in err
        assert err.count("\n") == 1


@pytest.mark.parametrize(("unit", "said"), [(1.0, ""), (1e3, "m away"), (1e-3, "m away")])
def test_poses_in_another_unit_are_said(command, tmp_path, frames, unit, said):
    content = {"unit_in_metres": unit, "frames": frames}
    (tmp_path / "cameras.json").write_text(json.dumps(content))
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert ("may be in another unit (unit_in_metres)" in out) == bool(said)
