"""Masks that came and that the others contradict at one place, where others were drawn instead."""

from collections.abc import Collection, Mapping
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from msg_adapters import View
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.geometry import Contours
from occ_recon_ros.streams.alone import Outlines
from occ_recon_ros.surface.agreement import contradicted

Mask = NDArray[np.uint8]

_LESS = 0.6  # of what of the mask that came is contradicted, that one drawn instead must be below:
# with an arm that was found 0.47 to 0.56, with another leg lost 0.64 and more


def no_better_drawn(
    views: BagViews, kept: Mapping[int, Mask], drawn: Mapping[int, Mask], torn: Collection[int]
) -> dict[int, Mask]:
    """By stamp, masks that came torn, in whose place none was drawn that the others contradict by
    clearly less.

    What lacks a leg is still right elsewhere, and is mended there by the others; colours may lose
    both legs.

    Args:
        views: of which ``torn`` are the numbers of those in question.
        kept: (h, w) uint8 coverage by stamp, of masks that came and agree.
        drawn: the same of all views, as they are now.
        torn: numbers of views.
    """
    asked = [view for k, view in enumerate(views) if k in torn and view.mask is not None]
    if not asked or len(kept) < 2:
        return {}
    seen = [own for v in views if (own := _outline(v, kept.get(v.stamp_ns))) is not None]
    found = dict[int, Mask]()
    for view in asked:
        came, anew = _outline(view, view.mask), _outline(view, drawn[view.stamp_ns])
        with suppress(ValueError):  # nothing in common
            if came is None or view.mask is None:
                continue
            if anew is None or contradicted(anew, seen) > _LESS * contradicted(came, seen):
                found[view.stamp_ns] = view.mask
    return found


def _outline(view: View, mask: Mask | None) -> Contours | None:
    seen = Outlines()
    if mask is not None:
        seen.add(view.image, view.camera, view.stamp_ns, mask)
    return next(iter(seen.contours), None)
