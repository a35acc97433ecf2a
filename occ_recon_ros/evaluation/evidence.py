"""What is known of a run, as its verdict rests on it."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from occ_recon_ros.geometry import Contours
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.surface.agreement import Agreement

from .ends import Ends

CAMERAS = "K, D and poses"


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
        gap_between: what the two successive views are called between which the rest is; empty
            where the rest is between the last view and the first.
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
        left_px, left_sigmas: how far apart two views stay in the poses that contours ask for, 1
            sigma, in px and in what outlines are known to; NaN: they were not asked.
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
    gap_between: Sequence[str] = ()
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
    left_px: float = float("nan")
    left_sigmas: float = float("nan")
    ends: Ends | None = None
    called: Sequence[str] = ()
    given: bool = False
    together: bool = False
    under: str = ""
    bare: str = ""
    lost: tuple[str, str] | None = None

    @property
    def views(self) -> int:
        """Number of views with an outline."""
        return len(self.contours) if self.outlines is None else self.outlines
