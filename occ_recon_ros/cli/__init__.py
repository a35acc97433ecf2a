"""The occ-recon command."""

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

    if arguments is None and not sys.warnoptions:  # they are for developers
        warnings.simplefilter("ignore")
    return run(sys.argv[1:] if arguments is None else list(arguments))
