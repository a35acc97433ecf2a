"""import: whatever is wrong with the folder, one line says it and nothing is left behind."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from occ_recon_ros.bags.views import BagViews

Folder = Any  # of conftest.py
Spoil = Callable[[Folder], None]


def frame(key: str, value: object, i: int = 1) -> Spoil:
    def spoil(folder: Folder) -> None:
        folder.content["frames"][i][key] = value
        folder.save()

    return spoil


def without(key: str) -> Spoil:
    def spoil(folder: Folder) -> None:
        del folder.content["frames"][2][key]
        folder.save()

    return spoil


def top(key: str, value: object) -> Spoil:
    def spoil(folder: Folder) -> None:
        folder.content[key] = value
        folder.save()

    return spoil


def moved(offset: tuple[float, float, float], times: float = 1.0) -> Spoil:
    """The object elsewhere, by so many metres."""

    def spoil(folder: Folder) -> None:
        for entry in folder.content["frames"]:
            at = entry["t"] - 1000 * np.array(entry["R"]) @ offset
            entry["t"] = (times * at).tolist()
        folder.save()

    return spoil


def text(content: str) -> Spoil:
    return lambda folder: (folder.path / "cameras.json").write_text(content) and None


def cut(i: int, part: float) -> Spoil:
    def spoil(folder: Folder) -> None:
        data = folder.image(i).read_bytes()
        folder.image(i).write_bytes(data[: int(len(data) * part)])

    return spoil


def drop_png_end(folder: Folder) -> None:
    folder.image(0).write_bytes(folder.image(0).read_bytes()[:-12])


def drop_jpeg_end(folder: Folder) -> None:
    folder.image(1).write_bytes(folder.image(1).read_bytes()[:-2])


def flip_png_byte(folder: Folder) -> None:
    data = bytearray(folder.image(0).read_bytes())
    data[len(data) // 2] ^= 0x40
    folder.image(0).write_bytes(bytes(data))


def resize(folder: Folder) -> None:
    cv2.imwrite(str(folder.image(2)), np.zeros((48, 63), np.uint8))


def resize_mask(folder: Folder) -> None:
    cv2.imwrite(str(folder.mask(2)), np.zeros((24, 36), np.uint8))


def redraw_masks(folder: Folder, change: Callable[[np.ndarray], np.ndarray]) -> None:
    for k in range(len(folder.content["frames"])):
        drawn = np.zeros((48, 64), np.uint8)
        drawn[10:30, 20:40] = 255
        cv2.imwrite(str(folder.mask(k)), change(drawn))


def float_image(folder: Folder) -> None:
    folder.content["frames"][0]["file"] = "0.tiff"
    folder.save()
    cv2.imwrite(str(folder.image(0)), np.zeros((48, 64), np.float32))


def many(folder: Folder, count: int) -> None:
    """As many frames: the third again and again under other names, from a little farther away."""
    for i in range(3, count):
        entry = folder.content["frames"][2] | {"file": f"{i}.png", "mask": f"m/{i}.png"}
        entry["t"] = [entry["t"][0], entry["t"][1], entry["t"][2] + i]
        folder.content["frames"].append(entry)
        folder.image(i).write_bytes(folder.image(2).read_bytes())
        folder.mask(i).write_bytes(folder.mask(2).read_bytes())
    folder.save()


K = [[80.0, 0, 31.5], [0, 82, 23.5], [0, 0, 1]]
NAN_K = [[math.nan, 0, 31.5], *K[1:]]
MIRRORED = [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]

CASES: dict[str, tuple[Spoil, tuple[str, ...]]] = {
    "no cameras.json": (lambda f: (f.path / "cameras.json").unlink(), ("cameras.json",)),
    "not JSON": (text('{"frames": ['), ("not JSON", "line 1")),
    "5000 digits": (text(f'{{"frames": [{"1" * 5000}]}}'), ("cannot be read as JSON",)),
    "nested without end": (text("[" * 100_000), ("cannot be read as JSON",)),
    "a name with a zero": (frame("mask", "a\0b"), ("frames[1].mask must be the name",)),
    "half a letter": (frame("file", "\ud800"), ("frames[1].file must be the name",)),
    "a list": (text("[]"), ("frames",)),
    "binary": (lambda f: (f.path / "cameras.json").write_bytes(b"\xff\xfe\x00"), ("json",)),
    "not UTF-8": (lambda f: (f.path / "cameras.json").write_bytes(b'{"\xfc": 1}'), ("UTF-8",)),
    "null": (text("null"), ("frames", "null")),
    "masks inverted": (lambda f: redraw_masks(f, np.invert), ("3 of 3 masks", "invert them")),
    "masks white": (lambda f: redraw_masks(f, np.ones_like), ("3 of 3 masks", "nearly everywhere")),
    "no frames": (top("frames", []), ("frames",)),
    "frames is an object": (top("frames", {"0": 1}), ("frames",)),
    "a frame is a number": (top("frames", [3]), ("frames[0]",)),
    "unit is text": (top("unit_in_metres", "mm"), ("unit_in_metres",)),
    "unit is zero": (top("unit_in_metres", 0), ("unit_in_metres",)),
    "unit is NaN": (top("unit_in_metres", math.nan), ("unit_in_metres",)),
    "K is 2x3": (frame("K", K[:2]), ("frames[1].K", "3x3", "2x3")),
    "K is ragged": (frame("K", [[1, 2], [3]]), ("frames[1].K", "3x3")),
    "K has NaN": (frame("K", NAN_K), ("frames[1].K", "finite")),
    "K of zeros": (frame("K", np.zeros((3, 3)).tolist()), ("frames[1]", "K")),
    "K of text": (frame("K", [["a"] * 3] * 3), ("frames[1].K",)),
    "K transposed": (frame("K", np.transpose(K).tolist()), ("frames[1]", "transposed")),
    "K is null": (frame("K", None), ("frames[1]", "'K'")),
    "R missing": (without("R"), ("frames[2]", "'R'")),
    "R mirrored": (frame("R", MIRRORED), ("frames[1]", "mirrors")),
    "R of eight": (frame("R", [1] * 8), ("frames[1].R", "3x3", "8")),
    "t infinite": (frame("t", [0, 0, math.inf]), ("frames[1].t", "finite")),
    "t too long": (frame("t", [0, 0, 1, 1]), ("frames[1].t",)),
    "500 km away": (moved((3e5, 4e5, 10)), ("4e+05 m", "1.96 pixels", "subtract an offset")),
    "map coordinates": (moved((5e5, 5.2e6, 300)), ("5.2e+06 m", "subtract an offset")),
    "another unit": (moved((0, 0, 0), 1e6), ("unit_in_metres",)),
    "t out of all measure": (moved((0, 0, 0), 1e300), ("unit_in_metres",)),
    "D of a tilted sensor": (frame("D", [0.1, *[0] * 12, 0.02]), ("frames[1].D", "tilted")),
    "D of three": (frame("D", [0.1, 0, 0]), ("frames[1].D", "4, 5, 8")),
    "D bends all": (frame("D", [1e200, 0, 0, 0]), ("1.jpg are of no lens",)),
    "unit of 400 digits": (top("unit_in_metres", 10**400), ("unit_in_metres", "finite")),
    "D has NaN": (frame("D", [math.nan] * 5), ("frames[1].D", "finite")),
    "width not whole": (frame("width", 64.5), ("frames[1].width",)),
    "file missing": (without("file"), ("frames[2]", "'file'")),
    "file is a number": (frame("file", 7), ("frames[1].file",)),
    "one stamp only": (frame("stamp", 3.0), ("frames[0]", "stamp")),
    "image gone": (lambda f: f.image(1).unlink(), ("1.jpg", "does not exist")),
    "image is a folder": (frame("file", "m"), ("is a folder",)),
    "mask gone": (lambda f: f.mask(1).unlink(), ("m/1.png", "does not exist")),
    "PNG cut": (cut(0, 0.6), ("0.png", "truncated")),
    "PNG without its end": (drop_png_end, ("0.png", "truncated")),
    "PNG with a wrong byte": (flip_png_byte, ("0.png", "damaged")),
    "JPEG cut": (cut(1, 0.7), ("1.jpg", "truncated")),
    "JPEG without its end": (drop_jpeg_end, ("1.jpg", "truncated")),
    "empty image": (cut(2, 0), ("2.png", "truncated")),
    "not an image": (lambda f: f.image(2).write_text("hello"), ("2.png",)),
    "another size": (resize, ("2.png", "63x48", "64x48")),
    "mask of another size": (resize_mask, ("m/2.png", "36x24", "64x48")),
    "pixels are floats": (float_image, ("0.tiff", "float32")),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("bag", ["new.mcap", "new"])
def test_a_bad_folder_is_one_line_and_leaves_nothing(command, folder, tmp_path, name, bag):
    spoil, words = CASES[name]
    spoil(folder)
    target = tmp_path / "results"
    code, out, err = command("import", folder.path, target / bag)
    assert code == 2
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    for word in words:
        assert word in err
    assert not target.exists() or not list(target.iterdir())


def of_one_frame(words: tuple[str, ...]) -> bool:
    return words[0].startswith(("frames[1]", "frames[2]")) or words[0][0] in "012m"


@pytest.mark.parametrize("name", [n for n, (_, words) in CASES.items() if of_one_frame(words)])
def test_one_bad_frame_of_six_is_left_out_by_name(command, folder, tmp_path, name):
    many(folder, 6)
    spoil, words = CASES[name]
    spoil(folder)
    code, out, err = command("import", folder.path, tmp_path / "a.mcap", "--json")
    assert (code, err) == (0, "")
    told = json.loads(out)
    (why,) = told["left_out"]
    for word in words:
        assert word in why
    counts = told["messages"]
    assert counts["/mask"] == 5
    assert counts["/image"] == counts["/camera_pose"] == (6 if "mask" in name else 5)
    assert ("its image is taken" in why) == ("mask" in name)
    code, out, _ = command("import", folder.path, tmp_path / "b.mcap")
    assert code == 0
    assert f"left out: {why}" in out


@pytest.mark.parametrize(("count", "lost", "code"), [(6, 3, 0), (6, 4, 2), (8, 4, 0), (9, 5, 2)])
def test_three_and_half_of_the_frames_must_be_left(command, folder, tmp_path, count, lost, code):
    many(folder, count)
    for i in range(lost):
        folder.image(i).unlink()
    assert command("import", folder.path, tmp_path / "a.mcap")[0] == code
    assert (tmp_path / "a.mcap").exists() == (code == 0)


def test_masks_that_are_lost_but_for_two_are_an_error(command, folder, tmp_path):
    many(folder, 6)
    for i in (0, 2, 3, 4):
        folder.mask(i).unlink()
    code, _, err = command("import", folder.path, tmp_path / "a.mcap")
    assert code == 2
    assert "m/0.png does not exist" in err
    assert command("import", folder.path, tmp_path / "a.mcap", "--no-masks")[0] == 0


@pytest.mark.parametrize("inverted", [1, 3])
def test_masks_of_some_frames_that_are_inverted_are_turned_back(
    command, folder, tmp_path, inverted
):
    many(folder, 6)
    redraw_masks(folder, lambda mask: mask)
    for k in range(inverted):
        cv2.imwrite(str(folder.mask(k)), ~cv2.imread(str(folder.mask(k)), cv2.IMREAD_UNCHANGED))
    code, out, err = command("import", folder.path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert f"{inverted} of 6 masks are white along the border" in out
    shares = [(view.mask > 127).mean() for view in BagViews(tmp_path / "a.mcap")]
    np.testing.assert_allclose(shares, 400 / (48 * 64))


def test_of_two_frames_of_one_stamp_the_first_is_taken(command, folder, tmp_path):
    many(folder, 6)
    for k, entry in enumerate(folder.content["frames"]):
        entry["stamp"] = 1.0 + k - (k == 4)
    folder.save()
    code, out, err = command("import", folder.path, tmp_path / "a.mcap")
    assert code == 0
    assert "frames[4].stamp is that of frames[3] as well" in out + err
    assert len(BagViews(tmp_path / "a.mcap")) == 5


def test_stamps_must_increase(command, folder, tmp_path):
    for entry, stamp in zip(folder.content["frames"], (1.0, 3.0, 3.0), strict=True):
        entry["stamp"] = stamp
    folder.save()
    code, _, err = command("import", folder.path, tmp_path / "a.mcap")
    assert code == 2
    assert "frames[2].stamp" in err


def test_bad_arguments(command, folder, tmp_path):
    nothing = tmp_path / "nothing"
    assert command("import", nothing, tmp_path / "a.mcap")[0] == 2
    code, _, err = command("import", folder.path, tmp_path / "a.mcap", "--storage", "zip")
    assert code == 2
    assert "mcap, sqlite3" in err
    code, _, err = command("import", folder.path, tmp_path / "a.mcap", "--storage", "sqlite3")
    assert code == 2
    assert "a.mcap" in err
    assert command("import", folder.path)[0] == 2
    assert command("imprt")[0] == 2
    blocked = tmp_path / "file"
    blocked.write_text("")
    code, _, err = command("import", folder.path, blocked / "a.mcap")
    assert code == 2
    assert err.count("\n") == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]


def test_a_jpeg_with_a_whole_thumbnail_but_half_an_image_is_truncated(command, folder, tmp_path):
    thumbnail = cv2.imencode(".jpg", np.zeros((16, 16), np.uint8))[1].tobytes()
    data = folder.image(1).read_bytes()
    segment = b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail
    folder.image(1).write_bytes(data[:2] + segment + data[2:])
    assert command("import", folder.path, tmp_path / "whole.mcap")[0] == 0
    folder.image(1).write_bytes(data[:2] + segment + data[2 : len(data) // 2])
    code, _, err = command("import", folder.path, tmp_path / "half.mcap")
    assert code == 2
    assert "truncated" in err


def test_without_the_extras_the_command_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, command, tmp_path: Path
):
    monkeypatch.setitem(__import__("sys").modules, "typer", None)
    code, out, err = command("demo")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert "pip install 'occ_recon_ros[cli]'" in err
