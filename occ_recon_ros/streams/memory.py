"""The memory of this process: how much it is, and giving back what is free."""

import ctypes
import resource
from pathlib import Path


def memory_mb() -> tuple[int, int]:
    """Resident memory now and at most, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    now = pages * resource.getpagesize() / 2**20
    return round(now), round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def give_back_memory() -> None:
    """Return what large arrays left behind to the system.

    The C library keeps up to 32 MB blocks for the next one of that size; blocks that grow
    from time to time leave two or three times their size behind.
    """
    ctypes.CDLL(None).malloc_trim(0)
