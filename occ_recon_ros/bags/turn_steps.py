"""The steps that a table turned in between photographs, or frames of a video, as they are told."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from occ_recon_ros.geometry.arrays import Array, Index

from .numbering import Numbering, gaps_in
from .turn_outlines import (
    TurnOutlines,
    comes_round,
    first_again,
    nearest_before,
    places_again,
    turned_by,
)

ALIKE = "like the image before: the table stood still"
_ROUND = "like the first image: the turn was over"
_OVER = "the turn was over: as {}"
_BACK = "the table had gone back: as {}"


@dataclass(frozen=True)
class Steps:
    """Which images of a turn are used, and how far it had come at each.

    Attributes:
        rows: of the outlines, those that are used.
        turned: (m,) float64, by how much the table had turned at each of these, in steps.
        count: of the steps that make the turn that was told.
        left_out: names of images that are like earlier ones, and why they are.
        over: of one before the last that is the first again; empty: there is none.
        back: of the first one after which the table had gone back; empty: it had not.
        gaps: numbers missing in the names, where numbers are the steps and not images.
        free: how far the table turned in all is to be found too: the last images may be missing.
    """

    rows: Index
    turned: Array
    count: float
    left_out: Mapping[str, str] = field(default_factory=dict)
    over: str = ""
    back: str = ""
    gaps: Numbering | None = None
    free: bool = False

    def angles(self, turn: float) -> Array:
        """(m,) of the object at each row, of a turn in all, both in rad."""
        return turn * self.turned / self.count

    @property
    def said(self) -> tuple[str, ...]:
        """What of them is not as images were told to be, in sentences."""
        found = []
        if self.gaps is not None:
            found.append(
                f"{self.gaps.said()}: numbers are taken for steps in place of images, for so the "
                "outlines fit better"
            )
        if self.over:
            found.append(f"{self.over} is the first image again: the turn is taken to end there")
        if self.back:
            found.append(
                f"{self.back} is the first image for which the table had gone back: images of "
                "places where it was before are left out, for so the outlines fit better"
            )
        if self.free:
            found.append(
                "how far the table turned in all is found too: the last images may be missing"
            )
        return tuple(found)


def even_steps(seen: TurnOutlines, whole: bool, by_hand: bool) -> Steps:
    """As many steps as images of that size: of a whole turn the last leads on to the first.

    Args:
        seen: the outlines.
        whole: whole turns were told.
        by_hand: frames of a video, see ``turned_by``.
    """
    turned, rows = turned_by(seen, by_hand)
    left_out = {seen.names[k]: _like(seen, k) for k in range(len(seen.names)) if k not in rows}
    count = turned[-1] + seen.unseen * float(turned[-1] > turned[-2]) if len(turned) > 1 else 0.0
    steps = Steps(rows, turned[rows], count, left_out)
    if not by_hand and whole and comes_round(seen):
        left_out[seen.names[rows[-1]]] = _ROUND
        return replace(steps, rows=rows[:-1], turned=turned[rows[:-1]], count=turned[-1])
    return steps


def _like(seen: TurnOutlines, row: int) -> str:
    """Why one that is like the row before is left out."""
    nearest = nearest_before(seen, row) if row else 0
    if nearest in (row, row - 1):
        return ALIKE
    return f"like {seen.names[nearest]}: the table was there before" if nearest else _ROUND


def steps_back(seen: TurnOutlines, whole: bool) -> Steps | None:
    """The steps of a turn in which the table went back to places where it was before, by images
    that are alike: each place once. None where it never did.

    Args:
        seen: the outlines.
        whole: one whole turn was told: its last place leads on to the first.
    """
    places, shown = places_again(seen)
    again, step = shown >= 0, np.diff(places, prepend=-1)
    furthest = np.maximum.accumulate(places)
    round_again = np.append(False, places[:-1] == furthest[:-1]) & (places == 0) & whole
    back = again & ~round_again & (step != 0) & (step != 1)
    if not back.any():
        return None
    left_out, why = {}, ALIKE
    for k in np.flatnonzero(again):
        if back[k]:
            why = _BACK
        elif not again[k - 1]:
            why = _OVER if round_again[k] and step[k] else ALIKE
        first = why == _OVER and not shown[k]
        left_out[seen.names[k]] = _ROUND if first else why.format(seen.names[shown[k]])
    rows = np.flatnonzero(~again)
    behind = seen.unseen - seen.numbers[0] - 1 if rows[-1] == len(places) - 1 else 0
    count = float(seen.numbers[0] + furthest[-1] + 1 + behind)
    gone = seen.names[int(np.argmax(back))]
    return Steps(rows, places[rows].astype(np.float64), count, left_out, back=gone)


def other_steps(seen: TurnOutlines, files: Sequence[str], whole: bool) -> list[Steps]:
    """What else the steps of photographs may be: the numbers in their names where some of these
    are missing; a turn that was over before the last image; and, if neither, those numbers of a
    turn that went on beyond the last.

    Args:
        seen: the outlines.
        files: names of all photographs, in order.
        whole: whole turns were told.
    """
    gaps, found = gaps_in(files), []
    if gaps is not None:
        numbers = [gaps.places[name] for name in seen.names]
        unseen = numbers[0] + gaps.places[files[-1]] + 1 - numbers[-1]
        seen = replace(seen, numbers=numbers, unseen=unseen)
        found.append(replace(even_steps(seen, whole, by_hand=False), gaps=gaps))
    if whole and (row := first_again(seen)) is not None:
        base = found[0] if found else even_steps(seen, whole, by_hand=False)
        count = float(turned_by(seen, by_hand=False)[0][row])
        found.append(replace(base, count=count, over=seen.names[row]))
    if gaps is not None:
        found.append(replace(found[0], free=True))
    return found
