"""The occ-recon command."""

import atexit
import os
import sys
import warnings
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``occ-recon``: 0 on success, 2 on bad arguments or input, 1 otherwise."""
    try:
        import mcap  # noqa: F401
        import PIL  # noqa: F401
        import rich  # noqa: F401
        import rosbags  # noqa: F401
        import typer  # noqa: F401
    except ImportError as error:
        print(
            f"error: occ-recon needs {error.name}: pip install 'occ_recon_ros[cli]'",
            file=sys.stderr,
        )
        return 2
    from .app import run
    from .ending import INTERRUPTED

    if arguments is None and not sys.warnoptions:  # they are for developers
        warnings.simplefilter("ignore")
    code = run(sys.argv[1:] if arguments is None else list(arguments))
    if arguments is None and code == INTERRUPTED:
        _leave(code)
    return code


def _leave(code: int) -> None:
    """End at once: a thread that was interrupted as it began waits for ever, and the interpreter
    would wait for it."""
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
