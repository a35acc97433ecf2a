"""How many images of a scan came to nothing because something that belongs to them never came."""

from collections import Counter

_LACKS = {
    "no_camera_info": "camera_info",
    "no_camera_pose": "camera_pose",
    "pose_gap": "poses near enough",
    "no_mask": "mask",
    "unusable": "camera_info, pose or pixels that can be used",
}
_MANY = 0.1  # of the images: fewer leave no gap


class LostImages:
    """The images of a scan, used and lost.

    Attributes:
        why: what is wrong with the stamps, as far as is seen, in words; "" for nothing.
    """

    def __init__(self) -> None:
        self.why = ""
        self._used = 0
        self._lost: Counter[str] = Counter()

    def use(self) -> None:
        """An image has been worked on."""
        self._used += 1

    def drop(self, reason: str) -> None:
        """One was dropped; before the first that was used, no scan goes on."""
        if self._used and reason in _LACKS:
            self._lost[reason] += 1

    def words(self, waiting: Counter[str]) -> str:
        """What is to be said of the scan; "" where few are lost.

        Args:
            waiting: images that still wait, by the reason for which they will be dropped.
        """
        lost = Counter(self._lost)
        lost.update({reason: n for reason, n in waiting.items() if reason in _LACKS})
        count, total = lost.total(), lost.total() + self._used
        if not self._used or count < _MANY * total:
            return ""
        lacks = ", ".join(f"{n} had no {_LACKS[reason]}" for reason, n in lost.most_common())
        why = f" ({self.why})" if self.why else ""
        return f"{count} of {total} images were lost: {lacks}{why}"
