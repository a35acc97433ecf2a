"""CameraInfo (with a pose) to Camera and back."""

import numpy as np
from sensor_msgs.msg import CameraInfo

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.lens import refuse_folded
from occ_recon_ros.geometry.pose import ORIGIN, CameraPose

from .header import encode_header

_COEFFICIENTS = {
    "plumb_bob": (4, 5),
    "rational_polynomial": (8, 12, 14),
    "equidistant": (4,),
}


def decode_camera(info: CameraInfo, pose: CameraPose = ORIGIN) -> Camera:
    """The view of an image as received: binning and region of interest applied to K.

    A binned pixel covers b sensor pixels, so its centre lies (b - 1) / 2 of them after the
    first one's: u = (u_sensor - offset - (b - 1) / 2) / b.

    Raises:
        ValueError: not calibrated (K[0] is 0), not finite, an unknown distortion model or a
            wrong number of coefficients, no size, a region outside the sensor, a distortion that
            folds back within the image.
    """
    K = np.array(info.k, np.float64).reshape(3, 3)
    if not np.isfinite(K).all():
        raise ValueError("K is not finite")
    if K[0, 0] == 0:
        raise ValueError("the camera is not calibrated: K[0] is 0")
    bx, by = max(1, int(info.binning_x)), max(1, int(info.binning_y))
    roi = info.roi
    x0, y0, width, height = int(roi.x_offset), int(roi.y_offset), int(roi.width), int(roi.height)
    # All zero means the whole sensor.
    width, height = width or int(info.width), height or int(info.height)
    if not width // bx or not height // by:
        raise ValueError(f"width and height are {width}x{height} at binning {bx}x{by}")
    if x0 + width > info.width or y0 + height > info.height:
        raise ValueError(
            f"the region of interest {width}x{height}+{x0}+{y0} lies outside of "
            f"{info.width}x{info.height}"
        )
    # Sensor pixels to pixels as received, as a matrix.
    u, v = (-x0 - (bx - 1) / 2) / bx, (-y0 - (by - 1) / 2) / by
    binned = np.array([[1 / bx, 0, u], [0, 1 / by, v], [0, 0, 1]])
    model, D = _distortion(info)
    R = pose.R_object_camera.T
    camera = Camera(binned @ K, width // bx, height // by, R, -R @ pose.centre, D, model)
    refuse_folded(camera)
    return camera


def _distortion(info: CameraInfo) -> tuple[str, np.ndarray]:
    D = np.array(info.d, np.float64)
    model = info.distortion_model
    if not np.isfinite(D).all():
        raise ValueError("D is not finite")
    bends = D.any() or (model == "equidistant" and len(D))  # no D at all: the image is rectified
    if not bends and (not model or model in _COEFFICIENTS):
        return "none", np.zeros(0)
    counts = _COEFFICIENTS.get(model)
    if counts is None:
        known = ", ".join(_COEFFICIENTS)
        raise ValueError(f"distortion model '{model}' is not supported: use one of {known}")
    if len(D) not in counts:
        wanted = " or ".join(map(str, counts))
        raise ValueError(f"{model} needs {wanted} coefficients, got {len(D)}")
    if D[12:].any():
        raise ValueError("a tilted sensor (coefficients 13 and 14) is not supported")
    return model, D[:12]


def encode_camera_info(camera: Camera, stamp_ns: int, frame_id: str) -> CameraInfo:
    """The intrinsics of a view, uncropped and not binned."""
    model = "plumb_bob" if camera.distortion == "none" else camera.distortion
    count = min(n for n in _COEFFICIENTS[model] if n >= max(len(camera.D), 5 * (model[0] == "p")))
    D = np.zeros(count)
    D[: len(camera.D)] = camera.D
    P = np.column_stack([camera.K, np.zeros(3)])
    return CameraInfo(
        header=encode_header(stamp_ns, frame_id),
        height=int(camera.height),
        width=int(camera.width),
        distortion_model=model,
        d=[float(value) for value in D],
        k=camera.K.astype(np.float64).ravel(),
        r=np.eye(3).ravel(),
        p=P.ravel(),
    )
