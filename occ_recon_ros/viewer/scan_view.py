"""What is known of a running scan from what its nodes say."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..geometry import Camera, Contours, Rim, Status
from ..geometry.arrays import Array, evenly
from ..geometry.coverage import angle_covered, angles_around
from ..imaging import draw_contours
from ..surface import Strip
from .live_surface import LiveSurface
from .patch import Patch, joined, merged

RIMS_SHOWN = 8
_CONTOURS_KEPT = 20
_CENTRES_KEPT = 4000
_HISTORY_BYTES = 60_000_000
_FRAMES_KEPT = 4000
_PICTURE_PX = 640
_RATE_S = 5.0
_NOBODY = "no node of a scan is heard: is it running, in this ROS domain?"
_SILENT_S = 3.0
_ROTATION_SAMPLES = 200


@dataclass
class ShownFrame:
    """One view of the turn.

    Attributes:
        stamp_ns: time of the image.
        centre: (3,) camera centre, metres, object frame.
        strip: triangles that its rim added, None before they have come.
        jpeg: the image with its contours as JPEG, None where it was not drawn.
        R_object_camera: (3, 3) rotation of the camera optical frame, None where unknown.
        field_of_view: from top to bottom of the image, radians.
    """

    stamp_ns: int
    centre: Array
    strip: Patch | None = None
    jpeg: bytes | None = None
    R_object_camera: Array | None = None
    field_of_view: float = 0.5

    def quaternion(self) -> Array:
        """(4,) x y z w of its rotation."""
        R = np.eye(3) if self.R_object_camera is None else self.R_object_camera
        return np.asarray(Rotation.from_matrix(R).as_quat())


@dataclass(frozen=True)
class StateWords:
    """How the scan is: a word, and a sentence for people."""

    word: str = "waiting"
    sentence: str = ""


@dataclass
class Node:
    """What a node last said of itself."""

    level: int
    message: str
    values: Mapping[str, str]
    heard_s: float


class ScanView:
    """Everything that the page shows, kept up by the messages and asked by the page.

    Times ``now_s`` are of any steady clock.

    Attributes:
        surface: of the strips.
        closed: the closed body, None while there is none.
        frames: the views of the turn in the order of their stamps.
        centres: of the cameras, (3,) metres, in the order of time; of very many only some.
        counts: frames, samples and good samples so far.
        rims: good points of the newest rims, (n, 3) float32 metres, newest last.
        paused: what this page has asked for.
        finished: whether the turn has been closed.
        saved: what the mesher answered to the last save.
        scans: how many scans have begun anew.
    """

    def __init__(self) -> None:
        self.surface = LiveSurface()
        self.nodes: dict[str, Node] = {}
        self.told: StateWords | None = None
        self.paused = False
        self.scans = 0
        self._forget()

    def _forget(self) -> None:
        self.closed: Patch | None = None
        self.closed_is_new = True
        self.frames: dict[int, ShownFrame] = {}
        self.rims: deque[NDArray[np.float32]] = deque(maxlen=RIMS_SHOWN)
        self.rims_are_new = True
        self.finished = False
        self.saved = ""
        self._contours: dict[int, Contours] = {}
        self.centres: list[Array] = []
        self._arrivals: deque[float] = deque(maxlen=1000)
        self._bytes: dict[int, int] = {}
        self._all_bytes = 0
        self.counts = {"frames": 0, "good": 0, "samples": 0}

    # What comes in.

    def new_scan(self) -> None:
        """Forget the scan, as the nodes do."""
        self.scans += 1
        self.surface.clear()
        self._forget()

    def add_contours(self, contours: Contours, now_s: float) -> None:
        """The contours of a frame; none at all and earlier than the last: a new scan begins."""
        if not len(contours):
            if self.frames and contours.stamp_ns <= max(self.frames):
                self.new_scan()
            return
        self._arrivals.append(now_s)
        self.counts["frames"] += 1
        self._contours[contours.stamp_ns] = contours
        while len(self._contours) > _CONTOURS_KEPT:
            del self._contours[next(iter(self._contours))]
        self._frame(contours.stamp_ns, contours.centre)
        self.centres.append(contours.centre)
        if len(self.centres) > _CENTRES_KEPT:
            del self.centres[1::2]

    def add_rim(self, rim: Rim) -> None:
        """The rim of a frame."""
        good = rim.status == Status.GOOD
        if len(rim):
            self.counts["good"] += int(good.sum())
            self.counts["samples"] += len(rim)
        if good.any():
            self.rims.append(rim.points[good].astype(np.float32))
            self.rims_are_new = True

    def add_strip(self, strip: Strip, now_s: float) -> None:
        """Triangles that a rim has added."""
        patch = merged(strip)
        self.surface.add(patch, now_s)
        frame = self.frames.get(strip.stamp_ns)
        if frame is not None:
            frame.strip = patch
            self._keep(frame, patch.nbytes)

    def set_mesh(self, mesh: Strip) -> None:
        """The whole surface as it is now; an empty one: somebody has reset the mesher."""
        if len(mesh):
            self.surface.replace(mesh)
        elif self.surface.latest() is not None:
            self.new_scan()

    def set_closed(self, body: Strip) -> None:
        """The closed body, coarse or full; empty if there is none any more."""
        self.closed = merged(body) if len(body) else None
        self.closed_is_new = True

    def add_report(
        self, name: str, level: int, message: str, values: Mapping[str, str], now_s: float
    ) -> None:
        """What a node says of itself."""
        self.nodes[name] = Node(level, message, values, now_s)

    def add_image(
        self, stamp_ns: int, image: NDArray[Any], camera: Camera | None
    ) -> ShownFrame | None:
        """The image of a frame whose contours have come.

        Args:
            stamp_ns: of the image.
            image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
            camera: its calibration, in whatever pose: that in the object frame follows from
                the viewing rays of the contours. None where unknown.

        Returns:
            The frame, now with a picture; None without contours of this stamp.
        """
        contours, frame = self._contours.get(stamp_ns), self.frames.get(stamp_ns)
        if contours is None or frame is None:
            return None
        drawn = draw_contours(image, contours)
        scale = _PICTURE_PX / max(drawn.shape[:2])
        if scale < 1:
            drawn = np.asarray(
                cv2.resize(drawn, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8
            )
        frame.jpeg = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
        self._keep(frame, len(frame.jpeg))
        if camera is not None:
            frame.R_object_camera = _rotation(camera, contours)
            frame.field_of_view = 2 * float(np.arctan(0.5 * camera.height / camera.K[1, 1]))
        return frame

    def drawable(self, stamps: Any) -> int | None:
        """The newest of some stamps whose contours have come and that has no picture yet."""
        known = [s for s in stamps if s in self._contours and s in self.frames]
        newest = max(known, default=None)
        return None if newest is None or self.frames[newest].jpeg else newest

    def _frame(self, stamp_ns: int, centre: Array) -> None:
        if stamp_ns not in self.frames:
            self.frames[stamp_ns] = ShownFrame(stamp_ns, centre)
            if len(self.frames) > _FRAMES_KEPT:
                self._drop_oldest()

    def _keep(self, frame: ShownFrame, nbytes: int) -> None:
        """Keep the history within its memory."""
        self._bytes[frame.stamp_ns] = self._bytes.get(frame.stamp_ns, 0) + nbytes
        self._all_bytes += nbytes
        while self._all_bytes > _HISTORY_BYTES and len(self.frames) > 1:
            self._drop_oldest()

    def _drop_oldest(self) -> None:
        oldest = next(iter(self.frames))
        del self.frames[oldest]
        self._all_bytes -= self._bytes.pop(oldest, 0)

    # What is asked.

    def state(self, now_s: float) -> StateWords:
        """How the scan is: as the mesher tells it, or else as the topics show it."""
        if self.paused:
            return StateWords("paused", "frames are not used until the scan goes on")
        if self.told is not None:
            return self.told
        if self.saved:
            return StateWords("saved", self.saved)
        if self.finished:
            return StateWords("turn closed", "the surface is whole: save it")
        if self._arrivals and now_s - self._arrivals[-1] < _SILENT_S:
            return StateWords("scanning", "turn the object once around")
        why = self._complaint(now_s)
        if self._arrivals and why == _NOBODY:
            return StateWords("ended", "its nodes have ended; what they made stays to be seen")
        if self._arrivals:
            return StateWords("waiting", f"no new frames; {why}" if why else "no new frames")
        return StateWords("waiting", why or "for the first frame")

    def _complaint(self, now_s: float) -> str:
        live = {n: node for n, node in self.nodes.items() if now_s - node.heard_s < _SILENT_S}
        if not live:
            return _NOBODY
        for part in ("contour_tracker", "reconstructor", "mesher"):
            for name, node in live.items():
                if name.endswith(part) and node.level:
                    return f"{part}: {node.message}"
        return ""

    def covered(self) -> float:
        """Angle that the camera has gone around the object, radians."""
        return angle_covered(self.centres)

    def directions(self) -> Array:
        """(k,) angles at which the camera has been, radians, about the middle of its path."""
        return angles_around(self.centres)

    def path(self) -> NDArray[np.float32]:
        """(k, 3) camera centres in the order of time."""
        return np.array(self.centres, np.float32).reshape(-1, 3)

    def frame_rate(self, now_s: float) -> float:
        """Frames a second over the last few seconds."""
        recent = [t for t in self._arrivals if now_s - t <= _RATE_S]
        if len(recent) < 2 or recent[-1] == recent[0]:
            return 0.0
        return (len(recent) - 1) / max(recent[-1] - recent[0], now_s - recent[0])

    def drops(self) -> list[tuple[str, str, int]]:
        """Node, reason and number of what was dropped."""
        out = []
        for name, node in sorted(self.nodes.items()):
            for key, value in node.values.items():
                if key.startswith("dropped ") and value.isdigit():
                    out.append((name.rsplit("/", 1)[-1], key.removeprefix("dropped "), int(value)))
        return out

    def warnings(self, now_s: float) -> list[tuple[str, str]]:
        """Node and sentence of what is wrong now."""
        return [
            (name.rsplit("/", 1)[-1], node.message)
            for name, node in sorted(self.nodes.items())
            if node.level and now_s - node.heard_s < _SILENT_S
        ]

    def pictured(self) -> ShownFrame | None:
        """A frame with a picture and a pose, None if there is none."""
        frames = (f for f in self.frames.values() if f.R_object_camera is not None)
        return next(frames, None)

    def past(self, count: int) -> Patch:
        """The surface as it was after so many frames of the history."""
        frames = list(self.frames.values())[:count]
        return joined([frame.strip for frame in frames if frame.strip is not None])

    def frame_at(self, count: int) -> ShownFrame | None:
        """The frame after which ``count`` are there."""
        frames = list(self.frames.values())[:count]
        return frames[-1] if frames else None


def _rotation(camera: Camera, contours: Contours) -> Array | None:
    """(3, 3) R_object_camera under which the pixels of the contours give their rays."""
    rows = evenly(len(contours), _ROTATION_SAMPLES)
    seen = camera.viewing_directions(contours.uv[rows]) @ camera.R_camera_object.T
    ok = np.isfinite(seen).all(axis=1)
    if ok.sum() < 3:
        return None
    rotation, _ = Rotation.align_vectors(contours.T[rows][ok], seen[ok])
    return np.asarray(rotation.as_matrix())
