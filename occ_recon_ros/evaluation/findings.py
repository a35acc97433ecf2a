"""What speaks against a result, one question after the other."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Contours
from occ_recon_ros.geometry.arrays import Array, Index
from occ_recon_ros.imaging.curves import signed_area
from occ_recon_ros.surface.agreement import Agreement
from occ_recon_ros.surface.covering import LEAST_COVERED_ONE, cut_off, stands_off
from occ_recon_ros.surface.evidence import MOST_DOUBTFUL

from .advice import (
    DOUBTED,
    EMPTY,
    FILLED_SO,
    FROM_ALL,
    GIVEN,
    IN_GAP,
    IN_ORDER,
    MASKS,
    OUTLINES,
    PART,
    ROUND,
    SHARPER,
    SMOOTH,
    WHOLE,
    of_remark,
)
from .evidence import Evidence

GOOD, DOUBTFUL, FAILED = "good", "doubtful", "failed"

_FEW_OUTLINES, _SOME_OUTLINES = 0.5, 0.9  # of the images
_FULL = 0.985  # of its bounding box, that a silhouette fills which is an upright rectangle
_SAME_PX = 1.5  # by which the sides of such rectangles differ from view to view
_AT_BORDER_PX = 3.0
_LACKS = 0.01  # of a mask, that it leaves out where others leave out more
_MUCH_CUT = 0.25  # of the size of an outline, that is missing along the border
_OFTEN_CUT = 0.2  # of the views
_FITS, _FITS_WELL = 0.85, 0.95  # IoU of the body with the outlines that it was made from
_FILLED, _MUCH_FILLED = 0.001, 0.01  # of an outline, that are holes
_FEW_GOOD = 0.2  # of the samples
_MUCH_OFF_PX = 1.5  # poses or calibration
_AGREED_SIGMAS = 1.5  # by which two views stay apart in right poses; of masks by hand up to 2
_WIDE_DEG = 50.0  # from view to view, where a body may stand off by a tenth of its radius
_SPARSE_DEG = 23.0  # by a fiftieth
_BEST_DEG = 10.0
_SMALL_PX = 50.0  # long side of the object: of a figure of 60 a tenth is lost, of 40 a quarter
_THIN_PX = 3.0  # of a part, thinner than which its sides run together
_UNSHARP_PX = 1.0  # sigma of an outline
_LARGE_PX = 1000  # long side of an image, above which both grow with it
_FEW_STRIPS = 0.15  # of the closed body; of usual turns it is a quarter or more
_FEW_WIDE_STRIPS = 0.5  # which those of far views are that are torn
_WHOLE_TURN = 359.9  # degrees, but for rounding


class Finding(NamedTuple):
    """What was found.

    Attributes:
        grade: of a result of which nothing worse is found; GOOD: it is a note.
        what: a sentence.
        advice: what to do.
    """

    grade: str
    what: str
    advice: str


def of_number(evidence: Evidence) -> list[Finding]:
    """Whether enough images gave an outline, and one of an object."""
    found = list[Finding]()
    n = evidence.views
    empty = f"{evidence.empty_masks} masks show no object" if evidence.empty_masks else ""
    mend = evidence.bare or (EMPTY if empty or evidence.given else MASKS)
    why, again = evidence.lost or (empty, mend)
    if n < _FEW_OUTLINES * evidence.images:
        what = f"only {n} of {evidence.images} images gave an outline"
        found.append(Finding(FAILED, ": ".join(filter(None, (what, why))), again))
    elif n < _SOME_OUTLINES * evidence.images:
        what = f"{evidence.images - n} of {evidence.images} images gave no outline"
        found.append(Finding(DOUBTFUL, ": ".join(filter(None, (what, why))), again))
    if n and _is_frame(evidence.contours):
        what = "the outline is the same upright rectangle in every view: the border of the image"
        what = f"{what}, or of bars around it, was taken for the object"
        found.append(Finding(FAILED, what, mend))
    return found


def of_agreement(evidence: Evidence, agreement: Agreement | None) -> list[Finding]:
    """Whether outlines contradict each other."""
    if agreement is None or not agreement.doubtful.any():
        return []
    doubtful, compared = np.flatnonzero(agreement.doubtful), len(evidence.contours)
    if evidence.given and agreement.parted:
        what = _parted(evidence, agreement.too_large, agreement.refuted)
        return [Finding(DOUBTFUL, what, PART)]
    if len(doubtful) > MOST_DOUBTFUL * compared:
        what = f"the outlines of {len(doubtful)} of {compared} views contradict the others"
        share = float(np.median(agreement.share[doubtful]))
        what = f"{what} (by {share:.0%} in the median)"
        if evidence.given and float(np.mean(agreement.local[doubtful])) > 0.5:
            return [Finding(FAILED, f"{what}, most of them at one place", PART)]
        return [Finding(FAILED, what, _outlines(evidence))]
    found = list[Finding]()
    if evidence.given and len(short := np.flatnonzero(agreement.local & _lacking(agreement))):
        what = f"{len(short)} of {compared} masks leave out, at one place, what the others hold"
        what = f"{what}, up to {float(agreement.refutes[short].max()):.0%} of a mask"
        found = [Finding(DOUBTFUL, f"{what}: {_named(evidence, short)}", PART)]
        doubtful = np.setdiff1d(doubtful, short)
    if not len(doubtful):
        return found
    what = f"{len(doubtful)} of {compared} views contradict the others"
    what = f"{what}, by up to {float(agreement.share[doubtful].max()):.0%}"
    do = "look at the contours of those views, or leave them out"
    return [*found, Finding(DOUBTFUL, f"{what}: {_named(evidence, doubtful)}", do)]


def _lacking(agreement: Agreement) -> NDArray[np.bool_]:
    """(n,) which lack what the others bear out, if more than they hold too much; where some do by
    more than right ones, half of that is told, too."""
    return (agreement.refutes > agreement.refuted) & (agreement.refutes > _LACKS)


def _parted(evidence: Evidence, large: NDArray[np.bool_], refuted: Array) -> str:
    """That some masks hold a part that the others leave out; the fewer are named."""
    share, more = float(np.median(refuted[large])), int(large.sum())
    fewer = f"of {len(large)} masks leave out what the others hold, {share:.0%} of these"
    if 2 * more > len(large):
        return f"{len(large) - more} {fewer}: {_named(evidence, np.flatnonzero(~large))}"
    what = f"{more} of {len(large)} masks hold what the others leave out, {share:.0%} of a mask"
    half = ", as many as do not" if 2 * more == len(large) else ""
    return f"{what}{half}: {_named(evidence, np.flatnonzero(large))}"


def of_covering(evidence: Evidence, agreement: Agreement | None) -> list[Finding]:
    """How the body covers its outlines. Where views contradict the others it cannot cover those."""
    contradicted = agreement is not None and bool(agreement.doubtful.any())
    rows, iou, outlines = list[Finding](), evidence.body_iou, _outlines(evidence)
    if evidence.given and agreement is not None and agreement.parted:
        # What some leave out is carved off.
        iou = np.sort(iou)[round(float(agreement.too_large.mean()) * len(iou)) :]
    holes = evidence.filled if len(evidence.filled) == len(iou) else 0.0  # of them more is said
    what = "the closed body covers {} by {:.1%} only (IoU)"
    if len(iou) and (mean := float(iou.mean())) < _FITS_WELL:
        word = DOUBTFUL if mean > _FITS else FAILED
        rows.append(Finding(word, what.format("its own outlines", mean), outlines))
    elif len(iou) and (iou + holes).min() < LEAST_COVERED_ONE and not contradicted:
        what = what.format("the outline of a view", iou.min())
        rows.append(Finding(DOUBTFUL, what, outlines))
    filled = np.flatnonzero(evidence.filled > _FILLED)
    if len(filled):
        most = float(evidence.filled.max())
        what = f"closed.ply fills holes of up to {most:.1%} of an outline, in view"
        what = f"{what}s" if len(filled) > 1 else what
        what = f"{what} {_named(evidence, filled)}"
        # What this program found in the images may as well be shadows and glints.
        word = DOUBTFUL if evidence.given and most > _MUCH_FILLED else GOOD
        rows.append(Finding(word, what, FILLED_SO))
    return rows


def of_border(evidence: Evidence) -> list[Finding]:
    """Whether images show all of the object."""
    cut = _share_cut(evidence.contours, evidence.sizes)
    if cut <= _OFTEN_CUT:
        return []
    what = f"the object is cut by the border of the image in {cut:.0%} of the views"
    return [Finding(DOUBTFUL, what, WHOLE)]


def of_views(evidence: Evidence, agreement: Agreement | None) -> list[Finding]:
    """Whether views are near enough to each other, and stand where they are said to."""
    found = list[Finding]()
    if evidence.views and evidence.good_share < _FEW_GOOD:
        what = f"only {evidence.good_share:.0%} of the samples gave a good rim point"
        found.append(Finding(DOUBTFUL, what, "turn in smaller steps (10 degrees or less)"))
    if evidence.neighbours_deg > _WIDE_DEG:
        # So far apart, rims that are off tell of the steps, and not of the poses.
        what = f"only {evidence.views} views, {evidence.neighbours_deg:.0f} degrees apart: too few"
        what = f"{what}: between them {_off_between(evidence.neighbours_deg)}"
        found.append(Finding(DOUBTFUL, what, "take more images: 10 degrees apart are best"))
    elif evidence.pose_error_px > _MUCH_OFF_PX * _larger(evidence):
        found.append(_off(evidence, agreement))
    if not evidence.follow:
        found.append(Finding(DOUBTFUL, _torn(evidence), IN_ORDER))
    return found


def _off(evidence: Evidence, agreement: Agreement | None) -> Finding:
    """That poses or calibration are off, or outlines ragged: then neighbours see their points apart
    as well, but agree on the planes that touch the object."""
    if evidence.left_sigmas < _AGREED_SIGMAS:
        what = f"the outlines are ragged or noisy by about {evidence.pose_error_px:.1f} px"
        what = f"{what}: poses agree with them to {evidence.left_px:.1f} px"
        return Finding(DOUBTFUL, what, SMOOTH if evidence.given else SHARPER)
    what = f"poses or calibration are off by about {evidence.pose_error_px:.1f} px"
    doubtful = 0.0 if agreement is None else float(agreement.doubtful.mean())
    if doubtful > MOST_DOUBTFUL and not evidence.given:
        # Outlines that are not the object's tell nothing of the cameras.
        what = f"the outlines are about {evidence.pose_error_px:.1f} px apart in these cameras"
    corrected = f"check {evidence.checked}: the contours ask for no better ones"
    refine = (
        "correct them by the contours: --refine; if that was done, the outlines are ragged or noisy"
    )
    return Finding(DOUBTFUL, what, corrected if evidence.refined else refine)


def of_sharpness(evidence: Evidence) -> list[Finding]:
    """Whether images show enough of the object to tell its outline."""
    found = list[Finding]()
    if evidence.object_px < _SMALL_PX:
        what = f"the object is only {evidence.object_px:.0f} px large in the images: what is"
        what = f"{what} thinner than {_THIN_PX / evidence.object_px:.0%} of that is lost"
        found.append(Finding(DOUBTFUL, what, "larger images, or a camera that is nearer"))
    unsharp = _median_sigma_px(evidence.contours)
    if unsharp > _UNSHARP_PX * _larger(evidence):
        what = f"the outlines are known to {unsharp:.1f} px only"
        found.append(Finding(DOUBTFUL, what, SHARPER))
    return found


def of_body(evidence: Evidence) -> list[Finding]:
    """Whether there is a closed body."""
    if not evidence.not_closed:
        return []
    return [Finding(DOUBTFUL, f"no closed body: {evidence.not_closed}", ROUND)]


def of_ends(evidence: Evidence) -> list[Finding]:
    """Whether outlines bound the body above and below."""
    ends = evidence.ends
    if ends is None or not (what := ends.said()):
        return []
    return [Finding(DOUBTFUL if ends.doubtful else GOOD, what, ends.advice())]


def of_remarks(evidence: Evidence) -> list[Finding]:
    """What those doubt who made the masks or poses."""
    mend = "mend its mask" if evidence.given else "give masks"
    doubted = DOUBTED.format(mend, evidence.checked)
    found = list[Finding]()
    for remark in evidence.remarks:
        own = evidence.bare if FROM_ALL in remark else ""
        found.append(Finding(DOUBTFUL, remark, own or of_remark(remark, doubted)))
    return found


def of_turn(evidence: Evidence) -> list[Finding]:
    """Whether the object was seen from all around."""
    if evidence.not_closed or evidence.covered_deg >= _WHOLE_TURN:
        return []
    gap = 360 - evidence.covered_deg
    if evidence.gap_between:
        what, advice = f"no view between {' and '.join(evidence.gap_between)}", IN_GAP
        what = f"{what} ({gap:.0f} degrees): the body there is what the other outlines allow"
    else:
        what, advice = f"the object was seen over {evidence.covered_deg:.0f} of 360 degrees", ROUND
        what = f"{what}: the rest of its body is what outlines allow"
    if gap > _WIDE_DEG:
        return [Finding(DOUBTFUL, what, advice)]
    # as between the views of a turn in steps so wide
    return [Finding(GOOD, f"{what}; in the gap {_off_between(gap)}", "")]


def median_size_px(contours: Sequence[Contours]) -> float:
    """Longer side of the box about an outline, px, in the median of the views; NaN of none."""
    boxes = _boxes(contours)
    return float(np.median((boxes[:, 2:] - boxes[:, :2]).max(axis=1))) if len(boxes) else np.nan


def _outlines(evidence: Evidence) -> str:
    """What to do about outlines that contradict each other."""
    if evidence.given:
        advice = GIVEN
    elif evidence.together:
        first = f"{evidence.under}; " if evidence.under else ""
        advice = first + OUTLINES.format("a plain backdrop, a scan volume (volume_*), or ")
    else:
        advice = OUTLINES.format("--segment joint, or ")
    return advice.format(evidence.checked)


def _larger(evidence: Evidence) -> float:
    """How many px count as one in images of this size."""
    sides = [max(size) for size in evidence.sizes] or [0]
    return max(1.0, float(np.median(sides)) / _LARGE_PX)


def _torn(evidence: Evidence) -> str:
    """What is wrong with the surface of views that do not follow each other."""
    whole = "" if evidence.not_closed else ", closed.ply is not"
    return (
        "the images do not follow each other around the object (successive ones are "
        f"{evidence.step_deg:.0f} degrees apart, neighbours {evidence.neighbours_deg:.0f}): "
        f"mesh.ply and rims are torn{whole}"
    )


def _named(evidence: Evidence, rows: Index) -> str:
    """The first of some views, by what they are called."""
    if evidence.called:
        names = [evidence.called[k] for k in rows.tolist()]
    else:
        names = [str(k * evidence.every) for k in rows.tolist()]
    return ", ".join(names[:12]) + (" ..." if len(names) > 12 else "")


def _off_between(step_deg: float) -> str:
    """How far off a body may be between two views."""
    return f"the body may stand off a round surface by {stands_off(step_deg):.0%} of its radius"


def sparse(evidence: Evidence) -> list[str]:
    """How far off the closed body may be between views that are not yet too few."""
    if evidence.not_closed or not _SPARSE_DEG < evidence.neighbours_deg <= _WIDE_DEG:
        return []
    return [
        f"{evidence.views} views, {evidence.neighbours_deg:.0f} degrees apart: between them "
        f"{_off_between(evidence.neighbours_deg)}; {_BEST_DEG:.0f} degrees apart leave "
        f"{stands_off(_BEST_DEG):.1%}"
    ]


def few_strips(evidence: Evidence) -> list[str]:
    """That the open surface is next to nothing, where the closed body is not."""
    least = _FEW_WIDE_STRIPS if evidence.neighbours_deg > _SPARSE_DEG else _FEW_STRIPS
    if evidence.not_closed or not evidence.strips_share < least:
        return []
    apart = f" ({evidence.neighbours_deg:.0f} degrees apart here)"
    return [
        f"mesh.ply is only {evidence.strips_share:.0%} of the surface: strips need neighbouring "
        f"views{apart if np.isfinite(evidence.neighbours_deg) else ''}; closed.ply is the result"
    ]


def _boxes(contours: Sequence[Contours]) -> Array:
    """(n, 4) smallest and largest u and v of each view."""
    return np.array([[*c.uv.min(axis=0), *c.uv.max(axis=0)] for c in contours])


def _is_frame(contours: Sequence[Contours]) -> bool:
    """Whether most views show one and the same upright rectangle."""
    boxes = _boxes(contours)
    usual = np.median(boxes, axis=0)
    same = (np.abs(boxes - usual) < _SAME_PX).all(axis=1)
    areas = np.array([_largest_area(c) for c in contours])
    size = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    return bool(np.mean(same & (areas > _FULL * size)) > 0.8)


def _largest_area(contours: Contours) -> float:
    """Of the loops of a view, px^2."""
    return max((abs(signed_area(loop)) for loop in contours.by_loop(contours.uv)), default=0.0)


def _share_cut(contours: Sequence[Contours], sizes: Sequence[tuple[int, int]]) -> float:
    """Share of the views in which the outline ends at the border of the image."""
    if not len(contours) or not len(sizes):
        return 0.0
    boxes, size = _boxes(contours), np.array(sizes, float)
    away = np.column_stack([boxes[:, :2], size - 1 - boxes[:, 2:]])
    cut = [cut_off(c, own) > _MUCH_CUT for c, own in zip(contours, sizes, strict=True)]
    return float(np.mean((away.min(axis=1) < _AT_BORDER_PX) | cut))


def _median_sigma_px(contours: Sequence[Contours]) -> float:
    sigmas = [c.usual_sigma / c.radians_per_pixel for c in contours]
    return float(np.median(sigmas)) if sigmas else 0.0
