"""A long scan through three processes: some hundred frames of benchmarks/soak.py."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

CHECKOUT = Path(__file__).resolve().parents[2]
FRAMES, EVERY = 240, 60


def test_a_long_scan_leaves_memory_and_files_as_they_were(ros, tmp_path):
    out = tmp_path / "soak.json"
    soak = [sys.executable, "benchmarks/soak.py", "--frames", str(FRAMES), "--every", str(EVERY)]
    done = subprocess.run(
        [*soak, "--out", str(out)],
        cwd=CHECKOUT,
        env=os.environ | {"ROS_DOMAIN_ID": str(ros.domain_id), "PYTHONPATH": str(CHECKOUT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    rows = json.loads(out.read_text())["rows"]
    assert [row["frames"] for row in rows] == list(range(EVERY, FRAMES + 1, EVERY))
    assert not any(row["drops"] for row in rows)
    # From the second turn on; a frame is an image of 19 kB and a cloud of 10 kB in each node.
    early, late = rows[1], rows[-1]
    frames = late["frames"] - early["frames"]
    for node in ("contour_tracker", "reconstructor", "mesher"):
        assert late[f"{node} files"] == early[f"{node} files"]
        grown = 1024 * (late[f"{node} MB"] - early[f"{node} MB"]) / frames
        kept = 40 if node == "reconstructor" else 15  # it keeps the latest frames, kB each
        assert grown < kept, node
