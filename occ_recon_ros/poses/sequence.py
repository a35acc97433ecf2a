"""Many images of one board: which to use, and the poses of all of them together."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import Array
from occ_recon_ros.geometry.pose import CameraPose

from .board import BoardSpec
from .board_pose import BoardPose, candidate_poses
from .chessboard import made_small
from .detect import BoardDetector, Detection, grey_image, why_unseen
from .intrinsics import BoardView, Intrinsics, calibrate_intrinsics
from .sheet_layout import other_layout
from .sheet_ratio import marker_ratio, wrong_markers
from .sheet_shape import SheetShape, SheetView, sheet_shape
from .sheet_zoom import two_zooms

BLURRED = 2.0  # times the usual blur
HARMLESS_BLUR_PX = 1.5
BAD_FIT = 4.0  # times the usual distance of the corners
BAD_FIT_PX = 3.0  # of an image 1000 px wide: all are wrong then
FEWEST_FITTING = 0.6  # share of the corners; fewer: the board is another one
_TURN_SCALE = np.deg2rad(10)  # what a camera turns from frame to frame without wonder
_MOST_WONDER = 20.0
_SHAPE_ROUNDS = 2
_PLENTY, _IN_VAIN = 40, 40  # images with the board, and without: it is not sought longer then
_PUZZLES, _PUZZLE_PX = 8, 2000  # images without the board that are looked at again; long side
_COPIED = 1e-4  # of an image's width, within which the corners of a copied image are


@dataclass(frozen=True)
class Shot:
    """What was seen of the board in one image.

    Attributes:
        name: of the image.
        stamp_ns: its time, nanoseconds.
        found: the corners.
        blur_px: of the printed edges, 1 sigma; NaN if unknown.
    """

    name: str
    stamp_ns: int
    found: Detection
    blur_px: float


@dataclass(frozen=True)
class PosedShot:
    """An image and where it was taken from."""

    shot: Shot
    pose: BoardPose


@dataclass(frozen=True)
class BoardPoses:
    """What came of a sequence.

    Attributes:
        camera: intrinsics, given or found.
        kept: the images to use, in order of time.
        left_out: name and reason of the others.
        intrinsics: the calibration from these images, None where it was given.
        shape: of the sheet, where it is not flat.
        board: that was found; its layout may be another than was given.
    """

    camera: Camera
    kept: list[PosedShot]
    left_out: dict[str, str]
    board: BoardSpec
    intrinsics: Intrinsics | None = None
    shape: SheetShape | None = None

    @property
    def reasons(self) -> Counter[str]:
        """How many images were left out, by reason."""
        return Counter(self.left_out.values())


class BoardSequence:
    """Collects the images of a sequence, then finds all poses.

    Args:
        board: that is in view.
        size: width and height of the images to use, px; (0, 0): those of the first.

    Attributes:
        shots: what was seen in each image that can be used.
        left_out: name and reason of the others.
        size: width and height of the images, px.
    """

    def __init__(self, board: BoardSpec, size: tuple[int, int] = (0, 0)) -> None:
        self.detector = BoardDetector(board)
        self.shots: list[Shot] = []
        self.left_out: dict[str, str] = {}
        self._puzzles: list[NDArray] = []
        self._unseen, self._apart = 0, 1
        self._seen: list[Detection] = []
        self.size = size

    @property
    def board(self) -> BoardSpec:
        """The board in the layout that was found."""
        return self.detector.board

    def add(self, name: str, stamp_ns: int, image: NDArray) -> Shot | None:
        """Look at an image, (h, w) or (h, w, 3) BGR; None where it shows no board to use."""
        if not image.size:
            self.left_out[name] = "damaged"
            return None
        size = (image.shape[1], image.shape[0])
        if self.size not in ((0, 0), size):
            self.left_out[name] = "other_size"
            return None
        self.size = size
        self.detector.thorough = len(self.shots) < _PLENTY and self._unseen < _IN_VAIN
        found = self.detector.find(image)
        self._seen.append(found)
        if found.problem is not None:
            self.left_out[name] = found.problem[0]
            if found.problem[0] == "no_board":
                self._remember(image)
            return None
        shot = Shot(name, stamp_ns, found, self.detector.blur_px(image, found))
        self.shots.append(shot)
        return shot

    def _remember(self, image: NDArray) -> None:
        """Keep some of the images without the board, spread over all."""
        if self._unseen % self._apart == 0:
            if len(self._puzzles) == _PUZZLES:
                self._puzzles, self._apart = self._puzzles[::2], 2 * self._apart
            self._puzzles.append(made_small(grey_image(image), _PUZZLE_PX)[0])
        self._unseen += 1

    def _why_unseen(self) -> str:
        """What most of the images without the board show in its place, that can be told."""
        seen = (why_unseen(self.detector, image) for image in self._puzzles)
        words = Counter(why[1] for why in seen if why is not None)
        return words.most_common(1)[0][0] if words else ""

    def solve(
        self, camera: Camera | None, focal_px: float | None = None, step: float = 0.0
    ) -> BoardPoses:
        """The poses of all images that can be used.

        Args:
            camera: intrinsics, or None to find them from these images.
            focal_px: a first guess for that.
            step: least angle between the images to be used, seen from the board, radians.

        Raises:
            ValueError: no poses can be had; the message says why, in words for the user.
        """
        if not self.shots:
            raise ValueError(self.diagnosis())
        self.refuse_other_layout()
        shots = self._sharp(sorted(self.shots, key=lambda shot: shot.stamp_ns))
        corners, intrinsics = self.board.corners, None
        if camera is None:
            intrinsics = self.calibrated(shots, corners, focal_px)
            camera = intrinsics.camera
        elif (camera.width, camera.height) != self.size:
            raise ValueError(
                f"the images are {self.size[0]}x{self.size[1]}, the calibration is for "
                f"{camera.width}x{camera.height}"
            )
        posed = self._posed(camera, corners, shots)
        self._check_board(camera, posed, shots)
        shape = None
        for _ in range(_SHAPE_ROUNDS if intrinsics else 1):
            shape = self._shape(camera, posed)
            if shape is None:
                break
            corners = shape.corners
            if intrinsics is not None:
                intrinsics = self.calibrated(shots, corners, camera.K[0, 0])
                camera = intrinsics.camera
            posed = self._posed(camera, corners, shots)
        posed = self._fitting(posed)
        if not posed:
            raise ValueError(self.diagnosis())
        posed = self._moving(posed, step)
        return BoardPoses(camera, posed, dict(self.left_out), self.board, intrinsics, shape)

    def refuse_other_layout(self) -> None:
        """
        Raises:
            ValueError: the markers in the images do not stand as board.yaml says.
        """
        if words := other_layout(self.board, self._seen):
            raise ValueError(words)

    def refuse_other_markers(self, camera: Camera, shots: Sequence[Shot]) -> None:
        """
        Raises:
            ValueError: seen by this camera, markers and what is between them are not in the ratio
                that board.yaml says.
        """
        self._check_markers(camera, self._posed(camera, self.board.corners, list(shots)))

    def calibrated(
        self, shots: Sequence[Shot], corners: Array, focal_px: float | None
    ) -> Intrinsics:
        """The camera, from images of which copies count once.

        Args:
            shots: what was seen in the images.
            corners: (n, 3) float64, the board's, metres.
            focal_px: a first guess, or None.

        Raises:
            ValueError: as ``calibrate_intrinsics``, or the zoom was changed between the images.
        """
        views = board_views(distinct(shots, self.size), corners)
        try:
            found = calibrate_intrinsics(views, self.size, focal_px)
        except ValueError as error:
            raise ValueError(two_zooms(views, self.size, np.inf) or str(error)) from None
        if words := two_zooms(views, self.size, found.rms_px):
            raise ValueError(words)
        return found

    def diagnosis(self) -> str:
        """Why nothing can be used, and what to do."""
        if not self.left_out:
            return "there are no images"
        if words := self._why_unseen() or other_layout(self.board, self._seen):
            return words
        reason, many = Counter(self.left_out.values()).most_common(1)[0]
        return f"{WORDS.get(reason, reason)} ({many} of {len(self.left_out)} images)"

    # Which images.

    def _sharp(self, shots: list[Shot]) -> list[Shot]:
        """Leave blurred ones out."""
        blurs = np.array([shot.blur_px for shot in shots])
        usual = np.nanmedian(blurs) if np.isfinite(blurs).any() else np.nan
        limit = max(BLURRED * usual, HARMLESS_BLUR_PX) if np.isfinite(usual) else np.inf
        self.left_out |= {shot.name: "blurred" for shot in shots if shot.blur_px > limit}
        return [shot for shot in shots if not shot.blur_px > limit]

    def _posed(self, camera: Camera, corners: Array, shots: list[Shot]) -> list[PosedShot]:
        """Poses of all, the ambiguous ones chosen by their neighbours."""
        candidates = []
        for shot in shots:
            found = candidate_poses(camera, corners[shot.found.index], shot.found.uv)
            if found:
                candidates.append((shot, found))
            else:
                self.left_out[shot.name] = "bad_fit"
        chosen = choose_in_time([found for _, found in candidates])
        return [PosedShot(s, pose) for (s, _), pose in zip(candidates, chosen, strict=True)]

    def _fitting(self, posed: list[PosedShot]) -> list[PosedShot]:
        if not posed:
            return []
        usual = float(np.median([p.pose.rms_px for p in posed]))
        most = max(BAD_FIT * usual, 0.5)
        self.left_out |= {p.shot.name: "bad_fit" for p in posed if p.pose.rms_px > most}
        return [p for p in posed if not p.pose.rms_px > most]

    def _moving(self, posed: list[PosedShot], step: float) -> list[PosedShot]:
        """Of the images within a step the sharpest one."""
        if step <= 0 or not posed:
            return posed
        kept: list[PosedShot] = []
        group = [posed[0]]
        for p in [*posed[1:], None]:
            if p is not None and _turn(group[0].pose.pose, p.pose.pose) < step:
                group.append(p)
                continue
            best = min(group, key=lambda q: np.nan_to_num(q.shot.blur_px, nan=0.0))
            kept.append(best)
            self.left_out |= {q.shot.name: "still" for q in group if q is not best}
            group = [p] if p is not None else []
        return kept

    # Is it the board?

    def _shape(self, camera: Camera, posed: list[PosedShot]) -> SheetShape | None:
        views = [SheetView(p.shot.found.index, p.shot.found.uv, p.pose.pose) for p in posed]
        try:
            shape = sheet_shape(camera, self.board.corners, views)
        except (ValueError, np.linalg.LinAlgError):
            return None
        return shape if shape.worth_it else None

    def _check_board(self, camera: Camera, posed: list[PosedShot], shots: list[Shot]) -> None:
        """
        Raises:
            ValueError: the corners are not where board.yaml says.
        """
        # A gap that is wrong by much spoils the fit, too, but is told by itself.
        self._check_markers(camera, posed)
        fitting = [float(p.pose.used.mean()) for p in posed]
        size = max(camera.width, camera.height) / 1000
        if len(posed) < 0.5 * len(shots) or np.median(fitting) < FEWEST_FITTING:
            share = 100 * (np.median(fitting) if fitting else 0)
            raise ValueError(
                f"only {share:.0f} % of the corners fit the board of board.yaml "
                f"({self.board.words}): another size, number of squares or gap, or two boards"
            )
        rms = float(np.median([p.pose.rms_px for p in posed]))
        if rms > BAD_FIT_PX * size:
            raise ValueError(
                f"the corners are {rms:.1f} px off from where {self.board.words} has them: "
                "correct board.yaml, or the calibration of the camera"
            )

    def _check_markers(self, camera: Camera, posed: list[PosedShot]) -> None:
        ratios = [marker_ratio(self.board, camera, p.pose.pose, p.shot.found) for p in posed]
        ratio = 1.0 if np.isnan(ratios).all() else float(np.nanmedian(ratios))
        if words := wrong_markers(self.board, ratio):
            raise ValueError(words)


def choose_in_time(candidates: Sequence[Sequence[BoardPose]]) -> list[BoardPose]:
    """One pose for each image: what fits, and what the neighbours in time make likely.

    The least sum of misfits and of unlikely turns from image to image, by dynamic programming.
    """
    if not candidates:
        return []
    cost = [np.array([p.cost - min(q.cost for q in found) for p in found]) for found in candidates]
    total, back = cost[0], []
    for before, here, own in zip(candidates, candidates[1:], cost[1:], strict=False):
        turns = np.array([[_turn(a.pose, b.pose) for a in before] for b in here])
        ways = np.minimum((turns / _TURN_SCALE) ** 2, _MOST_WONDER) + total
        back.append(ways.argmin(axis=1))
        total = ways.min(axis=1) + own
    k = int(total.argmin())
    chosen = [candidates[-1][k]]
    for found, way in zip(reversed(candidates[:-1]), reversed(back), strict=True):
        k = int(way[k])
        chosen.append(found[k])
    return chosen[::-1]


def _turn(a: CameraPose, b: CameraPose) -> float:
    """By how much a camera turned, radians."""
    cos = (np.trace(a.R_object_camera.T @ b.R_object_camera) - 1) / 2
    return float(np.arccos(np.clip(cos, -1, 1)))


def distinct(shots: Sequence[Shot], size: tuple[int, int]) -> list[Shot]:
    """Without the images that are copies of an earlier one: all corners are in the same place.

    Args:
        shots: what was seen in the images.
        size: width and height of the images, px.
    """
    kept: dict[tuple[int, ...], list[Shot]] = {}
    for shot in shots:
        alike = kept.setdefault(tuple(shot.found.index.tolist()), [])
        off = (np.abs(shot.found.uv - other.found.uv).max() for other in alike)
        if all(way > _COPIED * size[0] for way in off):
            alike.append(shot)
    names = {shot.name for some in kept.values() for shot in some}
    return [shot for shot in shots if shot.name in names]


def board_views(shots: Sequence[Shot], corners: Array) -> list[BoardView]:
    """Where the corners of the board, (n, 3) metres, are in images."""
    return [BoardView(s.name, corners[s.found.index], s.found.uv) for s in shots]


WORDS = {
    "no_board": "no board is in view: is it the sheet of board.yaml, whole, sharp and well lit?",
    "two_boards": "two boards are in view: cover one",
    "wrong_board": "the markers are not those of board.yaml: give the file of this sheet",
    "few_corners": "the board is hidden too much: show more of it around the object",
    "bad_fit": "the corners do not fit the board of board.yaml",
    "blurred": "the images are blurred: more light, or move more slowly",
    "still": "the board has not turned between the images",
    "other_size": "the images are of different sizes",
    "damaged": "the images are truncated or damaged: copy them again",
}
