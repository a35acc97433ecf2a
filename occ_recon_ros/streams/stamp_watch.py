"""Which topic has stamps that do not meet those of the images, and by how much."""

from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

_IMAGES = 100  # the latest, whose stamps are remembered
_OTHERS = 1000
_JUDGED = 20  # images
_STANDING = 4  # of one stamp
_UNMET = 3  # in a row, on both sides, after others that met
_LEAPS = 4.0  # pauses between poses of their own rate, that a clock has leapt by
_KEPT_UP = 0.5  # of a leap, by which poses are ahead of images since: they have not merely paused
_PACE = 0.5  # share of a pause by which two of the same pace may differ
_MOST = 1000  # of sync_queue
_DAY_NS = 86_400_000_000_000


class StampWatch:
    """Remembers the stamps that came, by topic: image, camera_info, mask, camera_pose."""

    def __init__(self) -> None:
        self._stamps: dict[str, deque[int]] = {}
        self._poses = 0  # so far
        # When an image came: the poses so far, and by how much the last was ahead of it.
        self._ahead: deque[tuple[int, int]] = deque(maxlen=_IMAGES)
        self._leap = ""

    def note(self, part: str, stamp_ns: int) -> None:
        """A message of a topic has come."""
        most = _IMAGES if part == "image" else _OTHERS
        self._stamps.setdefault(part, deque(maxlen=most)).append(stamp_ns)
        poses = self._stamps.get("camera_pose")
        if part == "image" and poses:
            self._ahead.append((self._poses, poses[-1] - stamp_ns))
        self._poses += part == "camera_pose"

    def leap(self) -> str:
        """What is to be said of poses of their own rate whose clock has leapt since the first
        message, "" where it has not. To be asked from time to time."""
        poses = self._of("camera_pose")
        if self._leap or len(poses) < _IMAGES // 5:
            return self._leap
        steps = np.diff(poses)
        pause = float(np.median(steps))
        at = int(np.abs(steps - pause).argmax())
        by = float(steps[at] - pause)
        count, ahead = np.array(self._ahead, np.int64).reshape(-1, 2).T
        since = count > self._poses - len(poses) + at + 1
        if abs(by) > _LEAPS * abs(pause) and min(since.sum(), (~since).sum()) >= _UNMET:
            moved = float(np.median(ahead[since]) - np.median(ahead[~since]))
            if moved * np.sign(by) > _KEPT_UP * abs(by):
                side = "ahead" if by > 0 else "back"
                self._leap = (
                    f"the stamps of camera_pose have leapt {side} by {duration(int(abs(by)))} "
                    "against those of the images, which since have poses of other moments: both "
                    "must have one time"
                )
        return self._leap

    def why(self, parts: Iterable[str], depth: int, most_gap_ns: int | None = None) -> str:
        """Why no frame is whole, with what helps; "" where nothing is seen.

        Args:
            parts: what a frame needs besides its image.
            depth: of the frames that wait, sync_queue.
            most_gap_ns: between the two poses that one is taken from, None for poses that must
                have the stamp of the image.
        """
        images = self._of("image")
        if not len(images):
            return ""
        reasons = []
        for part in parts:
            found = self._of(part)
            if not len(found):
                continue
            by_rate = part == "camera_pose" and most_gap_ns is not None
            rest, others = _unmet(images, found), _unmet(found, images)
            if len(rest) < len(images) and not by_rate:
                reasons.append(_jumped(part, rest, others))
            elif not found.any() or _of_other_clocks(images, found):
                reasons.append(_clocks(part, images, found))
            elif by_rate and most_gap_ns is not None:
                reasons.append(self._between(images[-_JUDGED:], found, most_gap_ns))
            else:
                reasons.append(_other(part, images[-_JUDGED:], found))
        found_one = next(filter(None, reasons), "")
        return found_one or self._late(parts, images, depth)

    def standing(self) -> str:
        """What is said of images that all have one stamp, "" of others."""
        images = self._of("image")[-_JUDGED:]
        if len(images) < _STANDING or images.min() < images.max():
            return ""
        return f"all images have the stamp {images[0] * 1e-9:g} s: what sends them must set it"

    def _of(self, part: str) -> NDArray[np.int64]:
        return np.array(self._stamps.get(part, ()), np.int64)

    def _between(
        self, images: NDArray[np.int64], poses: NDArray[np.int64], most_gap_ns: int
    ) -> str:
        """What is wrong with poses of another rate."""
        poses = np.unique(poses)
        gap = gap_around(images, poses)
        if gap is None:
            ahead = int(poses[0] - images[-1])
            return f"all poses are later than the images, by {duration(ahead)}" if ahead > 0 else ""
        if gap <= most_gap_ns:
            return ""
        return (
            f"the poses around an image are {gap * 1e-9:.3f} s apart, and max_pose_gap is "
            f"{most_gap_ns * 1e-9:g} s: set it to {1.5 * gap * 1e-9:.2g}, or send poses more often"
        )

    def _late(self, parts: Iterable[str], images: NDArray[np.int64], depth: int) -> str:
        """Which part comes when its images have been given up."""
        newest = {part: self._of(part)[-1:] for part in parts}
        behind = {p: int((images > s[0]).sum()) for p, s in newest.items() if len(s)}
        if not behind:
            return ""
        part = max(behind, key=lambda p: behind[p])
        if behind[part] < min(depth, len(images) - 1) or behind[part] == len(images):
            return ""
        seconds = (images.max() - newest[part][0]) * 1e-9
        return (
            f"{part} comes {seconds:.2f} s after its image, when {behind[part]} later ones have "
            f"come, and sync_queue is {depth}: set it to {min(2 * behind[part], _MOST)}"
        )


def _of_other_clocks(images: NDArray[np.int64], found: NDArray[np.int64]) -> bool:
    """Whether the stamps of a topic are that far from those of the images that it cannot merely
    be late: all images that are remembered came in less time than there is between the two."""
    between = max(images.min() - found.max(), found.min() - images.max())
    return between > (np.ptp(images) if len(images) >= _JUDGED else _DAY_NS)


def _clocks(part: str, images: NDArray[np.int64], found: NDArray[np.int64]) -> str:
    """Of a topic whose stamps are none, or those of another clock."""
    if not found.any():
        return f"the stamps of {part} are 0: it must have the stamp of its image"
    apart = int(found[-1] - images[-1])
    if abs(apart) > _DAY_NS:
        where = "of another clock than those of the images (since a start, not the time of day?)"
    else:
        side = "ahead of" if apart > 0 else "behind"
        where = f"{duration(abs(apart))} {side} those of the images: another clock"
    return f"the stamps of {part} are {where}: both must have one time"


def _unmet(stamps: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.int64]:
    """Those that came after the last of them that is among the others."""
    met = np.flatnonzero(np.isin(stamps, others))
    return stamps[met[-1] + 1 :] if len(met) else stamps


def _jumped(part: str, images: NDArray[np.int64], found: NDArray[np.int64]) -> str:
    """Of a topic whose stamps met those of the images until some time ago; "" where they only
    come late, or are lost."""
    count = min(len(images), len(found))
    if count < _UNMET:
        return ""
    apart = (found[:count] - images[:count]).astype(np.float64)
    pause = np.median(np.diff(images))
    if abs(np.median(np.diff(found)) - pause) > _PACE * abs(pause):  # none belongs to another
        apart = _nearest(images, found).astype(np.float64)
    by = int(np.median(apart))
    side = "ahead of" if by > 0 else "behind"
    return (
        f"the stamps of {part} have jumped: they are {duration(abs(by))} {side} those of the "
        "images now: another clock: both must have one time"
    )


def _nearest(images: NDArray[np.int64], found: NDArray[np.int64]) -> NDArray[np.int64]:
    """From each image to the stamp of a topic that is nearest to it."""
    apart = found[:, None] - images[None, :]
    return apart[np.abs(apart).argmin(axis=0), np.arange(len(images))]


def _other(part: str, images: NDArray[np.int64], found: NDArray[np.int64]) -> str:
    """Of a topic that has none of the stamps of the images."""
    nearest = _nearest(images, found)
    least = int(nearest[np.abs(nearest).argmin()])
    side = "later" if least > 0 else "earlier"
    helps = "it must have the stamp of its image"
    if part == "camera_pose":
        helps = "poses of another rate need pose_sync: interpolate"
    return (
        f"{part} has the stamp of no image, the nearest is {duration(abs(least))} {side}: {helps}"
    )


def gap_around(images: NDArray[np.int64], poses: NDArray[np.int64]) -> float | None:
    """Between the poses (increasing stamps) before and after an image, ns, in the median; None
    where no image is between any."""
    inside = images[(images > poses[0]) & (images < poses[-1])]
    after = np.searchsorted(poses, inside)
    return float(np.median(poses[after] - poses[after - 1])) if len(inside) else None


def duration(ns: int) -> str:
    """In the unit that fits it."""
    for unit, size in (("s", 1_000_000_000), ("ms", 1_000_000), ("us", 1_000)):
        if ns >= size:
            return f"{ns / size:.{3 if ns < 1000 * size else 6}g} {unit}"
    return f"{ns} ns"
