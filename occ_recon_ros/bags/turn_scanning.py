"""Photographs of an object on a turntable, without a board -> rosbag2 with poses."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from occ_recon_ros.errors import UserError
from occ_recon_ros.geometry import Camera
from occ_recon_ros.poses.turn_axis import FEWEST, TOO_FEW, TurnAxis, find_turn_axis

from .photographs import FolderPictures, Pictures, find_masks
from .scan_bag import PosedPicture
from .turn_outlines import TurnOutlines, find_outlines, slow_at_its_ends
from .turn_steps import ALIKE, Steps, even_steps, other_steps, steps_back
from .views import Progress

_NAMED = 8  # images that are named of those left out
_RATE = 0.1  # 1 sigma of the turn that was told where its ends are not: of a video, by hand
_SLOWLY = (
    "The images lie closer together at both ends of the turn than in its middle, as those of an "
    "animation do that starts and stops slowly: have it turn evenly."
)
_NOR = "Of the numbers {}: with these for steps they fit no turn either."
_CLEARLY = 0.8  # times as far apart, what the outlines fit better


@dataclass(frozen=True)
class TurnPoses:
    """What a look at all images gave.

    Attributes:
        axis: the cameras, a row an image that is used.
        names: of these images.
        images: how many there were.
        still: of these, frames of a video that are left out because the table stood still.
        left_out: names of others that are, and why.
        turn_deg: by how much the table was said to turn in all.
        steps: from image to image that it was taken to do so in; 0 for a video.
        outer_px: how far apart the outlines are with one step more, if that is not what it is.
        masks: file of each photograph that has one, by name.
        turned_deg: by how much it turned from the first image that is used to the last.
        distance: of the camera from the axis that was assumed, metres.
        said: what of the steps is not as was told, in sentences.
        inside: the turn was over before the last image.
    """

    axis: TurnAxis
    names: list[str]
    images: int
    still: int
    turn_deg: float
    turned_deg: float
    distance: float
    steps: int
    left_out: Mapping[str, str] = field(default_factory=dict)
    masks: Mapping[str, Path] = field(default_factory=dict)
    outer_px: float = 0.0
    said: tuple[str, ...] = ()
    inside: bool = False

    @property
    def camera(self) -> Camera:
        """The lens."""
        return self.axis.cameras[0]

    @property
    def step_deg(self) -> float:
        """By how much the table turned from one photograph to the next; 0 for a video."""
        return abs(self.turn_deg) * self.axis.rate / self.steps if self.steps else 0.0

    @property
    def report(self) -> dict[str, Any]:
        """As report.json holds it; ``warnings`` are doubts, in words."""
        axis = self.axis
        return {
            "turn_deg": self.turn_deg,
            "turned_deg": self.turned_deg,
            "step_deg": self.step_deg,
            "still_images": self.still + sum(why == ALIKE for why in self.left_out.values()),
            "assumed_distance_m": self.distance,
            "elevation_deg": axis.elevation_deg,
            "focal_px": float(self.camera.K[0, 0]),
            "apart_px": axis.apart_px,
            "rotation_sigma_deg": axis.rotation_deg,
            "focal_sigma_percent": 100 * axis.focal,
            "left_out": dict(self.left_out),
            "warnings": list(axis.doubts),
            "notes": list(self.said),
        }

    @property
    def lines(self) -> list[str]:
        """The result in words."""
        axis = self.axis
        focal = "as given" if not axis.focal else "found too"
        found = [f"left out: {line}" for line in _named(self.left_out)]
        if self.still:
            found.append(f"in {self.still} images the table stood still: they are left out")
        found += self.said
        if self.outer_px:
            found.append(
                f"{self.step_deg:.2f} degrees from image to image: --turn {self.turn_deg:g} is "
                "taken to be from the first image to the last, for so the outlines fit better "
                f"({axis.apart_px:.2f} px apart in place of {self.outer_px:.2f})"
            )
        elif self.steps:
            last = "" if self.inside else ", the last of them behind the last image that is used"
            told = f": --turn {self.turn_deg:g} in {self.steps} steps{last}"
            step = f"{self.step_deg:.2f} degrees from image to image"
            found.append(step if axis.rate != 1.0 else f"{step}{told}")
        if axis.rate != 1.0:
            found.append(
                f"from the first image that is used to the last the table turned by "
                f"{self.turned_deg:.1f} degrees"
            )
        return [
            *found,
            f"{len(self.names)} of {self.images} images are used; the axis was found from their "
            f"outlines: the camera looks down by {axis.elevation_deg:.1f} degrees, focal length "
            f"{self.camera.K[0, 0]:.0f} px ({focal}); outlines {axis.apart_px:.2f} px apart",
            f"the unit is arbitrary: outlines know no scale, so that the camera was taken to be "
            f"{self.distance:g} m from the axis (--distance)",
        ]

    def posed(self, pictures: Pictures) -> Iterator[PosedPicture]:
        """The images that are used, with their cameras and masks."""
        cameras = dict(zip(self.names, self.axis.cameras, strict=True))
        for name, stamp, image in pictures:
            if name in cameras:
                mask, file = self.masks.get(name), pictures.file(name)
                yield PosedPicture(image, cameras[name], stamp, mask, name=name, file=file)


def find_turn(
    pictures: Pictures,
    camera_file: Path | None,
    masks: Path | None,
    turn_deg: float,
    distance: float,
    progress: Progress,
) -> TurnPoses:
    """Look at all images and find the axis that they turned about.

    Args:
        pictures: the images, in equal steps.
        camera_file: camera_info YAML; None: the focal length is found too.
        masks: folder of masks; None: the transparency of images that the object was cut out of,
            else the outlines are found in the images.
        turn_deg: by how much the table turned, as many steps as images; in either direction.
            Less than a whole turn may be from the first to the last, where that fits better.
        distance: of the camera from the axis, metres.
        progress: told the images so far, and all of them.

    Raises:
        UserError: no axis can be had, in words.
    """
    if not 0 < distance < 1e3 or not 0 < abs(turn_deg) <= 3600:
        raise UserError("--distance must be above 0 (metres), --turn a number of degrees")
    by_hand, whole = not isinstance(pictures, FolderPictures), turn_deg % 360 == 0
    turn, rate_sigma = float(np.deg2rad(turn_deg)), _RATE if by_hand else 0.0
    seen = find_outlines(pictures, camera_file, masks, progress)
    steps, wrong = even_steps(seen, whole, by_hand), ""
    others: list[Steps] = []
    try:
        if len(steps.rows) < FEWEST:
            raise ValueError(TOO_FEW.format(len(steps.rows)))
        axis = _axis_of(seen, steps, turn, distance, rate_sigma)
    except ValueError as error:
        axis, wrong = None, str(error)
    looked_for = not by_hand and abs(turn_deg) <= 360 and len(seen.names) >= FEWEST
    back = steps_back(seen, whole) if looked_for else None
    if back is not None:
        axis, steps = _best_of(seen, [back], turn, distance, axis, steps)
    if isinstance(pictures, FolderPictures) and (axis is None or axis.uneven):
        others = other_steps(seen, [file.name for file in pictures.files], whole)
    axis, steps = _best_of(seen, others, turn, distance, axis, steps)
    left_out = {**seen.left_out, **({} if by_hand else steps.left_out)}
    if axis is None:
        causes = [_SLOWLY] if not by_hand and slow_at_its_ends(seen) else []
        causes += [_NOR.format(other.gaps.said()) for other in others[:1] if other.gaps]
        causes += _alike_at_end(seen.names, {} if by_hand else steps.left_out)
        causes += _without(left_out, len(steps.left_out) if by_hand else 0)
        raise UserError(f"{pictures.name}: {_and_more(wrong, causes)}")
    outer_px = 0.0
    if not by_hand and (steps.back or not steps.said) and abs(turn_deg) < 360:
        wider = replace(steps, count=steps.count - 1)
        found = _axis_if_any(seen, wider, turn, distance)
        if found is not None and found.apart_px < _CLEARLY * axis.apart_px:
            axis, steps, outer_px = found, wider, axis.apart_px
    names = [seen.names[k] for k in steps.rows]
    return TurnPoses(
        axis=axis,
        names=names,
        images=seen.images,
        still=len(steps.left_out) if by_hand else 0,
        turn_deg=turn_deg,
        turned_deg=float(np.rad2deg(axis.rate * np.ptp(steps.angles(turn)))),
        distance=distance,
        steps=0 if by_hand else round(steps.count),
        outer_px=outer_px,
        left_out=left_out,
        masks=find_masks(masks, names) if masks is not None and by_hand else seen.masks,
        said=steps.said,
        inside=bool(steps.over),
    )


def _best_of(
    seen: TurnOutlines,
    others: Sequence[Steps],
    turn: float,
    distance: float,
    axis: TurnAxis | None,
    steps: Steps,
) -> tuple[TurnAxis | None, Steps]:
    """The axis that fits best and its steps: those that were told, but where others fit clearly
    better; of others simply the best, how far the table turned being given up last."""
    for other in others:
        if other.free and axis is not None and not axis.uneven:
            break
        rate_sigma = _RATE if other.free else 0.0
        found = _axis_if_any(seen, other, turn, distance, rate_sigma)
        share = 1.0 if steps.said and not other.free else _CLEARLY
        if found is not None and (axis is None or found.apart_px < share * axis.apart_px):
            axis, steps = found, other
    return axis, steps


def _axis_of(
    seen: TurnOutlines, steps: Steps, turn: float, distance: float, rate_sigma: float
) -> TurnAxis:
    contours, angles = [seen.contours[k] for k in steps.rows], steps.angles(turn)
    return find_turn_axis(contours, seen.camera, angles, seen.focal_sigma, distance, rate_sigma)


def _axis_if_any(
    seen: TurnOutlines, steps: Steps, turn: float, distance: float, rate_sigma: float = 0.0
) -> TurnAxis | None:
    try:
        return _axis_of(seen, steps, turn, distance, rate_sigma)
    except ValueError:
        return None


def _alike_at_end(names: Sequence[str], left_out: Mapping[str, str]) -> list[str]:
    """That the last images are all alike, in a sentence; none where at most two are: who forgets to
    end takes the empty table, in which the first of them is used."""
    behind = 0
    while behind < len(names) and left_out.get(names[-1 - behind]) == ALIKE:
        behind += 1
    if not 1 < behind < len(names):
        return []
    return [
        f"{names[-1 - behind]} and the {behind} images behind it are alike: if they do not show "
        "the object, leave out all of them."
    ]


def _without(left_out: Mapping[str, str], still: int) -> list[str]:
    """Which images are left out and why, in one sentence; none if none is."""
    names: dict[str, list[str]] = {}
    for name, why in left_out.items():
        names.setdefault(why, []).append(name)
    reasons = []
    for why, whose in names.items():
        more = [f"{len(whose) - _NAMED} more"] if len(whose) > _NAMED else []
        reasons.append(f"{', '.join([*whose[:_NAMED], *more])} ({why})")
    if still:
        reasons.append(f"{still} images in which the table stood still")
    return [f"Left out: {'; '.join(reasons)}"] if reasons else []


def _and_more(words: str, sentences: list[str]) -> str:
    """Words, and sentences behind them."""
    ended = words if words.endswith(("?", ".")) or not sentences else f"{words}."
    return " ".join([ended, *sentences])


def _named(left_out: Mapping[str, str]) -> Iterator[str]:
    """Names and reasons; of many the first ones, and how many more there are."""
    for name, why in list(left_out.items())[:_NAMED]:
        yield f"{name}: {why}"
    if len(left_out) > _NAMED:
        yield f"{len(left_out) - _NAMED} images more"
