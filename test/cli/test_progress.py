"""The bars of a long command: one for each part that takes place, in their order."""

from rich.progress import Progress

from occ_recon_ros.cli.live import StatusLine
from occ_recon_ros.cli.progress import ProgressBar


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
