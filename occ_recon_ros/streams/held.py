"""Outlines of views held against each other, in the poses given and in those that they ask for: one
rule for live and for recorded scans."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from ..geometry import Camera, Contours
from ..geometry.arrays import Array
from ..geometry.viewing import seen_by
from ..surface.agreement import Agreement, silhouette_agreement
from .alone import DOUBT, MANY, MISPLACED, MOST_DOUBTFUL

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Held:
    """Outlines of views, held against each other.

    Attributes:
        contours: n.
        agreement: of each with the others; None where it cannot be told.
        lost: how many further views gave none.
        failed: whether something else speaks against all of them.
    """

    contours: Sequence[Contours]
    agreement: Agreement | None
    lost: int = 0
    failed: bool = False

    @property
    def shares(self) -> Array:
        """(n,) of each silhouette, that others contradict; 0 where it cannot be told."""
        return self.agreement.share if self.agreement else np.zeros(len(self.contours))

    @property
    def local(self) -> Flags:
        """(n,) whether that is at one place."""
        return self.agreement.local if self.agreement else self.shares > 0

    @property
    def wrong(self) -> Flags:
        """(n,) which are contradicted."""
        return self.shares > DOUBT

    def usable_without(self, wrong: Flags) -> bool:
        """Whether enough outlines agree to take these (n,) for wrong."""
        most = MOST_DOUBTFUL * (self.lost + len(wrong))
        return not self.failed and bool(self.lost + wrong.sum() <= most)

    @property
    def agreeing(self) -> list[Contours]:
        """Those that nothing contradicts; none where too many are contradicted to tell."""
        if not self.usable_without(self.wrong):
            return []
        return [own for own, bad in zip(self.contours, self.wrong, strict=True) if not bad]

    @cached_property
    def doubt_of_hull(self) -> str:
        """What speaks against those that nothing contradicts by the body that they leave, "" where
        nothing does."""
        covering, own = _covering(), self.agreeing
        return str(covering.doubt_of_hull(own)) if covering and own else ""

    @cached_property
    def doubt_of_holes(self) -> str:
        """The same, by that body closed over holes. Poses do not make these, nor mend them."""
        covering, own = _covering(), self.agreeing
        return str(covering.doubt_of_holes(own)) if covering and own else ""


@dataclass(frozen=True)
class Corrected:
    """Outlines as they are held in corrected poses; ``cameras``: a row each."""

    held: Held
    cameras: Sequence[Camera]


def in_corrected_poses(held: Held, cameras: Sequence[Camera]) -> Corrected | None:
    """In poses corrected by the outlines, where all of them agree there; else None.

    Args:
        held: as ``cameras`` see them.
        cameras: a row each.
    """
    from ..poses.refine import refine  # its optimiser is half a second of a node's start

    with suppress(ValueError):
        found = refine(held.contours, cameras).cameras
        moved = [seen_by(camera, own) for camera, own in zip(found, held.contours, strict=True)]
        again = replace(held, contours=moved, agreement=silhouette_agreement(moved))
        return None if again.wrong.any() else Corrected(again, found)
    return None


def where_poses_do_it(held: Held, cameras: Sequence[Camera]) -> Corrected | None:
    """In corrected poses, where these end contradictions that are little in many, or leave a body
    of what nothing contradicts: then images are not what is wrong. Else None."""
    many = (held.wrong & (held.shares <= MISPLACED)).sum() > MANY * len(held.shares)
    # Of thin parts, poses that contradict each other nowhere take much. Right outlines leave a body
    # of 0.97 of them in corrected poses, where shadows and holes still leave 0.94 at most.
    if not many and ((held.shares > MISPLACED).any() or not held.doubt_of_hull):
        return None
    again = in_corrected_poses(held, cameras)
    return again if again and (many or not again.held.doubt_of_hull) else None


def _covering() -> ModuleType | None:
    """What closes the body, which a node can do without; None where that is not installed."""
    try:
        from ..surface import covering
    except ModuleNotFoundError:
        return None
    return covering
