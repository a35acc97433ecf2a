"""Views that the others leave out, looked at by themselves: whether they show no object, show it in
another light, or show it as another view should."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from msg_adapters import View
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import evenly
from occ_recon_ros.imaging.joint import JointMasks
from occ_recon_ros.imaging.joint.edges import faint, in_small, small_contrast
from occ_recon_ros.streams.together import MOVED

Mask = NDArray[np.uint8]

SHOWS_NOTHING = "it shows no object"
_IN_PLACE = 0.2  # of the outline that others ask for without an edge: it is only lit otherwise
_NOWHERE = 0.8  # of that, without an edge: nothing stands there
_KEPT = "but it shows edges where the others ask for its outline: drawn there"
_APART = 0.5  # IoU, below which two masks show different places
_ELSEWHERE = 0.4  # of the outline of another view without an edge: of a neighbour's half is
_LESS = 0.5  # times the share without an edge where its own pose has it
_POSES = 60  # in which an image is looked at, at most
_ALIKE = 0.25  # of what others differ by from an image that shows no object: it shows none either
_THINNED = 4  # every so many-th row and column of small images tells as much of that


@dataclass
class LeftOut:
    """What views show that are left out.

    Attributes:
        words: what is to be said of them, by their numbers, where more is known than before.
        masks: (h, w) of those that are used all the same, by stamp.
        elsewhere: (h, w) of those that show the object as another view should, by stamp.
    """

    words: dict[int, str] = field(default_factory=dict)
    masks: dict[int, Mask] = field(default_factory=dict)
    elsewhere: dict[int, Mask] = field(default_factory=dict)


@dataclass(frozen=True)
class _Lost:
    """A view in small, where the others ask for the object in it, and the share of the outline of
    that which is without an edge."""

    small: Mask
    place: NDArray[np.bool_]
    edgeless: float


def look_at(
    views: BagViews,
    found: JointMasks,
    contrasts: Sequence[NDArray[np.float32]],
    out: Collection[int],
    strangers: Mapping[int, str],
    camera_of: Callable[[View], Camera],
) -> LeftOut:
    """Look at the views that are left out.

    Args:
        views: all of them.
        found: masks of the others.
        contrasts: along the outlines of these, as ``small_contrast``.
        out: numbers of the views that are left out.
        strangers: those of them that show something else than the rest, and what.
        camera_of: that of a view, in the frame in which the masks were found.
    """
    told = LeftOut()
    cameras = list[Camera]()
    faces, lost = dict[int, Mask](), dict[int, _Lost]()
    for k, view in enumerate(views):
        cameras.append(camera_of(view))
        if k not in out:
            small = in_small(view.image, np.zeros(view.image.shape[:2], np.uint8))[0]
            faces[k] = small[::_THINNED, ::_THINNED]
            continue
        mask = found.by_others(view.image, cameras[k])
        why = strangers.get(k) or _elsewhere(view.mask, mask)
        small, inside, picture = in_small(view.image, mask)
        own = small_contrast(small, inside, picture)
        edgeless = float(faint([*contrasts, own])[-1])
        if why and len(own) and edgeless < _IN_PLACE:
            told.masks[view.stamp_ns] = mask
            # What is in its place was not moved.
            told.words[k] = f"{why.removesuffix(MOVED)}; {_KEPT}"
        elif k in strangers:
            lost[k] = _Lost(small, inside, edgeless)
    poses = dict[int, int]()
    for k, one in lost.items():
        if (other := _as_another(k, one, found, contrasts, cameras)) is not None:
            poses[k] = other
            what = f"it seems to show what view {other} should"
            told.words[k] = f"{what}: its pose may be wrong; left out"
    empty = {k for k in lost if k not in poses and lost[k].edgeless > _NOWHERE}
    sure = [lost[k] for k in empty]
    empty |= {k for k in lost if k not in poses and _alike(lost[k], sure, faces)}
    told.words |= dict.fromkeys(empty, f"{SHOWS_NOTHING} where the others have it; left out")
    for k, view in zip(sorted(poses), views.some(poses), strict=True):
        told.elsewhere[view.stamp_ns] = found.by_others(view.image, _at(cameras, k, poses[k]))
    return told


def _as_another(
    k: int,
    view: _Lost,
    found: JointMasks,
    contrasts: Sequence[NDArray[np.float32]],
    cameras: Sequence[Camera],
) -> int | None:
    """The view, in whose pose the image of view k shows edges where the others ask for the outline;
    None of none."""
    some = [j for j in evenly(len(cameras), _POSES).tolist() if j != k]
    size = view.small.shape[1::-1]
    shares = []
    for j in some:
        mask = found.by_others(view.small, _at(cameras, k, j).resized(*size))
        own = small_contrast(*in_small(view.small, mask))
        shares.append(float(faint([*contrasts, own])[-1]) if len(own) else 1.0)
    best = int(np.argmin(shares)) if some else 0
    fits = bool(some) and shares[best] < min(_ELSEWHERE, _LESS * view.edgeless)
    return some[best] if fits else None


def _at(cameras: Sequence[Camera], k: int, j: int) -> Camera:
    """The camera of view k in the pose of view j."""
    there = cameras[j]
    R, t = there.R_camera_object, there.t_camera_object
    return replace(cameras[k], R_camera_object=R, t_camera_object=t)


def _alike(view: _Lost, empty: Sequence[_Lost], others: Mapping[int, Mask]) -> bool:
    """Whether a view shows in the place of the object what one without it shows, as of a camera
    that stands still."""
    thin = slice(None, None, _THINNED), slice(None, None, _THINNED)
    place, face = view.place[thin], view.small[thin]
    if not place.any():
        return False

    def apart(one: Mask, other: Mask) -> float:
        if one.shape != other.shape:
            return np.inf
        return float(cv2.absdiff(one, other)[place].mean())

    for one in empty:
        usual = [d for own in others.values() if np.isfinite(d := apart(own, one.small[thin]))]
        if usual and apart(face, one.small[thin]) < _ALIKE * float(np.median(usual)):
            return True
    return False


def _elsewhere(given: Mask | None, found: Mask) -> str:
    """What is to be said of a mask that came and shows another place than the one found; else "":
    of a wrong pose nearly the same is seen there."""
    if given is None or given.shape != found.shape:
        return ""
    one, other = given > 127, found > 127
    both, either = np.count_nonzero(one & other), np.count_nonzero(one | other)
    return "its mask shows another place" if both < _APART * either else ""
