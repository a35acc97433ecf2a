"""Reading bags: whole ones by the index, broken ones as far as they are whole."""

import shutil
from pathlib import Path

import pytest

from msg_adapters.serialised import header_stamp_ns
from occ_recon_ros.bags.reader import Bag, open_bag
from occ_recon_ros.errors import UserError

FRAME = 4  # messages: camera_info, camera_pose, mask, image


@pytest.fixture
def bag(command, folder, tmp_path):
    """Makes a bag of a given name of the small folder."""

    def make(name: str, *options: str) -> Path:
        assert command("import", folder.path, tmp_path / name, *options)[0] == 0
        return tmp_path / name

    return make


def cut(path: Path, size: int) -> None:
    path.write_bytes(path.read_bytes()[:size])


def read(bag: Bag) -> list[tuple[str, int]]:
    return [(m.topic, header_stamp_ns(m.cdr)) for m in bag.messages(list(bag.types))]


@pytest.mark.parametrize("name", ["a.mcap", "a.db3", "a"])
def test_a_whole_bag(bag, name):
    found = open_bag(bag(name))
    assert found.lost == ""
    assert dict(found.counts) == dict.fromkeys(
        ("/image", "/camera_info", "/camera_pose", "/mask"), 3
    )
    assert len(read(found)) == 3 * FRAME
    assert read(found) == read(found)
    assert {t for t, _ in ((m.topic, 0) for m in found.messages(["/mask"]))} == {"/mask"}
    assert list(found.messages([])) == []


@pytest.mark.parametrize("name", ["a.mcap", "a.db3"])
def test_every_cut_of_a_file_gives_a_beginning_of_it_or_an_error(bag, name):
    path = bag(name)
    whole = read(open_bag(path))
    data = path.read_bytes()
    lengths = set()
    for part in range(0, 100, 3):
        path.write_bytes(data[: len(data) * part // 100])
        found = opened(path)
        messages = [] if found is None else read(found)
        lengths.add(len(messages))
        assert messages == whole[: len(messages)]
        if found is not None and len(messages) < len(whole):
            assert f"after {len(messages)} messages" in found.lost
    assert 0 in lengths
    if name == "a.db3":  # a small mcap file is one chunk: all of it or nothing
        assert len(lengths) > 2


def opened(path: Path) -> Bag | None:
    """The bag, or None if it is refused for holding nothing."""
    try:
        return open_bag(path)
    except UserError:
        return None


def test_chunks_before_the_cut_are_recovered(command, shared_data, tmp_path):
    path = tmp_path / "dino.mcap"
    assert command("import", shared_data / "oxford_dino", path)[0] == 0
    cut(path, path.stat().st_size // 2)
    found = open_bag(path)
    assert found.counts["/image"] == 18
    assert "breaks off after 72 messages" in found.lost
    assert len(read(found)) == 72


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_folder_without_metadata_is_read_by_its_files(bag, storage):
    path = bag("a", "--storage", storage)
    (path / "metadata.yaml").unlink()
    assert len(read(open_bag(path))) == 3 * FRAME


def test_metadata_tell_how_much_is_lost(bag):
    path = bag("a", "--storage", "sqlite3")
    cut(path / "a.db3", (path / "a.db3").stat().st_size * 85 // 100)
    found = open_bag(path)
    count = len(read(found))
    assert 0 < count < 12
    assert found.lost.startswith(f"{12 - count} of 12 messages are lost")


def test_a_split_bag_with_a_damaged_last_file(bag, tmp_path):
    path = tmp_path / "split"
    path.mkdir()
    for i in range(11):  # ten comes after nine, not after one
        shutil.copy(bag(f"part{i}.mcap"), path / f"split_{i}.mcap")
    data = bytearray((path / "split_10.mcap").read_bytes())
    (path / "split_10.mcap").write_bytes(data[: len(data) // 2])
    found = open_bag(path)
    assert found.counts["/image"] == 30
    assert "split_10.mcap breaks off" in found.lost


def test_what_is_no_bag(tmp_path):
    (tmp_path / "text.txt").write_text("hello")
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "text.db3").write_text("hello")
    (tmp_path / "folder").mkdir()
    for name in ("text.txt", "empty.mcap", "text.db3", "folder", "nothing", "nothing.mcap"):
        with pytest.raises(UserError) as error:
            open_bag(tmp_path / name)
        assert name in str(error.value)
        assert "\n" not in str(error.value)
