"""A lens that outlines ask for and that is too far from the one known to be believed, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry.arrays import Array

_TOLD = 2.0  # of what a lens is usually known to, less of which is not said
_NO_LENS = 2.0  # times another focal length or pixel shape: outlines agree where all collapses
_CALIBRATE = "calibrate the camera (occ-recon calibrate intrinsics)"


@dataclass(frozen=True)
class AnotherLens:
    """What it is, next to the one known.

    Attributes:
        focal: factor of the focal length.
        wide: by how much pixels are wider than high, a factor (of fy / fx).
        centre_px: (2,) float64, how far its principal point is off.
        k1: radial distortion, beside what is known.
        told: (4,) which of these are off by more than lenses usually are.
        whole: whether it explains all that the outlines disagree by, but for their own errors.
    """

    focal: float
    wide: float
    centre_px: Array
    k1: float
    told: NDArray[np.bool_]
    whole: bool

    @staticmethod
    def of(lens: Array, usual: Array, whole: bool) -> AnotherLens:
        """From corrections (5,) of cx and cy (px), the logarithms of the focal length and of
        fy / fx, and ``Rig.bend``; and what these are usually known to, 1 sigma (5,)."""
        off = np.abs(lens) > _TOLD * usual
        told = np.array([off[2], off[3], off[:2].any(), off[4]])
        focal, wide = np.exp(lens[2:4])
        return AnotherLens(float(focal), float(wide), lens[:2], -float(lens[4]), told, whole)

    @property
    def is_none(self) -> bool:
        """Whether no lens is like that, so that its numbers mean nothing."""
        return bool(np.abs(np.log([self.focal, self.wide])).max() > np.log(_NO_LENS))

    def said(self) -> str:
        """What is to be thought of it and what to do, in a sentence."""
        advice = f"{_CALIBRATE}, with its distortion D" if self.told[3] else _CALIBRATE
        if not self.whole:
            return (
                "the outlines would agree better, but not as well as they are known, with another "
                f"lens ({self._numbers()}), which they alone cannot tell: to be sure, {advice}"
            )
        if self.is_none:
            return (
                "the outlines agree with each other in another lens, but do not tell which: check "
                f"the focal length, and whether the images were cropped or stretched, or {advice}"
            )
        return (
            f"the outlines ask for another lens ({self._numbers()}), which they alone cannot tell: "
            f"{advice}"
        )

    def _numbers(self) -> str:
        """Those that are off."""
        x, y = self.centre_px
        words = (
            f"focal length x {self.focal:.2f}",
            f"pixels {self.wide:.2f} times as wide as high: were the images stretched?",
            f"principal point off by ({x:.0f}, {y:.0f}) px",
            f"distortion k1 {self.k1:+.2f}",
        )
        return ", ".join(what for what, off in zip(words, self.told, strict=True) if off)
