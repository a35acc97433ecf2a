"""How a command that cannot go on ends: one line on stderr, and an exit code."""

import errno
import os
import sys
import traceback

from occ_recon_ros.errors import UserError

INTERRUPTED = 1
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)


def exit_code(error: BaseException) -> int:
    """Say what went wrong; 2 on bad arguments or input, else 1."""
    # The command-line library's own errors, of whichever package it takes them from.
    if isinstance(error, KeyboardInterrupt) or type(error).__name__ == "Abort":
        return _said("interrupted", INTERRUPTED)
    if isinstance(error, UserError):
        return _said(str(error), 2)
    if hasattr(error, "format_message") and hasattr(error, "exit_code"):
        return _said(f"{error.format_message()} (see occ-recon --help)", int(error.exit_code))
    if isinstance(error, OSError) and error.errno in _NO_ROOM:
        where = f" ({error.filename})" if error.filename else ""
        return _said(f"{error.strerror}{where}: make room and try again", 1)
    if os.environ.get("OCC_RECON_TRACEBACK"):
        traceback.print_exception(error)
    fault = "(a fault of ours; OCC_RECON_TRACEBACK=1 shows where)"
    return _said(f"{type(error).__name__}: {error} {fault}", 1)


def _said(words: str, code: int) -> int:
    print("error:", " ".join(words.split()), file=sys.stderr)
    return code
