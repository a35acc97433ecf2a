"""import: images that a model of others lists more than once."""

import json
import re

import cv2
import numpy as np
import pytest
from colmap_nerf import N, frames_of, turn, write_images, write_transforms

from occ_recon_ros.bags.views import BagViews

FAR = 1e6  # of a model that is moved, whose cameras are 30 units away from the object
LENS = {"fl_x": 123.456789123, "k1": -0.0123456789123}


@pytest.fixture
def twice(command, tmp_path):
    """What is said where each frame is there again, changed."""

    def check(change, shift=0.0) -> str:
        frames = [entry | LENS for entry in frames_of(turn())]
        again = []
        for entry in frames:
            T = np.array(entry["transform_matrix"])
            T[0, 3] += shift
            entry["transform_matrix"] = T.tolist()
            again.append(entry | change(T))
        write_transforms(tmp_path, turn(), frames=frames + again)
        write_images(tmp_path / "images")
        code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
        assert (code, err) == (0, "")
        assert "left out" not in out
        found = BagViews(tmp_path / "a.mcap").cameras().values()
        assert [camera.K[0, 0] for camera in found] == [LENS["fl_x"]] * N
        return out

    return check


def turned(T, by):
    about_z = np.eye(4)
    about_z[:2, :2] = [[np.cos(by), -np.sin(by)], [np.sin(by), np.cos(by)]]
    return {"transform_matrix": (T @ about_z).tolist()}


def moved(T, by):
    return {"transform_matrix": (T + 30 * by * np.eye(4)[:, :1] @ np.eye(4)[3:]).tolist()}


CHANGES = {
    "rotation": turned,
    "place": moved,
    "focal length": lambda T, by: {"fl_x": LENS["fl_x"] * (1 + by)},
    "distortion": lambda T, by: {"k1": LENS["k1"] * (1 + by)},
}


@pytest.mark.parametrize("shift", [0, FAR])
@pytest.mark.parametrize("change", CHANGES)
def test_frames_that_differ_in_one_thing_are_not_the_same(twice, change, shift):
    by = 2e-4 if change != "distortion" else 3e-4
    out = twice(lambda T: CHANGES[change](T, by), shift)
    assert "12 frames list an image that an earlier frame lists, with another pose or lens" in out
    assert ": the first counts" in out


@pytest.mark.parametrize("shift", [0, FAR])
@pytest.mark.parametrize("change", CHANGES)
def test_frames_that_differ_less_are_the_same(twice, change, shift):
    assert "with the same pose and lens" in twice(lambda T: CHANGES[change](T, 5e-5), shift)


def test_another_place_is_another_one_however_far_the_origin_is(twice):
    assert "with another pose or lens" in twice(lambda T: moved(T, 2 / 3), FAR)


@pytest.mark.parametrize("rounded", [lambda x: round(x, 6), lambda x: float(f"{x:.6g}")])
def test_frames_of_fewer_digits_are_the_same(twice, rounded):
    lens = {key: rounded(x) for key, x in LENS.items()}
    out = twice(lambda T: lens | {"transform_matrix": np.vectorize(rounded)(T).tolist()})
    assert "12 frames list an image that an earlier frame lists, with the same pose and lens" in out


def test_two_frames_do_not_share_an_image(command, tmp_path):
    write_images(tmp_path / "images", 6, called=lambda k: f"IMG {k}.png")
    named = frames_of(turn(), lambda k: f"cam{1 + k // 6}/IMG {k % 6}.png")
    write_transforms(tmp_path, turn(), frames=named)
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    shown = [int(view.image[0, 0]) - 10 for view in BagViews(tmp_path / "a.mcap")]
    assert shown == list(range(6))
    assert re.search(
        r"6 frames list an image that an earlier frame lists, with another pose or lens "
        r"\(\S+/transforms.json: frames\[\d+\]: \S+/images/IMG 0.png\): the first counts",
        out,
    )


def test_an_image_that_two_files_list_with_one_pose_is_taken_once(command, tmp_path):
    write_images(tmp_path / "images")
    write_transforms(tmp_path, turn())
    content = json.loads((tmp_path / "transforms.json").read_text())
    (tmp_path / "transforms.json").unlink()
    for part, some in (("train", slice(7)), ("val", slice(7, None)), ("test", slice(7, None))):
        listed = json.dumps(content | {"frames": content["frames"][some]})
        (tmp_path / f"transforms_{part}.json").write_text(listed)
    code, out, _ = command("import", tmp_path, tmp_path / "a.mcap")
    assert code == 0
    assert "left out" not in out
    assert "/image 12" in out
    once = [line for line in out.splitlines() if line.endswith("each image is taken once")]
    assert len(once) == 1
    assert once[0].startswith("5 frames list an image that an earlier frame lists, with the same")
    assert "/transforms_test.json: frames[" in once[0]
    assert f"unit and origin of {tmp_path}/transforms_*.json are arbitrary" in out


@pytest.mark.parametrize("more", [0, 1])
def test_as_many_contrary_frames_as_images_are_none_and_more_are_refused(command, tmp_path, more):
    write_images(tmp_path / "images", 4, called=lambda k: f"IMG {k}.png")
    cameras = turn()[: 8 + more]
    named = frames_of(cameras, lambda k: f"images/IMG {k % 4}.png")
    write_transforms(tmp_path, cameras, frames=named)
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert code == 2 * more
    said = f"{4 + more} frames list an image that an earlier frame lists, with another pose or lens"
    assert said in out + err
    assert ("the first counts" in out + err) == (not more)


@pytest.mark.parametrize("moved_by", [0, 1])
def test_a_mask_that_the_later_frame_alone_names_is_taken(command, tmp_path, moved_by):
    write_images(tmp_path / "images")
    drawn = np.zeros((72, 96), np.uint8)
    drawn[20:50, 30:60] = 255
    (tmp_path / "m").mkdir()
    frames = frames_of(turn())
    later = []
    for entry in frames[3:]:
        file = f"m/{entry['file_path'].split('/')[-1]}"
        cv2.imwrite(str(tmp_path / file), drawn)
        T = moved(np.array(entry["transform_matrix"]), moved_by)
        later.append(entry | T | {"mask_path": file})
    write_transforms(tmp_path, turn(), frames=frames + later)
    code, out, _ = command("import", tmp_path, tmp_path / "a.mcap")
    assert code == 0
    assert "/image 12" in out
    assert "/mask 9" in out
    assert "/mask" not in command("import", tmp_path, tmp_path / "b.mcap", "--no-masks")[1]


def test_copies_of_one_set_as_train_and_test_are_one(command, tmp_path):
    write_images(tmp_path / "train")
    write_images(tmp_path / "test")
    for part in ("train", "test"):
        frames = frames_of(turn(), f"{part}/view {{}}.png".format)
        write_transforms(tmp_path, turn(), frames=frames)
        (tmp_path / "transforms.json").rename(tmp_path / f"transforms_{part}.json")
    code, out, err = command("import", tmp_path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert "/image 12" in out
    assert "12 frames show a photograph that an earlier one shows, in the same pose" in out
