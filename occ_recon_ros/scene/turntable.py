"""The poses that a camera before a turntable takes in the frame of the object."""

from dataclasses import dataclass

import numpy as np

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.geometry.settings import setting


@dataclass(frozen=True)
class TurntableSettings:
    """A fixed camera before a turning object.

    Seen from above, the table turns the object counter-clockwise (positive about its
    axis) by ``step`` a frame; in the object frame the camera therefore moves clockwise.
    """

    frames: int = setting(36, "number of views", within=(1, 100000))
    step: float = setting(
        float(np.deg2rad(10)), "rotation of the table from view to view, rad", within=(-3.2, 3.2)
    )
    distance: float = setting(1.0, "camera centre to origin, m", within=(1e-3, 1e3))
    elevation: float = setting(
        float(np.deg2rad(15)),
        "angle of the camera above the table's plane, rad",
        within=(-1.5, 1.5),
    )
    width: int = setting(1280, "image width, px", within=(1, 20000))
    height: int = setting(960, "image height, px", within=(1, 20000))
    focal_px: float = setting(1600.0, "focal length, px", within=(1.0, 1e6))
    axis_offset_x: float = setting(
        0.0, "where the table's axis meets z = 0, m", within=(-10.0, 10.0)
    )
    axis_offset_y: float = setting(
        0.0, "where the table's axis meets z = 0, m", within=(-10.0, 10.0)
    )
    axis_tilt: float = setting(0.0, "tilt of the axis from z towards x, rad", within=(-1.5, 1.5))


def turntable_cameras(
    settings: TurntableSettings | None = None,
    D: tuple[float, ...] = (),
    distortion: str = "none",
) -> list[Camera]:
    """The views of one run of the turntable.

    The camera looks at the point where the axis meets z = 0, with the axis upright in
    the image; frame 0 sees it from +x (of the axis' own frame).

    Args:
        settings: the rig; the defaults if None.
        D, distortion: lens distortion, as in Camera.
    """
    s = settings or TurntableSettings()
    f, (u, v) = s.focal_px, (0.5 * (s.width - 1), 0.5 * (s.height - 1))
    K = np.array([[f, 0, u], [0, f, v], [0, 0, 1]])
    sin, cos = np.sin(s.elevation), np.cos(s.elevation)
    # Rows: right, down and forward of the camera in the table's frame.
    R_camera_table = np.array([[0, 1.0, 0], [sin, 0, -cos], [-cos, 0, -sin]])
    t_camera_table = np.array([0, 0, s.distance])
    axis_foot = np.array([s.axis_offset_x, s.axis_offset_y, 0])
    R_table_axis = _about_y(s.axis_tilt).T
    cameras = []
    for frame in range(s.frames):
        R = R_camera_table @ _about_z(frame * s.step) @ R_table_axis
        t = t_camera_table - R @ axis_foot
        cameras.append(Camera(K, s.width, s.height, R, t, np.array(D), distortion))
    return cameras


def _about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _about_y(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
