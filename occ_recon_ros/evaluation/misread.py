"""Poses and calibrations that were read another way than they were meant, told by the outlines.

Poses that look past each other are known without an image (``convention``). Where all of them look
at the object, only its silhouettes tell: meant as one of the ways that others write them, they
agree with each other, and as given they do not.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from occ_recon_ros.bags.exposure import numbered
from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import evenly, thinned
from occ_recon_ros.geometry.viewing import seen_by
from occ_recon_ros.imaging import ContourError, ContourSettings, ContourTracker
from occ_recon_ros.poses.convention import OTHER_CONVENTIONS, QUATERNION_ORDERS
from occ_recon_ros.poses.refine_break import parted_at
from occ_recon_ros.poses.refine_tangencies import hulls_of
from occ_recon_ros.surface.cone import Cone
from occ_recon_ros.surface.covering import body_iou
from occ_recon_ros.surface.hull import Hull

_VIEWS = 24  # that are looked at, spread evenly
_CELLS = 64  # along the body within all outlines
_MUCH = 0.05  # of the silhouettes lost by that body, less of which is no misunderstanding
_BETTER = 0.4  # of that, at most, is left where the poses are read as they were meant
_LEFT = 0.2  # of the silhouettes, at most, is lost then: where nothing agrees, chance loses half
_CUT = 0.02  # of the side of an image, less of which is no cut: principal points are off as much
_NO_SCALE = 0.15  # by which a principal point may be off the middle of any image
_FACTORS = (4.0, 3.0, 2.0, 1.5, 1 / 1.5, 1 / 2, 1 / 3, 1 / 4)  # by which whole sets are resized
_NEAR = 0.1  # of a factor: what the principal point tells of another is no other
_OFF_MIDDLE = 0.25  # of the side of an image, that the principal point may be off its middle

Cameras = Sequence[Camera]
Images = Sequence[Mapping[str, Any]]


def misread(
    contours: Sequence[Contours | None],
    cameras: Cameras,
    numbers: Sequence[int] = (),
    images: Images = (),
) -> str | None:
    """What poses or calibration seem to be, where the outlines contradict them as they are.

    Args:
        contours: of n views, None where there is none.
        cameras: of these, as given; metres, object frame.
        numbers: of these views, if they are not all that there are.
        images: of all, as ``BagViews.images``.

    Returns:
        Words, or None where the outlines agree, or with nothing that is known.
    """
    some = _some(contours, cameras, numbers)
    if len(some) < 4:
        return None
    seen, given = [c for c, _, _ in some], [k for _, k, _ in some]
    lost = _lost(seen, given)
    if lost < _MUCH:
        return None
    left = {words: _lost(seen, change(given)) for words, change in _others(given).items()}
    most = min(_BETTER * lost, _LEFT)
    # Of images that were cut about another point than their middle another size leaves .1.
    most_of = dict.fromkeys(_scalings(given), min(most, _MUCH))
    agreeing = [words for words in left if left[words] < most_of.get(words, most)]
    if agreeing or lost < _LEFT:
        return min(agreeing, key=lambda words: left[words], default=None)
    return _two_scans(seen, given, [numbered(n, images) for _, _, n in some])


def _some(
    contours: Sequence[Contours | None], cameras: Cameras, numbers: Sequence[int] = ()
) -> list[tuple[Contours, Camera, int]]:
    """The views that are looked at, arguments as ``misread``."""
    views = zip(contours, cameras, numbers or range(len(cameras)), strict=True)
    return [*thinned([(c, k, n) for c, k, n in views if c is not None and len(c) > 2], _VIEWS)]


def resized_so(
    words: str, contours: Sequence[Contours | None], cameras: Cameras
) -> Callable[[Cameras], Cameras] | None:
    """What gives the cameras of images that were resized or cut as ``misread`` says in words of
    these views; None where it says something else."""
    return resized([camera for _, camera, _ in _some(contours, cameras)]).get(words)


def _two_scans(contours: Sequence[Contours], cameras: Cameras, called: Sequence[str]) -> str | None:
    """Where an object fell over so that no motion tells how, or was exchanged for another."""
    first = parted_at(hulls_of(contours, cameras), cameras)
    if first is None:
        return None
    return (
        f"the images seem to be of two scans, up to view {called[first - 1]} and from view "
        f"{called[first]} on, for each of these agrees within itself and not with the other, as "
        "where the object fell over or was exchanged: give the images of one of them alone"
    )


def misread_by_masks(views: BagViews) -> str | None:
    """``misread`` by the masks that came with the views of a bag; None where none did."""
    if not views.masked():
        return None
    tracker = ContourTracker(ContourSettings(refine="none"))
    contours: list[Contours | None] = []
    cameras: list[Camera] = []
    numbers: list[int] = []
    some = evenly(len(views), _VIEWS)
    for number, view in zip(some, views.some(some), strict=True):
        if view.mask is not None:
            with suppress(ContourError):
                given = view.image, view.camera, view.stamp_ns, "object", view.mask
                contours.append(tracker.process(*given))
                cameras.append(view.camera)
                numbers.append(number)
    return misread(contours, cameras, numbers, views.images())


def _others(given: Cameras) -> dict[str, Callable[[Cameras], Cameras]]:
    found: dict[str, Callable[[Cameras], Cameras]] = {
        f"the poses seem to be {words}": _each(change)
        for words, change in {**OTHER_CONVENTIONS, **QUATERNION_ORDERS}.items()
    }
    found |= {
        "the rotations seem to be transposed: give R^T, and t as it is": _each(
            lambda c: replace(c, R_camera_object=c.R_camera_object.T)
        ),
        "t seems to be the place of the camera: give -R t": _each(
            lambda c: replace(c, t_camera_object=-c.R_camera_object @ c.t_camera_object)
        ),
        **resized(given),
        "the poses seem to be in the opposite order of the images: the table turns the other way, "
        "or the images are mirrored": (
            lambda cameras: [
                replace(
                    c, R_camera_object=other.R_camera_object, t_camera_object=other.t_camera_object
                )
                for c, other in zip(cameras, cameras[::-1], strict=True)
            ]
        ),
    }
    if _sides_exchanged(given):
        for way, sign in (("clockwise", 1), ("counter-clockwise", -1)):
            found[
                f"the images seem to be turned by 90 degrees {way} against K and poses: turn them "
                "back, or take them as they were stored"
            ] = _each(lambda c, sign=sign: _turned(c, sign))  # type: ignore[misc]
    return found


def resized(cameras: Cameras) -> dict[str, Callable[[Cameras], Cameras]]:
    """What may have been done to images whose K nobody changed, in words, with what gives the
    cameras that they have then: they were made smaller or larger, or cut."""
    return _scalings(cameras) | _cuts(cameras)


def _scalings(cameras: Cameras) -> dict[str, Callable[[Cameras], Cameras]]:
    """That K is of images some times as large, which have their middle near the principal point."""
    guess = _image_scale(cameras)
    factors = [s for s in _FACTORS if abs(guess / s - 1) < 2 * _OFF_MIDDLE]
    if abs(np.log(guess)) > _NO_SCALE and all(abs(guess / s - 1) > _NEAR for s in factors):
        factors.append(guess)
    found: dict[str, Callable[[Cameras], Cameras]] = {}
    for s in factors:
        about = "about " * (s not in _FACTORS)
        do, by = ("divide", s) if s > 1 else ("multiply", 1 / s)
        found[
            f"K seems to be of images {about}{s:.2g} times as large as these: {do} fx, fy, "
            f"cx + 0.5 and cy + 0.5 by {by:.2g}"
        ] = _each(lambda c, s=s: _of_smaller(c, s))  # type: ignore[misc]
    return found


def _of_smaller(camera: Camera, times: float) -> Camera:
    """The camera of an image that was made so many times smaller; edges stay edges, half a pixel
    before the first."""
    K = np.diag([1 / times, 1 / times, 1.0]) @ camera.K
    K[:2, 2] += 0.5 / times - 0.5
    return replace(camera, K=K)


def _cuts(cameras: Cameras) -> dict[str, Callable[[Cameras], Cameras]]:
    """What images may have been cut by whose K is of the whole ones, in words, with what gives the
    cameras that they have then: those had the principal point in their middle, and where it is too
    far to the right now, their left side may be gone, or as much at both sides."""
    at = np.median([c.K[:2, 2] for c in cameras], axis=0)
    size = np.median([[c.width, c.height] for c in cameras], axis=0)
    gone = np.where((lacks := 2 * at + 1 - size) > _CUT * size, lacks, 0.0)
    found: dict[str, Callable[[Cameras], Cameras]] = {}
    for shares in product((0.0, 0.5, 1.0), repeat=2):
        off = np.array(shares) * gone
        if not np.all(off.astype(bool) == np.array(shares, bool)) or not off.any():
            continue
        sides = [
            f"{px:.0f} px {side}{' and as much on the other side' if share < 1 else ''}"
            for px, side, share in zip(off, ("on the left", "at the top"), shares, strict=True)
            if px
        ]
        less = [f"{px:.0f} off c{axis}" for px, axis in zip(off, "xy", strict=True) if px]
        words = f"the images seem to be cut by {' and '.join(sides)}, with K of whole ones"
        shift = np.zeros((3, 3))
        shift[:2, 2] = off
        found[f"{words}: take {' and '.join(less)}"] = _each(
            lambda c, shift=shift: replace(c, K=c.K - shift)  # type: ignore[misc]
        )
    return found


def _sides_exchanged(cameras: Cameras) -> bool:
    """Whether the principal point is in the middle of images as high as these are wide."""
    at = np.median([c.K[:2, 2] for c in cameras], axis=0)
    size = np.median([[c.width, c.height] for c in cameras], axis=0)
    off, other = (np.linalg.norm(at / sides - 0.5) for sides in (size, size[::-1]))
    return bool(other < off)


def _turned(camera: Camera, sign: int) -> Camera:
    """The camera of an image that was turned by 90 degrees, clockwise where the sign is 1; without
    its distortion across the radius."""
    (fx, _, cx), (_, fy, cy), _ = camera.K
    cx, cy = (camera.width - 1 - cy, cx) if sign > 0 else (cy, camera.height - 1 - cx)
    turn = np.array([[0.0, -sign, 0], [sign, 0, 0], [0, 0, 1]])
    return replace(
        camera,
        K=np.array([[fy, 0, cx], [0, fx, cy], [0, 0, 1]]),
        R_camera_object=turn @ camera.R_camera_object,
        t_camera_object=turn @ camera.t_camera_object,
    )


def _each(change: Callable[[Camera], Camera]) -> Callable[[Cameras], Cameras]:
    return lambda cameras: [change(camera) for camera in cameras]


def _image_scale(cameras: Cameras) -> float:
    """How many times larger images would have their middle at the principal point."""
    sides = np.array([(c.K[:2, 2] + 0.5) / (c.width, c.height) for c in cameras])
    return float(2 * np.clip(np.median(sides), 1e-3, 1e3))


def _lost(contours: Sequence[Contours], cameras: Cameras) -> float:
    """Share of the silhouettes that the body within all of them leaves out, 1 - IoU; 1 where none
    is left, as where cameras look past each other."""
    try:
        again = [seen_by(camera, c) for c, camera in zip(contours, cameras, strict=True)]
        hull = Hull([Cone(c) for c in again])
        return 1 - float(body_iou(hull.mesh(_CELLS), again).mean()) if hull.bounded else 1.0
    except (ValueError, FloatingPointError):
        return 1.0
