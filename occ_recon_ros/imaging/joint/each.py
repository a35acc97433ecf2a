"""One thing done to every view, on all cores."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

Result = TypeVar("Result")


def each(function: Callable[..., Result], *of: Iterable[Any]) -> list[Result]:
    """Results, in order, as of ``map``; of what mostly is in NumPy and OpenCV, which let other
    threads work meanwhile.

    Raises:
        Exception: the first that the function raises.
    """
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(function, *of))
