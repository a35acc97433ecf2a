"""Masks of a recording that hold in all its views together."""

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters import View
from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews, Progress, doing
from occ_recon_ros.errors import UserError
from occ_recon_ros.geometry import Camera
from occ_recon_ros.imaging import ContourError, ContourSettings
from occ_recon_ros.imaging.joint import JointMasks, JointSegmenter, Volume
from occ_recon_ros.imaging.joint.edges import (
    SOME_WITHOUT_EDGE,
    in_small,
    keeps_to_edges,
    small_contrast,
)
from occ_recon_ros.imaging.joint.judge import support_doubt
from occ_recon_ros.imaging.joint.masks import LEAST_BELIEF, Trial
from occ_recon_ros.poses.board_backdrop import BoardBackdrop
from occ_recon_ros.poses.board_outline import outlines_before
from occ_recon_ros.streams.alone import MANY, filled
from occ_recon_ros.streams.together import SURE, better, strangers_among

from .alone import Alone, at_edges
from .figures import Report
from .left_out import look_at
from .misread import misread_by_masks
from .sheet import Sheet, held_sheet, not_drawn, sheet_in
from .torn import no_better_drawn
from .trimmed import CUT, part_words

Mask = NDArray[np.uint8]

WAYS = ("auto", "joint", "single")
_AGREED = 0.98  # of views and body, where masks before a sheet are right


class Segmentation:
    """Masks of a recording, where what its images say one by one does not agree.

    Args:
        way: auto: each image by itself (or the mask that came with it) where its outline agrees
            with the others, all views together where outlines do not; joint: all views
            together; single: one by one.
        volume: where the object is; None: not known.
        backdrop: what the object stands on, where that is known; None: a printed sheet is looked
            for in the images, where neither masks nor a volume tell of the object.
        images_alone: masks that came are not looked at.
        to_correct: whether poses are corrected afterwards.

    Attributes:
        way: as given.
        off_edges: sentences on masks that came and lie beside the edges of their images.
        elsewhere: masks (h, w) of views that show the object as another view should, by stamp;
            they are left out.
        misread: whether masks that came tell that poses or calibration were meant another way, or
            hold a printed sheet: nothing else is asked of them.
        report: what was done and how far it is to be believed.
    """

    name = "segmentation"

    def __init__(
        self,
        way: str = "auto",
        volume: Volume | None = None,
        backdrop: BoardBackdrop | None = None,
        images_alone: bool = False,
        to_correct: bool = True,
    ) -> None:
        if way not in WAYS:
            raise UserError(f"segment {way}: must be one of {', '.join(WAYS)}")
        self.way, self._volume, self._backdrop = way, volume, backdrop
        self._sheet: Sheet | None = None  # that was found
        self._images_alone, self._to_correct = images_alone, to_correct
        self._alone = Alone({}, (), {}, {}, {})  # what each view says by itself, once it was asked
        self.off_edges: Sequence[str] = ()
        self._at_edges = Changes()  # masks that lay beside the edges of their images, drawn there
        self._guess: Mapping[int, Mask] = {}  # by stamp, of which only the colours are begun from
        self._strangers: Mapping[int, str] = {}  # views that show something else, and what
        self._attempts = 0  # at all views together, so far
        self._like: Trial | None = None  # that found the best masks so far
        self.misread = False
        self.elsewhere: Mapping[int, Mask] = {}
        self.report: Report = {"way": "single"}

    @property
    def bounded(self) -> bool:
        """Whether it is known where the object ends and what it stands on begins."""
        return self._volume is not None or self._backdrop is not None or self._sheet is not None

    @property
    def on_sheet(self) -> bool:
        """Whether the masks are those before a printed sheet that was found in the images, by which
        cameras were placed."""
        return self._sheet is not None

    def anew(self, images_alone: bool = False) -> "Segmentation":
        """The same, to be asked of all views together."""
        found = Segmentation("joint", self._volume, self._backdrop, images_alone)
        found._like = None if images_alone else self._like
        return found

    def configure(self, values: Mapping[str, Any]) -> None:
        """Take the scan volume from parameters of the tracker.

        Raises:
            UserError: a volume that is none.
        """
        names = {item.name for item in fields(ContourSettings) if item.name.startswith("volume_")}
        given = {name: value for name, value in values.items() if name in names}
        try:
            volume = Volume.of(ContourSettings(**given))
        except (TypeError, ValueError) as error:
            raise UserError(f"contour_tracker: {error}") from None
        if volume is not None and not (volume.kind == "plane" and self._backdrop is not None):
            self._volume = volume  # what is known to lie on a plane tells more than the plane

    def __call__(self, views: BagViews, progress: Progress) -> Changes:
        """Look at all views; the masks to be played, or none where none are needed."""
        changes = self._looked(views, progress)
        if views.masked() and not (self._images_alone or self.misread or "not_used" in self.report):
            self._take_told(views.told_of_masks())
        return changes

    def _take_told(self, told: Mapping[str, Any]) -> None:
        """What whoever found the masks that came thinks of them holds while they are used."""
        self.report = {"belief": told["belief"], **self.report} if "belief" in told else self.report
        for kind in ("warnings", "notes"):
            if said := [*told.get(kind, ()), *self.report.get(kind, ())]:
                self.report[kind] = list(dict.fromkeys(said))
        if bad := {**told.get("bad_views", {}), **self.report.get("bad_views", {})}:
            self.report["bad_views"] = bad

    def _looked(self, views: BagViews, progress: Progress) -> Changes:
        if self.way == "single":
            return Changes()
        if self.way == "auto" and (meant := misread_by_masks(views) or held_sheet(views)):
            self.report["warnings"] = [meant]  # what else could be said of masks would be wrong
            self.misread = True
            return Changes()
        bare = self._images_alone or not views.masked()
        found = None if self.bounded or not bare else sheet_in(views)
        if found is not None and found.board is None:
            self.report["sheet"] = {"advice": not_drawn(found)}
        elif found is not None:
            self._sheet = Sheet(found)
        known = views.changes
        try:
            changes = self._masks(views, progress)
            changes = self._at_edges.then(changes)
        finally:
            views.changes = known
        if self._sheet is not None and changes.masks is None:
            # Nothing stands out from it: as if it were not known.
            self._sheet, self.report = None, {"way": "single"}
            changes = self._masks(views, progress)
        elif self._sheet is not None:
            self.report["notes"] = [self._sheet.words, *self.report.get("notes", ())]
        if self._attempts:
            self.report["attempts"] = self._attempts
        if self._alone.corrected:
            self.report["bad_views"] = {**self._alone.corrected, **self.report.get("bad_views", {})}
        if self.off_edges and "not_used" not in self.report:
            self.report["warnings"] = [*self.off_edges, *self.report.get("warnings", ())]
        return changes

    def _masks(self, views: BagViews, progress: Progress) -> Changes:
        kept: Mapping[int, Mask] | None = {} if self._images_alone else None
        # In a single image nothing tells the object from what it stands on.
        given = self._volume is not None or self._sheet is not None
        if self.way == "auto" and (not given or views.masked()):
            alone = self._alone = self._each_alone(views, progress)
            parted = bool(alone.trimmed or alone.lacking)
            known = len(alone.agreeing) + len(alone.lacking)
            if not alone.doubts or (parted and known == len(views)):
                return self._as_given(views)
            self.report["single_images"], kept = list(alone.doubts), alone.agreeing
        try:
            found, kept = self._together(views, kept, progress)
        except ContourError as error:
            self.report["warnings"] = [f"no masks from all views together: {error}"]
            return self._as_given(views)
        if found.belief < LEAST_BELIEF and self.way == "auto" and not self._clear(found):
            what = f"masks from all views together are not to be believed ({found.belief:.2f})"
            self.report["warnings"] = [f"{what} and not used", *found.warnings]
            return self._as_given(views)
        if kept is not None and not kept and views.masked():
            # What is wrong with masks that are not used is no doubt.
            against = [*self.off_edges, *self.report.get("single_images", ())]
            self.report["not_used"] = next(iter(against), "images are asked alone")
        left_out = {k: f"{why}; left out" for k, why in self._strangers.items()}
        out = dict(self._alone.misplaced) | left_out
        self._take(found, dict(self._alone.refuted) | out)
        changes = self._found(found, views, kept, progress, out)
        if not (self._images_alone or "not_used" in self.report):
            self._say_what_was_cut(len(views))
        return changes

    def _say_what_was_cut(self, count: int) -> None:
        """Into the report, of so many views, what was cut off masks that hold a part which others
        leave out."""
        cut, lacking = self._alone.trimmed, self._alone.lacking
        masks = count - len(self._alone.bare)
        if len(cut) > MANY * masks or lacking:  # so many that nobody is sure
            what = part_words(cut, lacking, masks)
            self.report["warnings"] = [*self.report.get("warnings", ()), what]
        said = {k: CUT.format(own.share) for k, own in cut.items()}
        self.report["bad_views"] = said | dict(self.report.get("bad_views", {}))

    def _each_alone(self, views: BagViews, progress: Progress) -> Alone:
        """Each view by itself; masks that were drawn at the edges of their images are those of the
        views from now on."""
        doing(progress, "each view alone")
        alone = at_edges(views, progress, self._to_correct)
        if alone.redrawn:
            self._at_edges = Changes(masks=alone.redrawn)
            views.changes = views.changes.then(self._at_edges)
            self.report["notes"] = [f"{next(iter(alone.off_edges))}: they were drawn there"]
            alone = replace(alone, off_edges=())
        # Whether outlines lie on edges was weighed where they were found in these images.
        self.off_edges = () if "belief" in views.told_of_masks() else alone.off_edges
        if alone.bare:
            self.report["without_masks"] = list(alone.bare)
            self.report["masked_ns"] = list(alone.masks)
        return alone

    def _together(
        self, views: BagViews, kept: Mapping[int, Mask] | None, progress: Progress
    ) -> tuple[JointMasks, Mapping[int, Mask] | None]:
        """All views together, and the masks that they began from: those that are kept, or none
        where that tells more.

        Raises:
            ContourError: nothing is found in all of them.
        """
        found, strangers = self._without_strangers(views, kept, progress)
        unsure = not views.masked() and min(found.belief, found.support) < SURE
        if unsure and (kept or self._alone.masks):
            # Outlines of single images agree with each other on a shadow as well; and where
            # they are wrong at places alone, they tell colours better than where all look.
            self._guess, self._like = {} if kept else self._alone.masks, found.trial
            with suppress(ContourError):
                other = self._without_strangers(views, {}, progress)
                # What explains all views is believed before what leaves some out.
                all_told = other[0].belief >= SURE and len(other[1]) < len(strangers)
                if all_told or better(other[0], found, guessed=bool(self._guess)):
                    (found, strangers), kept = other, {}
        self._like, self._strangers = found.trial, strangers
        return found, kept

    def _take(self, found: JointMasks, bad_views: Mapping[int, str]) -> None:
        """Into the report, what is to be thought of masks of all views together."""
        belief, doubts = found.belief, list(found.warnings)
        if self._clear(found):
            belief = max(belief, found.agreement * (1 - found.edgeless))
            doubts = [words for words in doubts if words != support_doubt(found.support)]
        self.report |= {
            "way": found.method,
            "belief": belief,
            "warnings": doubts,
            "agreement": [view.agreement for view in found.views],
            "bad_views": dict(bad_views),
        }
        if found.notes:
            self.report["notes"] = [*self.report.get("notes", ()), *found.notes]

    def _found(
        self,
        found: JointMasks,
        views: BagViews,
        kept: Mapping[int, Mask] | None,
        progress: Progress,
        out: Collection[int],
    ) -> Changes:
        """The masks of all views together, but for those that came and hold by their image."""
        masks = {}
        contrasts = []
        doing(progress, "masks")
        rows = iter(range(len(found.views)))  # of those that were looked at together
        for k, view in enumerate(views):
            progress(k + 1, len(views))
            if k in out:
                masks[view.stamp_ns] = _nothing(view)
                continue
            row = next(rows)
            mask = self._mask(found, row, view, _given(view, kept))
            cut = self._alone.trimmed.get(k)
            came = view.mask if cut is None else cut.mask
            held = None if self._images_alone or k in self._alone.torn else came
            if held is not None and keeps_to_edges(view.image, held, mask):
                # Where its image shows the outline that came, not the one that others ask for,
                # the pose is off: no reason to draw it anew, nor to call the view bad.
                mask = held
                self.report["bad_views"].pop(k, None)
            elif found.views[row].bad:
                self.report["bad_views"][k] = found.views[row].why
            masks[view.stamp_ns] = mask
            if out:
                contrasts.append(small_contrast(*in_small(view.image, mask)))
        if out:
            told = look_at(views, found, contrasts, out, self._strangers, self._camera)
            masks |= told.masks
            self.report["bad_views"] |= told.words
            self.elsewhere = told.elsewhere
        masks |= no_better_drawn(views, kept or {}, masks, self._alone.torn.difference(out))
        return Changes(masks=masks)

    def _as_given(self, views: BagViews) -> Changes:
        """What came with the views, but for those that are left out, and what the others refute."""
        cut, out = self._alone.trimmed, self._alone.misplaced
        if not out and not cut:
            return Changes()
        self.report |= {"way": "given", "bad_views": dict(out)}
        self._say_what_was_cut(len(views))
        given = {
            view.stamp_ns: _nothing(view) if k in out else cut[k].mask if k in cut else view.mask
            for k, view in enumerate(views)
        }
        return Changes(masks={stamp: mask for stamp, mask in given.items() if mask is not None})

    def _mask(self, found: JointMasks, k: int, view: View, given: Mask | None) -> Mask:
        if (backdrop := self._drawn) is None:
            return found.mask(k, view.image, given)
        known = backdrop.picture(view.image, self._camera(view))
        mask = found.mask(k, view.image, given, known)
        return filled(outlines_before(view.image, *known, mask), view.image.shape)

    @property
    def _drawn(self) -> BoardBackdrop | None:
        return self._backdrop if self._sheet is None else self._sheet.backdrop

    def _camera(self, view: View) -> Camera:
        """Of a view, in the frame in which all views are looked at together."""
        camera = self._alone.cameras.get(view.stamp_ns, view.camera)
        return camera if self._sheet is None else self._sheet.camera(view, camera)

    def _clear(self, found: JointMasks) -> bool:
        """Whether masks before a sheet that was found are right: the paper is not lit as evenly as
        it is drawn, so that its colours confirm little, but views and edges agree."""
        agreed = found.agreement > _AGREED and found.edgeless <= SOME_WITHOUT_EDGE
        return self.on_sheet and agreed

    def _without_strangers(
        self,
        views: BagViews,
        kept: Mapping[int, Mask] | None,
        progress: Progress,
    ) -> tuple[JointMasks, dict[int, str]]:
        """All views together but for those that are misplaced and those that show something else,
        and the latter, and why."""
        out = self._alone.misplaced

        def strange(found: JointMasks) -> dict[int, str]:
            return strangers_among(found, out, self._alone.contrary)

        def asks_again(found: JointMasks) -> bool:
            return self._clear(found) or bool(strange(found))

        found = self._jointly(views, kept, progress, out, asks_again)
        strangers = strange(found)
        if strangers:
            found = self._jointly(views, kept, progress, {*out, *strangers}, self._clear)
        return found, strangers

    def _jointly(
        self,
        views: BagViews,
        kept: Mapping[int, Mask] | None,
        progress: Progress,
        out: Collection[int],
        asks_again: Callable[[JointMasks], bool] = lambda _: False,
    ) -> JointMasks:
        self._attempts += 1
        attempt = f"all views together, attempt {self._attempts}"
        doing(progress, attempt)
        segmenter = JointSegmenter(self._volume, backdrop=self._drawn)
        segmenter.trying = lambda trial: doing(progress, f"{attempt}, trial {trial}")
        for k, view in enumerate(views):
            if k not in out:
                guess = self._guess.get(view.stamp_ns)
                segmenter.add(view.image, self._camera(view), _given(view, kept), guess)
            progress(k + 1, len(views))
        return segmenter.solve(asks_again, self._like)


def _given(view: View, kept: Mapping[int, Mask] | None) -> Mask | None:
    """The mask that a view begins from: of those that were kept, or any that came with it."""
    return view.mask if kept is None else kept.get(view.stamp_ns)


def _nothing(view: View) -> Mask:
    return np.zeros(view.image.shape[:2], np.uint8)
