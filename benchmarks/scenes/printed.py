"""A printed sheet as a camera sees it, by exact geometry and area sampling."""

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera

Array = NDArray[np.float64]

_CELL = 4200  # cells on the longer side of the table of what is black; whole ones for common boards


def printed_sheet(
    black: Array,
    size_m: tuple[float, float],
    margin_m: float,
    camera: Camera,
    samples: int = 4,
    table: float = 0.55,
) -> Array:
    """Brightness of a sheet in the plane z = 0 of the object frame.

    The sheet lies with the middle of its pattern in the origin, x to the right and y up as it
    is read, and is seen from z > 0. Each pixel is the mean over samples x samples rays, no
    two of them in a row or column: an edge that runs along the rows of pixels is then as well
    placed as any.

    Args:
        black: (k, 4) float64, what is black: left, top, right, bottom, metres from the top left
            corner of the pattern, right and down.
        size_m: width and height of the pattern.
        margin_m: white paper around it.
        camera: the view, distortion included.
        samples: rays along each side of a pixel.
        table: brightness of what is not the sheet.

    Returns:
        (height, width) float64, 0 black to 1 white.
    """
    white, cell = _white(black, size_m)
    v, u = np.mgrid[: camera.height, : camera.width].astype(np.float64)
    C = camera.centre
    # Rays of the pixels' centres and how they change, for those within: the distortion bends
    # next to nothing within a pixel.
    rays = camera.viewing_directions(np.column_stack([u.ravel(), v.ravel()]))
    hit = -C[2] * rays[:, :2] / np.where(rays[:, 2:] < 0, rays[:, 2:], np.nan) + C[:2]
    hit = hit.reshape(camera.height, camera.width, 2)
    along_v, along_u = np.gradient(hit, axis=(0, 1))
    light = np.full((camera.height, camera.width), table)
    reach = np.array(size_m) / 2 + margin_m + 0.5 * (np.abs(along_u) + np.abs(along_v))
    near = (np.abs(hit) < reach).all(axis=2)
    if not near.any():
        return light
    ends = (np.flatnonzero(near.any(axis=axis))[[0, -1]] for axis in (1, 0))
    seen = tuple(slice(first, last + 1) for first, last in ends)
    hit, along_u, along_v = hit[seen], along_u[seen], along_v[seen]
    total = np.zeros(hit.shape[:2])
    with np.errstate(invalid="ignore"):
        for du, dv in _rotated_grid(samples):
            at = hit + du * along_u + dv * along_v
            total += _brightness(at, white, cell, size_m, margin_m, table)
    light[seen] = total / samples**2
    return light


def _rotated_grid(n: int) -> Array:
    """(n^2, 2) places in a pixel, from its middle, each in a row and a column of its own."""
    a, b = np.divmod(np.arange(n**2), n)
    return (np.column_stack([n * a + b, n * b + n - 1 - a]) + 0.5) / n**2 - 0.5


def _brightness(
    at: Array,
    white: NDArray[np.float32],
    cell: float,
    size_m: tuple[float, float],
    margin_m: float,
    table: float,
) -> Array:
    x, y = at[..., 0] + size_m[0] / 2, size_m[1] / 2 - at[..., 1]
    # The middle of the table's cell k is k - 1/2 cells from the corner of the pattern.
    column, row = (np.nan_to_num(a / cell + 0.5, nan=-9).astype(np.float32) for a in (x, y))
    print_ = cv2.remap(white, column, row, cv2.INTER_LINEAR, borderValue=1.0)
    paper = (x > -margin_m) & (x < size_m[0] + margin_m)
    paper &= (y > -margin_m) & (y < size_m[1] + margin_m)
    return np.where(paper, print_, table)


def _white(black: Array, size_m: tuple[float, float]) -> tuple[NDArray[np.float32], float]:
    """A table of what is white, 0 or 1, with a white border of one cell, and the side of a cell."""
    cell = max(size_m) / _CELL
    shape = tuple(int(np.ceil(length / cell - 1e-6)) + 3 for length in size_m[::-1])
    table = np.ones(shape, np.float32)
    for left, top, right, bottom in np.rint(black / cell).astype(int) + 1:
        table[top:bottom, left:right] = 0
    return table, cell
