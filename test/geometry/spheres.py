"""A sphere, of which contours, rim and correspondents are known in closed form."""

from dataclasses import dataclass

import numpy as np

from occ_recon_ros.geometry import Contours


def unit(x):
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


@dataclass(frozen=True)
class Sphere:
    centre: np.ndarray
    radius: float

    def ray(self, C, theta):
        """Grazing directions and normals at angles round the outline, object on the left."""
        axis = self.centre - C
        distance = np.linalg.norm(axis)
        axis = axis / distance
        right = unit(np.cross(axis, [0.31, -0.2, 0.93]))
        up = np.cross(right, axis)
        theta = np.asarray(theta)[..., None]
        out = np.cos(theta) * right + np.sin(theta) * up
        sin = self.radius / distance
        cos = np.sqrt(1 - sin**2)
        return cos * axis + sin * out, cos * out - sin * axis

    def depth(self, C):
        return np.sqrt(np.sum((self.centre - C) ** 2) - self.radius**2)

    def contours(self, C, n=1000, stamp_ns=1, sigma=1e-9):
        theta = np.linspace(0, 2 * np.pi, n, endpoint=False)
        T, N = self.ray(C, theta)
        forward = unit(self.centre - C)
        right = unit(np.cross(forward, [0.31, -0.2, 0.93]))
        plane = np.stack([right, np.cross(forward, right)])
        uv = 1600 * (T @ plane.T) / (T @ forward)[:, None]
        return Contours(stamp_ns, "object", C, T, N, uv, np.zeros(n, np.uint16), np.full(n, sigma))

    def correspondent(self, C, T, N, C_i):
        """Direction from C_i, in the plane of C, C_i and T, that grazes the sphere on the
        same side as T does."""
        x = unit(T)
        y = unit((C_i - C) - ((C_i - C) @ x) * x)
        z = np.cross(x, y)
        foot = self.centre - ((self.centre - C) @ z) * z
        r = np.sqrt(self.radius**2 - np.sum((self.centre - foot) ** 2))
        towards = foot - C_i
        distance = np.linalg.norm(towards)
        cos, sin = np.sqrt(1 - (r / distance) ** 2), r / distance
        towards = towards / distance
        across = np.cross(z, towards)
        both = [cos * towards + s * sin * across for s in (1, -1)]
        # On the same side: the object is on the same hand of both rays, seen along z.
        hand = np.sign(np.cross(x, foot - C) @ z)
        (T_i,) = [t for t in both if np.sign(np.cross(t, foot - C_i) @ z) == hand]
        P_i = C_i + ((self.centre - C_i) @ T_i) * T_i
        return T_i, unit(P_i - self.centre)


def ring(angle, distance=1.3, height=0.3):
    """Camera centres on a circle about the z axis."""
    angle = np.asarray(angle)[..., None]
    parts = [distance * np.cos(angle), distance * np.sin(angle), height + 0 * angle]
    return np.concatenate(parts, axis=-1)


def general_path(s):
    """Camera centres on a curve in no plane, with uneven speed."""
    s = np.asarray(s)[..., None]
    r = 1.3 + 0.15 * np.sin(1.7 * s)
    return np.concatenate(
        [r * np.cos(s), 0.9 * r * np.sin(s), 0.25 + 0.4 * np.sin(1.3 * s) + 0.1 * s], axis=-1
    )
