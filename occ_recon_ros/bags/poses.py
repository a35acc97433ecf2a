"""Poses of the images of a bag: those of their stamps, else between the poses around them."""

from bisect import bisect_left
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msg_adapters import decode_pose, decode_stamp, deserialise, serialise
from msg_adapters.pose import PATH, POSE, encode_camera_pose, poses_of
from msg_adapters.serialised import header_stamp_ns
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
_STEADY = 0.05  # of a step, that an offset varies by (median) which is the same for all


@dataclass(frozen=True)
class PoseReading:
    """How the images of a bag get their poses, as contour_tracker's parameters of these names say.

    Attributes:
        object_frame: that poses are taken in from /tf, where the bag holds no camera_pose.
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
    a step: where all poses are a little late, the first image has one too.

    Args:
        bag: that holds them.
        source: their topic in the bag.
        images: (n,) int64, stamps of the images, ns, increasing.
        reading: how they are used.
    """

    def __init__(
        self, bag: Bag, source: str, images: NDArray[np.int64], reading: PoseReading
    ) -> None:
        found: dict[int, tuple[CameraPose, str]] = {}
        own = set()
        for message in _poses(bag, source):
            try:
                stamp = decode_stamp(message.header.stamp)
                own.add(stamp)
                found[stamp] = decode_pose(message), message.header.frame_id
            except ValueError:  # of one of an image's stamp, the tracker says so
                continue
        self._images = images.tolist()
        self._exact = reading.pose_sync == "exact"
        self._as_recorded = bag.types[source] == POSE
        self._own = own & set(self._images)
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
                recorded = self._as_recorded and stamp in self._own
                if is_pose and not recorded:
                    continue
                if not (is_pose or recorded) and (pose := self._at(stamp)) is not None:
                    cdr = serialise(encode_camera_pose(pose, stamp, self._frame(stamp)))
                    yield message._replace(topic="/camera_pose", msgtype=POSE, cdr=cdr)
            yield message

    def remarks(self) -> list[str]:
        """Sentences on images that have no pose of their stamp.

        Raises:
            UserError: not one has a pose; says why.
        """
        others = [stamp for stamp in self._images if stamp not in self._own]
        if not others:
            return []
        total = len(self._images)
        words = f"{len(others)} of {total} images have no pose of their stamp{self._offset(others)}"
        lacking = [stamp for stamp in others if self._at(stamp) is None]
        if self._exact:
            words += ", and pose_sync is exact: --set contour_tracker.pose_sync=interpolate"
            words += " takes it between the poses around each"
        elif lacking:
            words += f"; {len(lacking)} have none at all: {self._why_none(lacking)}"
        if len(lacking) == total:
            raise UserError(words)
        if len(lacking) < len(others):
            words += "; it is taken between the poses around each, by their stamps"
        return [words]

    def _at(self, stamp: int) -> CameraPose | None:
        """The pose at a time, None where there is none."""
        if stamp in self._found:
            return self._found[stamp][0]
        if self._exact or len(self._stamps) < 2:
            return None
        beyond = max(self._stamps[0] - stamp, stamp - self._stamps[-1])
        k = min(max(bisect_left(self._stamps, stamp), 1), len(self._stamps) - 1)
        before, after = self._stamps[k - 1], self._stamps[k]
        if beyond > _BEYOND * self._step or after - before > self._gap:
            return None
        fraction = (stamp - before) / (after - before)
        return self._found[before][0].towards(self._found[after][0], fraction)

    def _frame(self, stamp: int) -> str:
        """The frame that the pose before a time is in, or the first."""
        return self._found[self._stamps[max(bisect_left(self._stamps, stamp) - 1, 0)]][1]

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
