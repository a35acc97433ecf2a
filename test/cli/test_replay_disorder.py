"""replay of bags that were merged, looped, or written in another order than that of time."""

import json

from fixtures import COARSE
from recordings import FRAMES, write_all

ALL = f"{FRAMES} images, {FRAMES} contours, {FRAMES} rims"


def test_frames_that_come_twice_change_nothing_but_a_warning(command, messages, expected, tmp_path):
    """With the first passes over the images, which hold each view against the others."""
    bag = write_all(tmp_path / "bag", messages + messages[-12:])
    code, text, err = command("replay", bag, "--out", tmp_path / "out", COARSE)
    assert code == 0, err
    assert ALL in text
    assert (tmp_path / "out" / "rims.ply").read_bytes() == expected
    assert "4 images come again" in err
    assert err.count("\n") == 1
    assert json.loads((tmp_path / "out" / "report.json").read_text())["frames"]["images"] == FRAMES
