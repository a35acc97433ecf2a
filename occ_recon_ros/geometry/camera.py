"""The calibrated pinhole camera: pixels to viewing directions and back."""

from dataclasses import dataclass, field, replace

import numpy as np

from .arrays import Array, lengths
from .compiled import compiled
from .pose import CameraPose

DISTORTION_MODELS = ("none", "plumb_bob", "rational_polynomial", "equidistant")

_MANY = 1000  # points, from which on a compiled loop is the faster by far
_UNDISTORT_ITERATIONS = 50
_UNDISTORT_TOLERANCE = 1e-13


@dataclass(frozen=True)
class Camera:
    """One view: intrinsics, distortion and pose.

    Attributes:
        K: (3, 3) float64, pixels. Pixel (0, 0) is the centre of the top-left pixel.
        width, height: image size, pixels.
        R_camera_object: (3, 3) float64, rotation object -> camera optical frame
            (z forward, x right, y down).
        t_camera_object: (3,) float64, metres; X_camera = R X_object + t.
        D: (k,) float64, distortion coefficients in OpenCV's order.
        distortion: one of DISTORTION_MODELS.

    Raises:
        ValueError: wrong shape, not finite, K not of a camera, R not a rotation, or an
            unknown distortion model.
    """

    K: Array
    width: int
    height: int
    R_camera_object: Array
    t_camera_object: Array
    D: Array = field(default_factory=lambda: np.zeros(0))
    distortion: str = "none"

    def __post_init__(self) -> None:
        shapes = (("K", (3, 3)), ("R_camera_object", (3, 3)), ("t_camera_object", (3,)))
        for name, shape in shapes:
            value = np.asarray(getattr(self, name), np.float64)
            if value.shape != shape:
                raise ValueError(f"{name} must have shape {shape}, got {value.shape}")
            if not np.isfinite(value).all():
                raise ValueError(f"{name} is not finite")
            object.__setattr__(self, name, value)
        D = np.asarray(self.D, np.float64).ravel()
        if not np.isfinite(D).all():
            raise ValueError("D is not finite")
        if self.distortion not in DISTORTION_MODELS:
            raise ValueError(
                f"unknown distortion model '{self.distortion}': use one of {DISTORTION_MODELS}"
            )
        if self.distortion == "equidistant":  # without a coefficient it bends as well
            D = np.concatenate([D, np.zeros(4)])[:4]
        elif not D.any():
            D = np.zeros(0)
        object.__setattr__(self, "D", D)
        if self.K[0, 0] <= 0 or self.K[1, 1] <= 0 or self.K[2, 2] != 1:
            raise ValueError("K must have positive focal lengths and K[2][2] = 1")
        if np.abs(np.tril(self.K, -1)).max() > 1e-6:  # decompositions leave less
            raise ValueError(
                "K must be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], with 0 below its diagonal; "
                "this one seems to be transposed"
            )
        R = self.R_camera_object
        if np.abs(R @ R.T - np.eye(3)).max() > 1e-4 or np.linalg.det(R) < 0:
            raise ValueError("R_camera_object is not a rotation matrix")

    @property
    def centre(self) -> Array:
        """(3,) float64, camera centre C in the object frame, metres."""
        return -self.R_camera_object.T @ self.t_camera_object

    @property
    def pose(self) -> CameraPose:
        """Where it is."""
        return CameraPose(self.R_camera_object.T, self.centre)

    def at(self, pose: CameraPose) -> "Camera":
        """The same camera at another place."""
        R = pose.R_object_camera.T
        return replace(self, R_camera_object=R, t_camera_object=-R @ pose.centre)

    def in_camera(self, points: Array) -> Array:
        """Points (3,) or (n, 3) of the object frame in the camera's, metres."""
        local: Array = points @ self.R_camera_object.T + self.t_camera_object
        return local

    def resized(self, width: int, height: int) -> "Camera":
        """The camera of the whole image in another size, px."""
        K = self.K.copy()
        for row, times in enumerate((width / self.width, height / self.height)):
            K[row] *= times
            K[row, 2] += 0.5 * times - 0.5
        return replace(self, K=K, width=width, height=height)

    def viewing_directions(self, uv: Array) -> Array:
        """Unit viewing directions T of image points.

        Args:
            uv: (n, 2) float64, pixels in the image as received (distorted).

        Returns:
            (n, 3) float64, unit vectors in the object frame.
        """
        uv = np.asarray(uv, np.float64).reshape(-1, 2)
        y = (uv[:, 1] - self.K[1, 2]) / self.K[1, 1]
        x = (uv[:, 0] - self.K[0, 2] - self.K[0, 1] * y) / self.K[0, 0]
        x, y = self._undistort(x, y)
        # The lens may send a ray far to the side: its square must not overflow.
        far = np.maximum(np.maximum(np.abs(x), np.abs(y)), 1.0)
        rays = np.column_stack([x / far, y / far, 1 / far]) @ self.R_camera_object
        return rays / lengths(rays)[:, None]

    def project(self, points: Array) -> Array:
        """Image of points of the object frame.

        Args:
            points: (n, 3) float64, metres, object frame.

        Returns:
            (n, 2) float64, pixels (distorted); NaN for points not in front of the camera.
        """
        points = np.asarray(points, np.float64).reshape(-1, 3)
        if len(points) > _MANY:
            D = np.concatenate([self.D, np.zeros(12)])[:12]
            lens = self.K, D, self.distortion == "equidistant"
            pose = self.R_camera_object, self.t_camera_object
            return np.asarray(compiled().projected(points, *pose, *lens))
        X = self.in_camera(points)
        z = np.where(X[:, 2] > 0, X[:, 2], np.nan)
        x, y = self._distort(X[:, 0] / z, X[:, 1] / z)
        u = self.K[0, 0] * x + self.K[0, 1] * y + self.K[0, 2]
        return np.column_stack([u, self.K[1, 1] * y + self.K[1, 2]])

    def _distort(self, x: Array, y: Array) -> tuple[Array, Array]:
        if not len(self.D):
            return x, y
        if self.distortion == "equidistant":
            r = np.hypot(x, y)
            theta = np.arctan(r)
            theta_d = theta * np.polynomial.polynomial.polyval(theta**2, [1.0, *self.D])
            scale = np.where(r > 1e-12, theta_d / np.maximum(r, 1e-12), 1.0)
            return x * scale, y * scale
        D = self.D[:12].tolist()
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = D + [0.0] * (12 - len(D))
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        if any(D[5:8]):
            radial = radial / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        dx = 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        dy = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        if any(D[8:]):
            dx, dy = dx + r2 * (s1 + r2 * s2), dy + r2 * (s3 + r2 * s4)
        return x * radial + dx, y * radial + dy

    def _undistort(self, xd: Array, yd: Array) -> tuple[Array, Array]:
        """Invert ``_distort`` by Newton's method on the two image coordinates."""
        if not len(self.D):
            return xd, yd
        x, y, h = xd.copy(), yd.copy(), 1e-6
        for _ in range(_UNDISTORT_ITERATIONS):
            fx, fy = self._distort(x, y)
            ex, ey = fx - xd, fy - yd
            if max(np.abs(ex).max(initial=0), np.abs(ey).max(initial=0)) < _UNDISTORT_TOLERANCE:
                break
            ax, ay = self._distort(x + h, y)
            bx, by = self._distort(x, y + h)
            axx, axy, ayx, ayy = (ax - fx) / h, (bx - fx) / h, (ay - fy) / h, (by - fy) / h
            det = axx * ayy - axy * ayx
            x = x - (ayy * ex - axy * ey) / det
            y = y - (axx * ey - ayx * ex) / det
        return x, y
