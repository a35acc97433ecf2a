"""Photographs of a solid that stands on a printed board, all of it known exactly."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.poses import BoardSpec
from occ_recon_ros.scene import SceneObject
from occ_recon_ros.scene.coverage import coverage
from occ_recon_ros.scene.render import silhouette_loops
from occ_recon_ros.scene.shading import shading
from occ_recon_ros.scene.shapes import ball, placed, ring, through, turned

from .paths import looking_at
from .printed import printed_sheet

Array = NDArray[np.float64]

PAPER, INK = np.array([222.0, 226.0, 230.0]), np.array([34.0, 32.0, 33.0])
TABLE = np.array([70.0, 104.0, 138.0])  # wood
_MARGIN_M = 0.015  # white paper around the pattern
_SHADOW_CELL_M = 0.5e-3


def standing_vase() -> SceneObject:
    """An elliptic vase, 7 cm high, on the plane z = 0."""
    f = through([-1, -0.25, 0.25, 0.65, 1], [0.7, 1.0, 0.8, 0.55, 0.72])
    body = placed(turned(f, 7), (0.027, 0.022, 0.035), (0.004, -0.003, 0.035))
    return SceneObject("vase", (body,))


def standing_mug() -> SceneObject:
    """A mug with a lid and a handle, 6 cm high, on the plane z = 0."""
    body = placed(
        turned(np.polynomial.Chebyshev([1.0, 0.03]), 8), (0.024, 0.024, 0.03), (0, 0, 0.03)
    )
    handle = ring((0.017, 0.017), 0.0042, (0.0255, 0, 0.031), (0, -1, 0))
    return SceneObject("mug", (body, handle))


def lying_pebble() -> SceneObject:
    """A pebble, 4 cm high, on the plane z = 0."""
    return SceneObject("pebble", (ball((0.034, 0.026, 0.02), (0.002, 0.003, 0.02)),))


def cameras_around(
    frames: int, size: tuple[int, int] = (1280, 960), focal_px: float = 1300.0, seed: int = 0
) -> list[Camera]:
    """A turn about a board, uneven as by hand, with a lens that is no ideal one."""
    rng, found = np.random.default_rng(seed), []
    for k in range(frames):
        a = 2 * np.pi * k / frames + rng.uniform(-0.02, 0.02)
        e, distance = 0.62 + rng.uniform(-0.03, 0.03), 0.42 * (1 + rng.uniform(-0.03, 0.03))
        at = np.array([0, 0, 0.022]) + rng.uniform(-0.004, 0.004, 3)
        away = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
        aimed = looking_at(at + distance * away, at, rng.uniform(-0.03, 0.03), focal_px, size)
        K = aimed.K.copy()
        K[:2, 2] += np.array([0.005, -0.004]) * size[0]
        K[1, 1] *= 1.0015
        D = np.array([0.05, -0.1, 0.0005, -0.0005, 0.0])
        found.append(replace(aimed, K=K, D=D, distortion="plumb_bob"))
    return found


@dataclass(frozen=True)
class Standing:
    """What is photographed.

    Attributes:
        body: on the board, in its frame.
        board: that is printed.
        colour: (3,) BGR of the body in full light.
        light: (3,) direction to the lamp, in the object frame.
        shadow: share of the light that the body takes from the paper.
        blur_px, noise: of the camera; px and grey levels, 1 sigma.
    """

    body: SceneObject
    board: BoardSpec
    colour: ArrayLike = (150.0, 95.0, 55.0)
    light: ArrayLike = (0.4, 0.5, 1.0)
    shadow: float = 0.45
    blur_px: float = 0.7
    noise: float = 1.5
    _cast: list[Array] = field(default_factory=list, repr=False)

    def photograph(self, camera: Camera, seed: int = 0, samples: int = 3) -> NDArray[np.uint8]:
        """(h, w, 3) uint8 BGR, with anti-aliasing by exact area at the body's outline."""
        board, margin = self.board, _MARGIN_M
        print_ = printed_sheet(board.black, board.size_m, margin, camera, samples, np.nan)
        sheet = INK + np.nan_to_num(print_, nan=0.0)[..., None] * (PAPER - INK)
        scene = np.where(np.isnan(print_)[..., None], TABLE, sheet)
        scene *= 1 - self.shadow * self._shaded(camera)[..., None]
        loops = silhouette_loops(self.body.silhouette(camera, 0.5))
        covered = coverage(loops, camera.width, camera.height)[..., None]
        light = 0.45 + 0.6 * shading(*self.body.lit_samples, camera)[..., None]
        scene += covered * (light * np.asarray(self.colour) - scene)
        scene = cv2.GaussianBlur(scene, (0, 0), self.blur_px)
        scene += np.random.default_rng(seed).normal(0, self.noise, scene.shape)
        return np.clip(np.rint(scene), 0, 255).astype(np.uint8)

    def _shaded(self, camera: Camera) -> Array:
        """(h, w) 0 to 1: where the body keeps the lamp from the plane."""
        if not self._cast:
            mesh, light = self.body.mesh(128), np.asarray(self.light, np.float64)
            xy = mesh.vertices[:, :2] - mesh.vertices[:, 2:] * light[:2] / light[2]
            size = int(0.4 / _SHADOW_CELL_M)
            cells = np.rint(16 * (xy / _SHADOW_CELL_M + size / 2)).astype(np.int32)
            image = np.zeros((size, size), np.uint8)
            for triangle in cells[mesh.faces]:
                cv2.fillConvexPoly(image, triangle, 255, shift=4)
            self._cast.append(cv2.GaussianBlur(image / 255.0, (0, 0), 3.0))
        v, u = np.mgrid[: camera.height, : camera.width]
        rays = camera.viewing_directions(np.column_stack([u.ravel(), v.ravel()]).astype(float))
        C = camera.centre
        at = C[:2] - C[2] * rays[:, :2] / np.minimum(rays[:, 2:], -1e-9)
        cell = (at / _SHADOW_CELL_M + self._cast[0].shape[0] / 2).reshape(*u.shape, 2)
        cell = np.clip(cell, -1e4, 1e4).astype(np.float32)
        return cv2.remap(self._cast[0], cell[..., 0], cell[..., 1], cv2.INTER_LINEAR)
