"""A printed sheet of markers under the object, found in images of cameras whose poses are known.

Who takes poses from such a sheet gives the poses alone. Its markers lie at one place of the object
frame in all views, in a plane that the cameras look down on; their numbers tell how it was printed.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array, axes_along, evenly, nearest_to_rays
from occ_recon_ros.imaging.joint.space import fixation

from .board import BoardSpec, marker_dictionary
from .board_pose import refine_pose
from .detect import grey_image, other_dictionary, read_markers
from .marker_edges import side_corners
from .marker_grid import MarkerGrid, grid_of
from .sheet_blank import missing_markers

_ASKED = 3  # images, of which one must show a few markers of one set
_LOOKED_AT = 24  # images
_LONG_SIDE = 1600  # px, in which markers are read
_FEWEST_VIEWS = 3  # of a marker: one that is seen where there is none is not seen twice
_FEWEST = 4  # markers, no three of them a sheet
_FLAT = 0.3  # of a marker's side, that it may lie beside the plane or its place
_MOSTLY = 0.8  # of the markers in the plane, of the cameras above it
_OFF = 0.01  # of the long side of the images, by which poses may be off: markers place each view
_AT_PLACE = 0.001  # of it, by which markers in an image may be off: its pose is as good as theirs
_DRAWS = 200  # triples of markers that are tried as the plane
_PITCH_M = 0.04  # the unit of the board's frame: from one marker, or square, to the next
_BENEATH = 0.25  # of the longer side, by which cameras may aim at what is below the sheet
_ROUNDS = 3


@dataclass(frozen=True)
class FoundBoard:
    """A sheet and where it lies.

    Attributes:
        board: the print, in a unit of its own; None where its markers stand as in no sheet that can
            be drawn.
        R_object_board: (3, 3) float64, rotation board -> object frame.
        origin: (3,) float64, the board's in the object frame, metres.
        scale: metres of the object frame in one of the board's.
        dictionary: OpenCV's name of the set of markers.
        markers: how many were found.
        off_px: by how much they are off their places, in the median.
    """

    board: BoardSpec | None
    R_object_board: Array
    origin: Array
    scale: float
    dictionary: str
    markers: int
    off_px: float = float("nan")

    def camera(self, camera: Camera) -> Camera:
        """A camera of the object frame, its pose in the board's frame."""
        R, t = camera.R_camera_object, camera.t_camera_object
        moved = (R @ self.origin + t) / self.scale
        return replace(camera, R_camera_object=R @ self.R_object_board, t_camera_object=moved)

    def seen_by(self, image: NDArray, camera: Camera) -> Camera:
        """The same, or where its markers are clearly beside their places in the image the camera
        that has them there; ``board`` must be known.

        Args:
            image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
            camera: the view, in the object frame.
        """
        assert self.board is not None
        seen = _read(marker_dictionary(self.dictionary), image, camera)
        here = self.camera(seen.camera)
        ours = np.isin(seen.ids, self.board.marker_ids)
        corners = marker_corners(self.board)[seen.ids[ours] - self.board.first_id].reshape(-1, 3)
        uv = seen.quads[ours].reshape(-1, 2)
        if len(uv) < 4 * _FEWEST:
            return self.camera(camera)
        off = np.linalg.norm(here.project(corners) - uv, axis=1)
        if np.median(off) < _AT_PLACE * max(here.width, here.height):
            return self.camera(camera)
        placed = refine_pose(here, corners, uv, here.pose, off < 3 * np.median(off))
        own = self.camera(camera)
        return own if placed is None else own.at(placed.pose)


@dataclass(frozen=True)
class _Read:
    """The markers that were read once in an image: (m,) numbers, (m, 4, 2) corners, px of the
    image as its camera has it."""

    image: NDArray[np.uint8]
    camera: Camera
    ids: NDArray[np.intp]
    quads: Array


Some = Callable[[Sequence[int]], Iterator[tuple[NDArray, Camera]]]
"""Images, (h, w) or (h, w, 3) BGR, uint8 or uint16, and cameras of these numbers, in order."""


def find_board(count: int, some: Some) -> FoundBoard | None:
    """The sheet on which the object stands; None where there is none.

    Args:
        count: of the views.
        some: gives those that are asked for.
    """
    asked = evenly(count, 2 * _ASKED + 1)[1::2].tolist() if count >= _FEWEST_VIEWS else []
    for image, camera in some(asked):
        if name := other_dictionary(_small(image, camera)[0]):
            break
    else:
        return None
    read = partial(_read, marker_dictionary(name))
    seen = [read(*view) for view in some(evenly(count, _LOOKED_AT).tolist())]
    return _lying(name, seen)


def _small(image: NDArray, camera: Camera) -> tuple[NDArray[np.uint8], Camera]:
    grey = grey_image(image)
    scale = min(1.0, _LONG_SIDE / max(grey.shape))
    if scale == 1.0:
        return grey, camera
    size = max(1, round(scale * grey.shape[1])), max(1, round(scale * grey.shape[0]))
    small = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)
    return small, camera.resized(*size)


def marker_corners(board: BoardSpec) -> Array:
    """(m, 4, 3) of the markers, board frame, metres."""
    return board.from_sheet(board.sheet_markers.reshape(-1, 2)).reshape(-1, 4, 3)


def _read(dictionary: Any, image: NDArray, camera: Camera) -> _Read:
    grey, camera = _small(image, camera)
    names, quads = read_markers(cv2.aruco.ArucoDetector(dictionary), grey)
    different, first, counts = np.unique(names, return_index=True, return_counts=True)
    rough = quads[first[counts == 1]]
    fine = side_corners(grey, rough, int(dictionary.markerSize) + 2)
    sharp = np.isfinite(fine).all(axis=(1, 2))
    return _Read(grey, camera, different[counts == 1][sharp], fine[sharp])


def _lying(dictionary: str, seen: Sequence[_Read]) -> FoundBoard | None:
    """The sheet whose markers were read."""
    names, counts = np.unique(np.concatenate([s.ids for s in seen]), return_counts=True)
    names = names[counts >= _FEWEST_VIEWS]
    if len(names) < _FEWEST:
        return None
    cameras = [s.camera for s in seen]
    places = np.stack([_met(seen, int(name)) for name in names])
    side = float(np.median(np.linalg.norm(places - np.roll(places, 1, axis=1), axis=2)))
    plane = _plane(places.mean(axis=1), _FLAT * side)
    if plane is None:
        return None
    origin, normal = plane
    above = np.stack([(c.centre - origin) @ normal for c in cameras])
    normal = normal * (np.sign(np.median(above)) or 1.0)
    if np.mean(np.abs((places.mean(axis=1) - origin) @ normal) < _FLAT * side) < _MOSTLY:
        return None
    if np.mean(np.sign(np.median(above)) * above > 0) < _MOSTLY:
        return None
    axes = axes_along(normal)
    quads = np.stack([_on_plane(seen, int(name), origin, axes) for name in names])
    grid = grid_of(names, quads, dictionary, _PITCH_M)
    R = axes.T
    if grid is None:
        return FoundBoard(None, R, origin, 1.0, dictionary, len(names))
    right = np.array([np.cos(grid.angle), np.sin(grid.angle), 0.0])
    turn = np.column_stack([right, [-right[1], right[0], 0.0], [0.0, 0.0, 1.0]])
    at = origin + R @ np.array([*grid.middle, 0.0])
    found = FoundBoard(grid.board, R @ turn, at, grid.scale, dictionary, len(names))
    found = _settled(found, grid, seen)
    long = np.median([max(c.width, c.height) for c in cameras])
    assert found.board is not None
    size = np.array(found.board.size_m)
    aim = fixation([found.camera(c) for c in cameras])
    if not found.off_px <= _OFF * long:
        return None
    if (np.abs(aim[:2]) > 0.5 * size).any() or aim[2] < -_BENEATH * size.max():
        return None  # it lies beside what the cameras look at, or on it
    views = [(s.image, found.camera(s.camera), s.ids) for s in seen]
    blank = missing_markers(found.board, names.tolist(), views).blank
    return replace(found, board=replace(found.board, not_printed=blank))


def _met(seen: Sequence[_Read], name: int) -> Array:
    """(4, 3) the corners of a marker, where its rays meet."""
    views = [(s.camera, s.quads[s.ids == name][0]) for s in seen if name in s.ids]
    centres = np.stack([camera.centre for camera, _ in views])
    rays = np.stack([camera.viewing_directions(quad) for camera, quad in views])
    places = []
    for k in range(4):
        near = np.ones(len(views), np.bool_)
        for _ in range(_ROUNDS):
            place = nearest_to_rays(centres[near], rays[near, k])
            to = place - centres
            off = np.linalg.norm(np.cross(to, rays[:, k]), axis=1) / np.linalg.norm(to, axis=1)
            near = off <= 3 * np.median(off)
            if np.count_nonzero(near) < 2:
                break
        places.append(place)
    return np.stack(places)


def _plane(points: Array, reach: float) -> tuple[Array, Array] | None:
    """The plane in which most of (m, 3) points are, to within a distance: its middle and its
    normal; None where they lie in a row."""
    rng = np.random.default_rng(0)
    triples = points[np.stack([rng.permutation(len(points))[:3] for _ in range(_DRAWS)])]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    wide = lengths > reach * reach
    if not wide.any():
        return None
    normals, first = normals[wide] / lengths[wide, None], triples[wide, 0]
    heights = np.abs(np.einsum("pmi,pi->pm", points - first[:, None], normals))
    best = int(np.argmax(np.count_nonzero(heights < reach, axis=1)))
    flat = points[heights[best] < reach]
    middle = flat.mean(axis=0)
    _, extent, rows = np.linalg.svd(flat - middle)
    if extent[1] < reach * np.sqrt(len(flat)):
        return None
    return middle, rows[2]


def _on_plane(seen: Sequence[_Read], name: int, origin: Array, axes: Array) -> Array:
    """(4, 2) the corners of a marker in the plane, in the median of its views."""
    found = []
    for s in seen:
        if name in s.ids:
            rays = s.camera.viewing_directions(s.quads[s.ids == name][0])
            C = s.camera.centre - origin
            away = -(C @ axes[2]) / np.where(np.abs(rays @ axes[2]) > 1e-6, rays @ axes[2], 1e-6)
            found.append((C + away[:, None] * rays) @ axes[:2].T)
    return np.asarray(np.median(found, axis=0))


def _settled(found: FoundBoard, grid: MarkerGrid, seen: Sequence[_Read]) -> FoundBoard:
    """The sheet where all its markers in all views have it: place, unit, and size of markers."""
    from scipy.optimize import least_squares  # here: half a second that no import should take
    from scipy.spatial.transform import Rotation

    board = grid.board
    order = {int(name): k for k, name in enumerate(board.marker_ids)}
    rows = [[(k, order[int(n)]) for k, n in enumerate(s.ids) if int(n) in order] for s in seen]
    used = [(s, np.array(r)) for s, r in zip(seen, rows, strict=True) if r]
    flat = marker_corners(board)
    middles = flat.mean(axis=1, keepdims=True)
    measured = np.concatenate([s.quads[r[:, 0]].ravel() for s, r in used])

    def sheet(p: Array) -> tuple[FoundBoard, Array]:
        turn = found.R_object_board @ Rotation.from_rotvec(p[:3]).as_matrix()
        unit = found.scale * np.exp(p[6])
        at = found.origin + found.scale * p[3:6]
        return replace(found, R_object_board=turn, origin=at, scale=unit), np.exp(p[7])

    def off(p: Array) -> Array:
        placed, times = sheet(p)
        corners = middles + times * (flat - middles)
        drawn = [placed.camera(s.camera).project(corners[r[:, 1]].reshape(-1, 3)) for s, r in used]
        return np.nan_to_num(np.concatenate(drawn).ravel(), nan=1e4) - measured

    p = least_squares(off, np.zeros(8), loss="soft_l1", x_scale=0.01, max_nfev=30).x
    placed, times = sheet(p)
    away = np.linalg.norm(off(p).reshape(-1, 2), axis=1)
    marker = board.marker_m * float(times)
    gap = max(_PITCH_M - marker, 0.0) if board.kind == "aruco_grid" else board.gap_m
    return replace(
        placed,
        board=replace(board, marker_m=marker, gap_m=gap),
        off_px=float(np.median(away)),
    )
