"""The views of a folder as the file says that lists them, before they are checked together."""

from dataclasses import dataclass
from pathlib import Path

from occ_recon_ros.geometry import Camera
from occ_recon_ros.poses.convention import Ways

from .mask_files import Layout

FIRST_STAMP_NS = 1_000_000_000  # ROS takes time 0 for "not set"
STEP_NS = 100_000_000
MODEL_BY_COEFFICIENTS = {
    4: "plumb_bob",
    5: "plumb_bob",
    8: "rational_polynomial",
    12: "rational_polynomial",
}


@dataclass(frozen=True)
class Frame:
    """One view of a data set: where its files are, when and from where it was taken; and how masks
    of another shape than their images show these, where that is known."""

    image: Path
    mask: Path | None
    stamp_ns: int
    camera: Camera
    layout: Layout | None = None


@dataclass(frozen=True)
class Listing:
    """What one description of a folder says.

    Attributes:
        source: the file, or the folder of the model.
        poses: which way its poses must lead, in words.
        frames: in its order, with its stamps or with even ones.
        left_out: a sentence for each frame that cannot be used.
        remarks: on how the others were taken.
        stamped: whether the stamps are its own.
        metric: whether its lengths are metres by now; else their unit is arbitrary.
        ways: what its poses may be instead, in words of that file; None: it has none for that.
    """

    source: Path
    poses: str
    frames: list[Frame]
    left_out: list[str]
    remarks: list[str]
    stamped: bool = False
    metric: bool = False
    ways: Ways | None = None


def even_stamp(i: int) -> int:
    """Stamp of the i-th frame where none are given, nanoseconds."""
    return FIRST_STAMP_NS + i * STEP_NS
