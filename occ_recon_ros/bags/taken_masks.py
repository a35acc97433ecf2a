"""The masks of a folder of images, taken one by one, and what is said of them at the end."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.errors import UserError

from .dataset import refuse_too_few
from .exposure import listed
from .frames import Frame
from .mask_files import (
    INVERTED,
    masks_may_go,
    misdrawn,
    read_cut_out,
    read_mask_as,
    refuse_misdrawn,
)
from .mask_shadow import hold_shadows, without_shadow
from .photographs import image_size

_NAMED = 3  # masks that are left out: of more the first


class TakenMasks:
    """The masks of frames, taken one by one, and what is said of them at the end.

    Args:
        frames: all whose masks may be taken.
        names: what to call the image of each.
    """

    def __init__(self, frames: Sequence[Frame], names: dict[Path, str]) -> None:
        self._names = names
        self._own = {frame.image for frame in frames if frame.mask is None}
        self._shadowed = hold_shadows(frames)
        self._wrong = list[str]()  # of each that was read, how it is drawn wrongly, "": it is not
        self._unread = list[str]()
        self._empty = list[str]()
        self._uncut = list[str]()
        self._cut_outs = self._fitted = self._unshaded = self._count = 0

    def take(self, frame: Frame, image: NDArray[Any]) -> NDArray[np.uint8] | None:
        """(h, w) the mask of a frame, 255 = object, of the size of its image; None without one that
        can be used."""
        mask = self._read(frame)
        if mask is None:
            return None
        self._count += 1
        if self._shadowed:
            whole, mask = mask, without_shadow(mask)
            self._unshaded += mask is not whole
        size = image.shape[1::-1]
        self._fitted += (image_size(frame.mask or frame.image) or size) != size
        return mask

    def _read(self, frame: Frame) -> NDArray[np.uint8] | None:
        try:
            if frame.mask is None:
                mask, cut_out = read_cut_out(frame.image), False
            else:
                size = frame.camera.width, frame.camera.height
                mask, cut_out = read_mask_as(frame.mask, size, frame.image, frame.layout)
        except UserError as error:
            self._unread.append(str(error))
            if frame.mask is None:
                self._uncut.append(self._names[frame.image])
            return None
        self._cut_outs += cut_out
        if mask is None:
            self._uncut.append(self._names[frame.image])
            return None
        if not (mask > 127).any():
            self._empty.append(self._names[frame.image])
        self._wrong.append(wrong := misdrawn(mask))
        if wrong == INVERTED:  # of some of them, for of most they are refused
            return ~mask
        if wrong:
            how = wrong.removeprefix("masks are ")
            self._unread.append(f"{frame.mask or frame.image} is {how}")
            return None
        return mask

    def refuse(self, folder: Path) -> None:
        """Refuse masks that are wrong as a whole, and could be left out.

        Raises:
            UserError: most are drawn wrongly, or cannot be read.
        """
        with masks_may_go():
            refuse_misdrawn(self._wrong, folder)
            refuse_too_few(self._count, self._unread)

    def left_out(self) -> list[str]:
        """A sentence for each mask that was left out, but for one of many."""
        if len(self._unread) > _NAMED:
            first = f"the first: {self._unread[0]}"
            return [f"{len(self._unread)} masks, but not their images; {first}"]
        return [f"{why}; its image is taken" for why in self._unread]

    def remarks(self) -> list[str]:
        """Sentences on how those were taken that are used."""
        said, whole = list[str](), len(self._wrong)
        if 0 < len(self._uncut) < len(self._own):
            these = f"{len(self._uncut)} of {len(self._own)} images that should hold their masks"
            lacking = f"no transparency that cuts out: {listed(self._uncut)}"
            said.append(f"{these} have none, {lacking}")
        if self._empty:
            which = f": {listed(self._empty)}" if len(self._empty) < whole else ""
            those = f"{len(self._empty)} of {whole} masks are black"
            said.append(f"{those}, and show no object{which}")
        if self._cut_outs:
            said.append(
                f"{self._cut_outs} masks are photographs cut out on a plain colour: what is left "
                "of each is taken for the object"
            )
        if self._unshaded:
            said.append(
                f"{self._unshaded} masks half cover a shadow beside the object, along no edge of "
                "their images: it is left out"
            )
        if self._fitted:
            said.append(f"{self._fitted} masks are of another size than their images, and made so")
        if turned_back := self._wrong.count(INVERTED):
            said.append(
                f"{turned_back} of {whole} masks are white along the border and black within, "
                "unlike the others: they are taken inverted"
            )
        return said
