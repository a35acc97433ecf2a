"""The axis of a turntable before a fixed camera: found from board poses, used with an encoder.

The object turns by phi about the line through ``point`` along ``direction``; in the object's frame
the camera then turns by -phi about it, right-handed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry.arrays import Array, robust_sigma
from occ_recon_ros.geometry.pose import CameraPose

from .projection import difference
from .yaml_file import read_yaml

_FEWEST = 3
_LEAST_TURN = np.deg2rad(10)  # poses that turn less tell no axis
_SLIP_SIGMAS, _SLIP = 6.0, np.deg2rad(0.5)
_FITS = np.deg2rad(5)  # an encoder whose angles are off by more does not belong to these poses
_OFF_AXIS_SIGMAS = 10.0


@dataclass(frozen=True)
class Turntable:
    """A calibrated axis and the camera before it.

    Attributes:
        point: (3,) float64, the point of the axis nearest to the object frame's origin, metres.
        direction: (3,) float64, unit vector along it, object frame.
        camera_at_zero: pose of the camera when the joint is at angle 0.
        ratio: turn of the object over turn of the joint; -1 for one that counts the other way.
        joint: name of the joint, empty: the only one there is.
    """

    point: Array
    direction: Array
    camera_at_zero: CameraPose
    ratio: float = 1.0
    joint: str = ""

    def camera_at(self, angle: float) -> CameraPose:
        """Pose of the camera in the object frame at an angle of the joint, radians."""
        return _turned(self.camera_at_zero, self.point, self.direction, self.ratio * angle)

    def angle_of(self, pose: CameraPose) -> float:
        """By how much the object has turned from the joint's zero where the camera is at a pose,
        radians, -pi to pi."""
        R = pose.R_object_camera @ self.camera_at_zero.R_object_camera.T
        *xyz, w = Rotation.from_matrix(R).as_quat()
        return -float(wrapped(2 * np.arctan2(np.array(xyz) @ self.direction, w)))


@dataclass(frozen=True)
class AxisFit:
    """An axis found, and how well.

    Attributes:
        table: the axis.
        angles: (n,) float64, turn of the object at each pose from the first, radians.
        residual_mm, residual_deg: (n,) how far each pose is from the circle.
        sigma_direction_deg, sigma_point_mm: 1 sigma, the larger of the two directions.
        encoder_residual_deg: (n,) angle by the board minus angle by the encoder; empty without.
        slips: indices of the poses before which the encoder slipped.
    """

    table: Turntable
    angles: Array
    residual_mm: Array
    residual_deg: Array
    sigma_direction_deg: float
    sigma_point_mm: float
    encoder_residual_deg: Array
    slips: tuple[int, ...]


def calibrate_axis(
    poses: Sequence[CameraPose],
    covariances: Sequence[Array],
    joint_angles: Array | None = None,
    joint: str = "",
) -> AxisFit:
    """The axis from poses of a board on the table, at angles that need not be known.

    Args:
        poses: of the camera in the board's frame, three or more over ten degrees or more.
        covariances: (6, 6) each, as BoardPose has them.
        joint_angles: (n,) float64, what an encoder said, radians, or None.
        joint: its name.

    Raises:
        ValueError: too few poses, too small a turn, poses that lie on no circle, or an encoder
            that does not belong to them.
    """
    if len(poses) < _FEWEST:
        raise ValueError(f"{len(poses)} poses of the board: {_FEWEST} are needed, 12 are good")
    base = poses[0]
    turns = Rotation.from_matrix(
        np.array([p.R_object_camera @ base.R_object_camera.T for p in poses])
    ).as_rotvec()
    if np.linalg.norm(turns, axis=1).max() < _LEAST_TURN:
        raise ValueError("the table turned by less than 10 degrees: turn it further")
    direction = np.linalg.svd(turns)[2][0]
    # Upwards, or else along the largest component.
    largest = 2 if abs(direction[2]) > 0.1 else int(np.abs(direction).argmax())
    direction = direction * np.sign(direction[largest])
    phi = -turns @ direction
    white = [_whitener(covariance) for covariance in covariances]
    fit, d, p, reference, angles = _solve(poses, white, direction, phi)
    scale = max(1.0, float(2 * fit.cost / max(6 * len(poses) - len(fit.x), 1)))
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) * scale
    there = [_turned(reference, p, d, angle) for angle in angles]
    residuals = np.array([difference(*pair) for pair in zip(poses, there, strict=True)])
    if np.sqrt(scale) > _OFF_AXIS_SIGMAS:
        worst = int(np.linalg.norm(residuals[:, :3], axis=1).argmax())
        raise ValueError(
            f"the poses lie on no circle (pose {worst + 1} is "
            f"{1e3 * np.linalg.norm(residuals[worst, :3]):.1f} mm off): camera and axis must not "
            "move, only the table turns"
        )
    table = Turntable(p, d, reference, 1.0, joint)
    encoder_residual, slips = np.zeros(0), tuple[int, ...]()
    if joint_angles is not None:
        table, encoder_residual, slips = _with_encoder(table, angles, joint_angles)
    return AxisFit(
        table=table,
        angles=angles,
        residual_mm=1e3 * np.linalg.norm(residuals[:, :3], axis=1),
        residual_deg=np.rad2deg(np.linalg.norm(residuals[:, 3:], axis=1)),
        sigma_direction_deg=float(np.rad2deg(np.sqrt(np.diag(covariance)[:2].max()))),
        sigma_point_mm=1e3 * float(np.sqrt(np.diag(covariance)[2:4].max())),
        encoder_residual_deg=np.rad2deg(encoder_residual),
        slips=slips,
    )


def _solve(
    poses: Sequence[CameraPose], white: list[Array], direction: Array, phi: Array
) -> tuple[Any, Array, Array, CameraPose, Array]:
    """Axis, first camera and angles, by least squares weighted by the poses' covariances."""
    base, n = poses[0], len(poses)
    rows, right = [direction[None]], [np.zeros(1)]
    for pose, angle in zip(poses[1:], phi[1:], strict=True):
        R = Rotation.from_rotvec(-angle * direction).as_matrix()
        rows.append(np.eye(3) - R)
        right.append(pose.centre - R @ base.centre)
    point = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    e1 = np.linalg.svd(direction[None])[2][1]
    e2 = np.cross(direction, e1)
    size = max(float(np.linalg.norm(base.centre - point)), 1e-6)

    def unpack(x: Array) -> tuple[Array, Array, CameraPose, Array]:
        d = direction + x[0] * e1 + x[1] * e2
        p = point + x[2] * size * e1 + x[3] * size * e2
        turn = Rotation.from_rotvec(x[7:10]).as_matrix()
        first = CameraPose(turn @ base.R_object_camera, base.centre + x[4:7] * size)
        return d / np.linalg.norm(d), p, first, np.concatenate([[0.0], phi[1:] + x[10:]])

    def residuals(x: Array) -> Array:
        d, p, first, angles = unpack(x)
        R = Rotation.from_rotvec(-angles[:, None] * d).as_matrix()
        centres = p + R @ (first.centre - p)
        turns = Rotation.from_matrix(
            np.array([q.R_object_camera for q in poses])
            @ np.swapaxes(R @ first.R_object_camera, 1, 2)
        ).as_rotvec()
        shifts = np.array([q.centre for q in poses]) - centres
        both = np.concatenate([shifts, turns], axis=1)
        result: Array = np.einsum("nij,nj->ni", np.array(white), both).ravel()
        return result

    fit = least_squares(residuals, np.zeros(9 + n), method="trf", x_scale="jac")
    d, p, first, angles = unpack(fit.x)
    # In metres and radians, for the covariance.
    fit.jac[:, 2:7] /= size
    return fit, d, p - (p @ d) * d, first, angles


def _with_encoder(
    table: Turntable, angles: Array, joint: Array
) -> tuple[Turntable, Array, tuple[int, ...]]:
    """The table with the joint's sense and zero; what is left; where it slipped."""
    ways = []
    for ratio in (1.0, -1.0):
        rest = wrapped(angles - ratio * joint)
        offset = _circular_median(rest)
        ways.append((ratio, offset, wrapped(rest - offset)))
    ratio, offset, left = min(ways, key=lambda way: np.median(np.abs(way[2])))
    steps = wrapped(np.diff(left))
    usual = robust_sigma(steps) if len(steps) else 0.0
    slips = np.flatnonzero(np.abs(steps) > max(_SLIP_SIGMAS * usual, _SLIP)) + 1
    if np.median(np.abs(left)) > _FITS:
        raise ValueError(
            "the encoder's angles do not belong to these poses (off by "
            f"{np.rad2deg(np.median(np.abs(left))):.0f} degrees in the median): another joint, "
            "another unit than radians, or a gear between"
        )
    at_zero = _turned(table.camera_at_zero, table.point, table.direction, offset)
    return replace(table, camera_at_zero=at_zero, ratio=ratio), left, tuple(slips.tolist())


def _turned(pose: CameraPose, point: Array, direction: Array, phi: float) -> CameraPose:
    """The camera's pose when the object has turned by phi."""
    R = Rotation.from_rotvec(-phi * direction).as_matrix()
    return CameraPose(R @ pose.R_object_camera, point + R @ (pose.centre - point))


def _whitener(covariance: Array) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    floor = max(float(values[-1]), 1e-18) * 1e-12
    result: Array = (vectors / np.sqrt(np.maximum(values, floor))).T
    return result


def wrapped(angle: Any) -> Any:
    """Angles, radians, from -pi to pi."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


def _circular_median(angles: Array) -> float:
    """The one of the angles that is nearest to all."""
    apart = np.abs(wrapped(angles[:, None] - angles[None]))
    middle = angles[int(apart.sum(axis=1).argmin())]
    return float(middle + np.median(wrapped(angles - middle)))


def turntable_to_yaml(table: Turntable, comment: str = "") -> str:
    """The text of the file that turntable_pose reads."""
    quaternion = Rotation.from_matrix(table.camera_at_zero.R_object_camera).as_quat()
    content = {
        "joint": table.joint,
        "ratio": float(table.ratio),
        "axis": {
            "point": table.point.tolist(),
            "direction": table.direction.tolist(),
        },
        "camera_at_zero": {
            "position": table.camera_at_zero.centre.tolist(),
            "orientation_xyzw": quaternion.tolist(),
        },
    }
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    return head + str(yaml.safe_dump(content, sort_keys=False, default_flow_style=None))


def read_turntable(path: Path) -> Turntable:
    """A turntable of such a file.

    Raises:
        ValueError: not there, not of that form, or no axis, with the path in the message.
    """
    content = read_yaml(path, "axis file", "calibrate axis")
    try:
        point, direction = (
            np.asarray(content["axis"][key], np.float64).reshape(3)
            for key in ("point", "direction")
        )
        at_zero = content["camera_at_zero"]
        centre = np.asarray(at_zero["position"], np.float64).reshape(3)
        quaternion = np.asarray(at_zero["orientation_xyzw"], np.float64).reshape(4)
        ratio, joint = float(content.get("ratio", 1.0)), str(content.get("joint", ""))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"axis file {path} is not of the form that is needed: {error}") from None
    values = np.concatenate([point, direction, centre, quaternion, [ratio]])
    lengths = np.linalg.norm(direction), np.linalg.norm(quaternion)
    if not np.isfinite(values).all() or max(abs(v - 1) for v in lengths) > 1e-2 or ratio == 0:
        raise ValueError(
            f"axis file {path}: direction and orientation must have length 1, ratio must not be 0"
        )
    R = Rotation.from_quat(quaternion).as_matrix()
    return Turntable(point, direction / lengths[0], CameraPose(R, centre), ratio, joint)
