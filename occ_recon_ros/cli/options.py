"""Options that commands share, and how a result is said."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from .scan import ScanOptions, Source

Params = Annotated[Path | None, typer.Option(help="YAML file of parameters, as config/rig.yaml")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NODE.PARAM=VALUE", help="one parameter; may be repeated"),
]
Remap = Annotated[
    list[str] | None,
    typer.Option(metavar="FROM:=TO", help="rename a topic of the bag; may be repeated"),
]
ForBag = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NODE.PARAM=VALUE",
        help="of contour_tracker object_frame, pose_sync and max_pose_gap count; may be repeated",
    ),
]
Bag = Annotated[
    Path, typer.Argument(help="bag to write: NAME.mcap or NAME.db3 is one file, NAME a folder")
]
Storage = Annotated[
    str | None, typer.Option(help="mcap or sqlite3; default by the suffix of BAG, else mcap")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="replace what is there")]
Verbose = Annotated[bool, typer.Option("--verbose", help="show what the nodes log")]
View = Annotated[bool, typer.Option("--view", help="show it on a page in the browser as it grows")]
Quiet = Annotated[bool, typer.Option("--quiet", help="no progress and no words but errors")]
Json = Annotated[bool, typer.Option("--json", help="print every number as JSON instead of words")]

FAILED = 3
"""Exit code: a result there is, but it is judged to be wrong."""


def say(
    report: Mapping[str, Any], lines: Iterable[str], as_json: bool = False, quiet: bool = False
) -> None:
    """Print a result: as JSON, in words, or not."""
    if as_json:
        print(json.dumps(report, indent=1))
    elif not quiet:
        print(*lines, sep="\n")


def log_level(verbose: bool) -> str:
    """What nodes log."""
    return "info" if verbose else "error"


def scanned(
    source: "Source",
    what: str,
    options: "ScanOptions",
    as_json: bool,
    quiet: bool,
    pause_s: float = 0.0,
) -> int:
    """A scan with its progress and its page, and its result; the exit code."""
    from .progress import progress_bar
    from .scan import run_scan
    from .watching import watched_alone

    with watched_alone(options.view, options.params, options.assignments):
        with progress_bar(what, quiet or as_json, pause_s) as progress:
            report = run_scan(source, replace(options, progress=progress))
        return show(report, options.out, as_json, quiet)


def show(report: dict[str, Any], out: Path, as_json: bool, quiet: bool) -> int:
    """Print the result of a scan in a few lines, or as JSON; the exit code that its verdict asks
    for."""
    from .scan import headline

    if as_json:
        print((out / "report.json").read_text(encoding="utf-8"), end="")
    elif not quiet:
        print(*headline(report), sep="\n")
        print(f"results in {out}: {', '.join(report['files'])}, report.json, report.html")
    return FAILED if report["verdict"]["word"] == "failed" else 0
