"""Image, camera_info, pose and mask of one instant, brought together by their stamps."""

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

PARTS = ("image", "camera_info", "mask")

MAX_POSE_GAP_NS = 100_000_000
"""Widest gap between two poses that one is taken from in between, where nothing else is said."""

_POSES = 300  # that are kept


@dataclass
class Frame:
    """What has come of one stamp.

    Attributes:
        stamp_ns: nanoseconds.
        parts: messages by topic: image, camera_info and perhaps mask.
        poses: the pose of this stamp once, or the ones before and after it.
        fraction: where between those two the stamp lies, 0 to 1.
    """

    stamp_ns: int
    parts: dict[str, Any] = field(default_factory=dict)
    poses: tuple[Any, ...] = ()
    fraction: float = 0.0


class Poses:
    """The latest poses by stamp; a frame finds its own or its two neighbours.

    Attributes:
        words: why the last frame that was given up has no pose, where more is to be said than
            the name of the reason.
    """

    def __init__(self) -> None:
        self.words = ""
        self._poses: deque[tuple[int, Any]] = deque(maxlen=_POSES)

    def clear(self) -> None:
        """Forget all poses."""
        self._poses.clear()

    def add(self, stamp_ns: int, pose: Any) -> None:
        """Keep a pose. One that is older than all that are kept means that time went back."""
        if len(self._poses) > 1 and stamp_ns <= min(self._poses, key=_stamp)[0]:
            self._poses.clear()
        self._poses.append((stamp_ns, pose))

    def exact(self, frame: Frame) -> bool:
        """Fill in the pose of the frame's own stamp."""
        frame.poses = tuple(p for s, p in self._poses if s == frame.stamp_ns)[-1:]
        return bool(frame.poses)

    def around(self, frame: Frame) -> int | None:
        """Fill in the poses before and after the frame.

        Returns:
            Nanoseconds between them (0 for a pose of the very stamp), None if one is missing.
        """
        if self.exact(frame):
            return 0
        before = max((p for p in self._poses if p[0] < frame.stamp_ns), key=_stamp, default=None)
        after = min((p for p in self._poses if p[0] > frame.stamp_ns), key=_stamp, default=None)
        if before is None or after is None:
            return None
        frame.poses = (before[1], after[1])
        frame.fraction = (frame.stamp_ns - before[0]) / (after[0] - before[0])
        return after[0] - before[0]

    def missing(self, frame: Frame, interpolate: bool) -> str:
        """Name of what keeps the frame from having a pose."""
        wide = interpolate and self.around(frame) is not None
        return "pose_gap" if wide else "no_camera_pose"


class Pairing:
    """Collects frames until they are whole.

    A frame is given out as soon as it is whole. Frames older than it that still lack
    something will not be whole in time and are dropped: "no_image", "no_camera_info",
    "no_camera_pose", "no_mask", by what is missing, or "pose_gap" when the poses around
    it are too far apart.

    Args:
        drop: called with the reason and the stamp of each frame that is given up.
        interpolate: take the pose from the two around the image, not of its very stamp.
        max_pose_gap_ns: widest gap between those two.
        depth: frames that may wait; of more, the one that came first goes.
        with_pose: whether a frame needs one.
        poses: where they come from, None for those that ``add_pose`` is given.

    Attributes:
        await_mask: whether a frame needs a mask.
        spare_mask: a frame that lacks nothing but its mask when its time is over is given out
            without one, not dropped.
    """

    def __init__(
        self,
        drop: Callable[[str, int], None] = lambda reason, stamp: None,
        interpolate: bool = False,
        max_pose_gap_ns: int = MAX_POSE_GAP_NS,
        depth: int = 10,
        with_pose: bool = True,
        poses: Poses | None = None,
    ) -> None:
        self._drop = drop
        self._interpolate = interpolate
        self._max_gap = max_pose_gap_ns
        self._depth = depth
        self._with_pose = with_pose
        self._frames: dict[int, Frame] = {}
        self.poses = Poses() if poses is None else poses
        self.await_mask = False
        self.spare_mask = False

    def __len__(self) -> int:
        """Frames that wait for a part."""
        return len(self._frames)

    def waiting(self) -> Counter[str]:
        """The images that wait, by the reason for which they would be dropped."""
        frames = (frame for frame in self._frames.values() if "image" in frame.parts)
        return Counter(self._lack(frame)[0] for frame in frames)

    def clear(self) -> None:
        """Forget everything, without a word: a new scan begins."""
        self._frames.clear()
        self.poses.clear()

    def forget_after(self, stamp_ns: int) -> None:
        """Forget the frames later than a stamp: they are of the time before it jumped back."""
        self._frames = {s: frame for s, frame in self._frames.items() if s <= stamp_ns}

    def add(self, part: str, stamp_ns: int, message: Any) -> list[Frame]:
        """Take one message of a part; return the frames that it makes whole, oldest first."""
        frame = self._frames.setdefault(stamp_ns, Frame(stamp_ns))
        if part in frame.parts:
            self._drop("duplicate", stamp_ns)
        frame.parts[part] = message
        return self._give_out([frame])

    def add_pose(self, stamp_ns: int, message: Any) -> list[Frame]:
        """Take a pose; return the frames that it makes whole, oldest first."""
        self.poses.add(stamp_ns, message)
        waiting = sorted(self._frames) if self._interpolate else [stamp_ns]
        return self._give_out([self._frames[s] for s in waiting if s in self._frames])

    def look_again(self) -> list[Frame]:
        """The frames that are whole because more is known of poses now, oldest first."""
        return self._give_out([self._frames[stamp] for stamp in sorted(self._frames)])

    def flush(self) -> list[Frame]:
        """No message comes any more: the frames that are given out as they are, oldest first."""
        return list(filter(None, [self._give_up(stamp) for stamp in sorted(self._frames)]))

    def _give_out(self, candidates: list[Frame]) -> list[Frame]:
        whole = [frame for frame in candidates if self._is_whole(frame)]
        for frame in whole:
            del self._frames[frame.stamp_ns]
        out: list[Frame | None] = []
        if whole:
            newest = whole[-1].stamp_ns
            out += [self._give_up(s) for s in sorted(s for s in self._frames if s < newest)]
        while len(self._frames) > self._depth:
            # The first that came, not the lowest stamp: after a jump back in time that would be
            # every new one.
            out.append(self._give_up(next(iter(self._frames))))
        spared = [frame for frame in out if frame is not None]
        return sorted(spared + whole, key=lambda frame: frame.stamp_ns) if spared else whole

    def _is_whole(self, frame: Frame) -> bool:
        return not self._missing_part(frame) and self._has_pose(frame)

    def _has_pose(self, frame: Frame) -> bool:
        if not self._with_pose:
            return True
        if not self._interpolate:
            return self.poses.exact(frame)
        gap = self.poses.around(frame)
        # In a gap that is too wide the pose between may still come.
        return gap is not None and gap <= self._max_gap

    def _missing_part(self, frame: Frame) -> str | None:
        wanted = PARTS if self.await_mask else PARTS[:2]
        return next((part for part in wanted if part not in frame.parts), None)

    def _give_up(self, stamp_ns: int) -> Frame | None:
        """Wait no longer for a frame; the frame itself if it may go without what it lacks."""
        frame = self._frames.pop(stamp_ns)
        reason, posed = self._lack(frame)
        if reason == "no_mask" and self.spare_mask and posed:
            return frame
        self._drop(reason, stamp_ns)
        return None

    def _lack(self, frame: Frame) -> tuple[str, bool]:
        """Name of what keeps a frame from being whole, and whether it could have a pose."""
        missing = self._missing_part(frame)
        # An image that shows nothing of the object has no mask; its pose may be what is amiss.
        posed = missing in (None, "mask") and self._has_pose(frame)
        if missing and (missing != "mask" or posed):
            return f"no_{missing}", posed
        return self.poses.missing(frame, self._interpolate), posed


def _stamp(pose: tuple[int, Any]) -> int:
    return pose[0]
