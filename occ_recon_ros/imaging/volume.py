"""The scan volume: where the object is, and nothing that turns with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import Camera
from ..geometry.arrays import Array, axes_along
from .settings import ContourSettings

KINDS = ("none", "box", "cylinder", "plane")


@dataclass(frozen=True)
class Volume:
    """A box, a cylinder about an axis, or the side of a plane, in the object frame.

    Attributes:
        kind: one of KINDS.
        centre: (3,) float64, metres: middle of the box or of the cylinder, a point of the plane.
        size: (3,) float64, metres: edges of the box; diameter, (unused) and height of the
            cylinder. Unused for a plane.
        axis: (3,) float64: of the cylinder; normal of the plane, towards the object.
    """

    kind: str
    centre: Array = field(default_factory=lambda: np.zeros(3))
    size: Array = field(default_factory=lambda: np.ones(3))
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"volume_kind must be one of {', '.join(KINDS)}, not '{self.kind}'")
        length = float(np.linalg.norm(self.axis))
        if not np.isfinite(length) or length == 0:
            raise ValueError("volume_axis must not be zero")
        object.__setattr__(self, "centre", np.asarray(self.centre, np.float64))
        object.__setattr__(self, "size", np.asarray(self.size, np.float64))
        object.__setattr__(self, "axis", np.asarray(self.axis, np.float64) / length)
        if self.kind in ("box", "cylinder") and not (self.size > 0).all():
            raise ValueError("volume_size must be above 0")

    @staticmethod
    def of(settings: ContourSettings) -> Volume | None:
        """The volume that the settings ask for.

        Raises:
            ValueError: a size or an axis that is none.
        """
        s = settings
        if s.volume_kind == "none":
            return None
        return Volume(
            s.volume_kind,
            np.array([s.volume_x, s.volume_y, s.volume_z]),
            np.array([s.volume_width, s.volume_depth, s.volume_height]),
            np.array([s.volume_axis_x, s.volume_axis_y, s.volume_axis_z]),
        )

    def region(self, camera: Camera) -> NDArray[np.uint8] | None:
        """(h, w) uint8, 255 where a ray meets it; None where it bounds no image, as a plane that
        the camera stands above."""
        if self.kind not in ("box", "cylinder"):
            return None
        uv = camera.project(self._hull_points())
        if not np.isfinite(uv).all():
            return None
        region = np.zeros((camera.height, camera.width), np.uint8)
        corners = cv2.convexHull(np.clip(uv, -1e4, 1e4).astype(np.float32))
        fine = np.rint(corners * 16).astype(np.int32)
        cv2.fillConvexPoly(region, fine, 255, shift=4)
        return region

    def _hull_points(self) -> Array:
        """(n, 3) float64, metres, points whose convex hull it is."""
        if self.kind == "box":
            signs = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3)
            return np.asarray(self.centre + signs * self.size)
        first, second, _ = axes_along(self.axis)
        angle = np.linspace(0, 2 * np.pi, 96, endpoint=False)[:, None]
        ring = np.cos(angle) * first + np.sin(angle) * second
        ring = self.centre + 0.5 * self.size[0] * ring
        lift = 0.5 * self.size[2] * self.axis
        return np.concatenate([ring - lift, ring + lift])

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """(n,) whether (n, 3) points lie inside."""
        away = np.asarray(points) - self.centre
        if self.kind == "box":
            return np.asarray((np.abs(away) <= 0.5 * self.size).all(axis=1))
        along = away @ self.axis
        if self.kind == "plane":
            return np.asarray(along >= 0)
        if self.kind == "cylinder":
            across = np.linalg.norm(away - along[:, None] * self.axis, axis=1)
            return np.asarray(
                (np.abs(along) <= 0.5 * self.size[2]) & (across <= 0.5 * self.size[0])
            )
        return np.ones(len(away), np.bool_)

    def box(self, cameras: Sequence[Camera]) -> tuple[Array, Array]:
        """Lowest and highest corner of a box around it, within what the views share."""
        from .joint.space import shared_space

        if self.kind == "box":
            return self.centre - 0.5 * self.size, self.centre + 0.5 * self.size
        if self.kind == "cylinder":
            radius, half = 0.5 * self.size[0], 0.5 * self.size[2]
            reach = np.abs(self.axis) * half + radius * np.sqrt(1 - self.axis**2)
            return self.centre - reach, self.centre + reach
        return shared_space(cameras)
