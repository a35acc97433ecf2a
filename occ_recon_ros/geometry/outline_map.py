"""One outline on a grid of cells, made once to answer where points lie.

For each cell the grid holds its signed distance from the outline and, near it, the sample
nearest to its middle. All is in the plane at distance 1 across the middle viewing
direction, in units of the cell's width.
"""

import numpy as np
from numpy.typing import NDArray

from .arrays import axes_along
from .compiled import compiled
from .contours import Contours

Mask = NDArray[np.bool_]

_CELLS = 192  # across the longer side of the silhouette
_MARGIN = 2.5  # cells about the outline
FARTHEST = 5  # samples, of a move along the outline
WALKS = 2  # moves along the outline towards the sample nearest to a point
NEAR = 1.5  # cells between middles: the eight about a cell
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
        place: (m, 7) float64 of the samples: x, y; the outward unit normal x, y; one over the
            length to the next sample, the usual one over gaps; x, y of the outward direction that
            both edges beside it have a share in.
        loop: (m, 2) intp, the first row of the sample's loop, and of the next.
        cells: (cells,) float32: in cells with outline, and in those beside them outside, the
            number of a sample close by, and ``FIRST_ROW`` more; in others the distance of the
            cell's middle from the outline, negative inside, NaN beyond a gap of the outline. In
            one array: reading it is what a point costs.
    """

    def __init__(self, contours: Contours) -> None:
        axes = axes_along(contours.middle / np.linalg.norm(contours.middle))
        loops = compiled("geometry.outline_kernels")
        x, y, *normal, length = loops.on_plane(axes, contours.T, contours.N, contours.next_row)
        step = float(np.median(length)) or 1.0

        low, high = np.array([x.min(), y.min()]), np.array([x.max(), y.max()])
        self.width = max(float((high - low).max()) / _CELLS, 1.5 * step)
        low = low - _MARGIN * self.width
        shape = np.ceil((high - low) / self.width + _MARGIN).astype(int)
        self.shape = int(shape[0]), int(shape[1])
        x, y = (x - low[0]) / self.width, (y - low[1]) / self.width
        self.step = step / self.width
        rows = contours.previous_row, contours.next_row, contours.linked
        starts = contours.loop_starts
        loop = np.column_stack([starts[:-1], starts[1:]])
        self.place: NDArray[np.float64] = loops.placed(x, y, *normal, *rows, self.step)
        self.loop = np.repeat(loop, np.diff(starts), axis=0)
        into_cells = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, self.width]])
        self.rotation = into_cells / self.width @ axes
        self.shift = -self.rotation @ contours.centre
        self.cells: NDArray[np.float32] = loops.filled(x, y, *rows[1:], *self.shape)
