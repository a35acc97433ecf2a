"""What a node measures of itself: stage times, rates, memory."""

import ctypes
import resource
import time
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

_KEPT = 10_000


class Stages(defaultdict[str, "deque[float]"]):
    """Durations of the latest frames, by stage, seconds."""

    def __init__(self) -> None:
        super().__init__(lambda: deque(maxlen=_KEPT))

    @contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Add the duration of a block that ends without an exception."""
        start = time.perf_counter()
        yield
        self[name].append(time.perf_counter() - start)


class Rates:
    """Messages since the last look, by name."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._since = time.monotonic()

    def take(self) -> tuple[Counter[str], float]:
        """Counts since the last call, also of what came before and now does not; seconds."""
        counts, self.counts = self.counts, Counter(dict.fromkeys(self.counts, 0))
        now = time.monotonic()
        elapsed, self._since = now - self._since, now
        return counts, elapsed


def spread_ms(name: str, seconds: Iterable[float]) -> dict[str, float]:
    """Median and 95th percentile in milliseconds by what they are called; none of no values."""
    values = np.fromiter(seconds, np.float64)
    if not len(values):
        return {}
    median, p95 = np.percentile(values, [50, 95]) * 1e3
    return {f"{name} median ms": round(float(median), 2), f"{name} p95 ms": round(float(p95), 2)}


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
