"""What spoils recorded turns: light that goes, cameras that are touched, poses that are wrong."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry import Camera
from occ_recon_ros.geometry.arrays import nearest_to_rays


@dataclass(frozen=True)
class View:
    """A frame of a recorded turn; ``spoilt``: not one to judge by; ``brought``: the mask that comes
    with it where masks are played, None: the right one."""

    image: NDArray[np.uint8]
    mask: NDArray[np.uint8]
    camera: Camera
    spoilt: bool = False
    brought: NDArray[np.uint8] | None = None


Turn = list[View]


def _levels(image: NDArray) -> NDArray[np.uint8]:
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _last(count: int, change: Callable[[View], View], turn: Turn) -> Turn:
    ends = [replace(change(view), spoilt=True) for view in turn[-count:]]
    return [*turn[:-count], *ends]


def _dark(view: View) -> View:
    noise = np.random.default_rng(1).normal(0, 2, view.image.shape)
    return replace(view, image=_levels(0.04 * view.image + noise))


def _overexposed(view: View) -> View:
    return replace(view, image=_levels(3.0 * view.image + 60))


def _torn(view: View) -> View:
    image = view.image.copy()
    image[round(0.45 * len(image)) :] = 128
    return replace(view, image=image)


def _nearer(view: View) -> View:
    h, w = view.mask.shape
    M = cv2.getRotationMatrix2D((w / 2, h / 2), 0, 1.25)
    image = cv2.warpAffine(view.image, M, (w, h), borderMode=cv2.BORDER_REFLECT)
    return replace(view, image=np.asarray(image, np.uint8))


def _stuck(turn: Turn) -> Turn:
    return _last(6, lambda view: replace(view, camera=turn[-7].camera), turn)


def _brushed(view: View, px: int) -> View:
    """A mask painted so much too wide, or too narrow."""
    brush = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * abs(px) + 1,) * 2)
    paint = cv2.dilate if px > 0 else cv2.erode
    return replace(view, brought=np.asarray(paint(view.mask, brush), np.uint8))


def _by_a_network(view: View, k: int, share: float, wander_px: float = 0.0) -> View:
    """A mask of a network that sees each image alone: in a share of the views it lost a part, in as
    many it took something beside; the outline wanders (1 sigma)."""
    rng, mask = np.random.default_rng(k), view.mask.copy()
    size = max(cv2.boundingRect(mask)[2:])
    if wander_px:
        coarse = rng.normal(size=(mask.shape[0] // 30 + 3, mask.shape[1] // 30 + 3))
        fine = cv2.resize(coarse, None, fx=30, fy=30, interpolation=cv2.INTER_CUBIC)
        inside = (mask > 127).astype(np.uint8)
        deep = (cv2.distanceTransform(side, cv2.DIST_L2, 5) for side in (inside, 1 - inside))
        wander = wander_px / fine.std() * fine[: mask.shape[0], : mask.shape[1]]
        mask = np.where(next(deep) - next(deep) + wander > 0, np.uint8(255), np.uint8(0))
    outline = np.argwhere((mask > 127) & (cv2.erode(mask, np.ones((3, 3))) <= 127))
    for level in (0, 255):
        if rng.random() < share:
            y, x = outline[rng.integers(len(outline))].tolist()
            cv2.circle(mask, (x, y), round(0.12 * size), level, -1)
    return replace(view, brought=mask)


def _by_grabcut(view: View) -> View:
    """A mask that OpenCV's GrabCut finds in a box about the object, in this image alone."""
    x, y, w, h = cv2.boundingRect(view.mask)
    margin = round(0.08 * max(w, h))
    first = max(0, x - margin), max(0, y - margin)
    last = min(view.mask.shape[1] - 1, x + w + margin), min(view.mask.shape[0] - 1, y + h + margin)
    labels = np.zeros(view.mask.shape, np.uint8)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)
    box = (*first, last[0] - first[0], last[1] - first[1])
    cv2.grabCut(view.image, labels, box, *models, 4, cv2.GC_INIT_WITH_RECT)
    return replace(view, brought=np.asarray((labels & 1) * np.uint8(255), np.uint8))


def _numbered_from_one(turn: Turn) -> Turn:
    following = [*turn[1:], turn[0]]
    return [replace(v, brought=after.mask) for v, after in zip(turn, following, strict=True)]


def _centred_elsewhere(turn: Turn, right: float, down: float) -> Turn:
    off = np.array([[0, 0, right], [0, 0, down], [0, 0, 0]])
    return [replace(v, camera=replace(v.camera, K=v.camera.K + off)) for v in turn]


def _bumped(turn: Turn) -> Turn:
    """The camera looks past by (12, -5) px from half-way on."""
    M = np.float32([[1, 0, 12], [0, 1, -5]])

    def moved(pixels: NDArray[np.uint8], border: int) -> NDArray[np.uint8]:
        size = pixels.shape[1::-1]
        return np.asarray(cv2.warpAffine(pixels, M, size, borderMode=border), np.uint8)

    def after(v: View) -> View:
        image = moved(v.image, cv2.BORDER_REFLECT)
        return replace(v, image=image, mask=moved(v.mask, cv2.BORDER_CONSTANT))

    half = len(turn) // 2
    return [*turn[:half], *(after(view) for view in turn[half:])]


def _unsure(turn: Turn) -> Turn:
    """Each camera is told turned about itself by 0.3 degrees about each axis (1 sigma)."""
    about = np.random.default_rng(1).normal(0, np.deg2rad(0.3), (len(turn), 3))
    out = []
    for view, by in zip(turn, about, strict=True):
        R, c = Rotation.from_rotvec(by).as_matrix(), view.camera
        told = replace(
            c, R_camera_object=R @ c.R_camera_object, t_camera_object=R @ c.t_camera_object
        )
        out.append(replace(view, camera=told))
    return out


def _kicked(turn: Turn) -> Turn:
    """The object is turned by 6 degrees and moved by 1.2 % of its distance at two thirds."""
    centres = np.array([view.camera.centre for view in turn])
    looks = np.array([view.camera.R_camera_object[2] for view in turn])
    middle = nearest_to_rays(centres, looks)
    axis = np.linalg.svd(centres - centres.mean(axis=0))[2][2]
    R = Rotation.from_rotvec(np.deg2rad(6) * axis).as_matrix()
    aside = np.cross(axis, [1.0, 0, 0])
    shift = 0.012 * np.linalg.norm(centres[0] - middle) * aside
    out = list(turn)
    for k in range(2 * len(turn) // 3, len(turn)):
        c = turn[k].camera
        R_told = c.R_camera_object @ R.T
        t_told = c.t_camera_object + c.R_camera_object @ middle - R_told @ (middle + shift)
        told = replace(c, R_camera_object=R_told, t_camera_object=t_told)
        out[k] = replace(turn[k], camera=told)
    return out


def _empty(turn: Turn) -> NDArray[np.uint8]:
    """The picture without the object, of what the views show beside it."""
    size = turn[0].image.shape
    alike = [view for view in turn if view.image.shape == size]
    shown = np.stack([view.image for view in alike]).astype(np.float32)
    around = np.ones((9, 9), np.uint8)
    shown[np.stack([cv2.dilate(view.mask, around) for view in alike]) > 0] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a pixel that is never free
        typical = np.nanmedian(shown, axis=0)
    hidden = np.isnan(typical).any(axis=2).astype(np.uint8)
    return np.asarray(cv2.inpaint(_levels(np.nan_to_num(typical)), hidden, 5, cv2.INPAINT_TELEA))


def _taken_away(turn: Turn) -> Turn:
    """Nothing is on the table in the last three pictures."""
    noise, empty = np.random.default_rng(1), _empty(turn)
    grain = [noise.normal(0, 2, empty.shape) for _ in range(3)]
    ends = [
        replace(view, image=_levels(empty + by), spoilt=True)
        for view, by in zip(turn[-3:], grain, strict=True)
    ]
    return [*turn[:-3], *ends]


def _lifted(turn: Turn) -> Turn:
    """The object goes up by a tenth of the picture in each of the last three."""
    empty, out = _empty(turn), list(turn)
    for k, view in enumerate(turn[-3:], 1):
        M = np.float32([[1, 0, 0], [0, 1, -0.1 * k * len(empty)]])
        size = empty.shape[1::-1]
        share = cv2.warpAffine(view.mask, M, size).astype(np.float32)[..., None] / 255
        image = share * cv2.warpAffine(view.image, M, size) + (1 - share) * empty
        out[len(turn) - 4 + k] = replace(view, image=_levels(image), spoilt=True)
    return out


def _dimmer(view: View) -> View:
    return replace(view, image=_levels(view.image * np.array([0.55, 0.62, 0.7])))


def _evening(turn: Turn) -> Turn:
    """The light is dimmer and warmer from half-way on."""
    half = len(turn) // 2
    return [*turn[:half], *map(_dimmer, turn[half:])]


def _again(turn: Turn) -> Turn:
    """The table goes on for half a turn, when it is dimmer."""
    return [*turn, *map(_dimmer, turn[: len(turn) // 2])]


def _stopped(turn: Turn) -> Turn:
    """The table stands still for eight more pictures."""
    grain = np.random.default_rng(1)
    last = turn[-1].image
    return [
        *turn,
        *(
            replace(turn[-1], image=_levels(last + grain.normal(0, 2, last.shape)))
            for _ in range(8)
        ),
    ]


def _shaken(turn: Turn) -> Turn:
    """Every fifth picture is blurred by motion over a fortieth of its width."""
    kernel = np.full((1, turn[0].image.shape[1] // 40), 1.0)
    kernel /= kernel.size
    return [
        replace(view, image=np.asarray(cv2.filter2D(view.image, -1, kernel)), spoilt=True)
        if k % 5 == 4
        else view
        for k, view in enumerate(turn)
    ]


def _late(turn: Turn) -> Turn:
    """Each picture is told the pose of the one before it."""
    return [
        replace(view, camera=before.camera)
        for before, view in zip(turn[-1:] + turn[:-1], turn, strict=True)
    ]


def _mirrored(view: View) -> View:
    return replace(view, image=np.ascontiguousarray(view.image[:, ::-1]))


def _noisy(turn: Turn) -> Turn:
    grain = np.random.default_rng(3)
    return [replace(v, image=_levels(v.image + grain.normal(0, 25, v.image.shape))) for v in turn]


def _compressed(view: View) -> View:
    packed = cv2.imencode(".jpg", view.image, [cv2.IMWRITE_JPEG_QUALITY, 12])[1]
    return replace(view, image=np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8))


def _resized(view: View, width: int, way: int) -> View:
    height = round(width * view.mask.shape[0] / view.mask.shape[1])
    image, mask = (
        np.asarray(cv2.resize(pixels, (width, height), interpolation=way), np.uint8)
        for pixels in (view.image, view.mask)
    )
    by = width / view.mask.shape[1], height / view.mask.shape[0]
    S = np.array([[by[0], 0, 0.5 * by[0] - 0.5], [0, by[1], 0.5 * by[1] - 0.5], [0, 0, 1]])
    camera = replace(view.camera, K=S @ view.camera.K, width=width, height=height)
    return View(image, np.where(mask > 127, np.uint8(255), np.uint8(0)), camera)


def _small(view: View) -> View:
    return _resized(view, view.mask.shape[1] // 4, cv2.INTER_AREA)


def _large(turn: Turn) -> Turn:
    """Every second view as a photograph of a telephone: 4000 pixels wide, with grain."""
    grain, out = np.random.default_rng(0), []
    for view in turn[::2]:
        large = _resized(view, 4000, cv2.INTER_CUBIC)
        noise = grain.normal(0, 4, large.image.shape).astype(np.float32)
        image = large.image + cv2.GaussianBlur(noise, (0, 0), 0.7)
        out.append(replace(large, image=_levels(image)))
    return out


def _flickering(turn: Turn) -> Turn:
    light = np.random.default_rng(3)
    gains = [light.uniform(0.6, 1.25) * light.uniform(0.9, 1.1, 3) for _ in turn]
    return [replace(v, image=_levels(v.image * by)) for v, by in zip(turn, gains, strict=True)]


def _watermarked(view: View) -> View:
    image, (height, width) = view.image.copy(), view.mask.shape
    place, font = (width // 6, height // 2), cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(image, "SAMPLE photo", place, font, width / 400, (255, 255, 255), 3)
    return replace(view, image=image)


def _shuffled(turn: Turn) -> Turn:
    return [turn[k] for k in np.random.default_rng(3).permutation(len(turn))]


def _sinking(turn: Turn) -> Turn:
    """The camera sinks little by little, by 10 px in all."""
    out = []
    for k, view in enumerate(turn):
        M, size = np.float32([[1, 0, 0], [0, 1, 10 * k / len(turn)]]), view.mask.shape[::-1]
        image = cv2.warpAffine(view.image, M, size, borderMode=cv2.BORDER_REFLECT)
        mask = cv2.warpAffine(view.mask, M, size)
        out.append(replace(view, image=np.asarray(image), mask=np.asarray(mask)))
    return out


SPOILERS: dict[str, Callable[[Turn], Turn]] = {
    "as it is": lambda turn: turn,
    "5 last images dark": partial(_last, 5, _dark),
    "4 last images overexposed": partial(_last, 4, _overexposed),
    "3 last images torn": partial(_last, 3, _torn),
    "camera nearer in the 4 last": partial(_last, 4, _nearer),
    "pose stuck in the 6 last": _stuck,
    "principal point off by (10, -6) px": partial(_centred_elsewhere, right=10.0, down=-6.0),
    "principal point off by (40, 0) px": partial(_centred_elsewhere, right=40.0, down=0.0),
    "masks painted 8 px too wide": lambda turn: [_brushed(view, 8) for view in turn],
    "masks painted 10 px too narrow": lambda turn: [_brushed(view, -10) for view in turn],
    "masks of the next images": _numbered_from_one,
    "masks of a network, a tenth bitten, a tenth with more": lambda turn: [
        _by_a_network(view, k, 0.1) for k, view in enumerate(turn)
    ],
    "masks of a network, a third of each": lambda turn: [
        _by_a_network(view, k, 0.3) for k, view in enumerate(turn)
    ],
    "masks by GrabCut of a box": lambda turn: list(map(_by_grabcut, turn)),
    "masks that wander by 3 px": lambda turn: [
        _by_a_network(view, k, 0.0, 3.0) for k, view in enumerate(turn)
    ],
    "camera bumped half-way": _bumped,
    "poses off by 0.3 degrees": _unsure,
    "object kicked at two thirds": _kicked,
    "table empty in the 3 last": _taken_away,
    "object lifted in the 3 last": _lifted,
    "dimmer and warmer from half-way": _evening,
    "half a turn more, dimmer": _again,
    "8 more of the last view": _stopped,
    "every fifth blurred": _shaken,
    "poses a frame late": _late,
    "4 last mirrored": partial(_last, 4, _mirrored),
    "noise of 25 grey levels": _noisy,
    "JPEG of quality 12": lambda turn: list(map(_compressed, turn)),
    "a quarter of the size": lambda turn: list(map(_small, turn)),
    "every second view, 4000 px wide": _large,
    "light that flickers": _flickering,
    "a watermark": lambda turn: list(map(_watermarked, turn)),
    "images in no order": _shuffled,
    "a tripod that sinks": _sinking,
    "every third view": lambda turn: turn[::3],
    "a third of the turn": lambda turn: turn[: len(turn) // 3],
}
