"""Whether the calibrations of a folder are of lenses, and what is to be said of those."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from occ_recon_ros.geometry.lens import MOST_FOLDED, folded_share

from .frames import Frame

_ASPECT = 1.2  # of a pixel; those of photographs are square, those of old video nearly
_SEEN = 0.02  # share of the pixels without a ray that is worth a word
_SIMPLER = (
    "calibrate again with fewer coefficients (COLMAP: SIMPLE_PINHOLE or SIMPLE_RADIAL, one camera "
    "shared by all images)"
)


def split_lenses(frames: Sequence[Frame], source: Path) -> tuple[list[Frame], list[str], list[str]]:
    """Frames whose calibration is of a lens, why others are left out, and remarks on the former.

    Args:
        frames: of a folder.
        source: the file that lists them.
    """
    kept: list[Frame] = []
    left_out: list[str] = []
    shares: list[float] = []
    for frame in frames:
        if (share := folded_share(frame.camera)) > MOST_FOLDED:
            left_out.append(
                f"{source}: K and D of {frame.image} are of no lens: the distortion folds back "
                f"within the image, {100 * share:.0f} % of its pixels have no ray of their own"
                f"{_aspect_words(frame)}; {_SIMPLER}"
            )
        else:
            kept.append(frame)
            shares.append(share)
    remarks = []
    if (worst := max(shares, default=0.0)) > _SEEN:
        remarks.append(
            f"{source}: towards the corners the distortion folds back, up to {100 * worst:.0f} % "
            f"of the pixels of an image have no ray of their own: no outline may reach there, or "
            f"{_SIMPLER}"
        )
    if oblong := [frame for frame in kept if _aspect_words(frame)]:
        remarks.append(
            f"{source}: of {len(oblong)} images the pixels are not square{_aspect_words(oblong[0])}"
            f", which they are of nearly all cameras: {_SIMPLER}"
        )
    return kept, left_out, remarks


def _aspect_words(frame: Frame) -> str:
    """Of pixels that are far from square, else empty."""
    K = frame.camera.K
    aspect = float(K[1, 1] / K[0, 0])
    return f" (fy is {aspect:.3g} times fx)" if abs(np.log(aspect)) > np.log(_ASPECT) else ""
