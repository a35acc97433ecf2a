"""A long scan through three processes: some hundred frames of benchmarks/soak.py."""

import json
import sys

import pytest
import soak

FRAMES, EVERY = 240, 60


@pytest.mark.slow
def test_a_long_scan_leaves_memory_and_files_as_they_were(ros, tmp_path, monkeypatch):
    def start(name, parameters=None):
        given = [f"{key}:={str(value).lower()}" for key, value in (parameters or {}).items()]
        settings = [word for pair in given for word in ("-p", pair)]
        return ros.process(name, "--log-level", "error", *settings)

    monkeypatch.setattr(soak, "start", start)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(ros.domain_id))
    out = tmp_path / "soak.json"
    words = ["soak.py", "--frames", str(FRAMES), "--every", str(EVERY), "--out", str(out)]
    monkeypatch.setattr(sys, "argv", words)
    soak.main()
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
