"""A first pass over a recording that finds masks which hold in all views together."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from msg_adapters import View
from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews, Progress
from occ_recon_ros.bags.writer import choose_storage, new_bag
from occ_recon_ros.errors import UserError
from occ_recon_ros.evaluation.alone import MOST_DOUBTFUL, ROUGH, Alone, filled
from occ_recon_ros.evaluation.base import Base, base_under
from occ_recon_ros.evaluation.figures import Report
from occ_recon_ros.geometry import Contours
from occ_recon_ros.imaging import ContourError, ContourSettings, ContourTracker
from occ_recon_ros.imaging.joint import JointMasks, JointSegmenter, Volume
from occ_recon_ros.imaging.joint.edges import keeps_to_edges
from occ_recon_ros.poses.board_backdrop import BoardBackdrop
from occ_recon_ros.poses.board_outline import outlines_before
from occ_recon_ros.streams.topics import TYPE_NAMES

from .arguments import Values

Mask = NDArray[np.uint8]

WAYS = ("auto", "joint", "single")
_STRANGE = 0.6  # of the usual agreement with the other views (IoU); a hand before it costs less
_LEAST_BELIEF = 0.4  # in masks of all views together, that they are used at all
_SURE = 0.95  # belief in masks that begin from single images, with less of which others are tried
_TILE = 240  # px, the width of a picture on the contact sheet
_COLUMNS = 6


class Segmentation:
    """Masks of a recording, where what its images say one by one does not agree.

    Args:
        way: auto: each image by itself (or the mask that came with it) where its outline agrees
            with the others, all views together where outlines do not; joint: all views
            together; single: one by one.
        volume: where the object is; None: not known.
        backdrop: what the object stands on, where that is known.

    Attributes:
        report: what was done and how far it is to be believed.
    """

    name = "segmentation"

    def __init__(
        self,
        way: str = "auto",
        volume: Volume | None = None,
        backdrop: BoardBackdrop | None = None,
    ) -> None:
        if way not in WAYS:
            raise UserError(f"--segment {way}: must be one of {', '.join(WAYS)}")
        self._way, self._volume, self._backdrop = way, volume, backdrop
        self.report: Report = {"way": "single"}

    @property
    def bounded(self) -> bool:
        """Whether it is known where the object ends and what it stands on begins."""
        return self._volume is not None or self._backdrop is not None

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
        if self._way == "single":
            return Changes()
        kept: Mapping[int, Mask] | None = None
        refuted: Mapping[int, str] = {}
        out: dict[int, str] = {}  # views that are left out, and why
        # In a single image nothing tells the object from what it stands on.
        if self._way == "auto" and (self._volume is None or views.masked()):
            alone = Alone.of(views, progress)
            kept, refuted, out = alone.agreeing, alone.refuted, dict(alone.misplaced)
            if not alone.doubts:
                return self._as_given(views, out)
            self.report["single_images"] = list(alone.doubts)
        misplaced = dict(out)
        try:
            found = self._jointly(views, kept, progress, out)
            strangers = _strangers(found, out)
            if strangers:
                out |= strangers
                found = self._jointly(views, kept, progress, out)
            if kept and found.belief < _SURE and not views.masked():
                # Outlines of single images agree with each other on a shadow as well.
                with suppress(ContourError):
                    other = self._jointly(views, {}, progress, out)
                    if other.belief > found.belief:
                        found, kept = other, {}
        except ContourError as error:
            self.report["warnings"] = [f"no masks from all views together: {error}"]
            return self._as_given(views, misplaced)
        if found.belief < _LEAST_BELIEF and self._way == "auto":
            self.report["warnings"] = [
                f"masks from all views together are not to be believed ({found.belief:.2f}) and "
                "not used",
                *found.warnings,
            ]
            return self._as_given(views, misplaced)
        self.report |= {
            "way": found.method,
            "belief": found.belief,
            "warnings": list(found.warnings),
            "agreement": [view.agreement for view in found.views],
            "bad_views": dict(refuted) | out,
        }
        masks = {}
        rows = iter(range(len(found.views)))  # of those that were looked at together
        for k, view in enumerate(views):
            if k in out:
                masks[view.stamp_ns] = _nothing(view)
                continue
            given = view.mask if kept is None else kept.get(view.stamp_ns)
            row = next(rows)
            mask = self._mask(found, row, view, given)
            if view.mask is not None and keeps_to_edges(view.image, view.mask, mask):
                # Where its image shows the outline that came, not the one that others ask for,
                # the pose is off: no reason to draw it anew, nor to call the view bad.
                mask = view.mask
                self.report["bad_views"].pop(k, None)
            elif found.views[row].bad:
                self.report["bad_views"][k] = found.views[row].why
            masks[view.stamp_ns] = mask
            progress(k + 1, len(views))
        return Changes(masks=masks)

    def _as_given(self, views: BagViews, out: Mapping[int, str]) -> Changes:
        """What came with the views, but for those that are left out."""
        if not out:
            return Changes()
        self.report |= {"way": "given", "bad_views": dict(out)}
        given = {
            view.stamp_ns: _nothing(view) if k in out else view.mask for k, view in enumerate(views)
        }
        return Changes(masks={stamp: mask for stamp, mask in given.items() if mask is not None})

    def _mask(self, found: JointMasks, k: int, view: View, given: Mask | None) -> Mask:
        if self._backdrop is None:
            return found.mask(k, view.image, given)
        known = self._backdrop.picture(view.image, view.camera)
        mask = found.mask(k, view.image, given, known)
        return filled(outlines_before(view.image, *known, mask), view.image.shape)

    def _jointly(
        self,
        views: BagViews,
        kept: Mapping[int, Mask] | None,
        progress: Progress,
        out: Collection[int],
    ) -> JointMasks:
        segmenter = JointSegmenter(self._volume, backdrop=self._backdrop)
        for k, view in enumerate(views):
            if k not in out:
                given = view.mask if kept is None else kept.get(view.stamp_ns)
                segmenter.add(view.image, view.camera, given)
            progress(k + 1, len(views))
        return segmenter.solve()


def _nothing(view: View) -> Mask:
    return np.zeros(view.image.shape[:2], np.uint8)


def _strangers(found: JointMasks, out: Collection[int]) -> dict[int, str]:
    """Views that show something else than the rest, such as the empty rig, and why: they spoil
    what is learnt of all views together."""
    agreement = np.array([view.agreement for view in found.views])
    numbers = [k for k in range(len(agreement) + len(out)) if k not in out]
    strange = agreement < _STRANGE * np.median(agreement)
    if strange.sum() > MOST_DOUBTFUL * len(agreement):
        return {}
    return {
        numbers[i]: f"it agrees with the others by {agreement[i]:.0%} only, and was left out"
        for i in np.flatnonzero(strange)
    }


def segment(
    source: Path,
    target: Path,
    way: str,
    storage: str | None,
    overwrite: bool,
    progress: Progress,
    values: Values | None = None,
) -> Report:
    """Write a bag again with masks, and beside it a contact sheet to look at.

    Raises:
        UserError: a bag that cannot be read or written, or no masks were found.
    """
    views = BagViews(source)
    step = Segmentation(way)
    step.configure((values or {}).get("contour_tracker", {}))
    views.changes = step(views, progress)
    if views.changes.masks is None and step.report["way"] == "single":
        if step.report.get("warnings"):
            raise UserError(f"{source}: {step.report['warnings'][0]}")
        # A rough outline of a small object is a pixel too large: these are to a part of a pixel.
        views.changes = Changes(masks=Alone.of(views, progress, ContourSettings()).masks)
    base = None if step.bounded else base_under(_outlines(views))
    if base is not None:
        how = f"if it is not of the object: {base.options()}"
        step.report["warnings"] = [*step.report.get("warnings", ()), f"{base.said()}; {how}"]
    sheet = target.with_name(target.name + ".masks.png")
    with new_bag(target, choose_storage(target, storage), overwrite) as writer:
        for message in views.messages():
            writer.write(message.topic, TYPE_NAMES[message.topic], message.time_ns, message.cdr)
    _write_sheet(views, sheet, base)
    return step.report | {"sheet": str(sheet)}


def _outlines(views: BagViews) -> list[Contours]:
    """Of the masks that will be played, without those that show nothing."""
    tracker, found = ContourTracker(ROUGH), []
    for view in views:
        if view.mask is not None and view.mask.any():
            with suppress(ContourError):
                found.append(
                    tracker.process(view.image, view.camera, view.stamp_ns, "object", view.mask)
                )
    return found


def _write_sheet(views: BagViews, path: Path, base: Base | None) -> None:
    """All masks over their images, small, and the edge of what the object stands on."""
    tiles = []
    for k, view in enumerate(views):
        image = view.image if view.image.dtype == np.uint8 else (view.image >> 8).astype(np.uint8)
        colour = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        size = _TILE, max(1, round(_TILE * image.shape[0] / image.shape[1]))
        tile = cv2.resize(colour, size, interpolation=cv2.INTER_AREA)
        if view.mask is not None:
            small = (cv2.resize(view.mask, size, interpolation=cv2.INTER_AREA) > 127).astype(
                np.uint8
            )
            loops, _ = cv2.findContours(small, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(tile, loops, -1, (0, 0, 255), 1)
        if base is not None:
            edge = (view.camera.project(base.edge) + 0.5) * size / np.array(image.shape[1::-1])
            cv2.polylines(tile, [np.rint(edge - 0.5).astype(np.int32)], True, (0, 255, 255), 1)
        cv2.putText(tile, str(k), (4, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 255, 255), 1)
        tiles.append(tile)
    tallest = max(len(tile) for tile in tiles)
    tiles = [np.pad(tile, ((0, tallest - len(tile)), (0, 0), (0, 0))) for tile in tiles]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % _COLUMNS)
    rows = [np.hstack(tiles[k : k + _COLUMNS]) for k in range(0, len(tiles), _COLUMNS)]
    if not cv2.imwrite(str(path), np.vstack(rows)):
        raise UserError(f"cannot write {path}")
