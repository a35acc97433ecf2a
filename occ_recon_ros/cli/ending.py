"""How a command that cannot go on ends: one line on stderr, and an exit code."""

import errno
import json
import os
import sys
import traceback

from occ_recon_ros.errors import UserError

INTERRUPTED = 1
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)


def exit_code(error: BaseException, as_json: bool = False) -> int:
    """Say what went wrong, to programs as {"error": words} on stdout too; 2 on bad arguments or
    input, else 1."""
    words, code = _said(error)
    words = " ".join(words.split())
    print("error:", words, file=sys.stderr)
    if as_json:
        print(json.dumps({"error": words}))
    return code


def _said(error: BaseException) -> tuple[str, int]:
    # The command-line library's own errors, of whichever package it takes them from.
    if isinstance(error, KeyboardInterrupt) or type(error).__name__ == "Abort":
        return "interrupted", INTERRUPTED
    if isinstance(error, UserError):
        return str(error), 2
    if hasattr(error, "format_message") and hasattr(error, "exit_code"):
        return f"{error.format_message()} (see occ-recon --help)", int(error.exit_code)
    if isinstance(error, OSError) and error.errno in _NO_ROOM:
        where = f" ({error.filename})" if error.filename else ""
        return f"{error.strerror}{where}: make room and try again", 1
    if os.environ.get("OCC_RECON_TRACEBACK"):
        traceback.print_exception(error)
    fault = "(a fault of ours; OCC_RECON_TRACEBACK=1 shows where)"
    return f"{type(error).__name__}: {error} {fault}", 1
