"""--view, --json and --quiet."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fixtures import COARSE

sys.path.insert(0, str(Path(__file__).parents[1]))
from browser import visit

from occ_recon_ros.cli import app
from occ_recon_ros.cli.arguments import parse_settings
from occ_recon_ros.cli.watching import viewer_parameters

SMALL = ["--frames", "12", COARSE, "--set", "virtual_turntable.width=160"]
SMALL += ["--set", "virtual_turntable.height=120", "--set", "virtual_turntable.focal_px=200.0"]
START = [sys.executable, "-c", "from occ_recon_ros.cli import main; raise SystemExit(main())"]


@pytest.mark.slow
def test_a_demo_is_seen_to_grow_and_stays(tmp_path, ros):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [*START, "demo", *SMALL, "--view", "--set", f"viewer.port={port}"]
    command += ["--out", str(tmp_path / "out")]
    environment = {k: v for k, v in os.environ.items() if k != "DISPLAY"}
    environment["ROS_DOMAIN_ID"] = str(ros.domain_id)
    child = subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        line = child.stdout.readline()
        url = f"http://127.0.0.1:{port}/"
        assert line == f"watch it at {url}\n"
        with visit(url, size=(600, 400), scale=0.5) as page:
            panel = page.page.locator("#scan-panel")
            page.wait_for(lambda: "frames\t12" in panel.inner_text(), "all frames")
            assert "360°" in panel.inner_text()
            assert not page.strangers((url, url.replace("http", "ws")))
        said = []
        while not any("until Ctrl-C" in line for line in said):
            said.append(child.stdout.readline())
        child.send_signal(signal.SIGINT)
        child.communicate(timeout=120)
        assert child.returncode == 0
    finally:
        child.kill()
        child.communicate()
    assert (tmp_path / "out" / "report.html").exists()


@pytest.mark.slow
def test_the_page_ends_with_a_command_that_is_killed(tmp_path, ros, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    arguments = [*SMALL, "--view", "--set", "viewer.port=0", "--out", tmp_path / "out"]
    child = ros.command("demo", *arguments, one_pipe=True)
    port = int(re.search(r":(\d+)/", child.stdout.readline())[1])
    child.kill()
    child.communicate()
    gone = time.monotonic() + 60
    while time.monotonic() < gone:
        with socket.socket() as page:
            if page.connect_ex(("127.0.0.1", port)):
                return
        time.sleep(0.2)
    raise AssertionError("the page is still there")


@pytest.mark.slow
def test_quiet_says_nothing(replay, bag, tmp_path):
    assert replay(bag, tmp_path / "out", "--quiet") == (0, "", "")


@pytest.mark.parametrize("command", ["demo", "replay", "run"])
def test_help_names_the_page(command, capfd):
    assert app.run([command, "--help"]) == 0
    assert "--view" in capfd.readouterr().out


def test_other_commands_speak_json_or_not_at_all(command, folder, tmp_path):
    code, said, _ = command("import", folder.path, tmp_path / "a.mcap", "--json")
    assert code == 0
    assert json.loads(said)["messages"]["/image"] == 3
    code, *said = command("import", folder.path, tmp_path / "b.mcap", "--quiet")
    assert code == 0
    assert said == ["", ""]


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["import", "nowhere", "a.mcap"], 2, "nowhere does not exist"),
        (["replay", "nowhere", "--out", "out"], 2, "nowhere"),
        (["import", "nowhere"], 2, "Missing argument"),
    ],
)
def test_an_error_too_is_json_where_that_is_asked_for(command, arguments, code, words):
    told, out, err = command(*arguments, "--json")
    error = json.loads(out)["error"]
    assert (told, err) == (code, f"error: {error}\n")
    assert words in error
    assert command(*arguments) == (code, "", err)


def test_settings_of_the_viewer_reach_it_with_their_types():
    values = parse_settings(["viewer.token=1234", "viewer.port=90", "mesher.mesh_rate=2"])
    assert viewer_parameters(values) == ["-p", 'token:="1234"', "-p", "port:=90"]
