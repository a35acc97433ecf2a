"""Images of another size than their calibration is of."""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from .exposure import listed
from .frames import Frame
from .images import TURNED_BACK, orientation

_USUAL = 0.5  # of the images, above which one calibration is of their size
_OFF = 1.25  # times half of a side, by which principal points of larger images are beyond it
_NEARER = 0.5  # of the way from the middle of the stored image to the principal point


def same_shape(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether an image is a larger or smaller copy of the other, sides rounded up or down."""
    low, high = ([(b + by) / a for a, b in zip(one, other, strict=True)] for by in (-1, 1))
    return one == other or max(low) < min(high)


def as_shown(frame: Frame) -> Frame:
    """A frame whose image the EXIF data turn by a right angle, with the size that it then has
    where its principal point lies clearly nearer the middle of that than of the image as stored:
    the calibration is of the former, and the import turns the image. Others as they are."""
    camera = frame.camera
    width, height = camera.width, camera.height
    principal = camera.K[:2, 2]
    stored, shown = (
        float(np.hypot(*(principal - (np.array(size) - 1) / 2)))
        for size in ((width, height), (height, width))
    )
    if not shown < _NEARER * stored or orientation(frame.image) not in TURNED_BACK:
        return frame
    return replace(frame, camera=replace(camera, width=height, height=width))


def in_their_sizes(
    frames: Sequence[Frame], unsized: Collection[Path]
) -> tuple[list[Frame], list[str], list[str]]:
    """Frames of which those of another size than most have the K that these have, made to theirs.

    Args:
        frames: each with the size of its image.
        unsized: images of whose calibration nobody says which size it is of.

    Returns:
        The frames whose calibration can be told, why others are left out: they are of another shape
        (turned by a right angle they stay, for the import to turn); and remarks.
    """
    some = [frame for frame in frames if frame.image in unsized]
    lenses = Counter(map(_lens, some))
    lens, most = lenses.most_common(1)[0] if lenses else ((), 0)
    if most == len(some) or most <= _USUAL * len(some):
        return list(frames), [], []
    usual = next(frame.camera for frame in some if _lens(frame) == lens)
    size = usual.width, usual.height
    kept, left_out, scaled = list[Frame](), list[str](), list[str]()
    for frame in frames:
        camera, own = frame.camera, (frame.camera.width, frame.camera.height)
        if frame.image not in unsized or own == size or _lens(frame)[2:] != lens[2:]:
            kept.append(frame)
        elif same_shape(size, own):
            whole = replace(camera, width=size[0], height=size[1])
            kept.append(replace(frame, camera=whole.resized(*own)))
            scaled.append(f"{frame.image.name}, {own[0]}x{own[1]}")
        elif own[::-1] == size:
            kept.append(replace(frame, camera=replace(camera, width=size[0], height=size[1])))
        else:
            left_out.append(
                f"{frame.image} is {own[0]}x{own[1]}, and has the K of the others, {size[0]}x"
                f"{size[1]}, which are of another shape: give it its own K, width and height"
            )
    if not scaled:
        return kept, left_out, []
    return (
        kept,
        left_out,
        [
            f"{len(scaled)} images are not {size[0]}x{size[1]} as the others, and have "
            f"their K: it is scaled to theirs: {listed(scaled)}"
        ],
    )


def size_doubt(frames: Sequence[Frame], source: Path) -> list[str]:
    """What is to be said of principal points that are far from the middle of images along both
    sides alike, as those of images of another size are; less, the outlines tell later."""
    centres = np.array([frame.camera.K[:2, 2] for frame in frames])
    sizes = np.array([(frame.camera.width, frame.camera.height) for frame in frames])
    times = np.median(2 * (centres + 0.5) / sizes, axis=0)
    if not (times.min() > _OFF or 0 < times.max() < 1 / _OFF):
        return []
    (cx, cy), (width, height) = np.median(centres, axis=0), np.median(sizes, axis=0)
    return [
        f"{source}: the principal point ({cx:.0f}, {cy:.0f}) is far from the middle of images of "
        f"{width:.0f}x{height:.0f}: K seems to be of images about {np.sqrt(times.prod()):.2g} "
        "times as large; unless they were cut so, make fx, fy, cx + 0.5 and cy + 0.5 as much "
        "smaller or larger as the images were made"
    ]


def _lens(frame: Frame) -> tuple[float, ...]:
    """Width, height, K and D, to be compared."""
    c = frame.camera
    return (c.width, c.height, *np.ravel(c.K).tolist(), *c.D.tolist())
