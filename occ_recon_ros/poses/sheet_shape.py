"""The shape of a sheet that is not quite flat, from all views of it together.

Paper curls by a millimetre; its corners are then off by a pixel, in each view by another, and so
are the poses. Seen from many sides, each corner's true place can be told, as in any bundle
adjustment; that the sheet was printed flat and in true size is the prior, which also holds the
frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.geometry.pose import CameraPose

from .board_pose import refine_pose
from .intrinsics import corner_sigma
from .projection import moved, pixel_jacobian

_IN_PLANE = 1e-3  # of the board's size, 1 sigma: how true a printer is from corner to corner
_HEIGHT = 1e-2  # how much a sheet curls
_ROUNDS = 8
_HUBER = 3.0
_LEAST_VIEWS = 6
_GAIN = 0.9  # by which views left out must fit better


@dataclass(frozen=True)
class SheetView:
    """One view of a sheet.

    Attributes:
        index: (n,) which corners of the board.
        uv: (n, 2) float64, pixels.
        pose: about where the camera is.
    """

    index: NDArray[np.intp]
    uv: Array
    pose: CameraPose


@dataclass(frozen=True)
class SheetShape:
    """Where the corners of a sheet really are.

    Attributes:
        corners: (n, 3) float64, board frame, metres.
        flat_px, bent_px: root mean square distance of the corners of views that were left out,
            if the sheet is taken as flat, and with these corners.
        beside, above: how far they are, 1 sigma, from where they are printed: in the plane of the
            sheet, along one axis, and across it, metres.
    """

    corners: Array
    flat_px: float
    bent_px: float
    beside: float
    above: float

    @property
    def curled(self) -> bool:
        """Whether it is curled, more than printed, or read in its images, beside its places."""
        return self.above > self.beside

    @property
    def worth_it(self) -> bool:
        """Whether views that were left out fit better with it."""
        return bool(self.bent_px < _GAIN * self.flat_px)


def sheet_shape(camera: Camera, flat: Array, views: Sequence[SheetView]) -> SheetShape:
    """The shape of the sheet; judged by views that were left out.

    Args:
        camera: intrinsics.
        flat: (n, 3) float64, the corners as printed.
        views: their poses about right.

    Raises:
        ValueError: fewer than six views.
    """
    if len(views) < _LEAST_VIEWS:
        raise ValueError(f"{_LEAST_VIEWS} views are needed to see whether the sheet is flat")
    halves = [views[0::2], views[1::2]]
    flat_px = bent_px = 0.0
    for learnt, left_out in (halves, halves[::-1]):
        bent = _adjusted(camera, flat, learnt)
        flat_px += _misfit(camera, flat, left_out) ** 2 / 2
        bent_px += _misfit(camera, bent, left_out) ** 2 / 2
    corners = _adjusted(camera, flat, views)
    x, y, z = (corners - flat).std(axis=0).tolist()
    beside = float(np.hypot(x, y) / np.sqrt(2))
    return SheetShape(corners, float(np.sqrt(flat_px)), float(np.sqrt(bent_px)), beside, z)


def _misfit(camera: Camera, corners: Array, views: Sequence[SheetView]) -> float:
    """Root mean square distance in pixels, each view's pose fitted to these corners."""
    rests = []
    for view in views:
        points = corners[view.index]
        found = refine_pose(camera, points, view.uv, view.pose, np.ones(len(points), bool))
        if found is not None:
            rests.append((found.rms_px**2, np.count_nonzero(found.used)))
    if not rests:
        return float("inf")
    squares, counts = np.array(rests).T
    return float(np.sqrt((squares * counts).sum() / counts.sum()))


def _adjusted(camera: Camera, flat: Array, views: Sequence[SheetView]) -> Array:
    """Corners and poses together, by Gauss and Newton with the poses eliminated."""
    size = float(np.ptp(flat[:, :2], axis=0).max())
    prior = 1 / np.array([_IN_PLANE * size, _IN_PLANE * size, _HEIGHT * size]) ** 2
    corners, poses = flat.copy(), [view.pose for view in views]
    sigma = 1.0
    for _ in range(_ROUNDS):
        n = 3 * len(flat)
        normal, right = np.zeros((n, n)), np.zeros(n)
        eliminated, rests = [], []
        for view, pose in zip(views, poses, strict=True):
            seen, J = pixel_jacobian(camera.at(pose), corners[view.index])
            rest = view.uv - seen
            length = np.linalg.norm(rest, axis=1)
            rests.append(length)
            w = np.minimum(1, _HUBER * sigma / np.maximum(length, 1e-9)) / sigma**2
            Jp = -J[:, :, :3]  # a corner moves as the camera moves the other way
            own = np.einsum("n,nij,nik->njk", w, Jp, Jp)
            cross = np.einsum("n,nij,nik->njk", w, Jp, J)
            A = np.einsum("n,nij,nik->jk", w, J, J)
            g = np.einsum("n,nij,ni->j", w, J, rest)
            b = np.einsum("n,nij,ni->nj", w, Jp, rest)
            inverse = np.linalg.inv(A)
            B = cross.reshape(-1, 6)
            rows = (3 * view.index[:, None] + np.arange(3)).ravel()
            block = -B @ inverse @ B.T
            for k in range(len(view.index)):
                block[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += own[k]
            normal[np.ix_(rows, rows)] += block
            right[rows] += b.ravel() - B @ inverse @ g
            eliminated.append((inverse, B, g, rows))
        offset = corners - flat
        normal[np.arange(n), np.arange(n)] += np.tile(prior, len(flat))
        right -= (offset * prior).ravel()
        step = np.linalg.solve(normal, right)
        corners = corners + step.reshape(-1, 3)
        poses = [
            moved(pose, inverse @ (g - B.T @ step[rows]))
            for pose, (inverse, B, g, rows) in zip(poses, eliminated, strict=True)
        ]
        sigma = corner_sigma(np.concatenate(rests))
        if np.abs(step).max() < 1e-6 * size:
            break
    return corners
