"""Processes beside the nodes, whose parent is gone."""

import os
import pickle
import time
from pathlib import Path

import pytest
from forked import Beside

from occ_recon_ros.imaging import ContourSettings
from occ_recon_ros.streams import child as children

WORK = {
    "body_process": pickle.dumps(("close", True, 40, Path("closed.ply"))),
    "learning": pickle.dumps(([], ContourSettings())),
}


@pytest.mark.slow
@pytest.mark.parametrize("heard", [1.0, 0.5, 0.0], ids=["all", "half", "nothing"])
@pytest.mark.parametrize("name", WORK)
def test_a_child_whose_parent_was_killed_ends_without_a_word(name, heard, capfd):
    child = Beside(f"occ_recon_ros.streams.{name}")
    child.stdout.close()
    child.stdin.write(WORK[name][: int(heard * len(WORK[name]))])
    child.stdin.close()
    child.wait()
    assert not capfd.readouterr().err


@pytest.mark.skipif(not Path("/proc/self/autogroup").exists(), reason="no shares by session")
def test_a_child_in_a_session_of_its_own_leaves_the_processor_to_the_nodes():
    child = children.begin("occ_recon_ros.streams.body_process")
    try:
        session, until = Path(f"/proc/{child.pid}/autogroup"), time.monotonic() + 60
        own = Path("/proc/self/autogroup").read_text()
        while session.read_text().endswith("nice 0\n") and time.monotonic() < until:
            time.sleep(0.05)  # nothing to wait on: /proc tells of no change
        assert session.read_text().endswith("nice 10\n")
        assert os.getpriority(os.PRIO_PROCESS, child.pid) == 19
        assert Path("/proc/self/autogroup").read_text() == own
    finally:
        children.end(child)
        child.stdin.close()
        child.stdout.close()


class Session:
    """Stands for /proc/self/autogroup of a user who is not root: of all sessions of a machine, one
    may be made nice in a tenth of a second."""

    def __init__(self, *answers):
        self.answers, self.asked = list(answers), []

    def write_text(self, text):
        self.asked.append(text)
        if answer := self.answers.pop(0):
            raise answer


@pytest.mark.parametrize(
    ("answers", "times"),
    [
        ((None,), 1),
        ((BlockingIOError(), BlockingIOError(), None), 3),
        ((FileNotFoundError(),), 1),
        ((PermissionError(),), 1),
    ],
)
def test_where_another_session_was_just_made_nice_a_child_tries_again(monkeypatch, answers, times):
    session, niced, paused = Session(*answers), [], []
    monkeypatch.setattr(children, "_SESSION", session)
    monkeypatch.setattr(children.os, "nice", niced.append)
    monkeypatch.setattr(children.os, "getsid", lambda pid: os.getpid())
    monkeypatch.setattr(children.time, "sleep", paused.append)
    children.let_others_go_first()
    assert niced == [19]
    assert session.asked == ["10"] * times
    assert len(paused) == times - 1
    assert all(pause > 0.1 for pause in paused)


def test_a_session_that_is_shared_stays_as_it_is(monkeypatch):
    session = Session()
    monkeypatch.setattr(children, "_SESSION", session)
    monkeypatch.setattr(children.os, "nice", lambda by: 0)
    monkeypatch.setattr(children.os, "getsid", lambda pid: os.getpid() + 1)
    children.let_others_go_first()
    assert session.asked == []
