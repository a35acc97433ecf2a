"""Masks of all views of a turn, from their images and cameras."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from ...geometry import Camera
from ..padding import picture_area
from ..segment import to_uint8
from ..settings import ContourError
from .cuts import cut_image
from .evidence import Mask, SmallView, small_view
from .judge import ViewReport, judge
from .solve import Solution, solve
from .space import scaled
from .volume import Volume

_LONG_SIDE = 400  # px, of the images on which the joint pass works
_BAND = 2.0  # voxels about the projected body in which an outline is looked for
_BODY = 6.0  # nats by which the body speaks, away from its outline: more than any colour
_STIFFNESS = 4.0  # nats a pixel of outline where there is no edge
_FINE_BAND = 2.0  # pixels of the small image about its outline, for the whole image
_LEAST_VIEWS = 5


@dataclass(frozen=True)
class JointMasks:
    """The masks of a turn, and how far they are to be believed.

    Attributes:
        method: "joint", by colours and the body that all views see; "given", by the masks that
            came with most views, judged by each other.
        belief: 0 to 1; above 0.7 nothing speaks against the masks, below 0.4 do not use them.
        warnings: sentences on what is doubtful about the whole.
        views: of each view, agreement with the others and whether it is named as bad.
        small: of each view, (h, w) bool, its mask in the size of the joint pass.
    """

    method: str
    belief: float
    warnings: tuple[str, ...]
    views: tuple[ViewReport, ...]
    small: tuple[Mask, ...]
    _solution: Solution = field(repr=False)
    _given: tuple[bool, ...] = field(repr=False)

    def mask(self, k: int, image: NDArray, given: NDArray | None = None) -> NDArray[np.uint8]:
        """The mask of view k in full size, 255 = object.

        Args:
            k: number of the view, in the order in which the views were given.
            image: (h, w) or (h, w, 3) BGR, uint8 or uint16, the image of that view.
            given: (h, w) the mask that came with it, 0 = background: kept where it is good.
        """
        if given is not None and not self.views[k].bad and given.shape == image.shape[:2]:
            return (given > 127).astype(np.uint8) * np.uint8(255)
        image = to_uint8(image)
        height, width = image.shape[:2]
        coarse = self.small[k]
        times = max(1.0, width / coarse.shape[1])
        if times <= 1.0:
            return coarse.astype(np.uint8) * np.uint8(255)
        away = cv2.resize(_signed_distance(coarse), (width, height)) * np.float32(times)
        nats = cv2.resize(self._solution.saying[k], (width, height))
        reach = _FINE_BAND * times
        evidence = nats + _BODY * np.tanh(away / reach)
        free = np.abs(away) < 1.5 * reach
        evidence = np.where(free, evidence, np.where(away > 0, _BODY, -_BODY))
        found = cut_image(evidence.astype(np.float64), free, image, _STIFFNESS)
        return found.astype(np.uint8) * np.uint8(255)


class JointSegmenter:
    """Takes the views of a turn one by one, then finds all their masks.

    segmenter = JointSegmenter()
    for image, camera in views:
        segmenter.add(image, camera)     # keeps a small copy
    masks = segmenter.solve()
    for k, (image, _) in enumerate(views):
        mask = masks.mask(k, image)      # (h, w) uint8, 255 = object
    """

    def __init__(self, volume: Volume | None = None, long_side: int = _LONG_SIDE) -> None:
        self._volume = None if volume is None or volume.kind == "none" else volume
        self._long_side = long_side
        self._views: list[SmallView] = []

    def __len__(self) -> int:
        return len(self._views)

    def add(self, image: NDArray, camera: Camera, mask: NDArray | None = None) -> None:
        """Take a view.

        Args:
            image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
            camera: the view, in the object frame; of the size of the image.
            mask: (h, w) a mask that came with it, 0 = background, 255 = object.

        Raises:
            ContourError: image_size, where image and camera are not of one size.
        """
        if (camera.width, camera.height) != image.shape[1::-1]:
            raise ContourError(
                "image_size",
                f"image is {image.shape[1::-1]} px, camera_info says {camera.width, camera.height}",
            )
        image = to_uint8(image)
        scale = min(1.0, self._long_side / max(image.shape[:2]))
        size = max(1, round(scale * image.shape[1])), max(1, round(scale * image.shape[0]))
        small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        picture = np.zeros((size[1], size[0]), np.bool_)
        picture[picture_area(small)] = True
        given = None
        if mask is not None and mask.shape == image.shape[:2]:
            given = cv2.resize(mask, size, interpolation=cv2.INTER_AREA) > 127
        camera = scaled(camera, size[0] / image.shape[1], *size)
        self._views.append(small_view(small, camera, picture, given))

    def solve(self) -> JointMasks:
        """The masks of all views taken so far.

        Raises:
            ContourError: few_views; no_common_space, where the views do not look at one place;
                no_object, where no body agrees with the views.
        """
        views = self._views
        if len(views) < _LEAST_VIEWS:
            raise ContourError(
                "few_views", f"{len(views)} views: masks from all views need {_LEAST_VIEWS}"
            )
        try:
            found = solve(views, self._volume)
        except ValueError as error:
            raise ContourError("no_common_space", str(error)) from None
        if found is None:
            raise ContourError("no_object", "nothing stands out from the backdrop in all views")
        small = tuple(
            _outline(view, nats, outline, found.footprint)
            for view, nats, outline in zip(views, found.saying, found.outlines, strict=True)
        )
        reports, belief, warnings = judge(views, found, small)
        given = tuple(view.given is not None for view in views)
        return JointMasks(
            "given" if np.mean(given) >= 0.5 else "joint",
            belief,
            tuple(warnings),
            tuple(reports),
            small,
            found,
            given,
        )


def joint_masks(
    views: Iterable[tuple[NDArray, Camera]], volume: Volume | None = None
) -> tuple[JointMasks, list[NDArray[np.uint8]]]:
    """Masks of all views of a turn, where they fit into memory; else use ``JointSegmenter``.

    Returns:
        The judgement, and of each view its mask (h, w) uint8, 255 = object.

    Raises:
        ContourError: as ``JointSegmenter.solve``.
    """
    views = list(views)
    segmenter = JointSegmenter(volume)
    for image, camera in views:
        segmenter.add(image, camera)
    found = segmenter.solve()
    return found, [found.mask(k, image) for k, (image, _) in enumerate(views)]


def _outline(
    view: SmallView, nats: NDArray[np.float32], outline: NDArray[np.float32], footprint: float
) -> Mask:
    """(h, w) bool, the outline found again about that of the body."""
    away = _signed_distance(outline > 0.5)
    band = max(_BAND * footprint, 2.0)
    evidence = nats + _BODY * np.tanh(away / band)
    free = np.abs(away) < 3 * band
    evidence = np.where(free, evidence, np.where(away > 0, _BODY, -_BODY))
    found = cut_image(evidence.astype(np.float64), free, view.image, _STIFFNESS)
    return np.asarray(found & view.picture)


def _signed_distance(mask: Mask) -> NDArray[np.float32]:
    """(h, w) float32, px, positive inside."""
    here = mask.astype(np.uint8)
    if not here.any():
        return np.full(mask.shape, -1e3, np.float32)
    inside = cv2.distanceTransform(np.pad(here, 1, mode="edge"), cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.asarray(inside - cv2.distanceTransform(1 - here, cv2.DIST_L2, 5), np.float32)
