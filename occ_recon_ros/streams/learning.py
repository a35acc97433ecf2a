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
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..imaging import ContourError, ContourSettings
from ..imaging.joint import JointMasks, JointSegmenter, LearntMasks
from ..imaging.joint.masks import LEAST_BELIEF, Trial
from ..imaging.volume import Volume
from ..surface.agreement import silhouette_agreement
from .alone import MISPLACED, Mask, Outlines
from .child import END_S, GONE, Parent, answer, answers, begin
from .held import Held, where_poses_do_it
from .kept_frames import KeptFrames, PackedFrame
from .together import SURE, better, strangers_among

LEAST_FRAMES = 8
_TAUGHT = 36  # frames, spread evenly, that are learnt from
_SOME_FRAMES, _BELIEF_IN_FEW = 12, 0.7  # of fewer only if nothing speaks against them: 8 can err

_Masks = Mapping[int, Mask]
"""(h, w) coverage, by stamp."""


@dataclass(frozen=True)
class Lesson:
    """What was learnt.

    Attributes:
        masks: segments further images; None: none are needed, or it failed.
        words: why there are none, or what they are worth.
        failed: whether single images are wrong and nothing better was found.
        right: stamps of the frames whose own outlines hold.
        strangers: stamps of those that show something else.
    """

    masks: LearntMasks | None
    words: str
    failed: bool = False
    right: frozenset[int] = frozenset()
    strangers: frozenset[int] = frozenset()


def learn(frames: Sequence[PackedFrame], settings: ContourSettings) -> Lesson:
    """Hold the outlines of single images against each other, and look at all images together where
    that does not do, as ``replay`` does.

    Args:
        frames: at least ``LEAST_FRAMES``, from around the object; of more than some, the images of
            those that are spread evenly are looked at, and need be there.
        settings: of the scan volume.
    """
    taught = evenly(frames)
    sizes = {(frame.camera.width, frame.camera.height) for frame in frames}
    if len(sizes) > 1:
        return Lesson(None, "the images are not of one size", failed=True)
    alone = _alone(frames, taught)
    if not alone.why:
        return Lesson(None, "what single images say agrees")
    look, right = _Look(taught, alone.contrary, settings), alone.right
    given = {frame.stamp_ns: frame.mask() for frame in taught if frame.stamp_ns in right}
    try:
        found, strangers = look.all(given)
        if min(found.belief, found.support) < SURE:
            # Outlines of single images agree with each other on a shadow as well; and where they
            # are wrong at places alone, they tell colours better than where all look.
            guess = {} if right else {f.stamp_ns: f.mask() for f in taught if f.loops}
            with suppress(ContourError):
                other = look.all({}, guess, found.trial)
                all_told = other[0].belief >= SURE and len(other[1]) < len(strangers)
                if all_told or better(other[0], found, guessed=bool(guess)):
                    (found, strangers), right = other, frozenset()
    except ContourError as error:
        return Lesson(None, f"{alone.why}; all together: {error}", failed=True)
    if found.belief < (LEAST_BELIEF if len(frames) >= _SOME_FRAMES else _BELIEF_IN_FEW):
        doubts = "; ".join([f"are not to be believed ({found.belief:.2f})", *found.warnings])
        return Lesson(None, f"{alone.why}; masks from all together {doubts}", failed=True)
    words = "; ".join([f"belief {found.belief:.2f}, for {alone.why}", *found.warnings])
    looked_at = [frame.stamp_ns for k, frame in enumerate(taught) if k not in strangers]
    bad = {stamp for stamp, view in zip(looked_at, found.views, strict=True) if view.bad}
    odd = frozenset(taught[k].stamp_ns for k in strangers)
    return Lesson(LearntMasks(found, sizes.pop()), words, False, right - bad - odd, odd)


def evenly(frames: Sequence[PackedFrame]) -> list[PackedFrame]:
    """Those that are learnt from."""
    even = KeptFrames(_TAUGHT, sys.maxsize)
    for frame in frames:
        even.add(frame)
    return even.frames


@dataclass(frozen=True)
class _Alone:
    """What the outlines of single images say.

    Attributes:
        why: what speaks against them, "" where they hold in all views.
        right: stamps of those to begin from.
        contrary: stamps of those that the others contradict by much.
    """

    why: str
    right: frozenset[int] = frozenset()
    contrary: frozenset[int] = frozenset()


def _alone(frames: Sequence[PackedFrame], taught: Sequence[PackedFrame]) -> _Alone:
    """Hold the outlines against each other, and those of some against their images."""
    seen, asked = Outlines(), {frame.stamp_ns for frame in taught}
    for frame in frames:
        if (own := frame.outline()) is not None:
            image = frame.image if frame.stamp_ns in asked else None
            seen.take(own, frame.camera, frame.mask(), image)
    count, lost = len(seen), len(frames) - len(seen)
    by_image = seen.doubt()
    try:
        held = Held(seen.contours, silhouette_agreement(seen.contours), lost)
    except ValueError:
        return _Alone(f"single images give {count} outlines in {len(frames)} frames")
    if not by_image and (corrected := where_poses_do_it(held, seen.cameras)):
        held = corrected.held
    doubts = []
    if lost:
        doubts.append(f"{lost} of {len(frames)} single images give no outline")
    if wrong := held.wrong.sum():
        doubts.append(
            f"the outlines of {wrong} of {len(frames)} single images contradict the others"
        )
    more = by_image or held.doubt_of_hull or held.doubt_of_holes
    why = ", ".join([*doubts, more] if more else doubts)
    if more or not held.usable_without(held.wrong):
        return _Alone(why)
    stamps = np.array([own.stamp_ns for own in held.contours])
    right, contrary = stamps[~held.wrong], stamps[held.shares > MISPLACED]
    return _Alone(why, frozenset(right.tolist()), frozenset(contrary.tolist()))


class _Look:
    """Looks at all images together, but for those that show something else."""

    def __init__(
        self,
        frames: Sequence[PackedFrame],
        contrary: Collection[int],
        settings: ContourSettings,
    ) -> None:
        self._frames, self._volume = frames, Volume.of(settings)
        self._contrary = [k for k, f in enumerate(frames) if f.stamp_ns in contrary]

    def all(
        self, given: _Masks, guess: _Masks | None = None, like: Trial | None = None
    ) -> tuple[JointMasks, Collection[int]]:
        """The masks of all, and the numbers of those that are left out.

        Args:
            given: masks that hold, by stamp.
            guess: those of which only the colours are begun from.
            like: the trial that found the best masks before.

        Raises:
            ContourError: as ``JointSegmenter.solve``.
        """

        def strange(found: JointMasks) -> Collection[int]:
            return strangers_among(found, (), self._contrary)

        found = self._solve((), given, guess or {}, like, lambda found: bool(strange(found)))
        out = strange(found)
        if out:
            found = self._solve(out, given, guess or {}, like)
        return found, out

    def _solve(
        self,
        out: Collection[int],
        given: _Masks,
        guess: _Masks,
        like: Trial | None,
        asks_again: Callable[[JointMasks], bool] = lambda _: False,
    ) -> JointMasks:
        segmenter = JointSegmenter(self._volume)
        for k, frame in enumerate(self._frames):
            if k not in out:
                own = given.get(frame.stamp_ns), guess.get(frame.stamp_ns)
                segmenter.add(frame.image, frame.camera, *own)
        return segmenter.solve(asks_again, like)


class LearningProcess(Parent[Lesson]):
    """Runs ``learn`` in a process of its own."""

    _thread: threading.Thread | None = None

    def begin(self, frames: Sequence[PackedFrame], settings: ContourSettings) -> None:
        """Learn from these frames; ``ready`` is called when that is done."""
        taught = {frame.stamp_ns for frame in evenly(frames)}
        sent = [frame if frame.stamp_ns in taught else frame.bare for frame in frames]
        self._child = begin(__name__)
        self._thread = threading.Thread(
            target=self._talk, args=(self._child, (sent, settings)), daemon=True
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
