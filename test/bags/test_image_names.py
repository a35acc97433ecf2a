"""The names of the files that images came from travel with a bag, and words on views say them."""

import json
import shutil

import pytest
from recordings import read_all, write_all

from occ_recon_ros.bags.reader import open_bag
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.bags.writer import new_bag
from occ_recon_ros.report.words import view_words

NAMES = ["0.png", "1.jpg", "2.png"]


def names_of(bag):
    return [image["name"] for image in BagViews(bag).images()]


@pytest.fixture(params=["a.mcap", "a.db3", "a"])
def named(request, command, folder, tmp_path):
    """A bag of the small folder, as one file or a folder."""
    code, out, _ = command("import", folder.path, tmp_path / request.param, "--json")
    assert code == 0
    assert [image["name"] for image in json.loads(out)["images"]] == NAMES
    return tmp_path / request.param


def test_names_are_read_by_stamp_and_in_the_order_of_the_views(named):
    names, views = open_bag(named).names, BagViews(named)
    assert [names[view.stamp_ns] for view in views] == names_of(named) == NAMES
    assert [image["stamp_ns"] for image in views.images()] == [view.stamp_ns for view in views]


@pytest.mark.parametrize("name", ["b.mcap", "b.db3", "b"])
def test_they_go_on_to_a_bag_that_is_written_of_it(named, tmp_path, name):
    BagViews(named).write(tmp_path / name)
    assert names_of(tmp_path / name) == NAMES


def test_a_view_of_which_something_is_missing_has_no_number_and_the_others_their_names(
    command, folder, tmp_path
):
    assert command("import", folder.path, tmp_path / "a")[0] == 0
    messages = read_all(tmp_path / "a")
    pose = next(m for m in messages if m.topic == "/camera_pose")
    with new_bag(tmp_path / "b", "mcap") as writer:
        for m in messages:
            if m is not pose:
                writer.write(m.topic, m.msgtype, m.time_ns, m.cdr)
        writer.name_images(open_bag(tmp_path / "a").names)
    assert names_of(tmp_path / "b") == NAMES[1:]


def test_bags_without_names_have_none(command, folder, tmp_path):
    assert command("import", folder.path, tmp_path / "a.mcap")[0] == 0
    other = write_all(tmp_path / "b", read_all(tmp_path / "a.mcap"))
    assert open_bag(other).names == {}
    assert names_of(other) == []
    (damaged := tmp_path / "c.mcap").write_bytes((tmp_path / "a.mcap").read_bytes()[:-300])
    assert open_bag(damaged).names == {}


def test_images_of_one_name_in_two_folders_are_told_apart(command, folder, tmp_path):
    for k, frame in enumerate(folder.content["frames"]):
        (folder.path / f"cam{k}").mkdir()
        shutil.copy(folder.path / frame["file"], folder.path / f"cam{k}" / "1.png")
        frame["file"] = f"cam{k}/1.png"
    folder.save()
    assert command("import", folder.path, tmp_path / "a.mcap")[0] == 0
    assert names_of(tmp_path / "a.mcap") == ["cam0/1.png", "cam1/1.png", "cam2/1.png"]


def test_words_on_a_view_say_the_name_of_its_image():
    source = {"images": [{"stamp_ns": k, "name": name} for k, name in enumerate(NAMES)]}
    assert view_words(1, source) == "view 1 (1.jpg)"
    assert view_words(3, source) == view_words(3, {}) == "view 3"
