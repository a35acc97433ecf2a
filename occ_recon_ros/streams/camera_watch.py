"""Whether camera_info stays the same in a scan: zoom and focus of most rigs are fixed."""

import numpy as np

from ..geometry import Camera

_SAME = 1e-3  # of the image: what moves no more than that moves no outline by a pixel


class CameraWatch:
    """Holds each camera of a scan against the first.

    Attributes:
        doubt: what the widest change so far puts in doubt, in words; "" for nothing, as of another
            resolution with K in proportion.
    """

    def __init__(self) -> None:
        self.doubt = ""
        self._first: Camera | None = None
        self._said = False
        self._widest = 0.0

    def add(self, camera: Camera, stamp_ns: int) -> str:
        """Take in the camera of the next image; how it differs from the first, in words, where
        that is seen for the first time, else ""."""
        first = self._first = self._first or camera
        change = float(np.abs(_lens(camera) - _lens(first)).max())
        bent = camera.distortion != first.distortion or not np.array_equal(camera.D, first.D)
        size = (camera.width, camera.height) != (first.width, first.height)
        if change <= _SAME and not bent and not size:
            return ""
        words = f"camera_info changed in mid-scan, at stamp {stamp_ns * 1e-9:.3f}: "
        words += ", ".join(_differences(first, camera, change > _SAME, bent))
        if change > self._widest + _SAME or (bent and not self.doubt):
            self._widest = max(change, self._widest)
            self.doubt = f"{words}: right only if zoom or focus were really changed then"
        said, self._said = self._said, True
        return "" if said else self.doubt or words


def _lens(camera: Camera) -> np.ndarray:
    """(4,) focal lengths and principal point, in widths and heights of the image."""
    K, size = camera.K, np.array([camera.width, camera.height])
    return np.concatenate([K[[0, 1], [0, 1]] / size, (K[:2, 2] + 0.5) / size])


def _differences(first: Camera, camera: Camera, lens: bool, bent: bool) -> list[str]:
    words = []
    scale = camera.width / first.width
    if (camera.width, camera.height) != (first.width, first.height):
        size = f"images of {camera.width}x{camera.height} px"
        words.append(f"{size} instead of {first.width}x{first.height}")
    if lens:
        both, of_first = camera.K[[0, 1], [0, 1]], first.K[[0, 1], [0, 1]] * scale
        axis = int(np.abs(both / of_first - 1).argmax())
        f, before = both[axis], of_first[axis]
        if abs(f - before) > _SAME * before:
            words.append(f"f {f:.1f} px instead of {before:.1f} ({f / before - 1:+.1%})")
        x, y = camera.K[:2, 2] - ((first.K[:2, 2] + 0.5) * scale - 0.5)
        if np.hypot(x, y) > _SAME * camera.width:
            words.append(f"principal point moved by ({x:.1f}, {y:.1f}) px")
    if bent:
        words.append("another D")
    return words
