"""--view, --json and --quiet."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from browser import visit

from occ_recon_ros.cli import app

SMALL = ["--frames", "18", "--set", "virtual_turntable.width=320"]
SMALL += ["--set", "virtual_turntable.height=240", "--set", "virtual_turntable.focal_px=400.0"]
START = [sys.executable, "-c", "from occ_recon_ros.cli import main; raise SystemExit(main())"]


def test_a_demo_is_seen_to_grow_and_stays(tmp_path, ros):
    command = [*START, "demo", *SMALL, "--view"]
    command += ["--out", str(tmp_path / "out")]
    environment = {k: v for k, v in os.environ.items() if k != "DISPLAY"}
    environment["ROS_DOMAIN_ID"] = str(ros.domain_id)
    child = subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        line = child.stdout.readline()
        url = re.fullmatch(r"watch it at (http://127\.0\.0\.1:\d+/)\n", line)[1]
        with visit(url) as page:
            panel = page.page.locator("#scan-panel")
            page.wait_for(lambda: "frames\t18" in panel.inner_text(), "all frames", 60)
            assert "360°" in panel.inner_text()
            assert not page.strangers((url, url.replace("http", "ws")))
        said = []
        while not any("until Ctrl-C" in line for line in said):
            said.append(child.stdout.readline())
        child.send_signal(signal.SIGINT)
        child.communicate(timeout=20)
        assert child.returncode == 0
    finally:
        child.kill()
        child.communicate()
    assert (tmp_path / "out" / "report.html").exists()


def run_demo(ros, out, *options):
    """The command as a program: what it prints on stdout and stderr."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(ros.domain_id)}
    command = [*START, "demo", *SMALL, "--out", str(out), *options]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0
    return done.stdout, done.stderr


def test_json_is_the_report_and_nothing_else(tmp_path, ros):
    stdout, stderr = run_demo(ros, tmp_path / "out", "--json")
    assert json.loads(stdout) == json.loads((tmp_path / "out" / "report.json").read_text())
    assert stderr == ""


def test_quiet_says_nothing(tmp_path, ros):
    assert run_demo(ros, tmp_path / "out", "--quiet") == ("", "")


@pytest.mark.parametrize("command", ["demo", "replay", "run"])
def test_help_names_the_page(command, capfd):
    assert app.run([command, "--help"]) == 0
    assert "--view" in capfd.readouterr().out
