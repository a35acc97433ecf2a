"""The steps that a table turned in between photographs, or frames of a video, as they are told."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from occ_recon_ros.geometry.arrays import Array, Index

from .numbering import Numbering, gaps_in
from .turn_outlines import TurnOutlines, comes_round, first_again, turned_by


@dataclass(frozen=True)
class Steps:
    """Which images of a turn are used, and how far it had come at each.

    Attributes:
        rows: of the outlines, those that are used.
        turned: (m,) float64, by how much the table had turned at each of these, in steps.
        count: of the steps that make the turn that was told.
        still: names of images that are like the one before.
        last: name of the last image if that is the first again; empty: it is not.
        over: of one before the last that is; empty: there is none.
        gaps: numbers missing in the names, where numbers are the steps and not images.
        free: how far the table turned in all is to be found too: the last images may be missing.
    """

    rows: Index
    turned: Array
    count: float
    still: tuple[str, ...] = ()
    last: str = ""
    over: str = ""
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
    names = [seen.names[k] for k in rows]
    still = sorted(set(seen.names) - set(names), key=seen.names.index)
    count = turned[-1] + seen.unseen * float(turned[-1] > turned[-2]) if len(turned) > 1 else 0.0
    steps = Steps(rows, turned[rows], count, tuple(still))
    if not by_hand and whole and comes_round(seen):
        return replace(
            steps, rows=rows[:-1], turned=turned[rows[:-1]], count=turned[-1], last=names[-1]
        )
    return steps


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
        count = float(np.interp(row, base.rows, base.turned))
        found.append(replace(base, count=count, over=seen.names[row]))
    if gaps is not None:
        found.append(replace(found[0], free=True))
    return found
