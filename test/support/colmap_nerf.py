"""Cameras of a turn as COLMAP and the makers of transforms.json write them, in another world."""

import json
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from occ_recon_ros.geometry import Camera
from occ_recon_ros.scene import TurntableSettings, turntable_cameras

N = 12
RNG = np.random.default_rng(3)
Q = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
Q *= np.sign(np.linalg.det(Q))
SCALE, SHIFT = 37.0, np.array([120.0, -40, 9])
MODELS = {
    "SIMPLE_PINHOLE": (0, 0),
    "PINHOLE": (1, 0),
    "SIMPLE_RADIAL": (2, 1),
    "RADIAL": (3, 2),
    "OPENCV": (4, 4),
    "FULL_OPENCV": (6, 8),
}
"""{name: number in binary files, coefficients of distortion}."""
FISHEYES = {
    "OPENCV_FISHEYE": (5, 4),
    "SIMPLE_RADIAL_FISHEYE": (8, 1),
    "RADIAL_FISHEYE": (9, 2),
    "SIMPLE_FISHEYE": (14, 0),
    "FISHEYE": (15, 0),
}
"""The same, of lenses whose D is that of cv2.fisheye."""
D = (-0.2, 0.05, 0.002, -0.003, 0.01, 0.02, -0.01, 0.005)


def turn(coefficients: int = 0, square: bool = True) -> list[Camera]:
    """A turn; the axes of the cameras meet in the origin, 0.8 m away."""
    settings = TurntableSettings(
        frames=N, step=2 * np.pi / N, width=96, height=72, focal_px=130, distance=0.8
    )
    K = np.array([[130.0, 0, 45.5], [0, 130 if square else 137, 36.25], [0, 0, 1]])
    bent = np.array(D[:coefficients] + (0.0,) * max(0, 4 - coefficients))
    model = "rational_polynomial" if coefficients > 4 else "plumb_bob"
    return [replace(c, K=K, D=bent, distortion=model) for c in turntable_cameras(settings)]


def elsewhere(camera: Camera, shift: np.ndarray = SHIFT) -> tuple[np.ndarray, np.ndarray]:
    """Axes (rows: right, down, forward) and centre in a world turned, moved and of another unit."""
    return camera.R_camera_object @ Q.T, SCALE * Q @ camera.centre + shift


def quaternion(R: np.ndarray) -> np.ndarray:
    """w x y z of R, as the eigenvector of Bar-Itzhack (2000, doi:10.2514/2.4654)."""
    S = R + R.T - np.trace(R) * np.eye(3)
    v = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    matrix = np.block([[S, v[:, None]], [v[None], np.array([[np.trace(R)]])]])
    x, y, z, w = np.linalg.eigh(matrix)[1][:, -1]
    return np.array([w, x, y, z])


def parameters(camera: Camera, model: str) -> list[float]:
    """The principal point is measured from the corner of the first pixel."""
    focal = [camera.K[0, 0]] if model.startswith(("SIMPLE", "RADIAL")) else []
    focal = focal or [camera.K[0, 0], camera.K[1, 1]]
    bent = D[: (MODELS | FISHEYES)[model][1]]
    return [*focal, camera.K[0, 2] + 0.5, camera.K[1, 2] + 0.5, *bent]


def name(k: int) -> str:
    """Of an image: numbers count by value."""
    return f"view {k}.png"


def mixed(cameras: list[Camera]) -> list[int]:
    return [int(k) for k in np.random.default_rng(1).permutation(len(cameras))]


def write_images(
    folder: Path,
    count: int = N,
    size: tuple[int, int] = (96, 72),
    called: Callable[[int], str] = name,
) -> None:
    """The k-th is as bright as k."""
    for k in range(count):
        path = folder / called(k)
        path.parent.mkdir(parents=True, exist_ok=True)
        assert cv2.imwrite(str(path), np.full(size[::-1], 10 + k, np.uint8))


def write_text(
    model: Path, cameras: list[Camera], kind: str, called: Callable[[int], str] = name
) -> None:
    model.mkdir(parents=True, exist_ok=True)
    lenses, images = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"], ["# two lines an image"]
    for k in mixed(cameras):
        camera = cameras[k]
        R, centre = elsewhere(camera)
        words = [kind, camera.width, camera.height, *parameters(camera, kind)]
        lenses.append(" ".join(map(str, [k + 1, *words])))
        pose = [*-quaternion(R), *-R @ centre]  # that of the opposite sign is the same
        images.append(" ".join(map(str, [k + 70, *pose, k + 1, called(k)])))
        images.append("" if k % 2 else "5.5 6.5 -1 7.5 8.5 3")
    (model / "cameras.txt").write_text("\n".join(lenses) + "\n")
    (model / "images.txt").write_text("\n".join(images) + "\n")


def write_binary(
    model: Path,
    cameras: list[Camera],
    kind: str,
    shift: np.ndarray = SHIFT,
    called: Callable[[int], str] = name,
) -> None:
    model.mkdir(parents=True, exist_ok=True)
    lenses = images = struct.pack("<Q", len(cameras))
    for k in mixed(cameras):
        camera, values = cameras[k], parameters(cameras[k], kind)
        R, centre = elsewhere(camera, shift)
        lenses += struct.pack(
            "<IiQQ", k + 1, (MODELS | FISHEYES)[kind][0], camera.width, camera.height
        )
        lenses += struct.pack(f"<{len(values)}d", *values)
        images += struct.pack("<I4d3dI", k + 70, *quaternion(R), *-R @ centre, k + 1)
        images += called(k).encode() + b"\0" + struct.pack("<Q", k)
        images += struct.pack("<ddq", 5.5, 6.5, -1) * k
    (model / "cameras.bin").write_bytes(lenses)
    (model / "images.bin").write_bytes(images)


def frames_of(
    cameras: list[Camera], called: Callable[[int], str] = lambda k: f"./images/{name(k)}"
) -> list[dict[str, Any]]:
    """Camera -> world; the camera has y up and looks backwards."""
    frames = []
    for k in mixed(cameras):
        R, centre = elsewhere(cameras[k])
        T = np.eye(4)
        T[:3] = np.column_stack([R[0], -R[1], -R[2], centre])
        frames.append({"file_path": called(k), "transform_matrix": T.tolist()})
    return frames


def write_transforms(folder: Path, cameras: list[Camera], **more: Any) -> None:
    K = cameras[0].K
    content = {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2] + 0.5, "cy": K[1, 2] + 0.5}
    content |= {"w": 96.0, "h": 72.0, "aabb_scale": 16, "applied_scale": 0.2}
    content |= dict(zip(("k1", "k2", "p1", "p2", "k3"), cameras[0].D, strict=False))
    content |= {"frames": frames_of(cameras)} | more
    folder.mkdir(exist_ok=True)
    (folder / "transforms.json").write_text(json.dumps(content))
