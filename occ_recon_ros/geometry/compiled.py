"""Where the compiled loops are to be had."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from types import ModuleType


@cache
def compiled(package: str = "geometry") -> ModuleType | None:
    """The module ``kernels`` of a package; None where numba is not installed, or not for this
    Python. It is loaded at the first frame: a third of a second that no import should take."""
    try:
        return import_module(f"occ_recon_ros.{package}.kernels")
    except ImportError:
        return None
