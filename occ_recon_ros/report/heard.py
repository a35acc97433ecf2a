"""What went into the nodes in a run and what came out, as results are made of it."""

import tempfile
import weakref
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from msg_adapters import decode_contours, decode_picture, decode_rim, deserialise, frame_camera
from occ_recon_ros.geometry import Camera, Contours, Rim, Status
from occ_recon_ros.streams.pairing import Frame


@dataclass
class Sent:
    """What was fed in.

    Attributes:
        images: number of images.
        unanswered: stamps of images of which nothing came within the time allowed.
    """

    images: int = 0
    unanswered: list[int] = field(default_factory=list)


@dataclass
class KeptView:
    """One image that is kept to be shown.

    Attributes:
        image: Image or CompressedImage.
        frame: the whole frame, None as long as its camera_info or pose has not come.
    """

    image: Any
    frame: Frame | None = None

    def pixels(self) -> NDArray[Any]:
        """(h, w) or (h, w, 3) BGR."""
        return decode_picture(self.image)

    def camera(self) -> Camera | None:
        """The calibrated view; None where there is no whole frame."""
        return frame_camera(self.frame) if self.frame is not None else None


T = TypeVar("T")
_CLOUD = "sensor_msgs/msg/PointCloud2"
_IN_MEMORY = 1 << 26  # bytes of messages, some hundred frames; the rest is in a file


class Spool(Mapping[int, T], Generic[T]):
    """Messages by stamp, in memory as long as they are few, and decoded when asked for.

    Args:
        decode: the message's bytes (CDR) to what they mean.
        folder: where the file is made that takes many; it is gone with this object.
    """

    def __init__(self, decode: Callable[[bytes], T], folder: Path | None = None) -> None:
        self._decode = decode
        place = None if folder is None else str(folder)
        self._file = tempfile.SpooledTemporaryFile(_IN_MEMORY, dir=place)  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        self._places: dict[int, tuple[int, int]] = {}

    def keep(self, stamp_ns: int, cdr: bytes) -> None:
        """Add one; of those with one stamp the last counts."""
        start = self._file.seek(0, 2)
        self._file.write(cdr)
        self._places[stamp_ns] = start, len(cdr)

    def clear(self) -> None:
        """Forget all."""
        self._places.clear()
        self._file.seek(0)
        self._file.truncate()

    def __getitem__(self, stamp_ns: int) -> T:
        start, size = self._places[stamp_ns]
        self._file.seek(start)
        return self._decode(self._file.read(size))

    def __iter__(self) -> Iterator[int]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


@dataclass
class Heard:
    """All contours and rims, and a few whole frames for pictures.

    Attributes:
        folder: for files that take what is too much for memory.
        samples: number of contour samples by stamp (ns).
        loops: number of loops by stamp.
        centres: (3,) camera centre by stamp, metres, object frame.
        contours: by stamp.
        sizes: (width, height) of the image by stamp, px.
        rims: by stamp; a later one of the same stamp replaces the earlier.
        statuses: (6,) number of samples of each status in the rim of a stamp.
        views: kept frames by stamp.
        images: images heard.
    """

    folder: Path | None = None
    samples: dict[int, int] = field(default_factory=dict)
    loops: dict[int, int] = field(default_factory=dict)
    centres: dict[int, NDArray[np.float64]] = field(default_factory=dict)
    contours: Spool[Contours] = field(init=False)
    sizes: dict[int, tuple[int, int]] = field(default_factory=dict)
    rims: Spool[Rim] = field(init=False)
    statuses: dict[int, NDArray[np.int64]] = field(default_factory=dict)
    views: dict[int, KeptView] = field(default_factory=dict)
    images: int = 0

    def __post_init__(self) -> None:
        self.contours = Spool(lambda cdr: decode_contours(deserialise(cdr, _CLOUD)), self.folder)
        self.rims = Spool(lambda cdr: decode_rim(deserialise(cdr, _CLOUD)), self.folder)

    def add_contours(self, contours: Contours, cdr: bytes) -> None:
        """Take in the contours of a frame, and the message that they came in."""
        stamp = contours.stamp_ns
        self.samples[stamp] = len(contours)
        self.loops[stamp] = len(contours.loop_starts) - 1
        self.centres[stamp] = contours.centre
        self.contours.keep(stamp, cdr)

    def add_rim(self, rim: Rim, cdr: bytes) -> None:
        """Take in a rim, and the message that it came in. An empty one says that time went
        back: the rims of the scan before are no longer part of the surface."""
        if not len(rim):
            self.rims.clear()
            self.statuses.clear()
            return
        self.rims.keep(rim.stamp_ns, cdr)
        self.statuses[rim.stamp_ns] = np.bincount(rim.status, minlength=len(Status))
