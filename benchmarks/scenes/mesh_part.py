"""A closed triangle mesh as a scene object: its outline is exact, its curvature unknown."""

from functools import cached_property
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from occ_recon_ros.scene.closest import closest_on_triangles
from occ_recon_ros.scene.objects import SceneObject
from occ_recon_ros.scene.primitives import RimCurve

Array = NDArray[np.float64]

_ROWS_AT_ONCE = 2000


def mesh_object(path: str | Path, size: float = 0.2, y_up: bool = True) -> SceneObject:
    """A scene object out of a mesh file, centred on the origin.

    Args:
        path: a closed triangle mesh that trimesh reads.
        size: its largest extent, metres.
        y_up: turn the file's y axis up, as most models have it.

    Raises:
        ValueError: the mesh is not closed.
    """
    mesh = trimesh.load_mesh(path, process=True)
    # Seams of the texture hold vertices twice.
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    vertices = np.asarray(mesh.vertices, np.float64)
    if y_up:
        vertices = vertices[:, [0, 2, 1]] * [1, -1, 1]
    low, high = vertices.min(0), vertices.max(0)
    vertices = (vertices - 0.5 * (low + high)) * (size / (high - low).max())
    return SceneObject(Path(path).stem, (MeshPart(vertices, np.asarray(mesh.faces, np.intp)),))


class MeshPart:
    """A closed polyhedron.

    Args:
        vertices: (v, 3) float64, metres, object frame.
        faces: (m, 3) outward triangles.

    Raises:
        ValueError: the triangles do not close.
    """

    def __init__(self, vertices: Array, faces: NDArray[np.intp]) -> None:
        self.vertices, self.faces = vertices, faces
        edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        owner = np.repeat(np.arange(len(faces)), 3)
        # Each directed edge meets its opposite once.
        key = edges[:, 0] * len(vertices) + edges[:, 1]
        opposite = edges[:, 1] * len(vertices) + edges[:, 0]
        order = np.argsort(key)
        partner = order[np.searchsorted(key, opposite, sorter=order) % len(key)]
        if len(np.unique(key)) < len(key) or (key[partner] != opposite).any():
            raise ValueError("the mesh is not closed: an edge lacks its neighbour")
        self._edges, self._face, self._other_face = edges, owner, owner[partner]
        corners = vertices[faces]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._face_normals = cross / np.linalg.norm(cross, axis=1, keepdims=True)
        self._corners = corners
        weighted = np.zeros_like(vertices)
        np.add.at(weighted, faces.ravel(), np.repeat(cross, 3, axis=0))
        self._vertex_normals = weighted / np.linalg.norm(weighted, axis=1, keepdims=True)

    @cached_property
    def _trees(self) -> tuple[cKDTree, cKDTree, float]:
        middles = self._corners.mean(1)
        reach = np.linalg.norm(self._corners - middles[:, None], axis=2).max()
        return cKDTree(self.vertices), cKDTree(middles), float(reach)

    def rims(self, centre: Array) -> list[RimCurve]:
        """Closed polygons of edges between faces that face centre and faces that do not."""
        front = ((centre - self._corners[:, 0]) * self._face_normals).sum(1) > 0
        rim = self._edges[front[self._face] & ~front[self._other_face]]
        return [self._polygon(self.vertices[loop]) for loop in _chained(rim)]

    @staticmethod
    def _polygon(corners: Array) -> RimCurve:
        closed, n = np.vstack([corners, corners[:1]]), len(corners)

        def at(theta: Array) -> Array:
            place = np.mod(theta * (n / (2 * np.pi)), n)
            row = np.minimum(place.astype(np.intp), n - 1)
            share = (place - row)[:, None]
            return np.asarray((1 - share) * closed[row] + share * closed[row + 1], np.float64)

        return RimCurve(at, nodes=n)

    def at_rim(self, points: Array, T: Array) -> tuple[Array, Array]:
        """Normals smoothed over the vertices, made perpendicular to the rays; curvature NaN."""
        normals, _ = self.shape(points)
        normals = normals - (normals * T).sum(1, keepdims=True) * T
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return normals, np.full(len(points), np.nan)

    def shape(self, points: Array) -> tuple[Array, Array]:
        """Normals smoothed over the vertices; the shape operator is NaN."""
        _, row, weights = self._nearest(points)
        normals = np.einsum("ni,nij->nj", weights, self._vertex_normals[self.faces[row]])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return normals, np.full((len(points), 3, 3), np.nan)

    def graze(self, centre: Array, T: Array, points: Array) -> tuple[Array, Array]:
        """Depths of the places on the rays abreast of the given points; curvature NaN."""
        return ((points - centre) * T).sum(1), np.full(len(points), np.nan)

    def grid(self, n: int) -> tuple[Array, NDArray[np.intp]]:
        """The mesh itself, whatever n is."""
        return self.vertices, self.faces

    def inside(self, points: Array) -> NDArray[np.bool_]:
        """(n,) whether points (n, 3) lie inside."""
        return np.asarray(self.distance(points) < 0)

    def distance(self, points: Array) -> Array:
        """Signed distance (n,) of points (n, 3) to the polyhedron, metres, outside positive."""
        return self._nearest(points)[0]

    def bounds(self, points: Array) -> tuple[Array, Array]:
        """The distance (n,) itself, twice."""
        away = np.abs(self.distance(points))
        return away, away

    def beyond(self, points: Array) -> Array:
        """The distance (n,) of points (n, 3) to the box around the mesh, metres."""
        inside = np.clip(points, self.vertices.min(axis=0), self.vertices.max(axis=0))
        away: Array = np.linalg.norm(points - inside, axis=1)
        return away

    def _nearest(self, points: Array) -> tuple[Array, NDArray[np.intp], Array]:
        """Signed distance, nearest face and barycentric weights of the place on it."""
        chunks = [
            self._nearest_chunk(points[start : start + _ROWS_AT_ONCE])
            for start in range(0, max(len(points), 1), _ROWS_AT_ONCE)
        ]
        distance, row, weights = zip(*chunks, strict=True)
        return np.concatenate(distance), np.concatenate(row), np.concatenate(weights)

    def _nearest_chunk(self, points: Array) -> tuple[Array, NDArray[np.intp], Array]:
        vertex_tree, face_tree, reach = self._trees
        # No face whose middle is farther than this can beat the nearest vertex.
        limit = vertex_tree.query(points)[0] + reach + 1e-12
        faces = face_tree.query_ball_point(points, limit)
        count = np.array([len(f) for f in faces], np.intp)
        point = np.repeat(np.arange(len(points)), count)
        face = np.concatenate([np.zeros(0, np.intp), *(np.asarray(f, np.intp) for f in faces)])
        weights = closest_on_triangles(points[point], self._corners[face])
        away = points[point] - np.einsum("ni,nij->nj", weights, self._corners[face])
        squared = (away**2).sum(1)
        best = np.full(len(points), np.inf)
        np.minimum.at(best, point, squared)
        # On an edge or corner all faces there share the place, and the sign is that of
        # the sum of their normals.
        tied = squared <= best[point] * (1 + 1e-9) + 1e-24
        height = np.zeros(len(points))
        np.add.at(height, point[tied], (away[tied] * self._face_normals[face[tied]]).sum(1))
        order = np.flatnonzero(tied)
        chosen = np.zeros(len(points), np.intp)
        chosen[point[order]] = order
        return np.copysign(np.sqrt(best), height), face[chosen], weights[chosen]


def _chained(edges: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Closed loops of vertices out of directed edges that enter and leave each alike."""
    leaving: dict[int, list[int]] = {}
    for start, stop in edges.tolist():
        leaving.setdefault(start, []).append(stop)
    loops = []
    while leaving:
        first = next(iter(leaving))
        loop, here = [], first
        while here in leaving:
            loop.append(here)
            stops = leaving[here]
            follow = stops.pop()
            if not stops:
                del leaving[here]
            here = follow
        loops.append(np.array(loop, np.intp))
    return loops
