"""Numbers in the names of photographs, and which are missing among them."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_MOST_MISSING = 0.5  # of as many as there are; with more missing a count tells nothing
_NAMED = 8  # of the missing


@dataclass(frozen=True)
class Numbering:
    """An otherwise steady count in which numbers are missing.

    Attributes:
        places: of each name, counted from the first one.
        missing: the numbers that are not there, as names would write them.
    """

    places: dict[str, int]
    missing: tuple[str, ...]

    def said(self) -> str:
        """Which are missing, in words."""
        more = ", ..." if len(self.missing) > _NAMED else ""
        return f"the names lack {', '.join(self.missing[:_NAMED])}{more}"


def gaps_in(names: Sequence[str]) -> Numbering | None:
    """The count that names hold, where some of it is missing; None where nothing is, or names hold
    no such count, as those with the time of day.

    Args:
        names: in order; alike but for one number.
    """
    words = [re.split(r"(\d+)", Path(name).stem) for name in names]
    if len(names) < 3 or len({len(parts) for parts in words}) > 1:
        return None
    varying = [k for k, column in enumerate(zip(*words, strict=True)) if len(set(column)) > 1]
    if len(varying) != 1 or not varying[0] % 2:  # every second part is a number
        return None
    digits = [parts[varying[0]] for parts in words]
    numbers = np.array([int(number) for number in digits])
    steps = np.diff(numbers)
    usual = Counter(steps.tolist()).most_common(1)[0][0]
    if usual <= 0 or (steps <= 0).any() or (steps % usual).any() or (steps == usual).all():
        return None
    places: NDArray[np.int64] = (numbers - numbers[0]) // usual
    absent = sorted(set(range(int(places[-1]))) - set(places.tolist()))
    if len(absent) > _MOST_MISSING * len(names):
        return None
    width = len(digits[0])
    missing = (f"{numbers[0] + usual * place:0{width}d}" for place in absent)
    return Numbering(dict(zip(names, places.tolist(), strict=True)), tuple(missing))
