"""The masks of a turn, and how far they are to be believed."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...geometry import Camera
from ..segment import to_uint8
from ..segmenter import mask_coverage
from .edges import LONG_SIDE
from .finer import finer
from .judge import ViewReport, beside_of
from .regions import Mask
from .scenes import Scene
from .solve import Solution, Trial
from .space import silhouette

LEAST_BELIEF = 0.4  # with which masks are used at all

Window = tuple[int, int, int, int]
"""First column and row, and those after the last, px."""


def score(views: Sequence[ViewReport]) -> float:
    """By which the better masks of the same views are told, 0 to 1."""
    told = [(view.agreement, view.support, view.edgeless) for view in views]
    agreement, support, edgeless = np.median(told, axis=0)
    return float(agreement * support * (1 - edgeless) / (1 + beside_of(views)))


@dataclass(frozen=True)
class JointMasks:
    """The masks of a turn, and how far they are to be believed.

    Attributes:
        method: "joint", by colours and the body that all views see; "given", by the masks that
            came with most views, judged by each other.
        belief: 0 to 1; above 0.7 nothing speaks against the masks, below ``LEAST_BELIEF`` do not
            use them.
        warnings: sentences on what is doubtful about the whole.
        views: of each view, agreement with the others and whether it is named as bad.
        small: of each view, (h, w) bool, the mask of its window in the size of the joint pass.
        solution: the body, and the colours of object and backdrop.
        windows: of each view, the part of the image in which the object is.
        trial: in which they were found, None: by no trial.
        notes: sentences on what was decided, and is no reason to doubt them.
        cut_short: as of ``Judgement``.
    """

    method: str
    belief: float
    warnings: tuple[str, ...]
    views: tuple[ViewReport, ...]
    small: tuple[Mask, ...]
    solution: Solution = field(repr=False)
    windows: tuple[Window, ...]
    trial: Trial | None = None
    notes: tuple[str, ...] = ()
    cut_short: bool = False

    @property
    def agreement(self) -> float:
        """Of the usual view with the body that the others see, 0 to 1."""
        return float(np.median([view.agreement for view in self.views]))

    @property
    def beside(self) -> float:
        """Area beside the usual mask that edges enclose with it, as a share of the mask's."""
        return beside_of(self.views)

    @property
    def edgeless(self) -> float:
        """Share of the usual outline where its image shows no edge."""
        return float(np.median([view.edgeless for view in self.views]))

    @property
    def support(self) -> float:
        """Share of the usual outline that the colours on its two sides confirm, 0 to 1."""
        return float(np.median([view.support for view in self.views]))

    def score(self) -> float:
        """By which the better one of two is told, 0 to 1."""
        return score(self.views)

    def mask(
        self,
        k: int,
        image: NDArray,
        given: NDArray | None = None,
        known: Scene | None = None,
    ) -> NDArray[np.uint8]:
        """The mask of view k in full size, 255 = object.

        Args:
            k: number of the view, in the order in which the views were given.
            image: (h, w) or (h, w, 3) BGR, uint8 or uint16, the image of that view.
            given: (h, w) the mask that came with it, 0 = background: kept where it is good.
            known: what the image shows where nothing hides the backdrop, as ``finer``.
        """
        if given is not None and not self.views[k].bad and given.shape == image.shape[:2]:
            return mask_coverage(given)
        x0, y0, x1, y1 = self.windows[k]
        out = np.zeros(image.shape[:2], np.uint8)
        part = np.ascontiguousarray(to_uint8(image)[y0:y1, x0:x1])
        if known is not None:
            known = known[0][y0:y1, x0:x1], known[1][y0:y1, x0:x1]
        out[y0:y1, x0:x1] = finer(part, self.small[k], self.solution.outlining[k], known)
        return out

    def by_others(self, image: NDArray, camera: Camera) -> NDArray[np.uint8]:
        """The mask (h, w) of a view that was not among these, 255 = object: where the body ends in
        it, by the colours that this image alone shows on the two sides.

        Args:
            image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
            camera: the view, in the object frame; of the size of the image.
        """
        scale = min(1.0, LONG_SIDE / max(image.shape[:2]))
        width, height = (max(1, round(scale * side)) for side in image.shape[1::-1])
        body = self.solution.grid, self.solution.body
        outline = silhouette(*body, camera.resized(width, height)) > 0.5
        nothing = np.zeros(outline.shape, np.float32)
        return finer(to_uint8(image), np.asarray(outline), nothing)
