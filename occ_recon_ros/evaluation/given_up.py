"""What masks that came show and others, found in the images alone, leave out."""

from collections.abc import Iterable, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from msg_adapters import View
from occ_recon_ros.imaging.joint.colours import COUNT, colour_bins, histogram, probability
from occ_recon_ros.imaging.joint.edges import in_small
from occ_recon_ros.imaging.joint.regions import disc, grown, opened

_THICK = 0.05  # of the root of a mask's area: what is thinner is how a rim was drawn
_BESIDE = disc(5)  # px wide, about a mask, where its rim is mixed with what is behind it
_RARE = 0.1  # times as likely beside the masks as in what is left out: it is no backdrop


def given_up(views: Iterable[View], found: Mapping[int, NDArray[np.uint8]]) -> float:
    """How much of the usual mask that came others leave out in pieces whose colours are seen
    nowhere beside the masks that came: were it of the backdrop, as what a generous brush or a hull
    takes along is, it would be seen there too.

    Args:
        views: with the masks that came.
        found: (h, w) the others, 255 = object, by stamp; a view that has none is not asked.

    Returns:
        0 to 1, of its area, in the median of the views.
    """
    beside, lost = np.zeros(COUNT), np.zeros(COUNT)
    rows = list[tuple[NDArray[np.int32], int]]()  # colours that are left out, size of the mask
    for view in views:
        other = found.get(view.stamp_ns)
        if view.mask is None or other is None or not view.mask.any() or not other.any():
            continue
        small, own, picture = in_small(view.image, view.mask)
        bins = colour_bins(np.asarray(cv2.medianBlur(small, 5), np.uint8))
        area = int(np.count_nonzero(own)) or 1
        less = own & ~grown(in_small(view.image, other)[1], _BESIDE)
        left_out = bins[opened(less, disc(_THICK * float(np.sqrt(area))))]
        beside += histogram(bins[picture & ~grown(own, _BESIDE)])
        lost += histogram(left_out)
        rows.append((left_out, area))
    unlike = probability(beside) < _RARE * probability(lost)
    shares = [np.count_nonzero(unlike[left_out]) / area for left_out, area in rows]
    return float(np.median(shares)) if shares else 0.0
