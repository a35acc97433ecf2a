"""Which segmentation to use, and the mask it gives."""

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import robust_sigma
from .background import BackgroundModel
from .chroma import chroma_mask, discriminant
from .segment import Mask, frame, threshold_mask, to_grey, to_uint8
from .settings import ContourError, ContourSettings
from .window import Window

_AMPLE = 15.0  # standard deviations of the backdrop, from which on colour needs tell no better
_WITHIN = 0.95  # of what differs in colour, lies in what is lighter
_ALL_ALONG = 0.9  # of the border
_CLIPPED = 254  # grey levels: white, as bright as the camera tells
_PART = 0.85  # of what is lighter, what differs in colour covers less


class Segmenter:
    """Masks of image after image by the segmentation of the settings.

    Attributes:
        chosen: name of the segmentation in use, None before the first image.
        background: the empty rig, None before it is needed.
    """

    def __init__(self, settings: ContourSettings) -> None:
        self._settings = settings
        self.background: BackgroundModel | None = None
        self._mask: Mask | None = None
        self.chosen: str | None = None

    @property
    def by_background(self) -> bool:
        """Whether images are held against one of the empty rig, unless a mask comes with them."""
        wanted, given = self._settings.segmentation, self._settings
        empty_rig = given.background_image or given.background_frames
        return wanted == "background" or bool(wanted == "auto" and empty_rig)

    def mask(self, image: NDArray, given: NDArray | None, window: Window) -> Mask:
        """(h, w) uint8, 255 = object, of a given mask with levels of coverage between; the next
        call may write over it. What lies outside of the window is neither looked at nor object.

        Args:
            image: (h, w) or (h, w, 3) BGR.
            given: (h, w) mask that came with the image, 0 = background.
            window: the region of interest.

        Raises:
            ContourError: with the reason why there is no mask.
        """
        part = np.ascontiguousarray(window.cut(image))
        self.chosen = self._choose(part, given)
        if self.chosen == "mask":
            return window.restored(window.cut(_given_mask(image, given)), image)
        if self.chosen == "background":
            return window.restored(self._by_background(image, window), image)
        self._mask = self._by_itself(part)
        return window.restored(self._mask, image)

    def _by_itself(self, image: NDArray) -> Mask:
        if self.chosen == "threshold":
            return threshold_mask(image, self._mask)
        try:
            return chroma_mask(image, self._mask)
        except ContourError:
            if self._settings.segmentation == "chroma":
                raise
            # An image whose colour says nothing is none to be lost.
            return threshold_mask(image, self._mask)

    def _choose(self, image: NDArray, given: NDArray | None) -> str:
        wanted = self._settings.segmentation
        if wanted not in ("auto", "learnt"):
            return wanted
        if given is not None:
            return "mask"
        if self.by_background:
            return "background"
        # Once chosen it stays, or the contours would jump.
        if self.chosen in ("chroma", "threshold"):
            return str(self.chosen)
        return best_segmentation(image)

    def _by_background(self, image: NDArray, window: Window) -> Mask:
        if self.background is None:
            path = self._settings.background_image
            self.background = BackgroundModel.load(path) if path else BackgroundModel()
        needed = 0 if self._settings.background_image else self._settings.background_frames
        if self.background.frames < needed:
            self.background.learn(image)
            raise ContourError("background_frame", "taken as a picture of the empty rig")
        return self.background.mask(image, window)


def best_segmentation(image: NDArray) -> str:
    """Chroma where colour tells object from backdrop better than brightness does, and the backdrop
    is no white that has no colour, as that of retouched photographs: whatever is grey is object."""
    if image.ndim == 2:
        return "threshold"
    grey = to_grey(image)
    if np.mean(frame(grey) >= _CLIPPED) > _ALL_ALONG:
        return "threshold"
    try:
        light = threshold_mask(grey) > 0
    except ContourError:
        return "chroma" if discriminant(to_uint8(image))[2] > 0 else "threshold"
    apart = _apart(grey, light)
    if discriminant(to_uint8(image))[2] <= min(abs(apart), _AMPLE):
        return "threshold"
    return "threshold" if apart > 0 and _is_part(image, light) else "chroma"


def _apart(grey: Mask, mask: NDArray[np.bool_]) -> float:
    """Standard deviations of the backdrop by which the object is lighter than it."""
    inside, outside = grey[mask].astype(float), grey[~mask].astype(float)
    home = np.median(outside)
    deviation = robust_sigma(outside - home)
    return float((np.median(inside) - home) / max(deviation, 0.5))


def _is_part(image: NDArray, light: NDArray[np.bool_]) -> bool:
    """Whether what differs in colour is a part only of what is lighter than the backdrop, as the
    coloured plate under a grey mug. What is darker may be shadow."""
    try:
        coloured = chroma_mask(image) > 0
    except ContourError:
        return True
    within = np.count_nonzero(coloured & light) > _WITHIN * np.count_nonzero(coloured)
    return bool(within and np.count_nonzero(coloured) < _PART * np.count_nonzero(light))


def _given_mask(image: NDArray, given: NDArray | None) -> Mask:
    if given is None:
        raise ContourError("no_mask", "segmentation: mask, but no mask came with the image")
    if given.shape != image.shape[:2]:
        raise ContourError(
            "mask_size", f"mask is {given.shape[::-1]}, image {image.shape[1::-1]} px"
        )
    if not given.any():
        raise ContourError("no_object", "the mask is empty")
    return mask_coverage(given)


def white_around(mask: NDArray | None) -> str:
    """What is said of a mask that came, (h, w), and is white all along the border, "" of others."""
    if mask is None:
        return ""
    border = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
    if (border > 0).mean() < _ALL_ALONG:
        return ""
    return (
        "the mask is white all along the border: the object must be white, what is around it "
        "black; invert the masks"
    )


def mask_coverage(mask: NDArray) -> Mask:
    """(h, w) uint8, the share of each pixel that the object covers, 255: all of it.

    Where a mask holds 255 its levels are coverage, as the alpha of an image; else all above 0
    is object, as where parts have numbers.
    """
    if mask.dtype == np.uint8 and mask.size and mask.max() == 255:
        return np.asarray(mask, np.uint8)
    return (mask != 0).astype(np.uint8) * np.uint8(255)
