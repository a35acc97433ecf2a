"""Intrinsics of a camera from views of a board, with what is known of them.

Z. Zhang, "A flexible new technique for camera calibration", PAMI 22(11), 2000,
doi:10.1109/34.888718; for lenses that are usual, and for fisheyes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.special import chdtri

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.geometry.lens import MOST_FOLDED, folded_share

from .board_pose import candidate_poses
from .intrinsics_fisheye import FisheyeFit
from .intrinsics_plumb_bob import PlumbBobFit, straight_ahead

FEWEST_VIEWS = 3
_FEWEST_CORNERS = 8
_CUT = 6.0  # sigmas
_WORST = 0.5  # of the farthest corner's distance: what is left out at once
_ROUNDS = 6
_SIGNIFICANT = float(chdtri(1, 1e-3))  # chi-square: what a further coefficient must gain
_SIGNIFICANT_PAIR = float(chdtri(2, 1e-3))  # and what two must
_PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
_TILTED = np.deg2rad(8)  # how far the board's tilts must differ to tell more than f
_GRID = 8  # cells along each side of the image, to see where corners were
_GOOD_F, _FAIR_F = 0.002, 0.01  # relative sigma of the focal length
_GOOD_COVERAGE = 0.5
_GOOD_RMS_PX = 1.0
_WIDE = 1.0  # tangent of half the angle of view, from which on a lens may be a fisheye
_CLEARLY = 0.8  # times as far off, what another lens fits better


@dataclass(frozen=True)
class BoardView:
    """Corners of a board in one image.

    Attributes:
        name: of the image.
        points: (n, 3) float64, board frame, metres.
        uv: (n, 2) float64, pixels.
    """

    name: str
    points: Array
    uv: Array


@dataclass(frozen=True)
class Intrinsics:
    """A calibration.

    Attributes:
        camera: K, D (plumb_bob or equidistant), width and height; its pose means nothing.
        sigma: (9,) float64, 1 sigma of fx, fy, cx, cy and of D in its order (plumb_bob: k1, k2,
            p1, p2, k3); 0 for what was held.
        rms_px: of one corner's distance.
        view_rms_px: the same for each view.
        views: their names, those used.
        rejected: corners left out as wrong.
        coverage: share of the image, in cells, in which corners were.
        centred: all views had one tilt: that the principal point is near the middle, and the
            lens a usual one, is a part of the fit.
    """

    camera: Camera
    sigma: Array
    rms_px: float
    view_rms_px: Array
    views: tuple[str, ...]
    rejected: int
    coverage: float
    centred: bool = False

    @property
    def verdict(self) -> tuple[str, str]:
        """good, fair or poor, and why."""
        K, relative = self.camera.K, self.sigma[0] / self.camera.K[0, 0]
        size = max(self.camera.width, self.camera.height)
        numbers = (
            f"f {K[0, 0]:.1f} +- {self.sigma[0]:.1f} px ({100 * relative:.2f} %), principal point "
            f"({K[0, 2]:.1f} +- {self.sigma[2]:.1f}, {K[1, 2]:.1f} +- {self.sigma[3]:.1f}) px, "
            f"{self.rms_px:.2f} px off in the mean"
        )
        if self.camera.distortion == "equidistant":
            numbers += ", a fisheye lens (equidistant)"
        advice = []
        if self.centred:
            advice.append(
                "all views show the board under one tilt, which says little of the principal "
                "point: it is taken to be near the middle; 'occ-recon calibrate intrinsics' with "
                "a tilted board does better"
            )
        if relative > _GOOD_F and not self.centred:
            advice.append("tilt the board more (30 to 45 degrees) and vary its distance")
        if self.coverage < _GOOD_COVERAGE and not self.centred:
            advice.append(
                f"bring it to the borders too (corners were in {100 * self.coverage:.0f} % of "
                "the image)"
            )
        if self.rms_px > _GOOD_RMS_PX * size / 1000:
            advice.append(
                "glue the sheet flat, measure its squares, keep the camera still; unless the lens "
                "is neither plumb_bob nor equidistant, of which both were tried"
            )
        word = "good" if not advice else "fair"
        if relative > _FAIR_F or self.rms_px > 3 * _GOOD_RMS_PX * size / 1000:
            word = "poor"
        return word, numbers + (": " + "; ".join(advice) if advice else "")


def calibrate_intrinsics(
    views: Sequence[BoardView],
    size: tuple[int, int],
    focal_px: float | None = None,
) -> Intrinsics:
    """Focal length, principal point and distortion.

    Of a wide lens the equidistant model is tried beside plumb_bob, and taken where it fits clearly
    better. The third radial coefficient of plumb_bob is held at 0 unless it fits significantly
    better. The tangential ones are not: held, they would move the principal point by more than its
    sigma. Where all views show the board under one tilt (it lies on a turntable before a fixed
    camera), they say little of where the principal point is along that tilt: what is believed of
    lenses is then a part of the fit and of the sigmas, which ``centred`` says.

    Args:
        views: at least three with eight corners or more, not all from one direction.
        size: width and height of the images, pixels.
        focal_px: a first guess (EXIF), or None.

    Raises:
        ValueError: too few views, or views that do not determine it.
    """
    usable = [view for view in views if len(view.points) >= _FEWEST_CORNERS]
    if len(usable) < FEWEST_VIEWS:
        raise ValueError(
            f"{len(usable)} view{' shows' if len(usable) == 1 else 's show'} {_FEWEST_CORNERS} "
            f"corners of the board or more: {FEWEST_VIEWS} are needed, 15 are good"
        )
    points = [view.points for view in usable]
    uv = [view.uv for view in usable]
    total = sum(map(len, uv))
    full = 4 if _tilts(points, uv, size, focal_px) > _TILTED else 1
    fit, kept = _best_fit(points, uv, size, focal_px, full)
    uv = fit.uv
    sigma = fit.sigma()
    if not np.isfinite(sigma).all() or sigma[0] > 0.5 * fit.K[0, 0]:
        raise ValueError(
            "these views do not determine the camera: tilt the board, in several directions"
        )
    inside = np.concatenate(uv) / np.array(size) * _GRID
    cells = np.unique(np.clip(inside.astype(int), 0, _GRID - 1), axis=0)
    model = "plumb_bob" if fit.D.any() else "none"
    model = "equidistant" if isinstance(fit, FisheyeFit) else model
    camera = Camera(fit.K, *size, np.eye(3), np.zeros(3), fit.D, model)
    return Intrinsics(
        camera=camera,
        sigma=sigma,
        rms_px=float(np.sqrt(fit.squares / sum(map(len, uv)))),
        view_rms_px=np.array([np.sqrt(np.mean(rest**2)) for rest in fit.distances]),
        views=tuple(usable[k].name for k in kept),
        rejected=total - sum(map(len, uv)),
        coverage=len(cells) / _GRID**2,
        centred=full == 1,
    )


_Made = Callable[[list[Array], list[Array], float | None], "PlumbBobFit | FisheyeFit"]


def _best_fit(
    points: list[Array],
    uv: list[Array],
    size: tuple[int, int],
    focal_px: float | None,
    full: int,
) -> tuple[PlumbBobFit | FisheyeFit, list[int]]:
    """The lens that fits, and which views are used."""
    fit, kept = _settled(lambda p, w, f: PlumbBobFit.of(p, w, size, f, full), points, uv, focal_px)
    if full < 4:
        return fit, kept
    other: PlumbBobFit | FisheyeFit = PlumbBobFit.of(fit.points, fit.uv, size, fit.K[0, 0], 5)
    fit = other if (fit.squares - other.squares) / other.variance > _SIGNIFICANT else fit
    f = fit.K[0, 0]
    if np.hypot(*size) / 2 < _WIDE * f:
        return fit, kept
    try:
        other, others = _settled(
            lambda p, w, f: FisheyeFit.of(p, w, size, f or 1.0, 2), points, uv, f
        )
        more = FisheyeFit.of(other.points, other.uv, size, other.K[0, 0], 4)
    except (ValueError, cv2.error, np.linalg.LinAlgError):
        return fit, kept
    other = more if (other.squares - more.squares) / more.variance > _SIGNIFICANT_PAIR else other
    # What folds back within the image is no lens, as well as it may fit where corners were.
    plumb_bob = Camera(fit.K, *size, np.eye(3), np.zeros(3), fit.D, "plumb_bob")
    enough = 1 / _CLEARLY if folded_share(plumb_bob) > MOST_FOLDED else _CLEARLY
    worse = other.variance > enough**2 * fit.variance or _count(other) < _CLEARLY * _count(fit)
    return (fit, kept) if worse else (other, others)


def _count(fit: PlumbBobFit | FisheyeFit) -> int:
    return sum(map(len, fit.uv))


def _settled(
    made: _Made, points: list[Array], uv: list[Array], focal_px: float | None
) -> tuple[PlumbBobFit | FisheyeFit, list[int]]:
    """A fit without the corners that are wrong, and which views are left."""
    fit, kept = made(points, uv, focal_px), list(range(len(points)))
    for _ in range(_ROUNDS):  # the worst corners first: they bend the rest
        sigma_px = corner_sigma(np.concatenate(fit.distances))
        bound = max(_CUT * sigma_px, _WORST * max(float(rest.max()) for rest in fit.distances))
        good = [rest <= bound for rest in fit.distances]
        if all(g.all() for g in good):
            break
        enough = [k for k, g in enumerate(good) if g.sum() >= _FEWEST_CORNERS]
        if len(enough) < FEWEST_VIEWS:
            raise ValueError("the corners contradict each other: is it the board of board.yaml?")
        points = [points[k][good[k]] for k in enough]
        uv = [uv[k][good[k]] for k in enough]
        kept = [kept[k] for k in enough]
        fit = made(points, uv, fit.K[0, 0])
    return fit, kept


def _tilts(
    points: list[Array], uv: list[Array], size: tuple[int, int], focal_px: float | None
) -> float:
    """How far the board's normals differ in the camera's frame, radians: the second largest
    spread of directions would need a camera; a guessed one tells parallel from not."""
    K = straight_ahead(focal_px or 1.2 * max(size), size)
    guess = Camera(K, *size, np.eye(3), np.zeros(3))
    normals = [
        found[0].pose.R_object_camera[2]
        for p, w in zip(points, uv, strict=True)
        if (found := candidate_poses(guess, p, w))
    ]
    if len(normals) < FEWEST_VIEWS:
        return np.inf
    n = np.array(normals)
    middle = np.median(n, axis=0)
    apart = np.arccos(np.clip(n @ middle / np.linalg.norm(middle), -1, 1))
    return float(np.percentile(apart, 90))


def corner_sigma(distances: Array) -> float:
    """1 sigma of a coordinate of corners that are so far off, px, unmoved by wrong ones."""
    return max(float(np.median(distances)) / np.sqrt(2 * np.log(2)), 0.02)
