"""What a checkpoint keeps, and what it makes of files that are not whole."""

import resource
import signal

import pytest
from rig import scan, views

from occ_recon_ros.errors import SettingsError
from occ_recon_ros.streams.checkpoint_file import CheckpointFile

MESSAGES = [bytes([k + 1]) * (10 + k) for k in range(20)]


def written(path, messages=MESSAGES, every=3):
    file = CheckpointFile(path, "mesher", every, resume=False)
    for message in messages:
        file.append(message)
    file.close()
    return path


def reopened(path, add=()):
    """The messages of a file, and what is said to be lost; some may be added."""
    file = CheckpointFile(path, "mesher", 3, resume=True)
    messages = list(file.read())
    for message in add:
        file.append(message)
    file.close()
    return messages, file.lost


def test_what_was_written_is_read_and_more_can_follow(tmp_path):
    path = written(tmp_path / "new" / "a.checkpoint")
    assert reopened(path, add=[b"more"]) == (MESSAGES, "")
    assert reopened(path) == ([*MESSAGES, b"more"], "")


@pytest.mark.parametrize("zeros", [False, True])
def test_wherever_the_file_breaks_off_the_whole_messages_stay(tmp_path, zeros):
    """A power cut may leave any part of the last write, or nothing but zeros of it."""
    path = written(tmp_path / "a.checkpoint", MESSAGES[:3])
    whole = path.read_bytes()
    ends = [len(whole) - sum(len(m) + 8 for m in MESSAGES[k:3]) for k in range(4)]
    for cut in range(ends[0], len(whole)):
        path.write_bytes(whole[:cut] + bytes(len(whole) - cut if zeros else 0))
        count = sum(end <= cut for end in ends[1:])
        messages, lost = reopened(path, add=[b"more"])
        assert messages == MESSAGES[:count]
        assert bool(lost) == (zeros or cut not in ends)
        assert reopened(path) == ([*MESSAGES[:count], b"more"], "")


def test_a_flipped_bit_ends_what_can_be_trusted(tmp_path):
    path = written(tmp_path / "a.checkpoint")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)
    messages, lost = reopened(path)
    assert messages == MESSAGES[: len(messages)]
    assert 5 < len(messages) < 15
    assert f"first {len(messages)} messages" in lost


def test_a_new_scan_starts_empty(tmp_path):
    path = tmp_path / "a.checkpoint"
    file = CheckpointFile(path, "mesher", 1, resume=False)
    file.append(b"old")
    file.clear()
    file.append(b"new")
    file.close()
    assert reopened(path)[0] == [b"new"]


def test_a_scan_that_nobody_resumes_is_kept_beside_the_new_one(tmp_path):
    path = written(tmp_path / "a.checkpoint")
    written(path, [b"new"])
    assert reopened(path)[0] == [b"new"]
    assert reopened(path.with_name("a.checkpoint.previous"))[0] == MESSAGES


def test_the_checkpoint_of_another_node_is_refused(tmp_path):
    path = written(tmp_path / "a.checkpoint")
    with pytest.raises(SettingsError, match=r"a\.checkpoint is not a checkpoint of reconstructor"):
        CheckpointFile(path, "reconstructor", 1, resume=True)
    path.write_bytes(b"ply\nformat ascii 1.0\n")
    with pytest.raises(SettingsError, match="not a checkpoint of mesher"):
        CheckpointFile(path, "mesher", 1, resume=True)


def test_a_checkpoint_in_use_is_refused(tmp_path):
    path = tmp_path / "a.checkpoint"
    file = CheckpointFile(path, "mesher", 1, resume=False)
    with pytest.raises(SettingsError, match="in use by another node"):
        CheckpointFile(path, "mesher", 1, resume=True)
    file.close()


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingsError, match=r"Not a directory|File exists"):
        CheckpointFile(tmp_path / "file" / "a.checkpoint", "mesher", 1, resume=False)


def test_a_full_disk_ends_the_checkpoint_not_the_scan(make_graph, tmp_path):
    """RLIMIT_FSIZE stands for the full disk: a write past it fails in the same way."""
    graph = make_graph({"mesher": {"checkpoint_every": 1, "checkpoint_path": str(tmp_path)}})
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
    try:
        scan(graph.ros, graph.rig, views())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    report = graph.report(graph.mesher, lambda r: r.values["rims"] == str(len(views())))
    assert "mesher.checkpoint is written no more (the disk is full)" in report.message
    assert (tmp_path / "mesher.checkpoint").stat().st_size <= 100_000


def test_what_is_cleared_is_kept_beside_the_new_one(tmp_path):
    path = tmp_path / "a.checkpoint"
    file = CheckpointFile(path, "mesher", 1, resume=False)
    for message in (b"first", b"second", b"third"):
        file.append(message)
        file.clear()
    file.clear()  # nothing came: nothing is rotated away
    file.append(b"fourth")
    file.close()
    assert reopened(path)[0] == [b"fourth"]
    assert reopened(path.with_name("a.checkpoint.previous"))[0] == [b"third"]


def test_compacting_leaves_out_what_is_not_needed_and_goes_on(tmp_path):
    path = tmp_path / "a.checkpoint"
    file = CheckpointFile(path, "mesher", 3, resume=False)
    for message in MESSAGES:
        file.append(message)
    before = path.stat().st_size
    file.compact(lambda message: message[0] % 4 == 0)
    assert path.stat().st_size < before / 3
    with pytest.raises(SettingsError, match="in use"):
        CheckpointFile(path, "mesher", 3, resume=True)
    file.append(b"more")
    file.close()
    wanted = [m for m in MESSAGES if m[0] % 4 == 0]
    assert reopened(path) == ([*wanted, b"more"], "")
    assert [p.name for p in tmp_path.iterdir()] == ["a.checkpoint"]


def test_compacting_on_a_full_disk_leaves_the_file_as_it_was(tmp_path):
    path = written(tmp_path / "a.checkpoint")
    file = CheckpointFile(path, "mesher", 3, resume=True)
    assert list(file.read()) == MESSAGES
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        with pytest.raises(OSError, match=r"full|large"):
            file.compact(lambda message: True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    file.append(b"more")
    file.close()
    assert reopened(path) == ([*MESSAGES, b"more"], "")
