"""The outline of an object before a backdrop that is known, to a fraction of a pixel.

Across the outline each pixel is a mixture of the object's colour and of the print behind it; with
the print known its share says where the outline is, and edges of the print are none of the object.
After the matting equation with a known background (Smith and Blinn 1996,
doi:10.1145/237170.237263).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.special import ndtr

from occ_recon_ros.geometry.arrays import sampled
from occ_recon_ros.imaging.curves import along, normals, resample
from occ_recon_ros.imaging.loops import mask_loops
from occ_recon_ros.imaging.segment import to_uint8
from occ_recon_ros.imaging.settings import ContourSettings

Array = NDArray[np.floating]

_SPACING = 0.5  # px, of samples across
_WINDOWS_PX = ((3.5, 7.0), (2.5, 6.0), (2.0, 5.0))  # where colours are taken, round by round
_STEPS = 4  # of Gauss and Newton in a round
_FARTHEST_PX = 4.0
_DARKEST, _BRIGHTEST = 0.35, 1.25  # of the light that the print lies in, beside the object
_COLOUR_SHARE, _LIGHT_SHARE = 9, 15  # samples along the outline that share a colour
_GUESSED = 5.0  # times the noise
_NOISE = 2.0  # grey levels, at least
_NEAR, _WIDE, _WIDE_SHARE = 3, 41, 1e-3  # neighbours that help, and by how much


def outlines_before(
    image: NDArray,
    picture: NDArray[np.float32],
    spread: NDArray[np.float32],
    mask: NDArray[np.uint8],
    blur_px: float = 0.8,
) -> list[NDArray[np.float64]]:
    """The outlines in a mask, moved to where the object ends.

    Args:
        image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
        picture: (h, w, 3) what it would show if nothing hid the backdrop, grey levels.
        spread: (h, w) how sure that is, infinite where it is not known: there the backdrop is
            taken to be even across the outline.
        mask: (h, w) uint8, 255 = object, right to within some four pixels.
        blur_px: of the image, 1 sigma.

    Returns:
        Closed polygons (n, 2) px, the object on the left as displayed.
    """
    settings = ContourSettings()
    image = to_uint8(image)
    colour = image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
    known = np.isfinite(spread)
    doubt = np.where(known, spread, 0).astype(np.float32)
    loops = mask_loops(mask, settings.min_loop_px, settings.spacing_px)
    for window in _WINDOWS_PX:
        loops = [_moved(loop, colour, picture, known, doubt, window, blur_px) for loop in loops]
    return [np.asarray(loop, np.float64) for loop in loops]


def _moved(
    points: Array,
    image: NDArray[np.uint8],
    picture: NDArray[np.float32],
    known: NDArray[np.bool_],
    doubt: NDArray[np.float32],
    window: tuple[float, float],
    blur: float,
) -> Array:
    """One loop, moved once."""
    near, far = window
    out = normals(points, reach=3)
    u = np.arange(-far, far + _SPACING / 2, _SPACING)[:, None]
    x, y = points[:, 0] + u * out[:, 0], points[:, 1] + u * out[:, 1]
    seen = sampled(image, x, y)
    object_colour = along(seen[u[:, 0] <= -near].mean(axis=0), _COLOUR_SHARE)
    outside = u[:, 0] >= near
    sure = sampled(known.astype(np.float32), x, y) > 0.999
    behind = _backdrop(seen, sampled(picture, x, y), sure, outside)
    sigma = np.hypot(sampled(doubt, x, y), _NOISE)
    # Beside a backdrop that is known one that is guessed at says little.
    sigma = np.where(~sure & sure.any(axis=0), _GUESSED * sigma, sigma)
    across = object_colour - behind
    power = np.einsum("mnc,mnc->mn", across, across)
    share = np.einsum("mnc,mnc->mn", seen - behind, across) / np.maximum(power, 1.0)
    weight = power / sigma**2
    offset = np.zeros(len(points))
    for _ in range(_STEPS):
        z = (u - offset) / blur
        slope = np.exp(-0.5 * z**2) / (np.sqrt(2 * np.pi) * blur)
        taper = weight * np.exp(-0.5 * ((u - offset) / (1 + 1.5 * blur)) ** 2)
        rest = share - ndtr(-z)
        told = (taper * slope**2).sum(axis=0)
        step = (taper * slope * rest).sum(axis=0) / np.maximum(told, 1e-9)
        offset = np.clip(offset + np.clip(step, -1, 1), -_FARTHEST_PX, _FARTHEST_PX)
    # What does not look like an outline at all says less.
    misfit = (taper * rest**2).sum(axis=0) / np.maximum((taper > 0).sum(axis=0), 1)
    told = np.where(np.abs(offset) < _FARTHEST_PX, told / np.maximum(misfit, 1.0), 0.0) + 1e-9
    each = np.column_stack([told * offset, told])
    smooth = along(each, _NEAR) + _WIDE_SHARE * along(each, _WIDE)
    moved = points + (smooth[:, 0] / smooth[:, 1])[:, None] * out
    return resample(gaussian_filter1d(moved, 0.7, axis=0, mode="wrap"), 1.0)


def _backdrop(
    seen: Array, picture: Array, known: NDArray[np.bool_], outside: NDArray[np.bool_]
) -> Array:
    """(m, n, 3) colours behind the outline: the print in the light beside it; where nothing is
    known, what is seen beside it."""
    even = along(seen[outside].mean(axis=0), _COLOUR_SHARE)
    beside = known[outside][..., None]
    dots = along((beside * seen[outside] * picture[outside]).sum(axis=(0, 2)), _LIGHT_SHARE)
    squares = along((beside * picture[outside] ** 2).sum(axis=(0, 2)), _LIGHT_SHARE)
    light = np.where(squares > 1.0, dots / np.maximum(squares, 1.0), 1.0)
    light = np.clip(light, _DARKEST, _BRIGHTEST)
    result: Array = np.where(known[..., None], light[:, None] * picture, even)
    return result
