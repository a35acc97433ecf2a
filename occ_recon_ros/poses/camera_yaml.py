"""camera_info as a YAML file in the form of ROS's camera_calibration; OpenCV's is read too."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.geometry.lens import refuse_folded

from .yaml_file import read_yaml

_K = ("camera_matrix", "cameraMatrix")  # as OpenCV's samples call them
_D = ("distortion_coefficients", "distCoeffs", "dist_coeffs")
_WANTED = (
    "wanted are image_width, image_height, camera_matrix and distortion_coefficients (rows, cols, "
    "data), as 'occ-recon calibrate intrinsics' writes them"
)


def camera_to_yaml(camera: Camera) -> str:
    """The text of the file; the pose is not in it."""
    model = "plumb_bob" if camera.distortion == "none" else camera.distortion
    D = np.zeros(max(len(camera.D), {"equidistant": 4, "rational_polynomial": 8}.get(model, 5)))
    D[: len(camera.D)] = camera.D
    P = np.column_stack([camera.K, np.zeros(3)])
    content = {
        "image_width": int(camera.width),
        "image_height": int(camera.height),
        "camera_name": "camera",
        "camera_matrix": _matrix(camera.K),
        "distortion_model": model,
        "distortion_coefficients": _matrix(D[None]),
        "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(P),
    }
    return str(yaml.safe_dump(content, sort_keys=False, default_flow_style=None))


def _matrix(values: np.ndarray) -> dict[str, Any]:
    rows, cols = values.shape
    return {"rows": rows, "cols": cols, "data": values.ravel().tolist()}


def read_camera(path: Path) -> Camera:
    """A camera of such a file, at the origin.

    Raises:
        ValueError: not there, not of that form, or not a camera, or its distortion folds back
            within the image; with the path in the message.
    """
    content = read_yaml(path, "camera file", "calibrate intrinsics")
    try:
        camera = _camera(content)
        refuse_folded(camera)
    except ValueError as error:
        raise ValueError(f"camera file {path}: {error}") from None
    return camera


def _camera(content: Any) -> Camera:
    """
    Raises:
        ValueError: what is missing or wrong, in words.
    """
    if not isinstance(content, Mapping):
        raise ValueError(f"it holds no camera_matrix: {_WANTED}")
    lacks = [keys[0] for keys in (_K, _D) if not set(keys) & content.keys()]
    lacks += [key for key in ("image_width", "image_height") if key not in content]
    if lacks:
        raise ValueError(f"it lacks {' and '.join(lacks)}: {_WANTED}")
    K, D = _numbers(content, _K), _numbers(content, _D)
    if K.size != 9:
        raise ValueError(f"camera_matrix must have 9 numbers, it has {K.size}")
    model = str(content.get("distortion_model", "plumb_bob"))
    return Camera(
        K=K.reshape(3, 3),
        width=_pixels(content, "image_width"),
        height=_pixels(content, "image_height"),
        R_camera_object=np.eye(3),
        t_camera_object=np.zeros(3),
        D=D,
        distortion=model if D.any() or model == "equidistant" else "none",
    )


def _numbers(content: Mapping[str, Any], keys: tuple[str, ...]) -> Array:
    """(n,) the numbers of a matrix: a list, or rows, cols and data."""
    key = next(key for key in keys if key in content)
    value = content[key]
    if isinstance(value, Mapping):
        if "data" not in value:
            raise ValueError(f"{key} lacks data: {_WANTED}")
        value = value["data"]
    try:
        return np.asarray([] if value is None else value, np.float64).ravel()
    except (TypeError, ValueError):
        raise ValueError(f"{key} must be numbers, got {value!r:.40}") from None


def _pixels(content: Mapping[str, Any], key: str) -> int:
    value = content[key]
    try:
        if int(value) == float(value) and int(value) > 0:
            return int(value)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ValueError(f"{key} must be a whole number of pixels, got {value!r:.40}")
