"""Processes beside the nodes, whose parent is gone."""

import pickle

import pytest
from forked import Beside

from occ_recon_ros.imaging import ContourSettings

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
