"""The commands and their arguments."""

from __future__ import annotations

import os
import sys
import traceback
from pathlib import Path
from typing import Annotated

import typer

from .errors import UserError

app = typer.Typer(
    name="occ-recon",
    help="Rebuild the surface of an object on a turntable from its occluding contours.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def run(arguments: list[str]) -> int:
    """Run a command line; errors become one line on stderr and an exit code."""
    try:
        code = app(args=arguments or ["--help"], prog_name="occ-recon", standalone_mode=False)
        return code if isinstance(code, int) else 0
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        return 1
    except Exception as error:
        # The command-line library's own errors, of whichever package it takes them from.
        if hasattr(error, "format_message") and hasattr(error, "exit_code"):
            message = " ".join(error.format_message().split())
            print(f"error: {message} (see occ-recon --help)", file=sys.stderr)
            return int(error.exit_code)
        if os.environ.get("OCC_RECON_TRACEBACK"):
            traceback.print_exc()
        kind = type(error).__name__
        print(
            f"error: {kind}: {' '.join(str(error).split())} "
            "(a fault of ours; OCC_RECON_TRACEBACK=1 shows where)",
            file=sys.stderr,
        )
        return 1


@app.callback()
def _common() -> None:
    """Every subcommand has --help."""


@app.command("import")
def import_(
    folder: Annotated[Path, typer.Argument(help="has cameras.json and the images it names")],
    bag: Annotated[
        Path,
        typer.Argument(help="bag to write: NAME.mcap or NAME.db3 is one file, NAME a folder"),
    ],
    no_masks: Annotated[bool, typer.Option("--no-masks", help="leave the masks out")] = False,
    storage: Annotated[
        str | None,
        typer.Option(help="mcap or sqlite3; default by the suffix of BAG, else mcap"),
    ] = None,
    overwrite: Annotated[bool, typer.Option(help="replace an existing bag")] = False,
) -> None:
    """Image folder with cameras.json -> rosbag2."""
    from .importing import import_folder
    from .progress import progress_bar

    with progress_bar("importing") as progress:
        counts = import_folder(folder, bag, not no_masks, storage, overwrite, progress)
    listed = ", ".join(f"{topic} {count}" for topic, count in counts.items())
    print(f"{bag}: {listed}")
