"""camera_info as a YAML file in the form of ROS's camera_calibration."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from occ_recon_ros.geometry import Camera

from .yaml_file import read_yaml


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
    return {"rows": rows, "cols": cols, "data": [float(value) for value in values.ravel()]}


def read_camera(path: Path) -> Camera:
    """A camera of such a file, at the origin.

    Raises:
        ValueError: not there, not of that form, or not a camera, with the path in the message.
    """
    content = read_yaml(path, "camera file", "calibrate intrinsics")
    try:
        D = np.asarray(content["distortion_coefficients"]["data"], np.float64)
        model = str(content.get("distortion_model", "plumb_bob"))
        return Camera(
            K=np.asarray(content["camera_matrix"]["data"], np.float64).reshape(3, 3),
            width=int(content["image_width"]),
            height=int(content["image_height"]),
            R_camera_object=np.eye(3),
            t_camera_object=np.zeros(3),
            D=D,
            distortion=model if D.any() or model == "equidistant" else "none",
        )
    except (KeyError, TypeError) as error:
        raise ValueError(f"camera file {path} is not of ROS's form: it lacks {error}") from None
    except ValueError as error:
        raise ValueError(f"camera file {path}: {error}") from None
