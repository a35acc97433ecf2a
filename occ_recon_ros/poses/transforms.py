"""A tree of coordinate frames that move: where one is in another at a time in between."""

from bisect import bisect_left, insort
from dataclasses import dataclass, field

from occ_recon_ros.geometry.pose import ORIGIN, CameraPose
from occ_recon_ros.geometry.refusal import Refusal

_KEPT = 10_000  # stamps of a frame
_MOST_FRAMES = 1_000
_LONGEST_CHAIN = 100
_LATE_NS = 10_000_000_000  # what comes later than this is of another time


class NoTransform(Refusal):
    """A transform that cannot be had: tf_unconnected, tf_loop, tf_early (before all that is known),
    tf_late (after it: it may still come) or tf_gap."""


@dataclass(frozen=True)
class Transform:
    """Where a frame is in its parent.

    Attributes:
        parent, child: names of the frames.
        stamp_ns: nanoseconds.
        pose: of the child in the parent, metres.
    """

    parent: str
    child: str
    stamp_ns: int
    pose: CameraPose


@dataclass
class _Edge:
    """What is known of one child."""

    parent: str
    static: bool
    stamps: list[int] = field(default_factory=list)
    poses: dict[int, CameraPose] = field(default_factory=dict)

    def add(self, stamp_ns: int, pose: CameraPose) -> None:
        if self.static:
            self.stamps, self.poses = [stamp_ns], {stamp_ns: pose}
            return
        if stamp_ns not in self.poses:
            insort(self.stamps, stamp_ns)
        self.poses[stamp_ns] = pose
        while len(self.stamps) > _KEPT:
            del self.poses[self.stamps.pop(0)]

    def at(self, stamp_ns: int, most_gap_ns: int, words: str) -> CameraPose:
        if self.static:
            return self.poses[self.stamps[0]]
        if stamp_ns in self.poses:
            return self.poses[stamp_ns]
        k = bisect_left(self.stamps, stamp_ns)
        if k == 0:
            raise NoTransform("tf_early", f"{words} is not known yet at {stamp_ns * 1e-9:.3f} s")
        if k == len(self.stamps):
            raise NoTransform(
                "tf_late",
                f"{words} is known until {self.stamps[-1] * 1e-9:.3f} s, not at "
                f"{stamp_ns * 1e-9:.3f} s",
            )
        before, after = self.stamps[k - 1], self.stamps[k]
        if after - before > most_gap_ns:
            raise NoTransform(
                "tf_gap",
                f"{words} is not known for {(after - before) * 1e-9:.3f} s around "
                f"{stamp_ns * 1e-9:.3f} s (max_pose_gap)",
            )
        fraction = (stamp_ns - before) / (after - before)
        return self.poses[before].towards(self.poses[after], fraction)


class TransformTree:
    """Collects transforms as /tf and /tf_static bring them, and chains them."""

    def __init__(self) -> None:
        self._edges: dict[str, _Edge] = {}

    @property
    def frames(self) -> list[str]:
        """Names of all frames, sorted."""
        return sorted({*self._edges, *(edge.parent for edge in self._edges.values())})

    def clear(self) -> None:
        """Forget what moves; what is static is sent only once."""
        self._edges = {name: edge for name, edge in self._edges.items() if edge.static}

    def add(self, transform: Transform, static: bool = False) -> None:
        """Take in a transform. A frame with another parent than before moves over to it.

        Raises:
            ValueError: a frame without a name, within itself, or one too many.
        """
        parent, child = transform.parent.lstrip("/"), transform.child.lstrip("/")
        if not (parent and child):
            raise ValueError("a transform lacks the name of a frame")
        if parent == child:
            raise ValueError(f"frame '{child}' is its own parent")
        edge = self._edges.get(child)
        if edge is None and len(self._edges) >= _MOST_FRAMES:
            raise ValueError(f"more than {_MOST_FRAMES} frames")
        if edge is None or edge.parent != parent or edge.static != static:
            edge = self._edges[child] = _Edge(parent, static)
        elif not static and edge.stamps and transform.stamp_ns < edge.stamps[0] - _LATE_NS:
            # Long before all that is known: time went back.
            edge = self._edges[child] = _Edge(parent, static)
        edge.add(transform.stamp_ns, transform.pose)

    def lookup(
        self, target: str, source: str, stamp_ns: int, most_gap_ns: int = 2**62
    ) -> CameraPose:
        """Where frame ``source`` is in frame ``target`` at a time.

        Between two stamps a frame moves on a straight line and turns at constant speed.

        Args:
            target, source: names of frames.
            stamp_ns: nanoseconds.
            most_gap_ns: between two stamps that the pose is taken from.

        Raises:
            NoTransform: with the reason.
        """
        target, source = target.lstrip("/"), source.lstrip("/")
        up, over = self._chain(source), self._chain(target)
        common = next((name for name in up if name in over), None)
        if common is None:
            known = ", ".join(self.frames[:12]) or "nothing"
            raise NoTransform(
                "tf_unconnected",
                f"no transforms join '{source}' with '{target}'; /tf and /tf_static know {known}",
            )

        def root(chain: list[str]) -> CameraPose:
            total = ORIGIN
            for name in chain[: chain.index(common)]:
                edge = self._edges[name]
                words = f"'{name}' in '{edge.parent}'"
                total = edge.at(stamp_ns, most_gap_ns, words) @ total
            return total

        return root(over).inverse @ root(up)

    def _chain(self, name: str) -> list[str]:
        """A frame, its parent, and so on."""
        chain = [name]
        while chain[-1] in self._edges:
            parent = self._edges[chain[-1]].parent
            if parent in chain or len(chain) > _LONGEST_CHAIN:
                raise NoTransform("tf_loop", f"the frames go in a circle: {' < '.join(chain[:6])}")
            chain.append(parent)
        return chain
