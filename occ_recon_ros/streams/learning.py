"""What the first frames of a scan teach, in a process of its own so that no frame waits for it.

Frames are kept packed, spread evenly around the object. Where what single images say does not
hold in all of them, colours and body are learnt from all together.
"""

from __future__ import annotations

import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import Camera
from ..imaging import ContourError, ContourSettings
from ..imaging.joint import JointSegmenter, LearntMasks
from ..imaging.joint.masks import LEAST_BELIEF
from ..imaging.joint.space import Grid, shared_space, silhouettes
from ..imaging.volume import Volume
from ..surface.agreement import silhouette_agreement
from .alone import DOUBT, MOST_DOUBTFUL, Outlines
from .child import END_S, GONE, Parent, answer, answers, begin

Mask = NDArray[np.uint8]

LEAST_FRAMES = 8
_TAUGHT = 36  # frames, spread evenly, that are learnt from
_QUALITY = 95  # of the JPEG
_MOST_LACKING = 0.05  # share of the masks
_VOXELS = (48, 96)  # along the shared space, then along the hull in it
_NEAR_PX = 5  # about the hull's image, that voxels are too coarse for
_HALF = 127  # of the coverage of a pixel
_SOME_FRAMES, _BELIEF_IN_FEW = 12, 0.7  # of fewer only if nothing speaks against them: 8 can err


@dataclass(frozen=True)
class PackedFrame:
    """An image, as JPEG (PNG where it has 16 bits), and its camera in the object frame."""

    stamp_ns: int
    code: NDArray[np.uint8]
    camera: Camera

    @staticmethod
    def of(image: NDArray[Any], camera: Camera, stamp_ns: int) -> PackedFrame:
        """Pack an image, (h, w) or (h, w, 3) BGR, uint8 or uint16."""
        kind, how = (".png", []) if image.dtype == np.uint16 else (".jpg", _JPEG)
        return PackedFrame(stamp_ns, np.asarray(cv2.imencode(kind, image, how)[1]), camera)

    @property
    def image(self) -> NDArray[Any]:
        """(h, w) or (h, w, 3) BGR."""
        return np.asarray(cv2.imdecode(self.code, cv2.IMREAD_UNCHANGED))


_JPEG = [cv2.IMWRITE_JPEG_QUALITY, _QUALITY]


class KeptFrames:
    """Frames of a scan in bounded memory: where there are too many, the older one of the two
    whose cameras are nearest to each other goes, so that the rest stay spread evenly.

    Args:
        most: frames.
        most_bytes: of their packed images.
    """

    def __init__(self, most: int, most_bytes: int) -> None:
        self._most, self._most_bytes = most, most_bytes
        self.frames: list[PackedFrame] = []
        self.nbytes = 0

    def __len__(self) -> int:
        return len(self.frames)

    def clear(self) -> None:
        """Keep none."""
        self.frames, self.nbytes = [], 0

    @property
    def centres(self) -> NDArray[np.float64]:
        """(n, 3) of the cameras, metres, object frame, in the order of time."""
        return np.array([frame.camera.centre for frame in self.frames]).reshape(-1, 3)

    def add(self, frame: PackedFrame) -> None:
        """Keep a frame later than all before."""
        self.frames.append(frame)
        self.nbytes += frame.code.nbytes
        while len(self.frames) > self._most or self.nbytes > self._most_bytes:
            self.nbytes -= self.frames.pop(self._least_needed()).code.nbytes

    def _least_needed(self) -> int:
        if len(self.frames) < 3:
            return 0
        C = self.centres
        apart = np.linalg.norm(C[:, None] - C, axis=2)
        apart[np.tril_indices(len(C))] = np.inf
        return int(np.unravel_index(apart.argmin(), apart.shape)[0])


@dataclass(frozen=True)
class Lesson:
    """What was learnt.

    Attributes:
        masks: segments further images; None: none are needed, or it failed.
        words: why there are none, or what they are worth.
        failed: whether single images are wrong and nothing better was found.
    """

    masks: LearntMasks | None
    words: str
    failed: bool = False


def learn(frames: Sequence[PackedFrame], settings: ContourSettings) -> Lesson:
    """Look at frames one by one, and at all of them together where that does not do.

    Args:
        frames: at least ``LEAST_FRAMES``, from around the object.
        settings: by which each would be segmented alone.
    """
    even = KeptFrames(_TAUGHT, sys.maxsize)
    for frame in frames:
        even.add(frame)
    frames = even.frames
    sizes = {(frame.camera.width, frame.camera.height) for frame in frames}
    if len(sizes) > 1:
        return Lesson(None, "the images are not of one size", failed=True)
    right, why = _right_alone(frames, settings)
    if not why:
        return Lesson(None, "what single images say agrees")
    segmenter = JointSegmenter(Volume.of(settings))
    for frame in frames:
        segmenter.add(frame.image, frame.camera, right.get(frame.stamp_ns))
    try:
        found = segmenter.solve()
    except ContourError as error:
        return Lesson(None, f"{why}; all together: {error}", failed=True)
    if found.belief < (LEAST_BELIEF if len(frames) >= _SOME_FRAMES else _BELIEF_IN_FEW):
        doubts = "; ".join([f"are not to be believed ({found.belief:.2f})", *found.warnings])
        return Lesson(None, f"{why}; masks from all together {doubts}", failed=True)
    words = "; ".join([f"belief {found.belief:.2f}, for {why}", *found.warnings])
    return Lesson(LearntMasks(found, sizes.pop()), words)


def _right_alone(
    frames: Sequence[PackedFrame], settings: ContourSettings
) -> tuple[dict[int, Mask], str]:
    """Masks of single images to begin from, by stamp, and what speaks against them; "" where
    they hold in all views."""
    rough = replace(settings, refine="none", spacing_px=2.0, tracking="none")
    seen = Outlines(rough)
    for frame in frames:
        seen.add(frame.image, frame.camera, frame.stamp_ns)
    lost = len(frames) - len(seen)
    try:
        wrong = silhouette_agreement(seen.contours).share > DOUBT
        lacking = _lacking([mask > _HALF for mask in seen.masks.values()], seen.cameras)
    except (ValueError, np.linalg.LinAlgError):
        return {}, f"single images give {len(seen)} outlines in {len(frames)} frames"
    doubts = []
    if lost:
        doubts.append(f"{lost} of {len(frames)} single images give no outline")
    if wrong.any():
        doubts.append(
            f"the outlines of {wrong.sum()} of {len(frames)} single images contradict the others"
        )
    more = [doubt] if (doubt := seen.doubt()) else []
    if lacking > _MOST_LACKING:
        more.append(f"the body that all outlines leave lacks {lacking:.0%} of them")
    doubts += more
    if more or lost + wrong.sum() > MOST_DOUBTFUL * len(frames):
        return {}, ", ".join(doubts)
    pairs = zip(seen.masks.items(), wrong, strict=True)
    return {stamp: mask for (stamp, mask), bad in pairs if not bad}, ", ".join(doubts)


def _lacking(masks: Sequence[NDArray[np.bool_]], cameras: Sequence[Camera]) -> float:
    """How much of the masks is missing in the images of their own visual hull (share, in the
    mean), beyond the size of a voxel. Shadows taken for holes, a few in each view and too small to
    be a contradiction in any, leave a body in shreds.

    Raises:
        ValueError: the views look at no common space.
    """
    low, high = shared_space(cameras)
    for along in _VOXELS:
        grid = Grid.around(low, high, along)
        body = np.ones(int(np.prod(grid.shape)), np.bool_)
        for mask, camera in zip(masks, cameras, strict=True):
            pixel, seen = grid.pixels(camera)
            body &= ~seen | mask.ravel()[pixel]
        if not body.any():
            return 1.0
        occupied = body.reshape(grid.shape)
        low, high = grid.box_of(occupied, 2)
    shares = []
    for mask, shown in zip(masks, silhouettes(grid, occupied, cameras), strict=True):
        ring = np.ones((_NEAR_PX, _NEAR_PX), np.uint8)
        near = cv2.dilate((shown > 0.5).astype(np.uint8), ring) > 0
        shares.append(float((mask & ~near).sum() / max(1, mask.sum())))
    return float(np.mean(shares))


class LearningProcess(Parent[Lesson]):
    """Runs ``learn`` in a process of its own."""

    _thread: threading.Thread | None = None

    def begin(self, frames: Sequence[PackedFrame], settings: ContourSettings) -> None:
        """Learn from these frames; ``ready`` is called when that is done."""
        self._child = begin(__name__)
        self._thread = threading.Thread(
            target=self._talk, args=(self._child, (list(frames), settings)), daemon=True
        )
        self._thread.start()

    def _talk(self, child: subprocess.Popen[bytes], job: Any) -> None:
        answer, _ = child.communicate(pickle.dumps(job, protocol=5))
        try:
            lesson = pickle.loads(answer)
        except Exception:  # whatever half an answer gives
            why = f"the process that learns has ended ({child.returncode})"
            lesson = Lesson(None, why, failed=True)
        if self._child is child:
            self._give(lesson)

    def stop(self) -> None:
        """End the child, and forget what it was at."""
        child, self._child = self._child, None
        if child is not None and self._thread is not None:
            child.kill()
            self._thread.join(END_S)
        self._answers = queue.SimpleQueue()


def main() -> None:
    """Answer the parent."""
    pipe = answers()
    try:
        frames, settings = pickle.load(sys.stdin.buffer)
    except GONE:
        return
    try:
        lesson = learn(frames, settings)
    except Exception as error:
        lesson = Lesson(None, f"nothing could be learnt: {error!r}", failed=True)
    answer(pipe, lesson)
