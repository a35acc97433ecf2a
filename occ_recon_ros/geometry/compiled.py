"""Where the compiled loops are to be had."""

from functools import cache
from importlib import import_module
from types import ModuleType


@cache
def compiled(module: str = "geometry.kernels") -> ModuleType:
    """A module of compiled loops, loaded at the first frame: numba takes a third of a second that
    no import should take."""
    return import_module(f"occ_recon_ros.{module}")
