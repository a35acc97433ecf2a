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
    "body_process": pickle.dumps(("close", True, 40, ".ply")),
    "learning": pickle.dumps(([], ContourSettings())),
}


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
            time.sleep(0.05)
        assert session.read_text().endswith("nice 10\n")
        assert os.getpriority(os.PRIO_PROCESS, child.pid) == 19
        assert Path("/proc/self/autogroup").read_text() == own
    finally:
        children.end(child)
        child.stdin.close()
        child.stdout.close()
