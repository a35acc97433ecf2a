"""One outline on a grid of cells, made once to answer where points lie.

For each cell the grid holds its signed distance from the outline and, near it, the sample
nearest to its middle. All is in the plane at distance 1 across the middle viewing
direction, in units of the cell's width.
"""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .arrays import Array, Index, axes_along, repeated
from .compiled import compiled
from .contours import Contours

Mask = NDArray[np.bool_]

_CELLS = 192  # across the longer side of the silhouette
_MARGIN = 2.5  # cells about the outline
FARTHEST = 5  # samples, of a move along the outline
WALKS = 2  # moves along the outline towards the sample nearest to a point
_NEAR = 1.5  # cells between middles: the eight about a cell
FIRST_ROW = 2.0**20  # more than any distance in cells, and whole numbers beyond are float32


class OutlineMap:
    """The grid and the samples of one view's contours.

    Args:
        contours: m samples, at least one.

    Attributes:
        width: of a cell, radians of viewing direction.
        shape: cells of the grid.
        rotation, shift: (3, 3), (3,) that take a point of the object frame to (x z, y z, z),
            with x, y in cells from the grid's corner and z the depth.
        step: the usual distance of neighbours among the samples.
        samples: place, (m, 7) float64: x, y; the outward unit normal x, y; one over the length to
            the next sample, the usual one over gaps; x, y of the outward direction that both edges
            beside it have a share in. ahead, (m, 2 FARTHEST + 1): to the samples so many back to
            so many on along its loop, in rows.
        cells: (cells,) float32: in cells with outline, and in those beside them outside, the
            number of a sample close by, and ``FIRST_ROW`` more; in others the distance of the
            cell's middle from the outline, negative inside, NaN beyond a gap of the outline. In
            one array: reading it is what a point costs.
    """

    def __init__(self, contours: Contours) -> None:
        axes = axes_along(contours.middle / np.linalg.norm(contours.middle))
        ray = axes @ contours.T.T
        with np.errstate(invalid="ignore"):
            plane = ray[:2] / np.where(ray[2] > 0, ray[2], np.nan)
        ahead = plane[:, contours.next_row] - plane
        length = np.hypot(*ahead)
        step = float(np.median(length)) or 1.0

        low, high = plane.min(axis=1), plane.max(axis=1)
        self.width = max(float((high - low).max()) / _CELLS, 1.5 * step)
        low = low - _MARGIN * self.width
        shape = np.ceil((high - low) / self.width + _MARGIN).astype(int)
        self.shape = int(shape[0]), int(shape[1])
        self._x, self._y = (plane - low[:, None]) / self.width
        self.step = step / self.width
        normal = axes[:2] @ contours.N.T
        normal = normal / np.hypot(*normal)
        with np.errstate(invalid="ignore"):
            ahead = ahead / length
        along_x, along_y = ahead + ahead[:, contours.previous_row]
        length = np.where(contours.linked & (length > 0), length / self.width, self.step)
        place = [self._x, self._y, *normal, 1 / length, -along_y, along_x]
        # A sample alone has no normal.
        self.samples: dict[str, NDArray] = {
            "place": np.nan_to_num(np.stack(place, axis=1)),
            "ahead": _ahead(contours),
        }
        into_cells = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, self.width]])
        self.rotation = into_cells / self.width @ axes
        self.shift = -self.rotation @ contours.centre
        self.cells = self._filled(contours)

    @cached_property
    def arrays(self) -> tuple[object, ...]:
        """All of it, for ``outline_kernels.raise_to_outline``."""
        return (
            self.rotation,
            self.shift,
            *self.shape,
            self.step,
            self.cells,
            *(self.samples["place"], self.samples["ahead"]),
        )

    def _filled(self, contours: Contours) -> NDArray[np.float32]:
        """The grid's cells."""
        at = self._cells_of(self._x, self._y)
        row = np.full(self.shape, -1, np.int32).ravel()
        row[at] = np.arange(len(contours))
        blocked = row >= 0
        blocked[self._gaps(contours)] = True

        blocked = blocked.reshape(self.shape)
        distance, where = compiled("geometry.outline_kernels").nearest_cells(blocked)
        distance, row = distance.ravel().astype(np.float32), row[where.ravel()]
        far = np.where(self._inside(contours), -distance, distance)
        # Inside, a cell without outline says all that is asked: not outside.
        near = (far > -0.5) & (far < _NEAR) & (row >= 0)
        far[(row < 0) & (far > 0)] = np.nan
        cells: NDArray[np.float32] = np.where(near, np.float32(FIRST_ROW) + row, far)
        return cells.astype(np.float32)

    def _gaps(self, contours: Contours) -> Index:
        """Cells that the chords over gaps of the outline cross."""
        rows = np.flatnonzero(~contours.linked)
        after = contours.next_row[rows]
        x, y, over_x, over_y = self._x[rows], self._y[rows], self._x[after], self._y[after]
        count = (2 * np.hypot(over_x - x, over_y - y)).astype(np.intp) + 1
        edge, place = repeated(count)
        part = (place + 0.5) / count[edge]
        return self._cells_of(
            x[edge] + part * (over_x - x)[edge], y[edge] + part * (over_y - y)[edge]
        )

    def _inside(self, contours: Contours) -> Mask:
        """(cells,) whose middles the closed loops enclose, by parity along each line."""
        u, v, to = self._x - 0.5, self._y - 0.5, contours.next_row
        low = np.ceil(np.minimum(u, u[to])).astype(np.intp)
        edge, place = repeated(np.ceil(np.maximum(u, u[to])).astype(np.intp) - low)
        line = low[edge] + place
        part = (line - u[edge]) / (u[to[edge]] - u[edge])
        crossing = np.ceil(v[edge] + part * (v[to[edge]] - v[edge])).astype(np.intp)
        cells = self.shape[0] * self.shape[1]
        flips = np.bincount(line * self.shape[1] + crossing, minlength=cells)
        return (np.cumsum(flips.reshape(self.shape), axis=1) % 2 == 1).ravel()

    def _cells_of(self, x: Array, y: Array) -> Index:
        """(n,) flat indices of the cells of points on the grid."""
        return x.astype(np.intp) * self.shape[1] + y.astype(np.intp)


def _ahead(contours: Contours) -> NDArray[np.int32]:
    """(m, 2 FARTHEST + 1) how many rows on the samples are that follow on each."""
    ahead = np.zeros((len(contours), 2 * FARTHEST + 1), np.int32)
    row = here = np.arange(len(contours))
    back = here
    for k in range(1, FARTHEST + 1):
        row, back = contours.next_row[row], contours.previous_row[back]
        ahead[:, FARTHEST + k], ahead[:, FARTHEST - k] = row - here, back - here
    return ahead
