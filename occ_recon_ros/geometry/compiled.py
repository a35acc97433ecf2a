"""Where the compiled loops are to be had."""

from __future__ import annotations

from functools import cache
from types import ModuleType


@cache
def compiled() -> ModuleType | None:
    """The module ``kernels``; None where numba is not installed, or not for this Python. It is
    loaded at the first frame: a third of a second that no import should take."""
    try:
        from . import kernels
    except ImportError:
        return None
    return kernels
