"""What edges tell of the outlines that were found: that they lie on some, and that nothing is lost
which edges enclose beside them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .barrier import enclosed_beside, of_one_place
from .each import each
from .edges import StepsBeside, without_edge
from .evidence import looks_as_ground
from .holes import seen_through
from .regions import Mask
from .room import RoomEdges
from .shadow import shadow_coloured
from .small_view import SmallView
from .solve import Solution
from .space import Array

FEW = 0.2  # of the views: so many may show something strange (in more it is their light), or
# lack a mask, and tell nothing of the rest


@dataclass(frozen=True)
class EdgesAbout:
    """What edges tell of the outlines.

    Attributes:
        enclosed: (n,) of each view, area beside its mask that edges enclose with it, as a share
            of the mask's.
        edgeless: (n,) of each view, share of its outline where the image shows no edge.
        steps: share of the usual outline beside which there are edges as nowhere else.
        along: share of the usual outline along an edge of the room.
    """

    enclosed: Array
    edgeless: Array
    steps: float
    along: float


def edges_about(views: Sequence[SmallView], found: Solution, masks: Sequence[Mask]) -> EdgesAbout:
    """What edges tell of the outlines of ``masks``, of each view (h, w), of which those that came
    say nothing of those that were found beside them."""
    edgeless = without_edge(views, masks)
    own = [k for k, view in enumerate(views) if view.given is None and view.known is None]
    if not own:
        return EdgesAbout(np.zeros(len(views)), edgeless, 0.0, 0.0)
    shares = _enclosed(views, found, masks, own)
    # Those that were found stand for all, but for a few that are named by themselves.
    few = len(own) <= FEW * len(views)
    enclosed = np.full(len(views), 0.0 if few else np.median(shares))
    enclosed[own] = shares
    there = np.isin(np.arange(len(views)), own)
    edgeless = np.where(there, edgeless, 0.0 if few else np.median(edgeless[own]))
    if few:
        return EdgesAbout(enclosed, edgeless, 0.0, 0.0)
    beside, room = StepsBeside(), RoomEdges()
    for k in own:
        beside.add(views[k].image, masks[k], views[k].picture)
        room.add(views[k].image, masks[k], views[k].picture)
    steps, along = (float(np.median(seen.shares())) for seen in (beside, room))
    return EdgesAbout(enclosed, edgeless, steps, along)


def _enclosed(
    views: Sequence[SmallView], found: Solution, masks: Sequence[Mask], own: Sequence[int]
) -> list[float]:
    """Of each of the views ``own``, the area beside its mask that edges enclose with it, as a share
    of the mask's. What they enclose of a hole is not lost."""
    known = found.holes or list(map(np.zeros_like, masks))
    open_to = each(seen_through, views, masks, found.models.scenes)
    whole = [masks[k] | known[k] | open_to[k] for k in own]
    mine = [views[k] for k in own]
    shadows = [shadow_coloured(view.bins, found.models.shaded) for view in mine]
    lost = enclosed_beside(mine, whole, shadows, found.footprint)
    if found.ground is not None:
        # Print is enclosed by edges as well; what looks as the ground does there is the ground.
        grounds = [found.models.scenes[k][-1] for k in own]
        lost = [
            more & ~looks_as_ground(view, ground)
            for more, view, ground in zip(lost, mine, grounds, strict=True)
        ]
    if any(map(np.any, lost)):
        saying = [found.saying[k] for k in own]
        place = found.grid, found.body, found.footprint
        lost = of_one_place(mine, *place, whole, lost, saying)
    return [
        np.count_nonzero(more) / max(1, int(np.count_nonzero(mask)))
        for more, mask in zip(lost, whole, strict=True)
    ]
