"""A shaded view of triangles as a given camera sees them."""

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.evaluation.raycast import Hits, RayCaster
from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.surface import Strip

_SUBPIXELS = np.array([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]])
_EDGE = 16.0  # grey levels among a pixel and its neighbours: half of what the eye sees as a step
_BACKGROUND = np.array([250.0, 248.0, 246.0])  # BGR
_FRONT = np.array([214.0, 190.0, 160.0])
_BACK = np.array([110.0, 110.0, 205.0])
_AMBIENT = 0.2
_AMBIENT_ON_COLOUR = 0.8
_LIGHT = np.array([-0.5, -0.6, -0.8])  # camera frame: from the upper left behind the camera


Box = tuple[float, float, float, float]
"""left, top, right, bottom of a part of an image, pixels; (0, 0, width, height) is all of it."""


class Shader:
    """Draws a surface: fronts in its own colour or a light one, backs in red."""

    def __init__(self, surface: Strip) -> None:
        self._surface = surface
        self._caster = RayCaster(surface.corners)

    def draw(
        self, camera: Camera, box: Box, size: int, behind: NDArray[np.uint8] | None = None
    ) -> NDArray[np.uint8]:
        """Draw the surface by a ray a pixel, edges smoothed by four.

        Args:
            camera: the view, as calibrated.
            box: the part of its image to draw.
            size: height of the picture, pixels.
            behind: (size, width, 3) BGR that the surface is drawn over; plain if None.

        Returns:
            (size, width, 3) uint8 BGR with the aspect of the box.
        """
        scale = size / (box[3] - box[1])
        width = round((box[2] - box[0]) * scale)
        v, u = np.mgrid[:size, :width]
        pixels = np.column_stack([u.ravel(), v.ravel()])
        # Pixel centres are whole numbers, so that the box begins half a pixel before its corner.
        corner = np.array(box[:2]) - 0.5
        seen = self._seen(camera, corner + (pixels + 0.5) / scale)
        plain = (seen[:, :3] + (1 - seen[:, 3:]) * _BACKGROUND).reshape(size, width, 3)
        contrast = cv2.morphologyEx(plain, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
        edge = np.flatnonzero(contrast.max(axis=2) > _EDGE)
        places = corner + (pixels[edge] + _SUBPIXELS[:, None]) / scale
        seen[edge] = self._seen(camera, places.reshape(-1, 2)).reshape(4, -1, 4).mean(axis=0)
        under = _BACKGROUND if behind is None else behind.reshape(-1, 3).astype(float)
        picture = seen[:, :3] + (1 - seen[:, 3:]) * under
        return picture.round().clip(0, 255).astype(np.uint8).reshape(size, width, 3)

    def _seen(self, camera: Camera, uv: Array) -> Array:
        """(n, 4) BGR of what is hit at image points (n, 2), and 1; zeros where nothing is."""
        hits, seen = self._caster.cast(camera, uv), np.zeros((len(uv), 4))
        seen[hits.ray, :3], seen[hits.ray, 3] = self._colours(camera, hits), 1
        return seen

    def _colours(self, camera: Camera, hits: Hits) -> Array:
        """(k, 3) BGR of what is hit."""
        surface, rows = self._surface, hits.triangle
        corners = self._caster.corners[rows]
        facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        front = np.einsum("kj,kj->k", facing, camera.centre - corners[:, 0]) > 0
        normals = np.einsum("kc,kcj->kj", hits.weights, surface.normals[rows])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        to_light = _LIGHT / np.linalg.norm(_LIGHT) @ camera.R_camera_object
        light = (normals / np.maximum(length, 1e-12)) @ to_light
        light = (0.5 + 0.5 * np.where(front, light, -light)).clip(0, 1) ** 1.5
        ambient, tint = _AMBIENT, np.broadcast_to(_FRONT, (len(rows), 3))
        if surface.rgb is not None:  # photographs have their own light in them
            ambient = _AMBIENT_ON_COLOUR
            tint = np.einsum("kc,kcj->kj", hits.weights, surface.rgb[rows])[:, ::-1]
        tint = np.where(front[:, None], tint, _BACK)
        return (ambient + (1 - ambient) * light)[:, None] * tint
