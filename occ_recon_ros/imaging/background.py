"""Object against a model of the empty rig."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import robust_sigma
from .segment import Mask, frame
from .settings import ContourError, ContourSettings
from .window import Window

_LEAST_DIFFERENCE = 5.0  # of 255: what light and converter do to a still backdrop
_NOISE = 6.0
_SOFTEN = 1.0


def check_background(settings: ContourSettings) -> None:
    """Before the first image: whether there is an empty rig to segment by.

    Raises:
        ContourError: background_image, where there is none or its file is no image.
    """
    if settings.background_image:
        BackgroundModel.load(settings.background_image)
    elif settings.segmentation == "background" and not settings.background_frames:
        raise ContourError(
            "background_image",
            "segmentation: background needs a picture of the empty rig: set background_image, or "
            "background_frames to take the first frames for it",
        )


class BackgroundModel:
    """The empty rig, pixel by pixel: the mean of the frames it was shown."""

    def __init__(self, image: NDArray | None = None) -> None:
        self._sum: NDArray[np.float32] | None = None
        self.frames = 0
        if image is not None:
            self.learn(image)

    @staticmethod
    def load(path: str) -> BackgroundModel:
        """From an image file.

        Raises:
            ContourError: background_image, where there is no such file, or it is no image.
        """
        try:
            data = Path(path).expanduser().read_bytes()
        except OSError as error:
            words = f"background_image '{path}' cannot be read: {error.strerror}"
            raise ContourError("background_image", words) from None
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
        if image is None or image.ndim not in (2, 3):
            raise ContourError("background_image", f"background_image '{path}' is not an image")
        return BackgroundModel(image[..., :3] if image.ndim == 3 else image)

    def state(self) -> dict[str, NDArray]:
        """All that was learnt."""
        learnt = {} if self._sum is None else {"sum": self._sum}
        return {"frames": np.array(self.frames), **learnt}

    @staticmethod
    def restored(state: dict[str, NDArray]) -> BackgroundModel:
        """The model of a state."""
        model = BackgroundModel()
        model._sum, model.frames = state.get("sum"), int(state["frames"])
        return model

    def learn(self, image: NDArray) -> None:
        """Add a frame without the object."""
        if self._sum is None or self._sum.shape != image.shape:
            self._sum, self.frames = np.zeros(image.shape, np.float32), 0
        self._sum += image
        self.frames += 1

    def mask(self, image: NDArray, window: Window) -> Mask:
        """What differs from the empty rig by more than its noise.

        A change of the exposure is measured along the border of the window and taken out.

        Args:
            image: of the shape of those learnt.
            window: the region of interest.

        Returns:
            uint8 of the shape of the window, 255 = object.

        Raises:
            ContourError: background_size, where image and model are not of one shape.
        """
        if self._sum is None:
            raise ContourError("no_background", "segmentation: background, but no empty rig seen")
        empty = self._sum / self.frames
        if image.shape != empty.shape:
            raise ContourError(
                "background_size", f"image is {image.shape}, the empty rig is {empty.shape}"
            )
        image, empty = window.cut(image), window.cut(empty)
        here, there = frame(image).astype(np.float32), frame(empty)
        gain = np.median(here) / max(float(np.median(there)), 1.0)
        difference = cv2.GaussianBlur(image.astype(np.float32) - gain * empty, (0, 0), _SOFTEN)
        difference = np.abs(difference)
        if difference.ndim == 3:
            difference = difference.max(axis=2)
        scale = 1.0 if image.dtype == np.uint8 else max(float(empty.max()), 1.0) / 255.0
        noise = robust_sigma(frame(difference))
        limit = max(_LEAST_DIFFERENCE * scale, _NOISE * noise)
        return (difference > limit).astype(np.uint8) * np.uint8(255)
