"""Rendered photographs of textured objects in rooms, and the exact mask of each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from trimesh.ray.ray_pyembree import RayMeshIntersector

from occ_recon_ros.geometry import Camera
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras

Array = NDArray[np.float64]
Colours = Callable[[Array], Array]
"""(n, 3) points, object frame, to (n, 3) BGR."""
Backdrop = Callable[[Camera, int], Array]
"""Camera and number of the view to (h, w, 3) BGR."""

_FINE = 2  # rays along each side of a pixel
_AMBIENT = 0.35


@dataclass(frozen=True)
class Shot:
    """A photograph, what of it is the object, and the mask that comes with it."""

    image: NDArray[np.uint8]
    truth: NDArray[np.bool_]
    camera: Camera
    given: NDArray[np.uint8] | None = None


@dataclass(frozen=True)
class Floor:
    """What the object stands on.

    Attributes:
        height: of its top, metres along z.
        radius: of the disc, metres.
        colours: of its points.
        shadow: share of the light that the object takes from it.
    """

    height: float
    radius: float
    colours: Colours
    shadow: float = 0.5


@dataclass(frozen=True)
class Stage:
    """What is photographed.

    Attributes:
        body: mesh of the object, metres.
        colours: of its points.
        backdrop: behind everything.
        floor: under it.
        shine: share of a highlight.
        light: (3,) direction to the light, camera frame (x right, y down, z forward).
        ambient: light where the lamp does not reach.
        noise: standard deviation, grey levels.
    """

    body: trimesh.Trimesh
    colours: Colours
    backdrop: Backdrop
    floor: Floor | None = None
    shine: float = 0.0
    light: tuple[float, float, float] = (-0.5, -0.7, -0.5)
    ambient: float = _AMBIENT
    noise: float = 2.0
    _caster: list = field(default_factory=list)

    def caster(self) -> RayMeshIntersector:
        if not self._caster:
            self._caster.append(RayMeshIntersector(self.body))
        return self._caster[0]


def photograph(stage: Stage, camera: Camera, number: int) -> Shot:
    """One view."""
    rows, columns = _FINE * camera.height, _FINE * camera.width
    y, x = np.mgrid[:rows, :columns]
    uv = (np.stack([x, y], axis=-1).reshape(-1, 2) + 0.5) / _FINE - 0.5
    rays = camera.viewing_directions(uv)
    scene = np.asarray(
        cv2.resize(np.asarray(stage.backdrop(camera, number), np.float32), (columns, rows)),
        np.float64,
    ).reshape(-1, 3)
    light = camera.R_camera_object.T @ (np.array(stage.light) / np.linalg.norm(stage.light))
    if stage.floor is not None:
        _draw_floor(scene, stage, camera, rays, light)
    near = _box(stage.body, camera, uv)
    hit = np.zeros(len(rays), np.bool_)
    where, ray, face = stage.caster().intersects_location(
        np.broadcast_to(camera.centre, (len(near), 3)), rays[near], multiple_hits=False
    )[0:3]
    at = near[ray]
    hit[at] = True
    scene[at] = _lit(stage, where, face, rays[at], light)
    image = scene.reshape(camera.height, _FINE, camera.width, _FINE, 3).mean(axis=(1, 3))
    share = hit.reshape(camera.height, _FINE, camera.width, _FINE).mean(axis=(1, 3))
    image = cv2.GaussianBlur(image, (0, 0), 0.6)
    image = image + stage.noise * np.random.default_rng(number).standard_normal(image.shape)
    return Shot(np.clip(np.rint(image), 0, 255).astype(np.uint8), share > 0.5, camera)


def _box(body: trimesh.Trimesh, camera: Camera, uv: Array) -> NDArray[np.intp]:
    seen = camera.project(np.asarray(body.vertices))
    low, high = seen.min(axis=0) - 2, seen.max(axis=0) + 2
    return np.flatnonzero(((uv >= low) & (uv <= high)).all(axis=1))


def _lit(stage: Stage, points: Array, face: NDArray, rays: Array, light: Array) -> Array:
    corners = stage.body.triangles[face]
    weights = trimesh.triangles.points_to_barycentric(corners, points)
    normals = (stage.body.vertex_normals[stage.body.faces[face]] * weights[..., None]).sum(axis=1)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    diffuse = np.maximum(normals @ light, 0.0)
    colours = stage.colours(points) * (stage.ambient + (1 - stage.ambient) * diffuse)[:, None]
    if stage.shine:
        half = light - rays / np.linalg.norm(rays, axis=1)[:, None]
        half /= np.linalg.norm(half, axis=1)[:, None]
        colours = (
            colours + 255 * stage.shine * np.maximum((normals * half).sum(1), 0)[:, None] ** 30
        )
    return colours


def _draw_floor(scene: Array, stage: Stage, camera: Camera, rays: Array, light: Array) -> None:
    assert stage.floor is not None
    down = np.where(np.abs(rays[:, 2]) > 1e-9, rays[:, 2], 1e-9)
    away = (stage.floor.height - camera.centre[2]) / down
    points = camera.centre + away[:, None] * rays
    on = (away > 0) & (np.hypot(points[:, 0], points[:, 1]) < stage.floor.radius)
    points = points[on]
    colours = stage.floor.colours(points)
    if stage.floor.shadow:
        # A lamp of some size: shadows of a few points on it.
        rng, shade = np.random.default_rng(0), np.zeros(len(points))
        for spread in 0.12 * rng.standard_normal((4, 3)):
            towards = np.broadcast_to(light + spread, points.shape)
            shade += stage.caster().intersects_any(points + 1e-4 * light, towards) / 4
        colours = colours * (1 - stage.floor.shadow * shade)[:, None]
    scene[on] = colours


def in_soft_light(stage: Stage, darkest: float = 0.85, directions: int = 64) -> Stage:
    """The stage with the shadow that light from all the sky leaves under the object, on its floor:
    a soft one, darkest at the foot, that turns with the object."""
    assert stage.floor is not None
    half, cells = min(stage.floor.radius, 0.3), 220
    side = np.linspace(-half, half, cells)
    x, y = np.meshgrid(side, side)
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, stage.floor.height + 1e-4)])
    sky = np.random.default_rng(0).normal(size=(directions, 3))
    sky[:, 2] = np.abs(sky[:, 2])
    sky /= np.linalg.norm(sky, axis=1)[:, None]
    hidden = np.zeros(len(points))
    for towards in sky:
        hidden += towards[2] * stage.caster().intersects_any(
            points, np.broadcast_to(towards, points.shape)
        )
    share = hidden.reshape(cells, cells) / sky[:, 2].sum()
    soft = cv2.GaussianBlur(share.astype(np.float32), (0, 0), 1.5)
    bare = stage.floor.colours

    def colours(where: Array) -> Array:
        at = (where[:, 1::-1].T + half) / (2 * half) * (cells - 1)
        return bare(where) * (1 - darkest * map_coordinates(soft, at, order=1))[:, None]

    return replace(stage, floor=replace(stage.floor, colours=colours))


def body(name: str, models: Path | None = None) -> trimesh.Trimesh:
    """A mesh about 0.2 m high around the origin, upright along z."""
    if name == "temple":
        return temple()
    if name == "spot":
        assert models is not None
        mesh = trimesh.load(models / "spot.obj", force="mesh", process=False)
        mesh = trimesh.Trimesh(mesh.vertices, mesh.faces)
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
        mesh.apply_scale(0.2 / np.ptp(mesh.bounds, axis=0).max())
        return mesh
    parts = [trimesh.Trimesh(*part.grid(128), process=False) for part in make_object(name).parts]
    return trimesh.util.concatenate(parts)


def temple() -> trimesh.Trimesh:
    """Two corner columns of a ruin: steps, columns, walls behind them, a cornice with teeth."""
    box, move = trimesh.creation.box, trimesh.transformations.translation_matrix
    parts = [
        box((0.12, 0.1, 0.02), move((0, 0, -0.09))),
        box((0.10, 0.08, 0.02), move((0, 0, -0.07))),
    ]
    for x, y in ((-0.038, -0.028), (0.0, -0.028), (0.038, -0.028), (-0.038, 0.02), (-0.038, 0.0)):
        column = trimesh.creation.cylinder(0.008, 0.10, sections=24)
        parts.append(column.apply_transform(move((x, y, -0.01))))
        parts.append(box((0.02, 0.02, 0.006), move((x, y, 0.04))))
    parts.append(box((0.06, 0.012, 0.10), move((0.012, 0.022, -0.01))))
    parts.append(box((0.012, 0.05, 0.10), move((-0.012, 0.0, -0.01))))
    parts.append(box((0.105, 0.085, 0.018), move((0, 0, 0.052))))
    for x in np.linspace(-0.045, 0.045, 7):
        parts.append(box((0.008, 0.094, 0.008), move((x, 0, 0.065))))
    rubble = np.random.default_rng(1)
    for _ in range(12):
        at = rubble.uniform([-0.04, -0.03, 0.066], [0.01, 0.03, 0.085])
        parts.append(box(rubble.uniform(0.012, 0.03, 3), move(at)))
    mesh = trimesh.util.concatenate(parts)
    mesh.unmerge_vertices()
    return mesh


def turn(
    frames: int,
    size: tuple[int, int] = (640, 480),
    degrees: float = 360.0,
    elevation: float = 0.3,
    fills: float = 0.55,
    rolled: bool = False,
) -> list[Camera]:
    """Cameras about the object, which fills this share of the image's height."""
    width, height = size
    rig = TurntableSettings(
        frames=frames,
        step=np.deg2rad(degrees) / frames,
        elevation=elevation,
        width=width,
        height=height,
        focal_px=fills * height / 0.2,
    )
    cameras = turntable_cameras(rig)
    if not rolled:
        return cameras
    R = np.array([[0, 1.0, 0], [-1, 0, 0], [0, 0, 1]])
    return [
        replace(c, R_camera_object=R @ c.R_camera_object, t_camera_object=R @ c.t_camera_object)
        for c in cameras
    ]


def even(bgr: Sequence[float]) -> Colours:
    """One colour."""
    return lambda points: np.broadcast_to(np.array(bgr, float), points.shape)


def mottled(bgr: Sequence[float], other: Sequence[float], size: float, seed: int = 0) -> Colours:
    """Two colours that mix in blots of a size, metres."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(8, 3)) / size
    phase = rng.uniform(0, 6.3, 8)

    def colours(points: Array) -> Array:
        mix = np.sin(points @ waves.T + phase).sum(axis=1) / 2.0
        share = (0.5 + 0.5 * np.tanh(mix))[:, None]
        return share * np.array(bgr, float) + (1 - share) * np.array(other, float)

    return colours


def checked(bgr: Sequence[float], other: Sequence[float], size: float) -> Colours:
    """Squares that are unlike each other, as on a printed board."""

    def colours(points: Array) -> Array:
        cell = np.floor(points[:, :2] / size).astype(np.int64)
        inner = np.floor(points[:, :2] / (size / 4)).astype(np.int64)
        code = (cell[:, 0] * 73856093) ^ (cell[:, 1] * 19349663)
        bit = (inner[:, 0] * 7 + inner[:, 1] * 13 + code) % 5 < 2
        even_cell = (cell.sum(axis=1) % 2 == 0) & bit
        return np.where(even_cell[:, None], np.array(bgr, float), np.array(other, float))

    return colours


def plain(bgr: Sequence[float]) -> Backdrop:
    """One colour."""
    return lambda camera, number: np.broadcast_to(
        np.array(bgr, float), (camera.height, camera.width, 3)
    )


def folded(bgr: Sequence[float], fold: float) -> Backdrop:
    """Cloth with folds, that many grey levels high."""

    def draw(camera: Camera, number: int) -> Array:
        y, x = np.mgrid[: camera.height, : camera.width] / camera.height
        waves = np.sin(17 * x + 4 * np.sin(5 * y)) + 0.6 * np.sin(9 * x - 14 * y + 1)
        return np.array(bgr, float) + (fold * np.maximum(waves, 0) / 1.6)[..., None]

    return draw


def gradient(low: Sequence[float], high: Sequence[float]) -> Backdrop:
    """From one colour above to another below."""

    def draw(camera: Camera, number: int) -> Array:
        share = np.linspace(0, 1, camera.height)[:, None, None]
        row = (1 - share) * np.array(low, float) + share * np.array(high, float)
        return np.broadcast_to(row, (camera.height, camera.width, 3))

    return draw


def room(seed: int = 0, contrast: float = 60.0, moves: bool = False) -> Backdrop:
    """Things far behind: with the fixed camera, or standing still while the camera moves."""

    def draw(camera: Camera, number: int) -> Array:
        rng = np.random.default_rng(seed)
        y, x = np.mgrid[: camera.height : 4, : camera.width : 4]
        T = np.column_stack([(x.ravel() + 1.5), (y.ravel() + 1.5)]).astype(float)
        rays = camera.viewing_directions(T)
        if not moves:
            rays = rays @ camera.R_camera_object.T
        rays = rays / np.linalg.norm(rays, axis=1)[:, None]
        out = np.full((len(rays), 3), 110.0)
        for _ in range(10):
            wave, tint = 6 * rng.normal(size=3), rng.uniform(0.3, 1, 3)
            out += contrast / 3 * tint * np.sign(np.sin(rays @ wave + rng.uniform(0, 6)))[:, None]
        small = out.reshape(*x.shape, 3).astype(np.float32)
        return np.asarray(cv2.resize(small, (camera.width, camera.height)), np.float64)

    return draw
