"""What spoils photographs, done to recorded and to rendered turns whose masks are known."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from photograph_scenes import (
    Floor,
    Shot,
    Stage,
    body,
    checked,
    even,
    folded,
    gradient,
    in_soft_light,
    mottled,
    photograph,
    plain,
    room,
    turn,
)
from recorded import real_frames

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import nearest_to_rays
from occ_recon_ros.imaging.joint import Volume

RECORDED = ("oxford_dino", "apple_aruco", "dino_ring")


@dataclass(frozen=True)
class Case:
    """A turn to be segmented.

    Attributes:
        name: of the case.
        shots: its photographs.
        spoilt: numbers of the views that must be named.
        volume: the scan volume, where the case needs one.
    """

    name: str
    shots: list[Shot]
    spoilt: frozenset[int] = frozenset()
    volume: Volume | None = None


def recorded(folder: Path, step: int = 1) -> list[Shot]:
    """A recorded turn without its masks."""
    frames = list(real_frames(folder))[::step]
    return [Shot(image, mask > 127, camera) for image, mask, camera in frames]


def padded(shots: Sequence[Shot]) -> list[Shot]:
    """Black bars below and on the right, as where images are brought to one size."""
    out = []
    for shot in shots:
        height, width = shot.truth.shape
        down, right = round(0.12 * height), round(0.2 * width)
        ends = (0, down, right // 2, right - right // 2)
        K = shot.camera.K.copy()
        K[0, 2] += right // 2
        camera = replace(shot.camera, K=K, width=width + right, height=height + down)
        image = cv2.copyMakeBorder(shot.image, *ends, cv2.BORDER_CONSTANT, value=(0, 0, 0))
        truth = cv2.copyMakeBorder(shot.truth.astype(np.uint8), *ends, cv2.BORDER_CONSTANT) > 0
        out.append(Shot(np.asarray(image, np.uint8), truth, camera))
    return out


def creviced(shots: Sequence[Shot]) -> list[Shot]:
    """Some places of the object as dark (or of the colour) as its backdrop, each seen from one
    side."""
    rng = np.random.default_rng(3)
    middle, size = _place(shots)
    spots = rng.normal(size=(9, 3))
    spots /= np.linalg.norm(spots, axis=1)[:, None]
    out = []
    for shot in shots:
        home = np.median(shot.image[~shot.truth].reshape(-1, shot.image.shape[2]), axis=0)
        away = shot.camera.centre - middle
        distance = np.linalg.norm(away)
        inner = cv2.erode(shot.truth.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        drawn = np.zeros(shot.truth.shape, np.uint8)
        for spot in spots[spots @ away > 0.2 * distance]:
            at = shot.camera.project((middle + 0.5 * size * spot)[None])[0]
            radius = 0.1 * size * shot.camera.K[0, 0] / distance
            axes = (max(1, round(radius)), max(1, round(0.4 * radius)))
            cv2.ellipse(drawn, tuple(int(v) for v in at), axes, 30, 0, 360, 1, -1)
        image = shot.image.copy()
        noise = rng.normal(0, 2, image.shape)
        dark = (drawn > 0) & inner
        image[dark] = np.clip(home + noise, 0, 255).astype(np.uint8)[dark]
        out.append(replace(shot, image=image))
    return out


def with_hand(shots: Sequence[Shot], views: Sequence[int]) -> list[Shot]:
    """An arm comes in from the border up to the object and covers a part of it."""
    out = list(shots)
    for k in views:
        shot = shots[k]
        y, x = np.argwhere(shot.truth).mean(axis=0)
        reach = np.sqrt(np.count_nonzero(shot.truth))
        image = shot.image.copy()
        end, wide = (int(x + 0.15 * reach), int(y - 0.1 * reach)), max(4, round(0.3 * reach))
        cv2.line(image, (shot.truth.shape[1], int(y + 0.6 * reach)), end, (120, 150, 205), wide)
        out[k] = replace(shot, image=image)
    return out


def unevenly_lit(shots: Sequence[Shot]) -> list[Shot]:
    """Light that falls off across the image, by more than half, and flickers."""
    out = []
    for k, shot in enumerate(shots):
        height, width = shot.truth.shape
        y, x = np.mgrid[:height, :width] / [[[height]], [[width]]]
        gain = (1.0 - 0.55 * x - 0.25 * (y - 0.5) ** 2) * (1 + 0.06 * np.sin(2.4 * k))
        image = np.clip(shot.image * gain[..., None], 0, 255).astype(np.uint8)
        out.append(replace(shot, image=image))
    return out


def compressed(shots: Sequence[Shot], quality: int = 50) -> list[Shot]:
    """JPEG."""
    out = []
    for shot in shots:
        code = cv2.imencode(".jpg", shot.image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        out.append(replace(shot, image=np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), np.uint8)))
    return out


def grey(shots: Sequence[Shot]) -> list[Shot]:
    """Images of one channel."""
    return [
        replace(s, image=np.asarray(cv2.cvtColor(s.image, cv2.COLOR_BGR2GRAY), np.uint8))
        for s in shots
    ]


def with_masks(
    shots: Sequence[Shot], missing: Sequence[int] = (), wrong: Sequence[int] = ()
) -> list[Shot]:
    """With their masks, but for some that are missing and some that are another view's."""
    out = []
    for k, shot in enumerate(shots):
        mask = shot.truth.astype(np.uint8) * np.uint8(255)
        if k in wrong:
            mask = np.roll(mask, mask.shape[1] // 6, axis=1)
        out.append(replace(shot, given=None if k in missing else mask))
    return out


def _place(shots: Sequence[Shot]) -> tuple[NDArray[np.float64], float]:
    """Middle (3,) and size of the object, metres, from its masks."""
    rays = [
        s.camera.viewing_directions(np.argwhere(s.truth).mean(axis=0)[None, ::-1])[0] for s in shots
    ]
    middle = nearest_to_rays(np.array([s.camera.centre for s in shots]), np.array(rays))
    size = [
        np.sqrt(np.count_nonzero(s.truth))
        / s.camera.K[0, 0]
        * np.linalg.norm(s.camera.centre - middle)
        for s in shots
    ]
    return middle, float(np.median(size))


def recordings(data: Path, step: int) -> dict[str, Callable[[], Case]]:
    """Recorded turns that are there, as they are, and their hard copies."""
    table: dict[str, Callable[[], Case]] = {}
    for name in RECORDED:
        if not (data / name).is_dir():
            continue
        for how in ("", *_SPOILERS):
            table[f"{name}, {how}" if how else name] = partial(_recording, data / name, how, step)
    return table


def _recording(folder: Path, how: str, step: int) -> Case:
    shots = recorded(folder, step)
    five = np.linspace(1, len(shots) - 2, 5).astype(int).tolist()
    spoil, spoilt = _SPOILERS[how] if how else (lambda shots, five: shots, lambda five: [])
    name = f"{folder.name}, {how}" if how else folder.name
    return Case(name, spoil(shots, five), frozenset(spoilt(five)))


_SPOILERS: dict[str, tuple[Callable, Callable]] = {
    "black bars": (lambda shots, five: padded(shots), lambda five: []),
    "crevices": (lambda shots, five: creviced(shots), lambda five: []),
    "hand in 2 views": (
        lambda shots, five: with_hand(shots, five[1:4:2]),
        lambda five: five[1:4:2],
    ),
    "5 masks missing": (lambda shots, five: with_masks(shots, missing=five), lambda five: []),
    "5 masks wrong": (lambda shots, five: with_masks(shots, wrong=five), lambda five: five),
    "uneven light": (lambda shots, five: unevenly_lit(shots), lambda five: []),
    "JPEG 50": (lambda shots, five: compressed(shots), lambda five: []),
    "grey": (lambda shots, five: grey(shots), lambda five: []),
}


def _shots(stage: Stage, cameras: Sequence[Camera]) -> list[Shot]:
    return [photograph(stage, camera, k) for k, camera in enumerate(cameras)]


_STONE = mottled((150, 170, 180), (90, 110, 125), 0.03)
_PLASTER = mottled((185, 195, 200), (165, 175, 180), 0.04)
_PAINT = mottled((150, 60, 40), (40, 90, 60), 0.03)
_GLAZE = mottled((50, 60, 200), (40, 200, 200), 0.03)
_COW = mottled((90, 160, 210), (60, 90, 130), 0.05)
_TABLE = mottled((200, 205, 210), (190, 195, 200), 0.03)
_BOARD = checked((40, 40, 40), (220, 220, 220), 0.03)
_WOOD = mottled((60, 110, 160), (80, 135, 185), 0.02)


def scenes(models: Path, n: int, size: tuple[int, int]) -> dict[str, Callable[[], Case]]:
    """Rendered turns by their names; n views of a size unless the case is about that."""

    def spot() -> Stage:
        return Stage(body("spot", models), _COW, room())

    def mug(floor: Floor | None) -> Stage:
        return Stage(body("mug"), _GLAZE, room(), floor)

    def stone(backdrop: object = None, **more: object) -> Stage:
        return Stage(body("temple"), _STONE, plain((12, 12, 12)), ambient=0.1, **more)  # type: ignore[arg-type]

    above = Volume("plane", np.array([0, 0, -0.0605]), axis=np.array([0, 0, 1.0]))

    def made(
        stage: Callable[[], Stage],
        spoil: Callable[[list[Shot]], list[Shot]] = lambda shots: shots,
        spoilt: Sequence[int] = (),
        volume: Volume | None = None,
        views: int = n,
        **rig: float | bool,
    ) -> Callable[[], tuple[list[Shot], frozenset[int], Volume | None]]:
        return lambda: (
            spoil(_shots(stage(), turn(views, size, **rig))),  # type: ignore[arg-type]
            frozenset(spoilt),
            volume,
        )

    two, five = (3, n // 2), tuple(np.linspace(1, n - 2, 5).astype(int).tolist())
    table = {
        "cow in a room": made(spot),
        "cow, hand in 2 views": made(spot, lambda s: with_hand(s, two), two),
        "cow, 5 masks missing": made(spot, lambda s: with_masks(s, missing=five)),
        "cow, 5 masks wrong": made(spot, lambda s: with_masks(s, wrong=five), five),
        "cow, uneven light": made(spot, unevenly_lit),
        "cow, JPEG 50": made(spot, compressed),
        "cow, grey": made(spot, grey),
        "cow, black bars": made(spot, padded),
        "cow, 12 views": made(spot, views=12),
        "cow, 72 views": made(spot, views=72),
        "cow, 120 degrees": made(spot, degrees=120.0),
        "cow, small": made(spot, fills=0.12),
        "cow, fills the image": made(spot, fills=0.93, elevation=0.1),
        "cow, cut by the border": made(spot, fills=1.15),
        "temple before black": made(stone, rolled=True, fills=0.95),
        "temple before black, bars": made(stone, padded, rolled=True, fills=0.95),
        "temple before black, softly lit": made(
            lambda: Stage(body("temple"), _STONE, plain((12, 12, 12)), ambient=0.25, noise=1.5),
            rolled=True,
            fills=0.9,
        ),
        "temple before folds, softly lit": made(
            lambda: Stage(body("temple"), _STONE, folded((9, 9, 9), 9), ambient=0.25, noise=1.5),
            rolled=True,
            fills=0.9,
        ),
        "temple, near black stone": made(
            lambda: Stage(
                body("temple"),
                mottled((150, 170, 180), (18, 20, 22), 0.012),
                plain((12, 12, 12)),
                ambient=0.08,
            ),
            rolled=True,
            fills=0.9,
        ),
        "plaster, folds of 10 levels": made(
            lambda: Stage(body("spot", models), _PLASTER, folded((10, 10, 11), 10), ambient=0.15)
        ),
        "plaster figure, blue folds": made(
            lambda: Stage(body("figure"), _PLASTER, folded((90, 40, 20), 25), ambient=0.15)
        ),
        "mug on a plate, volume": made(
            lambda: mug(Floor(-0.062, 0.09, even((150, 150, 150)))), volume=above
        ),
        "mug on a wooden plate": made(lambda: mug(Floor(-0.062, 0.11, _WOOD))),
        "mug on a board": made(lambda: mug(Floor(-0.062, 0.2, _BOARD)), elevation=0.5),
        "vase, shadow on a light table": made(
            lambda: Stage(body("vase"), _PAINT, plain((200, 205, 210)), Floor(-0.1, 9.0, _TABLE)),
            elevation=0.6,
        ),
        "cow, contact shadow on white": made(
            lambda: in_soft_light(
                Stage(
                    body("spot", models),
                    _COW,
                    plain((222, 226, 228)),
                    Floor(-0.0983, 3.0, even((222, 226, 228)), 0.35),
                )
            ),
            elevation=0.5,
        ),
        "figure, contact shadow on blue": made(
            lambda: in_soft_light(
                Stage(
                    body("figure"),
                    _PLASTER,
                    plain((150, 90, 50)),
                    Floor(-0.1001, 3.0, even((150, 90, 50)), 0.35),
                )
            ),
            elevation=0.4,
        ),
        "camera moves, textured floor": made(
            lambda: Stage(body("spot", models), _GLAZE, room(moves=True), Floor(-0.09, 1.5, _WOOD)),
            elevation=0.5,
        ),
        "camera moves, in a room": made(
            lambda: Stage(body("spot", models), _COW, room(moves=True))
        ),
        "vase before a gradient": made(
            lambda: Stage(body("vase"), _PAINT, gradient((230, 200, 190), (60, 50, 50)))
        ),
        "white vase, white backdrop": made(
            lambda: Stage(
                body("vase"),
                mottled((190, 195, 195), (170, 180, 180), 0.05),
                plain((243, 244, 245)),
                shine=0.6,
            )
        ),
        "vase half of the backdrop's colour": made(
            lambda: Stage(
                body("vase"), mottled((60, 60, 190), (150, 110, 70), 0.02), plain((130, 95, 60))
            )
        ),
    }

    def named(name: str) -> Callable[[], Case]:
        def make() -> Case:
            shots, spoilt, volume = table[name]()
            return Case(name, shots, spoilt, volume)

        return make

    return {name: named(name) for name in table}
