"""Masks of further views of a turn, by the colours and the body that its first views taught."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...geometry import Camera
from ..segment import to_uint8
from ..settings import ContourError
from .evidence import likelihood, with_less_alike
from .finer import finer
from .masks import JointMasks
from .models import Models
from .plane import Ground, Picture, ground_picture, ground_scene
from .regions import Mask, disc, grown
from .scenes import Scene
from .segmenter import JointSegmenter, outline_again
from .shadow import soft_shadow
from .solve import ALIKE_OUTSIDE, Solution
from .space import silhouette

_AROUND = 2.0  # voxels about the projected body from which on a view shows the backdrop


class LearntMasks:
    """Segments views that were not among those learnt from.

    masks = LearntMasks(segmenter.solve(), (width, height))
    mask = masks.mask(image, camera)     # (h, w) uint8, 255 = object

    It can be pickled, and is some megabytes large.

    Args:
        found: the masks of a turn.
        size: (width, height) px of its images; others are refused.
    """

    def __init__(self, found: JointMasks, size: tuple[int, int]) -> None:
        solution: Solution = found.solution
        self._size, self._window = size, found.windows[0]
        self._grid, self._body = solution.grid, solution.body
        self._footprint = solution.footprint
        self._ground: Ground | None = None
        self._on_ground: Picture | None = None
        scenes = list(solution.models.scenes[0])
        if solution.ground is not None and scenes:
            on_ground = [scenes[-1] for scenes in solution.models.scenes]
            self._on_ground = ground_picture(solution.ground, on_ground)
            self._ground = replace(solution.ground, places=[])
            scenes = scenes[:-1]
        self._fixed: list[Scene] = scenes
        self._models: Models = replace(solution.models, scenes=[], shadows=())

    def mask(self, image: NDArray, camera: Camera) -> NDArray[np.uint8]:
        """The mask of a view in full size, (h, w) uint8, 255 = object.

        Args:
            image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
            camera: the view, in the object frame.

        Raises:
            ContourError: image_size, where images were of another size before; no_object, where
                the body is not in view.
        """
        if image.shape[1::-1] != self._size:
            raise ContourError(
                "image_size", f"image is {image.shape[1::-1]} px, those learnt from {self._size}"
            )
        one = JointSegmenter()
        one.add(image, camera)
        view = one.view(0, self._window)
        outline = silhouette(self._grid, self._body, view.camera)
        if not (outline > 0.5).any():
            raise ContourError("no_object", "the body that was learnt is not in view")
        outside = self._beside(outline) & view.picture
        scenes = list(self._fixed)
        if self._ground is not None and self._on_ground is not None:
            scenes.append(ground_scene(self._ground, self._on_ground, view.camera))
        shaded = self._models.shaded
        shadow = (
            np.zeros_like(outside)
            if shaded is None
            else soft_shadow(view.even, view.bins, outside, shaded, view.enlarged)
        )
        models = replace(self._models, scenes=[scenes], shadows=[shadow])
        nats = likelihood(view, models, 0, outside)
        nats = with_less_alike(nats, models.alike, ALIKE_OUTSIDE)
        small = outline_again(view, nats, outline, self._footprint)
        x0, y0, x1, y1 = self._window
        out = np.zeros(image.shape[:2], np.uint8)
        part = np.ascontiguousarray(to_uint8(image)[y0:y1, x0:x1])
        out[y0:y1, x0:x1] = finer(part, small, nats)
        return out

    def _beside(self, outline: NDArray[np.float32]) -> Mask:
        return ~grown(outline > 0.5, disc(_AROUND * self._footprint))
