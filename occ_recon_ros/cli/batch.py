"""Many recorded scans, each replayed by a program of its own on the workers of a Dask cluster."""

from __future__ import annotations

import csv
import ctypes
import json
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Annotated, Any

import typer

from occ_recon_ros.bags.places import make_folder
from occ_recon_ros.errors import UserError

from .options import FAILED, Remap, Settings

_START = "from occ_recon_ros.cli import main; raise SystemExit(main())"
_PARENT_DEATH = 1  # PR_SET_PDEATHSIG of prctl(2)
_TABLE = "batch.json"
_REFUSED = 2  # exit code of a replay whose arguments or input are bad
_OWN_OPTIONS = ("--out", "--overwrite", "--quiet", "--json", "--view", "--help")
_CONNECT_S = "30s"
_libc = ctypes.CDLL(None)


@dataclass(frozen=True)
class Job:
    """One scan to be replayed.

    Attributes:
        name: folder of the results, within that of all.
        bag: absolute path.
        options: further arguments of ``occ-recon replay``.
        state: size and time of change of the bag's files, to tell whether it is the same still.
    """

    name: str
    bag: str
    options: list[str]
    state: str


@dataclass(frozen=True)
class Row(Job):
    """What became of a job: a line of the table.

    Attributes:
        code: exit code of the replay.
        verdict: good, doubtful or failed; empty where there are no results.
        reason: why it is not good, or why there are no results.
        images, rims, triangles: numbers of them.
        good_percent: samples with a good rim point.
        genus: of the closed body, None without one.
        seconds: that the replay took.
    """

    code: int = 1
    verdict: str = ""
    reason: str = ""
    images: int = 0
    rims: int = 0
    triangles: int = 0
    good_percent: float = 0.0
    genus: int | None = None
    seconds: float = 0.0


@dataclass
class Batch:
    """The table of all scans, kept on disk as it grows.

    Attributes:
        folder: of all results.
        rows: by name.
    """

    folder: Path
    rows: dict[str, Row] = field(default_factory=dict)

    @staticmethod
    def of(folder: Path) -> Batch:
        """That of a folder, with what an earlier one has left there.

        Raises:
            UserError: there is a table that cannot be read.
        """
        path = folder / _TABLE
        if not path.exists():
            return Batch(folder)
        try:
            rows = json.loads(path.read_text(encoding="utf-8"))
            return Batch(folder, {row["name"]: Row(**row) for row in rows})
        except (OSError, ValueError, TypeError, KeyError):
            raise UserError(f"{path} is no table of a batch: choose another --out") from None

    def done(self, job: Job) -> bool:
        """Whether a job's results are there, of the very same bag and options."""
        row = self.rows.get(job.name)
        return row is not None and row.options == job.options and self.has_results(job)

    def has_results(self, job: Job) -> bool:
        """Whether results of the very same bag are there, with whatever options."""
        row = self.rows.get(job.name)
        if row is None or (row.bag, row.state) != (job.bag, job.state):
            return False
        return bool(row.verdict) and (self.folder / job.name / "report.json").exists()

    def add(self, row: Row) -> None:
        """Take in a row, and write the table as JSON and CSV."""
        from occ_recon_ros.surface import write_whole

        self.rows[row.name] = row
        rows = [asdict(self.rows[name]) for name in sorted(self.rows)]
        text = json.dumps(rows, indent=1) + "\n"
        write_whole(self.folder / _TABLE, text.encode(), overwrite=True)
        with (self.folder / "batch.csv").open("w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, list(rows[0]))
            table.writeheader()
            table.writerows(rows)


def batch(
    bags: Sequence[Path],
    out: Path,
    options: Sequence[str],
    workers: int | None,
    cluster: str | None,
    progress: Callable[[int, int], None],
) -> list[Row]:
    """Replay many bags, each into a folder of its own.

    A scan that fails stops no other, and takes no results away that an earlier call with other
    options has left of the same bag; one whose worker is killed is done again by another; one
    whose results are there from an earlier call, of the same bag and options, is not done again.

    Args:
        bags, out, workers, cluster: as of the command; ``out`` is made if it is not there.
        options: further arguments of ``occ-recon replay``.
        progress: told how many scans are done of how many.

    Returns:
        A row for each bag, in the order of the names.

    Raises:
        UserError: nothing to do, options that no replay has or that are set here, or no such
            cluster.
    """
    from distributed import Client, LocalCluster, as_completed

    if not bags:
        raise UserError("no bag is given")
    _refuse_options(options)
    make_folder(out)
    table, jobs = Batch.of(out.absolute()), _jobs(bags, list(options))
    todo = [job for job in jobs if not table.done(job)]
    rows = {job.name: table.rows[job.name] for job in jobs if job not in todo}
    if todo:
        try:
            if cluster is None:
                most = min(workers or os.cpu_count() or 1, len(todo))
                local: dict[str, Any] = {"n_workers": most, "threads_per_worker": 1}
                local |= {"host": "127.0.0.1", "dashboard_address": None}
                with _interrupts_kept_from_workers():
                    client = Client(LocalCluster(**local, silence_logs=logging.CRITICAL))
            else:
                client = Client(cluster, timeout=_CONNECT_S)
        except (OSError, ValueError) as error:
            raise UserError(f"no Dask cluster at {cluster}: {error}") from None
        with client:
            folders = [table.folder / job.name for job in todo]
            running = [
                client.submit(replay_one, job, out, key=str(out), pure=False)
                for job, out in zip(todo, folders, strict=True)
            ]
            for count, future in enumerate(as_completed(running)):
                row = _row_of(future, todo[running.index(future)])
                rows[row.name] = row
                if not (row.code == _REFUSED and table.has_results(row)):
                    table.add(row)
                progress(len(jobs) - len(todo) + count + 1, len(jobs))
            if cluster is None:
                client.cluster.close()
    return [rows[name] for name in sorted(rows)]


def replay_one(job: Job, out: Path) -> Row:
    """Replay one bag in a program of its own, which ends when this worker does."""
    started = time.monotonic()
    command = [sys.executable, "-c", _START, "replay", job.bag, "--out", str(out), "--quiet"]
    command += ["--overwrite", *job.options]
    # Each replay keeps to a ROS domain of its own.
    environment = {k: v for k, v in os.environ.items() if k != "ROS_DOMAIN_ID"}
    # One whose worker is gone would write into the folder of the one that does it again.
    end_with_parent = partial(_libc.prctl, _PARENT_DEATH, signal.SIGKILL)
    child = subprocess.run(
        command,
        env=environment,
        capture_output=True,
        text=True,
        preexec_fn=end_with_parent,
        stdin=subprocess.DEVNULL,
    )
    said = [line for line in child.stderr.splitlines() if line.startswith("error: ")]
    seconds = round(time.monotonic() - started, 2)
    row = Row(**asdict(job), code=child.returncode, seconds=seconds)
    if child.returncode not in (0, FAILED):
        reason = said[-1].removeprefix("error: ") if said else _last_line(child)
        return replace(row, reason=reason)
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    return replace(
        row,
        verdict=report["verdict"]["word"],
        reason="; ".join(report["verdict"]["reasons"]),
        images=report["frames"]["images"],
        rims=report["frames"]["rims"],
        triangles=report["mesh"]["triangles"],
        good_percent=round(100 * report["samples"]["fraction_good"], 2),
        genus=report["closed"].get("genus"),
    )


def exit_code(rows: Sequence[Row]) -> int:
    """1 where a scan came to no results, 2 where for bad input alone, 3 where one is judged
    failed, else 0."""
    without = {row.code for row in rows if not row.verdict}
    if without:
        return _REFUSED if without == {_REFUSED} else 1
    return FAILED if any(row.verdict == "failed" for row in rows) else 0


def lines(rows: Sequence[Row]) -> list[str]:
    """The table in lines for a terminal."""
    widest = max(len(row.name) for row in rows)
    found = [f"{'scan':<{widest}}  verdict   images  rims  good %  genus  seconds"]
    for row in rows:
        genus = "-" if row.genus is None else row.genus
        found.append(
            f"{row.name:<{widest}}  {row.verdict or 'no result':<9} {row.images:>6} {row.rims:>5} "
            f"{row.good_percent:>7.1f} {genus:>6} {row.seconds:>8.1f}"
            + (f"  {row.reason}" if row.reason else "")
        )
    return found


def _refuse_options(options: Sequence[str]) -> None:
    """Keep out what would end every replay before it begins.

    Raises:
        UserError: an option that this command sets, or that ``replay`` does not know.
    """
    from .app import app
    from .arguments import parse_remaps, parse_settings

    for option in options:
        if option.split("=")[0] in _OWN_OPTIONS:
            raise UserError(f"--option={option}: batch sets that itself, or cannot have it")
    commands: Any = typer.main.get_command(app)
    replay = commands.commands["replay"]
    try:
        given = replay.make_context("replay", ["BAG", "--out", "OUT", *options]).params
    except Exception as error:
        # The command-line library's own, of whichever package it takes them from.
        if not hasattr(error, "format_message"):
            raise
        raise UserError(f"--option: {error.format_message()}") from None
    parse_settings(given.get("settings") or ())
    parse_remaps(given.get("remap") or ())


@contextmanager
def _interrupts_kept_from_workers() -> Iterator[None]:
    """Ctrl-C reaches all programs of a terminal: workers leave it to this one, which ends them.

    A thread that is made in the block has the signal blocked, and so has all that it starts, as
    workers that take the places of others later. Pressed meanwhile, it counts after the block.
    """
    resource_tracker.ensure_running()  # which would unblock it
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _jobs(bags: Sequence[Path], options: list[str]) -> list[Job]:
    """A job for each bag, in a folder of its name; equal names get a number."""
    jobs: dict[str, Job] = {}
    for bag in bags:
        stem = bag.stem if bag.suffix in (".mcap", ".db3") else bag.name
        name, number = stem, 1
        while name in jobs:
            number += 1
            name = f"{stem}_{number}"
        jobs[name] = Job(name, str(bag.absolute()), options, _state(bag))
    return list(jobs.values())


def _state(bag: Path) -> str:
    files = sorted(bag.rglob("*")) if bag.is_dir() else [bag] if bag.exists() else []
    stats = [(path.name, path.stat()) for path in files if path.is_file()]
    return ";".join(f"{name}:{s.st_size}:{s.st_mtime_ns}" for name, s in stats)


def _row_of(future: Any, job: Job) -> Row:
    """The row of a job whose worker may have been lost too often."""
    try:
        row = future.result()
        assert isinstance(row, Row)
        return row
    except Exception as error:  # of whatever kind: it must stop no other scan
        reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
        return Row(**asdict(job), reason=reason)


def _last_line(child: subprocess.CompletedProcess[str]) -> str:
    if child.returncode < 0:
        return f"ended by signal {signal.Signals(-child.returncode).name}"
    said = child.stderr.strip().splitlines()
    return said[-1] if said else f"exit code {child.returncode}"


def batch_(
    bags: Annotated[list[Path], typer.Argument(help="recorded scans, as for replay")],
    out: Annotated[Path, typer.Option(help="folder for a folder of results of each")],
    workers: Annotated[
        int | None, typer.Option(help="scans at a time; default: one a core", min=1)
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="tcp://HOST:PORT", help="a Dask cluster whose workers see the same files"
        ),
    ] = None,
    option: Annotated[
        list[str] | None,
        typer.Option(
            metavar="OPTION", help="for each replay, such as --option=--segment=joint; repeats"
        ),
    ] = None,
    remap: Remap = None,
    settings: Settings = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="no progress, no table")] = False,
) -> int:
    """Many recorded scans, on the cores of this machine or on a cluster.

    Called again, it goes on where it stopped. The table is kept in OUT/batch.json and .csv.
    """
    from .progress import progress_bar

    options = list(option or [])
    options += [f"--remap={rule}" for rule in remap or ()]
    options += [f"--set={assignment}" for assignment in settings or ()]
    with progress_bar("replaying", quiet) as progress:
        rows = batch(bags, out, options, workers, dask, progress)
    if not quiet:
        print("\n".join(lines(rows)))
    return exit_code(rows)
