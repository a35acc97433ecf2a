"""What masks of all views together are worth beside others, and which views they leave out."""

from collections.abc import Collection

import numpy as np

from ..imaging.joint import JointMasks
from ..imaging.joint.masks import LEAST_BELIEF
from .alone import MOST_DOUBTFUL

_STRANGE = 0.6  # of the usual agreement with the other views (IoU); a hand before it costs less
_MOVED = 0.85  # of that, where the view is named as bad: shadows and dark sides cost less
_HIDDEN = 0.5  # of the object in colours of no other view: it is lit otherwise, or not to be seen
_CLEARLY = 0.01  # of the score of masks that are believed as much
MOVED = ": moved, hidden or in a shadow in part, or its pose or mask is wrong"
SURE = 0.95  # belief in masks that begin from single images, with less of which others are tried
_LEVELS = (LEAST_BELIEF, 0.7, SURE)  # used at all; nothing speaks against them; not to be doubted


def better(found: JointMasks, other: JointMasks, guessed: bool = False) -> bool:
    """Whether masks are believed more than others, or as much and clearly more confirmed.

    Args:
        found, other: of the same views.
        guessed: the former begin from outlines of single images that contradict each other, the
            others from none. Such confirm themselves a little wherever they are wrong: they have
            to be without doubt, or as much less in doubt as makes a difference to whoever uses
            them.
    """
    if guessed and found.belief < SURE:
        return _level(found.belief) > _level(other.belief)
    if found.belief != other.belief:
        return found.belief > other.belief
    return found.score() > (1 + _CLEARLY) * other.score()


def _level(belief: float) -> int:
    return sum(belief >= least for least in _LEVELS)


def strangers_among(
    found: JointMasks, out: Collection[int], contrary: Collection[int]
) -> dict[int, str]:
    """Views that show something else than the rest, such as the empty rig, and why: they spoil
    what is learnt of all views together, and a mask drawn by what the others say tells nothing.

    Args:
        found: of all views but those that are ``out``, by their numbers.
        contrary: numbers of views whose own image has an outline that the others contradict.
    """
    numbers = [k for k in range(len(found.views) + len(out)) if k not in out]
    usual = float(np.median([view.agreement for view in found.views]))
    strange: dict[int, str] = {}
    for number, view in zip(numbers, found.views, strict=True):
        if view.agreement < _STRANGE * usual:
            strange[number] = f"it agrees with the others by {view.agreement:.0%} only"
        elif view.covered > _HIDDEN or (view.covered and view.agreement < _MOVED * usual):
            what = f"{view.covered:.0%} of the object show colours of no other view"
            strange[number] = f"{what}: hidden, or in another light"
        elif view.disagrees and (number in contrary or view.agreement < _MOVED * usual):
            strange[number] = view.why + MOVED
    return strange if len(strange) <= MOST_DOUBTFUL * len(found.views) else {}
