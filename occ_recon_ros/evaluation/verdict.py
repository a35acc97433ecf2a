"""Whether a result may be believed: good, doubtful or failed, why, and what to do.

A body can be watertight and wrong: it was carved from outlines of something else. What tells:
outlines that contradict each other, outlines of the image instead of an object, images of
which nothing came, a body that its own outlines refute.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Contours
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.imaging.curves import signed_area
from occ_recon_ros.surface.agreement import Agreement, silhouette_agreement
from occ_recon_ros.surface.covering import LEAST_COVERED_ONE, cut_off, stands_off
from occ_recon_ros.surface.evidence import MOST_DOUBTFUL

from .advice import (
    BARE,
    DOUBTED,
    EMPTY,
    FILLED_SO,
    FROM_ALL,
    GIVEN,
    IN_ORDER,
    MASKS,
    OUTLINES,
    ROUND,
    WHOLE,
    explains_all,
    of_remark,
)
from .base import Base, base_under
from .ends import Ends

GOOD, DOUBTFUL, FAILED = "good", "doubtful", "failed"

_FEW_OUTLINES, _SOME_OUTLINES = 0.5, 0.9  # of the images
_FULL = 0.985  # of its bounding box, that a silhouette fills which is an upright rectangle
_SAME_PX = 1.5  # by which the sides of such rectangles differ from view to view
_AT_BORDER_PX = 3.0
_MUCH_CUT = 0.25  # of the size of an outline, that is missing along the border
_OFTEN_CUT = 0.2  # of the views
_FITS, _FITS_WELL = 0.85, 0.95  # IoU of the body with the outlines that it was made from
_FILLED, _MUCH_FILLED = 0.001, 0.01  # of an outline, that are holes
_FEW_GOOD = 0.2  # of the samples
_MUCH_OFF_PX = 1.5  # poses or calibration
_WIDE_DEG = 50.0  # from view to view, where a body may stand off by a tenth of its radius
_SPARSE_DEG = 23.0  # by a fiftieth
_BEST_DEG = 10.0
_SMALL_PX = 50.0  # long side of the object: of a figure of 60 a tenth is lost, of 40 a quarter
_THIN_PX = 3.0  # of a part, thinner than which its sides run together
_UNSHARP_PX = 1.0  # sigma of an outline
_LARGE_PX = 1000  # long side of an image, above which both grow with it

CAMERAS = "K, D and poses"
_FEW_STRIPS = 0.15  # of the closed body; of usual turns it is a quarter or more
_FEW_WIDE_STRIPS = 0.5  # which those of far views are that are torn
_WHOLE_TURN = 359.9  # degrees, but for rounding


@dataclass(frozen=True)
class Evidence:
    """What is known of a run.

    Attributes:
        contours: of the views with an outline, in the order of time; ``every`` so many-th of them.
        sizes: (width, height) px of their images, one for each of the contours; empty: whether
            the object is cut by their border is not asked.
        images: number of images sent.
        good_share: of the samples, those with status 0.
        pose_error_px: 1 sigma by which poses or calibration are off, NaN if unknown.
        covered_deg: how far the camera went around.
        step_deg: usual angle between successive views, NaN if unknown.
        neighbours_deg: usual angle between neighbours around the object, NaN if unknown.
        follow: whether successive views follow each other around the object.
        not_closed: why there is no closed body, empty if there is one.
        body_iou: (m,) of the closed body with the outlines of some views; empty without one.
        filled: (n,) share of each outline that are holes which the closed body fills.
        remarks: further doubts, in words, by those who made the masks or poses.
        notes: what else they said, which is no doubt.
        checked: what is to be looked at where poses or calibration may be wrong, in words.
        strips_share: area of mesh.ply, of that of the closed body; NaN without one.
        every: 1 where all contours are there.
        outlines: number of views with an outline; None: as many as contours.
        bounded: whether masks that came with the images, or a scan volume, tell the object from
            what it stands on.
        agreement: of these contours with each other, where it is known already.
        object_px: ``median_size_px`` of these contours, NaN: it is not asked whether it is enough.
        empty_masks: number of images whose masks, that came with them, show nothing.
        refined: whether contours were asked what poses they would have.
        ends: of the closed body; None without one.
        called: what the views of these contours are called; empty: by their number.
        given: whether the outlines are those of masks that came with the images.
        together: whether outlines were sought in all views together.
        bare: what to do about images that gave no outline, where that is known.
        lost: why they gave none, and what to do, where none was sought in most of them.
        under: what to do about what the object stands on, where that is known to be hard to tell.
    """

    contours: Sequence[Contours]
    sizes: Sequence[tuple[int, int]]
    images: int
    good_share: float
    pose_error_px: float = float("nan")
    covered_deg: float = 360.0
    step_deg: float = float("nan")
    neighbours_deg: float = float("nan")
    follow: bool = True
    not_closed: str = ""
    body_iou: Array = field(default_factory=lambda: np.zeros(0))
    filled: Array = field(default_factory=lambda: np.zeros(0))
    remarks: Sequence[str] = ()
    notes: Sequence[str] = ()
    checked: str = CAMERAS
    strips_share: float = float("nan")
    every: int = 1
    outlines: int | None = None
    bounded: bool = False
    agreement: Agreement | None = None
    object_px: float = float("nan")
    empty_masks: int = 0
    refined: bool = False
    ends: Ends | None = None
    called: Sequence[str] = ()
    given: bool = False
    together: bool = False
    under: str = ""
    bare: str = ""
    lost: tuple[str, str] | None = None


@dataclass(frozen=True)
class Verdict:
    """What is to be thought of a result.

    Attributes:
        word: good, doubtful or failed.
        reasons: sentences, the gravest first; empty if it is good.
        advice: what to do, in the order to try it.
        doubtful_views: numbers, from 0, of views that contradict the others.
        shares: (n,) by how much each view does, 0 to 1; empty if it could not be told.
        local: (n,) whether that is at one place, as ``Agreement``.
        base: something flat that turns with the object and was taken for a part of it.
        notes: sentences on what outlines cannot tell of a body that fits them well.
    """

    word: str
    reasons: tuple[str, ...]
    advice: tuple[str, ...]
    doubtful_views: tuple[int, ...] = ()
    shares: Array = field(default_factory=lambda: np.zeros(0))
    local: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    base: Base | None = None
    notes: tuple[str, ...] = ()

    def report(self) -> dict[str, object]:
        """As report.json holds it."""
        return {
            "word": self.word,
            "reasons": list(self.reasons),
            "advice": list(self.advice),
            "notes": list(self.notes),
            "doubtful_views": list(self.doubtful_views),
            "view_disagreement": [float(share) for share in self.shares],
        }


def judge(evidence: Evidence) -> Verdict:
    """Weigh the evidence. The gravest finding decides."""
    found: list[tuple[str, str, str]] = []
    compared = len(evidence.contours)
    n = compared if evidence.outlines is None else evidence.outlines
    agreement = evidence.agreement or _agreement(evidence.contours)
    doubtful = np.flatnonzero(agreement.doubtful) if agreement else np.zeros(0, np.intp)
    called = [evidence.called[int(k)] for k in doubtful] if evidence.called else []
    doubtful *= evidence.every
    empty = f": {evidence.empty_masks} masks show no object" if evidence.empty_masks else ""
    mend = evidence.bare or (EMPTY if empty or evidence.given else MASKS)
    why, again = evidence.lost or (empty[2:], mend)
    outlines = (GIVEN if evidence.given else _outlines(evidence)).format(evidence.checked)
    if n < _FEW_OUTLINES * evidence.images:
        what = f"only {n} of {evidence.images} images gave an outline"
        found.append((FAILED, ": ".join(filter(None, (what, why))), again))
    elif n < _SOME_OUTLINES * evidence.images:
        what = f"{evidence.images - n} of {evidence.images} images gave no outline"
        found.append((DOUBTFUL, ": ".join(filter(None, (what, why))), again))
    if n and _is_frame(evidence.contours):
        what = "the outline is the same upright rectangle in every view: the border of the image"
        found.append((FAILED, f"{what}, or of bars around it, was taken for the object", mend))
    if len(doubtful) > MOST_DOUBTFUL * compared:
        share = float(np.median(agreement.share)) if agreement else 1.0
        what = f"the outlines of {len(doubtful)} of {compared} views contradict the others"
        found.append((FAILED, f"{what} (by {share:.0%} in the median)", outlines))
    elif len(doubtful):
        named = _listed(called or [*map(str, doubtful)])
        most = float(agreement.share.max()) if agreement else 1.0
        what = f"{len(doubtful)} of {compared} views contradict the others"
        what = f"{what}, by up to {most:.0%}: {named}"
        found.append((DOUBTFUL, what, "look at the contours of those views, or leave them out"))
    found += _covering(evidence, outlines, bool(len(doubtful)))
    cut = _share_cut(evidence.contours, evidence.sizes)
    if cut > _OFTEN_CUT:
        what = f"the object is cut by the border of the image in {cut:.0%} of the views"
        found.append((DOUBTFUL, what, WHOLE))
    if n and evidence.good_share < _FEW_GOOD:
        what = f"only {evidence.good_share:.0%} of the samples gave a good rim point"
        found.append((DOUBTFUL, what, "turn in smaller steps (10 degrees or less)"))
    larger = max(1.0, float(np.median([max(size) for size in evidence.sizes] or [0])) / _LARGE_PX)
    if evidence.neighbours_deg > _WIDE_DEG:
        # So far apart, rims that are off tell of the steps, and not of the poses.
        what = f"only {n} views, {evidence.neighbours_deg:.0f} degrees apart: too few"
        what = f"{what}: between them {_off_between(evidence.neighbours_deg)}"
        found.append((DOUBTFUL, what, "take more images: 10 degrees apart are best"))
    elif evidence.pose_error_px > _MUCH_OFF_PX * larger:
        what = f"poses or calibration are off by about {evidence.pose_error_px:.1f} px"
        if len(doubtful) > MOST_DOUBTFUL * compared and not evidence.given:
            # Outlines that are not the object's tell nothing of the cameras.
            what = f"the outlines are about {evidence.pose_error_px:.1f} px apart in these cameras"
        corrected = f"check {evidence.checked}: the contours ask for no better ones"
        refine = "correct them by the contours: --refine"
        found.append((DOUBTFUL, what, corrected if evidence.refined else refine))
    if not evidence.follow:
        found.append((DOUBTFUL, _torn(evidence), IN_ORDER))
    if evidence.object_px < _SMALL_PX:
        what = f"the object is only {evidence.object_px:.0f} px large in the images: what is"
        what = f"{what} thinner than {_THIN_PX / evidence.object_px:.0%} of that is lost"
        found.append((DOUBTFUL, what, "larger images, or a camera that is nearer"))
    unsharp = _median_sigma_px(evidence.contours)
    if unsharp > _UNSHARP_PX * larger:
        what = f"the outlines are known to {unsharp:.1f} px only"
        found.append((DOUBTFUL, what, "more contrast to the backdrop, sharper images"))
    if evidence.not_closed:
        found.append((DOUBTFUL, f"no closed body: {evidence.not_closed}", ROUND))
    ends = evidence.ends
    notes = [*evidence.notes, *_few_strips(evidence), *_sparse(evidence, n)]
    if ends is not None and (what := ends.said()):
        if ends.doubtful:
            found.append((DOUBTFUL, what, ends.advice()))
        else:
            notes.append(f"{what}; {ends.advice()}")
    # Whether it is the object at all goes before how much of it was seen.
    doubted = DOUBTED.format("mend its mask" if evidence.given else "give masks", evidence.checked)
    for remark in evidence.remarks:
        own = evidence.bare if FROM_ALL in remark else ""
        found.append((DOUBTFUL, remark, own or of_remark(remark, doubted)))
    if not evidence.not_closed and evidence.covered_deg < _WHOLE_TURN:
        what = f"the object was seen over {evidence.covered_deg:.0f} of 360 degrees"
        what = f"{what}: the rest of its body is what outlines allow"
        if 360 - evidence.covered_deg > _WIDE_DEG:
            found.append((DOUBTFUL, what, ROUND))
        else:  # as between the views of a turn in steps so wide
            off = _off_between(360 - evidence.covered_deg)
            found.append((GOOD, f"{what}; in the gap {off}", ""))
    base = None if evidence.bounded else base_under(evidence.contours)
    if base is not None:
        what = "if it is not of the object, leave it out" if not base.bare else BARE
        found.append((DOUBTFUL, base.said(), f"{what}: --segment joint {base.options()}"))
    notes += ["; ".join(filter(None, row[1:])) for row in found if row[0] == GOOD]
    found = sorted((row for row in found if row[0] != GOOD), key=lambda row: row[0] != FAILED)
    word = found[0][0] if found else GOOD
    first = [(word, what, do) for _, what, do in found if explains_all(what)]
    found = first + [row for row in found if not explains_all(row[1])]
    return Verdict(
        word,
        tuple(what for _, what, _ in found),
        # Where it failed, what is only doubtful is most likely a consequence.
        tuple(dict.fromkeys(advice for grade, _, advice in found if grade == word)),
        tuple(doubtful.tolist()),
        agreement.share if agreement else np.zeros(0),
        agreement.local if agreement else np.zeros(0, np.bool_),
        base,
        tuple(notes) if word != FAILED else (),
    )


def _outlines(evidence: Evidence) -> str:
    """What to do about outlines that were found in the images and contradict each other."""
    if evidence.together:
        first = f"{evidence.under}; " if evidence.under else ""
        return first + OUTLINES.format("a plain backdrop, a scan volume (volume_*), or ")
    return OUTLINES.format("--segment joint, or ")


def median_size_px(contours: Sequence[Contours]) -> float:
    """Longer side of the box about an outline, px, in the median of the views; NaN of none."""
    boxes = _boxes(contours)
    return float(np.median((boxes[:, 2:] - boxes[:, :2]).max(axis=1))) if len(boxes) else np.nan


def _torn(evidence: Evidence) -> str:
    """What is wrong with the surface of views that do not follow each other."""
    whole = "" if evidence.not_closed else ", closed.ply is not"
    return (
        "the images do not follow each other around the object (successive ones are "
        f"{evidence.step_deg:.0f} degrees apart, neighbours {evidence.neighbours_deg:.0f}): "
        f"mesh.ply and rims are torn{whole}"
    )


def _covering(evidence: Evidence, outlines: str, contradicted: bool) -> list[tuple[str, str, str]]:
    """What is to be said of how the body covers its outlines: grades, GOOD for a note, sentences
    and advice. Where views contradict the others it cannot cover those."""
    rows, iou = list[tuple[str, str, str]](), evidence.body_iou
    holes = evidence.filled if len(evidence.filled) == len(iou) else 0.0  # of them more is said
    what = "the closed body covers {} by {:.1%} only (IoU)"
    if len(iou) and (mean := float(iou.mean())) < _FITS_WELL:
        word = DOUBTFUL if mean > _FITS else FAILED
        rows.append((word, what.format("its own outlines", mean), outlines))
    elif len(iou) and (iou + holes).min() < LEAST_COVERED_ONE and not contradicted:
        rows.append((DOUBTFUL, what.format("the outline of a view", iou.min()), outlines))
    filled = np.flatnonzero(evidence.filled > _FILLED)
    if len(filled):
        names = evidence.called or [*map(str, np.arange(len(evidence.filled)) * evidence.every)]
        most = float(evidence.filled.max())
        what = f"closed.ply fills holes of up to {most:.1%} of an outline, in view"
        what = f"{what}s" if len(filled) > 1 else what
        what = f"{what} {_listed([names[k] for k in filled.tolist()])}"
        # What this program found in the images may as well be shadows and glints.
        word = DOUBTFUL if evidence.given and most > _MUCH_FILLED else GOOD
        rows.append((word, what, FILLED_SO))
    return rows


def _listed(names: Sequence[str]) -> str:
    """The first of some names."""
    return ", ".join(names[:12]) + (" ..." if len(names) > 12 else "")


def _off_between(step_deg: float) -> str:
    """How far off a body may be between two views."""
    return f"the body may stand off a round surface by {stands_off(step_deg):.0%} of its radius"


def _sparse(evidence: Evidence, views: int) -> list[str]:
    """How far off the closed body may be between views that are not yet too few."""
    if evidence.not_closed or not _SPARSE_DEG < evidence.neighbours_deg <= _WIDE_DEG:
        return []
    return [
        f"{views} views, {evidence.neighbours_deg:.0f} degrees apart: between them "
        f"{_off_between(evidence.neighbours_deg)}; {_BEST_DEG:.0f} degrees apart leave "
        f"{stands_off(_BEST_DEG):.1%}"
    ]


def _few_strips(evidence: Evidence) -> list[str]:
    """That the open surface is next to nothing, where the closed body is not."""
    least = _FEW_WIDE_STRIPS if evidence.neighbours_deg > _SPARSE_DEG else _FEW_STRIPS
    if evidence.not_closed or not evidence.strips_share < least:
        return []
    apart = f" ({evidence.neighbours_deg:.0f} degrees apart here)"
    return [
        f"mesh.ply is only {evidence.strips_share:.0%} of the surface: strips need neighbouring "
        f"views{apart if np.isfinite(evidence.neighbours_deg) else ''}; closed.ply is the result"
    ]


def _agreement(contours: Sequence[Contours]) -> Agreement | None:
    try:
        return silhouette_agreement(contours)
    except (ValueError, np.linalg.LinAlgError):
        return None


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
