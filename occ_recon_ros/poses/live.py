"""Poses from a board, image by image as they come; what cannot be used has a name."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.refusal import Refusal

from .board import BoardSpec
from .board_pose import BoardPose, candidate_poses
from .detect import BoardDetector, why_unseen
from .sequence import (
    BAD_FIT,
    BAD_FIT_PX,
    BLURRED,
    FEWEST_FITTING,
    HARMLESS_BLUR_PX,
    WORDS,
    choose_in_time,
)
from .sheet_ratio import marker_ratio, wrong_markers

_REMEMBERED = 50  # images that say what is usual
_FEWEST_USUAL = 5
_MOST_PENDING = 5  # images that wait for a neighbour to tell between two poses
_GAP_NS = 1_000_000_000  # neighbours in time are no farther apart
_ALWAYS_FITS_PX = 0.5
_PUZZLED_EVERY = 10  # images without a board; looking for the reason takes as long as ten


class NoPose(Refusal):
    """An image without a pose."""


@dataclass(frozen=True)
class LivePose:
    """The pose of one image.

    Attributes:
        stamp_ns: of the image, nanoseconds.
        pose: in the board's frame.
        blur_px: of the printed edges, 1 sigma; NaN if unknown.
    """

    stamp_ns: int
    pose: BoardPose
    blur_px: float


class LiveBoard:
    """Poses of the images of a stream.

    Where the corners cannot tell which of two poses it is, the neighbours in time do: the image
    before or, at the beginning, the ones to come, until which its pose is held back.

    Args:
        board: that is in view.
    """

    def __init__(self, board: BoardSpec) -> None:
        self.board = board
        self._detector = BoardDetector(board)
        self.reset()

    def reset(self) -> None:
        """Forget the images seen so far."""
        self._rms: deque[float] = deque(maxlen=_REMEMBERED)
        self._blur: deque[float] = deque(maxlen=_REMEMBERED)
        self._last: tuple[int, BoardPose] | None = None
        self._pending: list[tuple[int, float, list[BoardPose]]] = []
        self._without = 0

    def look(self, image: NDArray, camera: Camera, stamp_ns: int) -> list[LivePose]:
        """The poses that an image completes, oldest first: its own and those held back.

        Args:
            image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
            camera: intrinsics; its pose does not matter.
            stamp_ns: time of the image, nanoseconds.

        Raises:
            NoPose: no_board, mirrored_board, two_boards, wrong_board, few_corners, blurred,
                bad_fit, or image_size.
        """
        if (camera.width, camera.height) != image.shape[1::-1]:
            raise NoPose(
                "image_size",
                f"the image is {image.shape[1]}x{image.shape[0]}, camera_info says "
                f"{camera.width}x{camera.height}",
            )
        found = self._detector.find(image)
        if found.problem is not None:
            reason, sentence = found.problem
            if reason == "no_board":
                reason, sentence = self._puzzled(image) or (reason, sentence)
            raise NoPose(reason, sentence)
        self._without = 0
        blur = self._detector.blur_px(image, found)
        self._refuse_blurred(blur)
        corners = self.board.corners[found.index]
        candidates = candidate_poses(camera, corners, found.uv)
        if not candidates:
            raise NoPose("bad_fit", f"the corners do not fit {self.board.words}")
        best = candidates[0]
        self._refuse_bad_fit(best, camera)
        ratio = marker_ratio(self.board, camera, best.pose, found)
        if words := wrong_markers(self.board, ratio):
            raise NoPose("wrong_board", words)
        self._rms.append(best.rms_px)
        return self._in_time(stamp_ns, blur, candidates)

    def _refuse_blurred(self, blur: float) -> None:
        if not np.isfinite(blur):
            return
        usual = np.median(self._blur) if len(self._blur) >= _FEWEST_USUAL else blur
        self._blur.append(blur)
        if blur > max(BLURRED * usual, HARMLESS_BLUR_PX):
            raise NoPose(
                "blurred",
                f"edges of the board are blurred by {blur:.1f} px, usual are {usual:.1f}: more "
                "light, or move more slowly",
            )

    def _refuse_bad_fit(self, pose: BoardPose, camera: Camera) -> None:
        fitting = float(pose.used.mean())
        if fitting < FEWEST_FITTING:
            raise NoPose(
                "bad_fit",
                f"only {100 * fitting:.0f} % of the corners fit {self.board.words}: another size, "
                "number of squares or gap, or two boards",
            )
        usual = np.median(self._rms) if len(self._rms) >= _FEWEST_USUAL else np.inf
        most = BAD_FIT_PX * max(camera.width, camera.height) / 1000
        if pose.rms_px > min(most, max(BAD_FIT * usual, _ALWAYS_FITS_PX)):
            raise NoPose(
                "bad_fit",
                f"the corners are {pose.rms_px:.1f} px off from where {self.board.words} has "
                "them: correct board.yaml, or the calibration of the camera",
            )

    def _in_time(self, stamp_ns: int, blur: float, candidates: list[BoardPose]) -> list[LivePose]:
        near = self._last is not None and abs(stamp_ns - self._last[0]) <= _GAP_NS
        self._pending.append((stamp_ns, blur, candidates))
        if len(candidates) > 1 and not near and len(self._pending) < _MOST_PENDING:
            return []
        pending, self._pending = self._pending, []
        before = [[self._last[1]]] if near and self._last is not None else []
        chosen = choose_in_time([*before, *(found for _, _, found in pending)])[len(before) :]
        self._last = (stamp_ns, chosen[-1])
        return [
            LivePose(stamp, pose, width)
            for (stamp, width, _), pose in zip(pending, chosen, strict=True)
        ]

    def _puzzled(self, image: NDArray) -> tuple[str, str] | None:
        """Why there is no board, a short name and a sentence; None for an image not asked."""
        self._without += 1
        if self._without % _PUZZLED_EVERY != 1:
            return None
        return why_unseen(self._detector, image) or ("no_board", WORDS["no_board"])
