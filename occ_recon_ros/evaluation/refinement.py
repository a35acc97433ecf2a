"""Poses and calibration of a recording, corrected by its contours."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews, Progress, doing
from occ_recon_ros.errors import UserError
from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.viewing import seen_by
from occ_recon_ros.imaging import ContourError, ContourTracker
from occ_recon_ros.poses.placed_anew import strays
from occ_recon_ros.poses.placing import held_in_place
from occ_recon_ros.poses.refine import Refinement, event_between, refine
from occ_recon_ros.poses.refine_trials import NEEDLESS, Trial

from .corrected import camera_rows
from .figures import Report
from .misread import misread, resized_so

_LENS = ("principal_point_px", "focal_percent", "aspect_percent", "k1_")
_NOTHING_FITS = 0.01  # of the outlines' size: poses apart by more may be meant another way
_NOT_SQUARE = 1.12  # fx to fy: pixels of old television were 1.09, others are square
_ANOTHER_FOCAL = 0.01  # change of the focal length from which on it is told: sizes go with it
_CLEAR_GAIN = 3.0  # standard errors: of right cameras 2.1 at most, of 3 % in focal length 3.4
_WOULD_FIT = {
    "focal": "another focal length would fit better ({}): sizes go with it, calibrate the camera",
    "lens": "another lens would fit better ({}): calibrate the camera",
    "steps": "other steps of the table would fit better ({}): check the angles of the poses",
}
_FEW = 0.2  # of the views: so many at most are no reason to move the others
_MUCH = 0.1  # of the same: outlines alone make up for so much, but do not tell all of it
WAYS = ("auto", "on", "off")


class Refine:
    """Corrected cameras of a recording, where its outlines do not agree with each other.

    Args:
        way: auto: where the outlines disagree by more than they are known to; on: always look
            (applied is only what gains); off: never.

    Attributes:
        way: as given.
        report: what was corrected, and how far it is to be believed.
    """

    name = "refinement"

    def __init__(self, way: str = "auto") -> None:
        if way not in WAYS:
            raise UserError(f"--refine {way}: must be one of {', '.join(WAYS)}")
        self.way = way
        self.report: Report = {"way": way, "corrected": []}

    def anew(self) -> "Refine":
        """The same, before it has looked."""
        return Refine(self.way)

    def __call__(self, views: BagViews, progress: Progress) -> Changes:
        """Look at all views; the cameras to be played, or none where none gain."""
        if self.way == "off":
            return Changes()
        seen, known = _Seen.of(views, progress), Changes()
        self._doubt(_stretched(seen.cameras))
        # Masks that came do not depend on poses: what they tell of these is told at once.
        meant = seen.misread(views) if views.masked() else None
        looked = None if meant else self._look(seen, views, progress)
        if looked and looked.apart > _NOTHING_FITS and not views.masked():
            meant = seen.misread(views)
        if meant:
            self._doubt(meant)
            whole = resized_so(meant, seen.contours, seen.cameras)
            if whole is None:
                # What else they seem to be off by is no error of theirs.
                self.report |= {"corrected": [], "moved": []}
                return Changes()
            self._note(f"{meant.partition(':')[0]}: K is taken so")
            seen = seen.by([*whole(seen.cameras)])
            known = self._taken(seen.stamps, seen.cameras, views)
            looked = self._look(seen, views, progress)
        if looked is None:
            return known
        found, settled = looked.found, looked.settled
        self._tell_of_lens(found)
        if not found.groups:
            self._note(not_taken(found.trials))
            return known
        if looked.apart > _MUCH:
            what = f"views were {found.before_px:.0f} px apart in the cameras as given"
            self._doubt(
                f"{what}, and are {found.after_px:.1f} in those that the outlines ask for: check "
                "the calibration and the poses, for sizes may be off with them"
            )
        cameras = held_in_place(found.cameras, seen.cameras, settled)
        return self._taken(seen.stamps, cameras, views)

    def _look(self, seen: "_Seen", views: BagViews, progress: Progress) -> "_Looked | None":
        """What outlines ask for; None where they cannot tell, which is noted."""
        settled = seen.settled()
        doing(progress, "cameras")
        try:
            found = refine(settled, seen.cameras, self.way == "on", progress)
        except ValueError as error:
            self.report["note"] = str(error)
            return None
        looked = _Looked(found, settled, found.before_px / _extent_px(seen.contours))
        self.report |= refinement_report(found) | {"before_of_size": looked.apart}
        images = views.images() if found.breaks else []
        for event in self.report["moved"] if images else ():
            event["image"] = images[event["before_view"]]["name"]
        return looked

    def _doubt(self, words: str) -> None:
        """Put it before those that were found so far, which are less grave."""
        if words:
            self.report["warnings"] = [words, *self.report.get("warnings", ())]

    def _note(self, words: str) -> None:
        if words:
            self.report["notes"] = [*self.report.get("notes", ()), words]

    def _tell_of_lens(self, found: Refinement) -> None:
        """What is to be said of a lens that was made another, or would have to be."""
        lens = found.another_lens
        made = "focal" in found.groups
        made |= "lens" in found.groups and abs(found.common[8]) > _ANOTHER_FOCAL
        if lens is not None and lens.whole:
            self.report["warnings"] = [*self.report.get("warnings", ()), lens.said()]
        elif lens is not None:
            self._note(lens.said())
        elif made:
            self._note(
                f"the focal length was made {np.exp(found.common[8]):.2f} times what it was, with "
                "which all outlines agree, and sizes may be off by as much, for outlines tell "
                "none: calibrate the camera, to be sure (occ-recon calibrate intrinsics)"
            )

    def _taken(self, stamps: Sequence[int], cameras: Sequence[Camera], views: BagViews) -> Changes:
        """These cameras in place of those of the views."""
        corrected = dict(zip(stamps, cameras, strict=True))
        self.report["cameras"] = camera_rows(corrected, views.recorded_cameras)
        return Changes(cameras=corrected)


@dataclass(frozen=True)
class _Seen:
    """n views: their stamps (ns), cameras, and outlines made with these, None where one has
    none."""

    stamps: Sequence[int]
    cameras: Sequence[Camera]
    contours: Sequence[Contours | None]

    @classmethod
    def of(cls, views: BagViews, progress: Progress) -> "_Seen":
        """Those of a recording."""
        cameras, contours = outlines_of(views, progress)
        return cls([*cameras], [*cameras.values()], contours)

    def by(self, cameras: Sequence[Camera]) -> "_Seen":
        """The same outlines, seen by other cameras."""
        pairs = zip(self.contours, cameras, strict=True)
        return _Seen(self.stamps, cameras, [own and seen_by(camera, own) for own, camera in pairs])

    def misread(self, views: BagViews) -> str | None:
        """What they seem to be, of these views, as ``misread``."""
        return misread(self.contours, self.cameras, images=views.images())

    def settled(self) -> Sequence[Contours | None]:
        """The outlines without a few that stand elsewhere, by much, which would bend the others
        (see ``Misplaced``). Those that something moved at one time agree with each other."""
        astray = strays(self.contours, self.cameras)
        few = 0 < len(astray) <= _FEW * len(self.cameras)
        if not few or event_between(self.contours, self.cameras) is not None:
            return self.contours
        return [None if k in astray else own for k, own in enumerate(self.contours)]


@dataclass(frozen=True)
class _Looked:
    """What was found from outlines that are settled, and by how much these were apart in the
    cameras as given, of their size."""

    found: Refinement
    settled: Sequence[Contours | None]
    apart: float


def outlines_of(
    views: BagViews, progress: Progress
) -> tuple[dict[int, Camera], list[Contours | None]]:
    """Cameras by stamp (ns), and the outline of each view, None where it has none; by the masks
    that come with the views, where some do."""
    doing(progress, "outlines")
    tracker, masked = ContourTracker(), views.masked()
    cameras: dict[int, Camera] = {}
    contours: list[Contours | None] = []
    for k, view in enumerate(views, 1):
        progress(k, len(views))
        cameras[view.stamp_ns] = view.camera
        found = None
        if view.mask is not None or not masked:
            with suppress(ContourError):
                found = tracker.process(view.image, view.camera, view.stamp_ns, "object", view.mask)
        contours.append(found)
    return cameras, contours


def _stretched(cameras: Sequence[Camera]) -> str:
    """What speaks against focal lengths that are not one, "" where they are: a body that is wider
    than the object by as much agrees with all outlines."""
    ratio = float(np.median([c.K[0, 0] / c.K[1, 1] for c in cameras])) if cameras else 1.0
    if max(ratio, 1 / ratio) < _NOT_SQUARE:
        return ""
    return (
        f"fx is {ratio:.2f} times fy, which no outline can tell: unless the images were stretched, "
        "K is wrong, and the body as much too wide or too narrow"
    )


def _extent_px(contours: Sequence[Contours | None]) -> float:
    """Longer side of the box around the outlines of a view, px, in the median."""
    sides = [float(np.ptp(c.uv, axis=0).max()) for c in contours if c is not None and len(c)]
    return float(np.median(sides)) if sides else np.inf


def what_moved(report: Report) -> list[str]:
    """What moved in the middle of the scan, in words, by the report on it."""
    return [
        f"that the {event['what']} moved before view {event['before_view']}{_named(event)}, by "
        f"{event['deg']:.2g} degrees and {event['mm']:.2g} mm"
        for event in report.get("moved", ())
    ]


def not_taken(trials: Sequence[Trial]) -> str:
    """What explains more than chance, and was not corrected since the outlines agree as well as
    they are known; "" where nothing does.

    Args:
        trials: in the order in which they were made, the first of the cameras as given.
    """
    for trial in trials[1:]:
        clear = trial.refused == NEEDLESS and trial.gain > _CLEAR_GAIN
        if clear and (words := _WOULD_FIT.get(trial.groups[-1])):
            less = f"{trials[0].left_out_px:.2f} px to {trial.left_out_px:.2f}"
            return words.format(f"{less}, by {trial.gain:.1f} standard errors")
    return ""


def apart_words(report: Report) -> str:
    """How far apart two views were and are, by the report on what was corrected. Of what moved, all
    pairs together do not tell: degrees and millimetres do."""
    before, after = report["before_px"], report["after_px"]
    if report.get("moved"):
        return f"two views are now {after:.2f} px apart (1 sigma)"
    return f"two views were {before:.2f} px apart (1 sigma), now {after:.2f}"


def _named(event: Report) -> str:
    return f" ({event['image']})" if event.get("image") else ""


def refinement_report(found: Refinement) -> Report:
    """As report.json holds it: pixels, degrees, millimetres."""
    report: Report = {
        "corrected": list(found.groups),
        "moved": [
            {
                "what": event.what,
                "before_view": event.first,
                "deg": float(np.rad2deg(event.turn)),
                "mm": 1e3 * event.shift,
            }
            for event in found.breaks
        ],
        "before_px": found.before_px,
        "after_px": found.after_px,
        "before_in_sigmas": found.before,
        "after_in_sigmas": found.after,
        "turntable": found.axis is not None,
        "not_determined": list(found.undetermined),
        "tried": [
            {
                "groups": list(trial.groups),
                "left_out_px": trial.left_out_px,
                "gain_in_standard_errors": trial.gain,
                "better": trial.better,
                "refused": trial.refused,
            }
            for trial in found.trials
        ],
    }
    if found.groups:
        units = np.array([*[np.rad2deg(1)] * 3, 1e3, 1e3, 1e3, 1, 1, 100, 100, -1])
        names = ("rotation_deg", "shift_mm", *_LENS)
        parts = np.split(np.arange(11), [3, 6, 8, 9, 10])
        report["common"] = {
            name: {
                "value": (found.common * units)[part].tolist(),
                "sigma": (found.common_sigma * np.abs(units))[part].tolist(),
            }
            for name, part in zip(names, parts, strict=True)
            if found.common_sigma[part].any()
        }
        report["steps_deg"] = np.rad2deg(found.steps).tolist()
        report["views_px"] = found.views_px.tolist()
        sigma = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
        report["pose_sigma"] = {
            "rotation_deg": np.rad2deg(sigma[:, :3]).max(axis=1).tolist(),
            "shift_mm": (1e3 * sigma[:, 3:]).max(axis=1).tolist(),
        }
    return report
