"""replay of poses in which the object lies far from the origin."""

import pytest
from fixtures import COARSE
from recordings import FRAMES, changed, write_all


def moved(messages, offset_m, folder):
    def move(pose):
        pose.pose.position.x += offset_m

    return write_all(
        folder / "bag", [changed(m, move) if m.topic == "/camera_pose" else m for m in messages]
    )


@pytest.mark.parametrize("offset_m", [1e5, 5e6])
def test_out_of_reach_of_float32_it_is_refused_in_words(command, messages, tmp_path, offset_m):
    bag = moved(messages, offset_m, tmp_path)
    code, out, err = command("replay", bag, "--out", tmp_path / "out", COARSE)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert "m from the origin of the object frame" in err
    assert "subtract an offset" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_within_reach_it_is_rebuilt_there(replay, messages, tmp_path):
    code, out, err = replay(moved(messages, 3e4, tmp_path), tmp_path / "out")
    assert (code, err) == (0, "")
    assert f"{FRAMES} images, {FRAMES} contours, {FRAMES} rims" in out
