"""batch: many recorded scans on the workers of a Dask cluster."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from threading import Thread

import pytest
from fixtures import PLAIN

from occ_recon_ros.cli.batch import Row, exit_code

# As in a terminal: what tests are run by may have left the signal out.
START = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from occ_recon_ros.cli import main; raise SystemExit(main())"
)


def table(out: Path) -> dict:
    return {row["name"]: row for row in json.loads((out / "batch.json").read_text())}


def replaying() -> dict[int, int]:
    """{process: its parent} of all replays of this user that run now."""
    found = {}
    for entry in Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
            status = (entry / "status").read_text()
        except OSError:
            continue
        if b"replay" in words and b"--quiet" in words:
            found[int(entry.name)] = int(re.search(r"PPid:\s+(\d+)", status)[1])
    return found


@pytest.mark.slow
def test_a_broken_bag_and_a_killed_worker_cost_no_other_scan(command, bag, expected, tmp_path):
    bags = [tmp_path / f"{name}.mcap" for name in ("first", "second")]
    for path in bags:
        shutil.copy(bag, path)
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(b"no bag at all")
    out = tmp_path / "results"
    options = [f"--option={option}" for option in PLAIN]
    killed = []

    def kill_a_worker():
        late = time.monotonic() + 300
        while not killed and time.monotonic() < late:
            for replay, worker in replaying().items():
                if str(out) in cmdline(replay) and not killed:
                    os.kill(worker, signal.SIGKILL)
                    killed.append(worker)
            time.sleep(0.1)  # nothing to wait on: it is a process of another program

    killer = Thread(target=kill_a_worker)
    killer.start()
    code, said, err = command("batch", *bags, broken, "--out", out, "--workers", "2", *options)
    killer.join()
    assert len(killed) == 1
    assert code == 2, err
    rows = table(out)
    assert set(rows) == {"first", "second", "broken"}
    for name in ("first", "second"):
        assert rows[name]["verdict"]
        assert (out / name / "rims.ply").read_bytes() == expected
    assert rows["broken"]["code"] == 2
    assert "broken.mcap" in rows["broken"]["reason"]
    assert "broken.mcap" in next(line for line in said.splitlines() if "broken" in line)
    with (out / "batch.csv").open() as file:
        assert [row["name"] for row in csv.DictReader(file)] == sorted(rows)

    # Again: only what has no results, or is another bag now, is done.
    first, states = out / "first" / "report.json", {n: row["state"] for n, row in rows.items()}
    before = first.stat().st_mtime_ns
    broken.write_bytes(b"again no bag")
    bags[1].write_bytes(b"no bag any more")
    code, _, _ = command("batch", *bags, broken, "--out", out, "--workers", "1", *options)
    assert code == 2
    assert first.stat().st_mtime_ns == before
    rows = table(out)
    assert {name: row["code"] for name, row in rows.items()} == {
        "first": 0,
        "second": 2,
        "broken": 2,
    }
    assert [name for name, state in states.items() if rows[name]["state"] == state] == ["first"]

    # Results stay where a replay with other options never ran.
    wrong = [*options, "--option=--rate=backwards"]
    code, said, _ = command("batch", bags[0], "--out", out, "--workers", "1", *wrong)
    assert code == 2
    assert "--rate backwards" in said
    assert table(out) == rows
    assert first.stat().st_mtime_ns == before


def cmdline(process: int) -> str:
    try:
        return Path(f"/proc/{process}/cmdline").read_text()
    except OSError:
        return ""


def test_no_such_cluster_is_said_in_a_line(command, bag, tmp_path, monkeypatch):
    monkeypatch.setattr("occ_recon_ros.cli.batch._CONNECT_S", "1s")
    code, out, err = command("batch", bag, "--out", tmp_path / "out", "--dask", "tcp://127.0.0.1:9")
    assert (code, out) == (2, "")
    assert re.fullmatch(r"error: no Dask cluster at tcp://127\.0\.0\.1:9: .*\n", err)


def test_a_table_of_something_else_is_not_written_over(command, bag, tmp_path):
    (tmp_path / "batch.json").write_text('{"mine": 1}')
    code, _, err = command("batch", bag, "--out", tmp_path)
    assert code == 2
    assert "batch.json" in err
    assert json.loads((tmp_path / "batch.json").read_text()) == {"mine": 1}


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("--out=zz", "batch sets that itself"),
        ("--overwrite", "batch sets that itself"),
        ("--bogus", "--bogus"),
        ("--set=mesher.colour=1", "mesher has no parameter"),
        ("another.mcap", "another.mcap"),
    ],
)
def test_options_that_no_replay_can_have_are_refused_at_once(command, bag, tmp_path, option, said):
    code, out, err = command("batch", bag, "--out", tmp_path / "out", f"--option={option}")
    assert (code, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_ctrl_c_ends_in_one_line(bag, tmp_path):
    """Pressed in a terminal, it reaches the workers as well."""
    out = tmp_path / "out"
    words = ["batch", str(bag), "--out", str(out), "--workers", "1"]
    program = subprocess.Popen(
        [sys.executable, "-c", START, *words],
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
    )
    late = time.monotonic() + 120
    while not any(str(out) in cmdline(replay) for replay in replaying()):
        assert time.monotonic() < late
        assert program.poll() is None
        time.sleep(0.05)  # nothing to wait on: it is a process of another program
    os.killpg(program.pid, signal.SIGINT)
    assert program.communicate(timeout=60)[1] == "error: interrupted\n"
    assert program.returncode == 1
    assert not any(str(out) in cmdline(replay) for replay in replaying())


@pytest.mark.parametrize(
    ("codes", "expected"),
    [((0, 0), 0), ((0, 2, 2), 2), ((2, 3), 2), ((0, 3), 3), ((0, 2, 1), 1), ((-9, 3), 1)],
)
def test_the_exit_code_is_that_of_one_replay(codes, expected):
    verdicts = {0: "good", 3: "failed"}
    rows = [Row("a", "b", [], "", code=code, verdict=verdicts.get(code, "")) for code in codes]
    assert exit_code(rows) == expected
