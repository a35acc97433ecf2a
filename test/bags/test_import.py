"""import: what goes into the bag is what was in the folder, to other people's readers."""

import errno
import json
import sqlite3
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from PIL import ExifTags, Image
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from occ_recon_ros.bags.dataset import load_dataset
from occ_recon_ros.bags.images import bits_used, read_image
from occ_recon_ros.bags.photographs import FolderPictures
from occ_recon_ros.bags.writer import new_bag

TOPICS = {
    "/image": "sensor_msgs/msg/Image",
    "/camera_info": "sensor_msgs/msg/CameraInfo",
    "/camera_pose": "geometry_msgs/msg/PoseStamped",
    "/mask": "sensor_msgs/msg/Image",
}


def read(bag: Path) -> dict[str, list[Any]]:
    """All messages by topic, decoded by rosbags and not by ROS."""
    store = get_typestore(Stores.ROS2_JAZZY)
    out: dict[str, list[Any]] = {}
    with Reader(bag) as reader:
        for connection, time_ns, raw in reader.messages():
            assert connection.msgtype == TOPICS[connection.topic]
            message = store.deserialize_cdr(raw, connection.msgtype)
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            assert stamp == time_ns
            out.setdefault(connection.topic, []).append(message)
    return out


def pixels(message: Any) -> np.ndarray:
    kind = {"bgr8": (np.uint8, 3), "mono8": (np.uint8, 1), "mono16": (np.uint16, 1)}
    dtype, channels = kind[message.encoding]
    shape = (message.height, message.width) + ((channels,) if channels > 1 else ())
    return message.data.view(dtype).reshape(shape)


@pytest.mark.parametrize("name", ["a.mcap", "a.db3", "a_folder"])
def test_every_message_says_what_the_folder_says(command, folder, tmp_path, name):
    bag = tmp_path / name
    code, out, err = command("import", folder.path, bag)
    assert (code, err) == (0, "")
    assert "/image 3" in out
    messages = read(bag)
    assert {topic: len(all_) for topic, all_ in messages.items()} == dict.fromkeys(TOPICS, 3)
    encodings = [message.encoding for message in messages["/image"]]
    assert encodings == ["bgr8", "mono8", "mono16"]
    for i, entry in enumerate(folder.content["frames"]):
        expected = cv2.imread(str(folder.image(i)), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(pixels(messages["/image"][i]), expected)
        expected = cv2.imread(str(folder.mask(i)), cv2.IMREAD_GRAYSCALE)
        np.testing.assert_array_equal(pixels(messages["/mask"][i]), expected)
        info = messages["/camera_info"][i]
        np.testing.assert_allclose(info.k.reshape(3, 3), entry["K"])
        np.testing.assert_allclose(info.d[:4], entry["D"])
        assert (info.width, info.height, info.distortion_model) == (64, 48, "plumb_bob")
        pose = messages["/camera_pose"][i]
        assert pose.header.frame_id == "turntable"
        q, p = pose.pose.orientation, pose.pose.position
        R_object_camera = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
        np.testing.assert_allclose(R_object_camera, np.transpose(entry["R"]), atol=1e-12)
        centre = -R_object_camera @ np.array(entry["t"]) * 0.001
        np.testing.assert_allclose([p.x, p.y, p.z], centre, atol=1e-12)


def test_an_mcap_file_is_one_that_mcap_tools_read(command, folder, tmp_path):
    bag = tmp_path / "a.mcap"
    assert command("import", folder.path, bag)[0] == 0
    with bag.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert {s.name for s in summary.schemas.values()} == set(TOPICS.values())
        assert {c.message_encoding for c in summary.channels.values()} == {"cdr"}
        assert sum(1 for _ in reader.iter_messages()) == 12


def test_a_db3_file_is_a_database(command, folder, tmp_path):
    bag = tmp_path / "a.db3"
    assert command("import", folder.path, bag)[0] == 0
    with sqlite3.connect(bag) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert database.execute("SELECT count(*) FROM messages").fetchone() == (12,)
    database.close()


def test_a_folder_bag_can_be_sqlite3(command, folder, tmp_path):
    assert command("import", folder.path, tmp_path / "bag", "--storage", "sqlite3")[0] == 0
    assert sorted(p.name for p in (tmp_path / "bag").iterdir()) == ["bag.db3", "metadata.yaml"]
    assert len(read(tmp_path / "bag")["/image"]) == 3


def test_masks_can_be_left_out(command, folder, tmp_path):
    folder.mask(1).unlink()
    assert command("import", folder.path, tmp_path / "a.mcap", "--no-masks")[0] == 0
    assert set(read(tmp_path / "a.mcap")) == set(TOPICS) - {"/mask"}


def test_masks_of_zero_and_one_and_of_jpeg_mean_the_same(command, folder, tmp_path):
    mask = cv2.imread(str(folder.mask(0)), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(folder.mask(0)), mask // 255)
    folder.content["frames"][1]["mask"] = "m/1.jpg"
    cv2.imwrite(str(folder.mask(1)), mask, [cv2.IMWRITE_JPEG_QUALITY, 60])
    folder.save()
    assert command("import", folder.path, tmp_path / "a.mcap")[0] == 0
    for message in read(tmp_path / "a.mcap")["/mask"][:2]:
        np.testing.assert_array_equal(pixels(message), mask)


def test_stamps_are_kept_or_evenly_spaced(command, folder, tmp_path):
    assert command("import", folder.path, tmp_path / "made_up.mcap")[0] == 0
    seconds = [1700000000.25, 1700000000.5, 1700000002.0]
    for entry, stamp in zip(folder.content["frames"], seconds, strict=True):
        entry["stamp"] = stamp
    folder.save()
    assert command("import", folder.path, tmp_path / "given.mcap")[0] == 0

    def stamps(name: str) -> list[int]:
        poses = read(tmp_path / name)["/camera_pose"]
        return [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in poses]

    assert stamps("given.mcap") == [round(s * 1e9) for s in seconds]
    steps = np.diff(stamps("made_up.mcap"))
    assert steps[0] > 0
    assert (steps == steps[0]).all()
    assert stamps("made_up.mcap")[0] > 0


def test_an_existing_bag_is_kept_unless_told_otherwise(command, folder, tmp_path):
    for name in ("a.mcap", "bag"):
        bag = tmp_path / name
        assert command("import", folder.path, bag)[0] == 0
        code, _, err = command("import", folder.path, bag, "--no-masks")
        assert code == 2
        assert "--overwrite" in err
        assert "/mask" in read(bag)
        assert command("import", folder.path, bag, "--no-masks", "--overwrite")[0] == 0
        assert "/mask" not in read(bag)


@pytest.mark.parametrize("at", [1, 2])
def test_a_bag_that_is_overwritten_is_there_whenever_it_is_interrupted(tmp_path, monkeypatch, at):
    """Between taking the old one away and putting the new one in its place, above all."""
    path = tmp_path / "bag"
    with new_bag(path, "mcap"):
        pass
    (path / "mine").write_text("the old one")
    rename, count = Path.rename, iter(range(10))

    def interrupted(self, target):
        if next(count) + 1 == at:
            raise KeyboardInterrupt
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt), new_bag(path, "mcap", overwrite=True):
        pass
    assert (path / "mine").read_text() == "the old one"
    assert [entry.name for entry in tmp_path.iterdir()] == ["bag"]


def test_a_full_disk_is_said_and_no_fault_of_ours(command, folder, tmp_path, monkeypatch):
    def full(self, *args, **kwargs):
        raise OSError(errno.ENOSPC, "No space left on device", str(tmp_path / "x"))

    monkeypatch.setattr("occ_recon_ros.bags.writer.BagWriter.write", full)
    code, _, err = command("import", folder.path, tmp_path / "bag")
    assert code == 1
    assert err == f"error: No space left on device ({tmp_path / 'x'}): make room and try again\n"
    assert [entry.name for entry in tmp_path.iterdir()] == ["folder"]


def test_overwriting_never_takes_a_folder_that_is_no_bag(command, folder, tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "holiday.txt").write_text("keep")
    for name in ("photos", "photos.mcap"):
        (tmp_path / "photos").replace(tmp_path / name)
        code, _, _ = command("import", folder.path, tmp_path / name, "--overwrite")
        assert code == 2
        assert (tmp_path / name / "holiday.txt").read_text() == "keep"
        (tmp_path / name).replace(tmp_path / "photos")


@pytest.mark.parametrize("D", [[[0.1, -0.02, 0, 0, 0]], [[0.1], [-0.02], [0], [0], [0]]])
def test_rows_and_columns_of_opencv_are_taken_as_lists(command, folder, tmp_path, D):
    for entry in folder.content["frames"]:
        entry["t"] = [[x] for x in entry["t"]]
        entry["D"] = D
    folder.save()
    assert command("import", folder.path, tmp_path / "a.mcap")[0] == 0
    flat = load_dataset(folder.path)[0]
    for entry in folder.content["frames"]:
        entry["D"] = [*np.ravel(D), *[0] * 9]  # of the tilted model, whose other numbers are 0
    folder.save()
    read = load_dataset(folder.path)[0]
    assert [len(frame.camera.D) for frame in read] == [12] * len(read)
    for a, b in zip(flat, read, strict=True):
        np.testing.assert_array_equal(a.camera.D, b.camera.D[:5])
        np.testing.assert_array_equal(a.camera.t_camera_object, b.camera.t_camera_object)


def test_masks_that_no_frame_names_are_named(command, folder, tmp_path):
    (folder.path / "masks").mkdir()
    for k, entry in enumerate(folder.content["frames"]):
        folder.mask(k).rename(folder.path / "masks" / f"{Path(entry['file']).stem}.png")
        del entry["mask"]
    folder.save()
    code, out, _ = command("import", folder.path, tmp_path / "a.mcap")
    assert code == 0
    assert "holds masks of 3 images; they are not used, for no frame of" in out


def test_the_transparency_of_a_cut_out_object_is_its_mask(command, folder, tmp_path):
    entry = folder.content["frames"][0]
    alpha = cv2.imread(str(folder.mask(0)), 0)
    alpha[12, 20] = 100
    picture = np.dstack([cv2.imread(str(folder.image(0))), alpha])
    entry["file"] = "cut_out.png"
    del entry["mask"]
    cv2.imwrite(str(folder.image(0)), picture)
    folder.save()
    assert command("import", folder.path, tmp_path / "a.mcap")[0] == 0
    np.testing.assert_array_equal(pixels(read(tmp_path / "a.mcap")["/mask"][0]), alpha)
    assert command("import", folder.path, tmp_path / "bare.mcap", "--no-masks")[0] == 0
    assert "/mask" not in read(tmp_path / "bare.mcap")


def test_a_transparency_that_cuts_nothing_out_is_no_mask(command, folder, tmp_path):
    for k, entry in enumerate(folder.content["frames"]):
        picture = cv2.imread(str(folder.image(k)))
        alpha = np.full(picture.shape[:2], 255, np.uint8)
        alpha[0, 0] = 0
        entry["file"] = f"opaque_{k}.png"
        del entry["mask"]
        cv2.imwrite(str(folder.image(k)), np.dstack([picture, alpha]))
    folder.save()
    assert command("import", folder.path, tmp_path / "a.mcap")[0] == 0
    assert "/mask" not in read(tmp_path / "a.mcap")


@pytest.mark.parametrize(("bits", "shape"), [(10, (48, 64)), (12, (48, 64, 3)), (16, (48, 64))])
def test_images_that_fill_some_of_16_bits_are_as_bright_as_those_that_fill_all(
    tmp_path, bits, shape
):
    image = np.random.default_rng(0).integers(0, 1 << bits, shape).astype(np.uint16)
    image[0, 0] = (1 << bits) - 1
    # One that is dark stays so much darker than the others.
    files = tmp_path / "a.png", tmp_path / "b.png"
    shown = image // 20, image
    for file, levels in zip(files, shown, strict=True):
        cv2.imwrite(str(file), levels)
    assert bits_used([tmp_path / "lost.png", *files]) == bits
    for file, levels in zip(files, shown, strict=True):
        expected = levels << (16 - bits)
        if len(shape) == 3:
            expected = (expected // 257).astype(np.uint8)
        np.testing.assert_array_equal(read_image(file, bits), expected)
    cv2.imwrite(str(tmp_path / "8.png"), np.zeros((48, 64), np.uint8))
    assert bits_used([tmp_path / "8.png", *files]) == 16


def test_a_folder_of_10_bits_is_imported_as_bright_as_one_of_16(command, folder, tmp_path):
    for k, entry in enumerate(folder.content["frames"]):
        grey = cv2.imread(str(folder.image(k)), cv2.IMREAD_GRAYSCALE)
        entry["file"] = f"deep_{k}.png"
        cv2.imwrite(str(folder.image(k)), grey.astype(np.uint16) * 4)
    folder.save()
    assert command("import", folder.path, tmp_path / "a.mcap")[0] == 0
    for k, message in enumerate(read(tmp_path / "a.mcap")["/image"]):
        shown = cv2.imread(str(folder.image(k)), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(pixels(message), shown << 6)


def test_cameras_json_of_a_windows_editor_is_read(command, folder, tmp_path):
    folder.content["frames"][0]["mask"] = "m\\0.png"
    text = json.dumps(folder.content)
    (folder.path / "cameras.json").write_text(text, encoding="utf-8-sig")
    code, out, err = command("import", folder.path, tmp_path / "a.mcap")
    assert (code, err) == (0, "")
    assert "/mask 3" in out


def test_frames_of_any_order_are_sorted_by_their_stamps(command, folder, tmp_path):
    for entry, stamp in zip(folder.content["frames"], (3.0, 1.0, 2.0), strict=True):
        entry["stamp"] = stamp
    folder.save()
    assert command("import", folder.path, tmp_path / "a.mcap")[0] == 0
    encodings = [message.encoding for message in read(tmp_path / "a.mcap")["/image"]]
    assert encodings == ["mono8", "mono16", "bgr8"]


def test_rotations_of_few_digits_and_calibrations_of_any_scale_are_taken(command, folder, tmp_path):
    for entry in folder.content["frames"]:
        entry["R"] = np.round(entry["R"], 3).tolist()
        entry["K"] = (np.array(entry["K"]) * 0.5).tolist()
    folder.save()
    assert command("import", folder.path, tmp_path / "a.mcap")[0] == 0
    info = read(tmp_path / "a.mcap")["/camera_info"][1]
    np.testing.assert_allclose(info.k, np.array(folder.content["frames"][1]["K"]).ravel() * 2)


def test_photographs_tell_their_focal_length(tmp_path):
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 26
    for name, known in (
        ("told", exif),
        ("silent", Image.Exif()),
        ("garbled", b"Exif\0\0II*\0\xff"),
    ):
        (tmp_path / name).mkdir()
        Image.new("L", (400, 300)).save(tmp_path / name / "1.jpg", exif=known)
    # The diagonals: 43.27 mm of a film, 500 px of the image.
    told = FolderPictures(tmp_path / "told").focal_px()
    assert told == pytest.approx(26 / 43.2666 * 500, rel=1e-5)
    assert FolderPictures(tmp_path / "silent").focal_px() is None
    assert FolderPictures(tmp_path / "garbled").focal_px() is None
