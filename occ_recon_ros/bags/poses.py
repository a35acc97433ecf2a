"""Poses of the images of a bag: those of their stamps, else between the poses around them."""

from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msg_adapters import decode_pose, decode_stamp, deserialise, serialise
from msg_adapters.pose import PATH, POSE, encode_camera_pose, poses_of
from msg_adapters.serialised import header_frame, header_stamp_ns
from occ_recon_ros.errors import UserError
from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.streams.pairing import MAX_POSE_GAP_NS
from occ_recon_ros.streams.stamp_watch import duration, gap_around
from occ_recon_ros.streams.topics import IMAGES

from .reader import Bag, BagMessage

OBJECT_FRAME = "turntable"
"""Of the poses, where nothing else is said."""

_USUAL_STEPS = 1.5  # between the two poses that one is taken from: of more, one is missing there
_BEYOND = 0.9  # of a step, before the first pose or after the last: a whole one is a missing pose
_ONE_EACH = 0.1  # of the images, that there are more or fewer poses where each has one
_NAMED = 3  # of poses that are left out
_STEADY = 0.05  # of a step, that an offset varies by (median) which is the same for all


@dataclass(frozen=True)
class PoseReading:
    """How the images of a bag get their poses, as contour_tracker's parameters of these names say.

    Attributes:
        object_frame: that poses are taken in from /tf, where the bag holds no camera_pose; of
            camera_pose in several frames that which counts, where it is among them.
        pose_sync: exact: the pose has the stamp of the image; interpolate: an image without such
            a pose has that between the two around it.
        max_pose_gap_ns: widest gap between those two; None: 0.1 s, or where poses are further
            apart, one and a half of their usual steps.
    """

    object_frame: str = OBJECT_FRAME
    pose_sync: str = "interpolate"
    max_pose_gap_ns: int | None = None

    @property
    def tf_gap_ns(self) -> int:
        """Widest gap between two transforms."""
        return MAX_POSE_GAP_NS if self.max_pose_gap_ns is None else self.max_pose_gap_ns


AS_USUAL = PoseReading()
"""Where nothing is said."""


class BagPoses:
    """The poses of a bag, all known before its first image is played.

    Before the first and after the last, the way between the two next to it goes on for less than
    a step: where all poses are a little late, the first image has one too. Those that cannot be
    used are left out, and so are those in another frame than the first, or than the one that is
    named.

    Args:
        bag: that holds them.
        source: their topic in the bag.
        images: (n,) int64, stamps of the images, ns, increasing.
        reading: how they are used.

    Attributes:
        frame: that they are in.
    """

    def __init__(
        self, bag: Bag, source: str, images: NDArray[np.int64], reading: PoseReading
    ) -> None:
        by_frame: dict[str, dict[int, CameraPose]] = {}
        self._counts: Counter[str] = Counter()
        self._bad: dict[str, list[int]] = {}
        for message in _poses(bag, source):
            stamp = decode_stamp(message.header.stamp)
            try:
                pose = decode_pose(message)
            except ValueError as error:
                self._bad.setdefault(str(error), []).append(stamp)
                continue
            by_frame.setdefault(message.header.frame_id, {})[stamp] = pose
            self._counts[message.header.frame_id] += 1
        named = reading.object_frame in by_frame
        self.frame = reading.object_frame if named else next(iter(by_frame), "")
        found = by_frame.get(self.frame, {})
        self._images = images.tolist()
        self._exact = reading.pose_sync == "exact"
        self._as_recorded = bag.types[source] == POSE
        self._own = found.keys() & set(self._images)
        self._found = found
        self._stamps = sorted(found)
        self._step = int(np.median(np.diff(self._stamps))) if len(found) > 1 else 0
        usual = max(MAX_POSE_GAP_NS, int(_USUAL_STEPS * self._step))
        self._gap = usual if reading.max_pose_gap_ns is None else reading.max_pose_gap_ns

    def placed(self, messages: Iterable[BagMessage]) -> Iterator[BagMessage]:
        """The messages (under the names of our topics) with the pose of each image: as it was
        recorded where it has the stamp of the image, else before the image."""
        for message in messages:
            is_pose = message.topic == "/camera_pose"
            if is_pose or message.topic in IMAGES:
                stamp = header_stamp_ns(message.cdr)
                if is_pose and not self._passes(message, stamp):
                    continue
                recorded = is_pose or (self._as_recorded and stamp in self._own)
                if not recorded and (pose := self._at(stamp)) is not None:
                    cdr = serialise(encode_camera_pose(pose, stamp, self.frame))
                    yield message._replace(topic="/camera_pose", msgtype=POSE, cdr=cdr)
            yield message

    def remarks(self) -> list[str]:
        """Sentences on poses that are left out, and on images that have none of their stamp.

        Raises:
            UserError: not one has a pose; says why.
        """
        left_out = [*self._unusable(), *self._in_other_frames()]
        others = [stamp for stamp in self._images if stamp not in self._own]
        if not others:
            return left_out
        total = len(self._images)
        words = f"{len(others)} of {total} images have no pose of their stamp{self._offset(others)}"
        lacking = [stamp for stamp in others if self._at(stamp) is None]
        if self._exact:
            words += ", and pose_sync is exact: --set contour_tracker.pose_sync=interpolate"
            words += " takes it between the poses around each"
        elif lacking:
            words += f"; {len(lacking)} have none at all: {self._why_none(lacking)}"
        if len(lacking) == total:
            raise UserError("; ".join([*left_out, words]))
        if len(lacking) < len(others):
            words += "; it is taken between the poses around each, by their stamps"
        return [*left_out, words]

    def _unusable(self) -> list[str]:
        """What is to be said of poses that cannot be used."""
        bad = sum(map(len, self._bad.values()))
        if not bad:
            return []
        kinds = []
        for why, stamps in sorted(self._bad.items(), key=lambda row: -len(row[1]))[:_NAMED]:
            at = ", ".join(f"{stamp * 1e-9:.3f}" for stamp in stamps[:_NAMED])
            kinds.append(f"{len(stamps)} {why} (at {at}{', ...' * (len(stamps) > _NAMED)} s)")
        total = bad + self._counts.total()
        return [f"{bad} of {total} poses cannot be used and are left out: {'; '.join(kinds)}"]

    def _in_other_frames(self) -> list[str]:
        """What is to be said of poses in other frames than the one that counts."""
        total = self._counts.total()
        return [
            f"{count} of {total} poses are in the frame '{frame}', not '{self.frame}', and left "
            f"out (--set contour_tracker.object_frame={frame} takes those instead)"
            for frame, count in self._counts.most_common(_NAMED + 1)
            if frame != self.frame
        ]

    def _passes(self, pose: BagMessage, stamp: int) -> bool:
        """Whether a pose is played as it was recorded."""
        if not self._as_recorded or stamp not in self._own:
            return False
        if header_frame(pose.cdr) != self.frame:
            return False
        if not any(stamp in stamps for stamps in self._bad.values()):
            return True
        try:
            decode_pose(deserialise(pose.cdr, POSE))
        except ValueError:
            return False  # another of its stamp is whole
        return True

    def _at(self, stamp: int) -> CameraPose | None:
        """The pose at a time, None where there is none."""
        if stamp in self._found:
            return self._found[stamp]
        if self._exact or len(self._stamps) < 2:
            return None
        beyond = max(self._stamps[0] - stamp, stamp - self._stamps[-1])
        k = min(max(bisect_left(self._stamps, stamp), 1), len(self._stamps) - 1)
        before, after = self._stamps[k - 1], self._stamps[k]
        if beyond > _BEYOND * self._step or after - before > self._gap:
            return None
        fraction = (stamp - before) / (after - before)
        return self._found[before].towards(self._found[after], fraction)

    def _offset(self, images: list[int]) -> str:
        """By how much all poses are late or early, where there is one an image and it is the same
        for all."""
        others = abs(len(self._stamps) - len(self._images))
        if len(self._stamps) < 2 or others > _ONE_EACH * len(self._images):
            return ""
        stamps = np.array(self._stamps)
        k = np.clip(np.searchsorted(stamps, images), 1, len(stamps) - 1)
        apart = np.stack([stamps[k - 1], stamps[k]]) - np.array(images)
        nearest = apart[np.abs(apart).argmin(axis=0), np.arange(len(images))]
        offset = int(np.median(nearest))
        if np.median(np.abs(nearest - offset)) > _STEADY * self._step:
            return ""
        side = "later" if offset > 0 else "earlier"
        return (
            f" (poses come {duration(abs(offset))} {side}; if each is that of an image, it should "
            "have its stamp)"
        )

    def _why_none(self, images: list[int]) -> str:
        if len(self._stamps) < 2:
            return f"{len(self._stamps)} poses can be used"
        stamps, at = np.array(self._stamps), np.array(images)
        if (gap := gap_around(at, stamps)) is not None:
            return (
                f"the poses around them are {gap * 1e-9:.3g} s apart "
                f"(--set contour_tracker.max_pose_gap={1.5e-9 * gap:.2g} takes them)"
            )
        seconds = [f"{ns * 1e-9:.3f}" for ns in (stamps[0], stamps[-1], at[0], at[-1])]
        return f"poses are of {seconds[0]} to {seconds[1]} s, these of {seconds[2]} to {seconds[3]}"


def _poses(bag: Bag, source: str) -> Iterator:
    """The poses of a topic as PoseStamped, in order of recording; of paths those of the last, which
    holds all."""
    kind, messages = bag.types[source], bag.messages([source])
    for message in deque(messages, maxlen=1) if kind == PATH else messages:
        yield from _decoded(message.cdr, kind)


def _decoded(cdr: bytes, kind: str) -> Iterator:
    try:
        # Of many kinds: whatever the parser stumbles over.
        yield from poses_of(deserialise(cdr, kind), kind)
    except Exception:
        return
