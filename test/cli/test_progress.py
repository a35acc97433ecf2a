"""The bars of a long command: one for each part that takes place, in their order."""

import time

import pytest
from rich.progress import Progress

from occ_recon_ros.bags.views import doing
from occ_recon_ros.cli.live import StatusLine
from occ_recon_ros.cli.progress import Lines, ProgressBar, progress_bar


def bars():
    shown = Progress(disable=True)
    return shown, ProgressBar(shown, "replaying")


def described(shown):
    return [(task.description, task.completed, task.total) for task in shown.tasks]


def test_parts_that_do_not_take_place_leave_no_bar():
    shown, progress = bars()
    progress.part("segmentation")
    refining = progress.part("refinement")
    playing = progress.part("replaying")
    refining(1, 2)
    playing(3, 36)
    assert described(shown) == [("refinement", 2, 2), ("replaying", 3, 36)]


def test_a_part_without_counts_is_full_when_the_next_begins():
    shown, progress = bars()
    progress(36, 36)
    progress.stage("finishing the turn")
    progress.stage("closing the surface")
    progress(5, 100)
    assert described(shown) == [
        ("replaying", 36, 36),
        ("finishing the turn", 1, 1),
        ("closing the surface", 5, 100),
    ]


def test_the_first_part_may_be_named_anew():
    shown, progress = bars()
    progress.stage("reconstructing")
    assert described(shown) == [("reconstructing", 0, None)]


def test_what_is_done_in_a_part_is_named_and_begins_to_count_anew():
    shown, progress = bars()
    looking = progress.part("second look")
    looking(69, 69)
    doing(looking, "all views together, attempt 1, trial 1")
    assert described(shown) == [
        ("second look: all views together, attempt 1, trial 1", 0, None),
    ]
    doing(looking, "masks")
    looking(3, 69)
    assert described(shown) == [("second look: masks", 3, 69)]
    progress.stage("replaying")
    doing(progress, "the turn")
    assert [task[0] for task in described(shown)] == ["second look: masks", "replaying: the turn"]
    doing(lambda done, total: None, "what a plain function is not told")


class Node:
    def __init__(self, **figures):
        self._figures = figures

    def figures(self):
        return self._figures


def test_a_live_scan_is_one_line_that_is_written_over(capsys):
    counts = {"samples good": 75, "samples outside": 20, "samples double": 5}
    rims = Node(frames=12, **{"angle covered deg": 120}, **counts)
    line = StatusLine({"reconstructor": rims, "mesher": Node(triangles=900)})
    line.show()
    line.show()
    said = "12 frames, 120 deg covered, 75 % of the samples good, 900 triangles"
    assert capsys.readouterr().err == f"{said}\033[K\r"


def test_without_a_terminal_each_part_of_long_work_is_a_line_and_then_some():
    shown, progress = bars()
    lines = Lines(begun_s=100.0)

    def due(now_s):
        return lines.due(now_s, shown.tasks[-1])

    progress(2, 36)
    assert due(109) == ""
    assert due(111) == "replaying, 2 of 36, after 11 s"
    progress(3, 36)
    assert due(140) == ""
    assert due(142) == "replaying, 3 of 36, after 42 s"
    progress.stage("closing the surface")
    assert due(142.5) == "closing the surface, after 42 s"
    assert due(172) == ""
    assert due(173) == "closing the surface, after 73 s"


@pytest.mark.parametrize(("quiet", "said"), [(False, "importing, 1 of 3, after"), (True, "")])
def test_they_go_to_stderr_unless_nobody_wants_them(monkeypatch, capsys, quiet, said):
    monkeypatch.setattr("occ_recon_ros.cli.progress.FIRST_S", 0.0)
    monkeypatch.setattr("occ_recon_ros.cli.progress._LOOKS_S", 0.01)
    with progress_bar("importing", quiet) as progress:
        progress(1, 3)
        time.sleep(0.2)
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", bool(said))
    assert err.startswith(said)
