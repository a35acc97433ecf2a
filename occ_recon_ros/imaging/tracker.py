"""From image to Contours: segment, find the loops, refine, smooth, mark."""

from dataclasses import fields, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import Camera, Contours, contours_from_loops
from ..geometry.lens import have_ray
from .background import BackgroundModel
from .identity import Identities, match_loops
from .loops import mask_loops
from .outline import Outline, image_outline, mask_outline
from .segmenter import Segmenter, white_around
from .settings import ContourError, ContourSettings
from .snake import Snake, follow, start_snake
from .snake_check import collapsed, resegment, trusted
from .volume import Volume
from .window import Window

Array = NDArray[np.floating]

_HALF = 127  # of the coverage of a pixel
_LEAST_HOLE = 0.005  # of a part that an image alone shows: smaller ones may as well be glints


class ContourTracker:
    """Finds the contours of the object in image after image."""

    def __init__(self, settings: ContourSettings | None = None) -> None:
        self.settings = settings or ContourSettings()
        self._events: list[str] = []
        self.reset()

    def reset(self) -> None:
        """Forget the images seen so far."""
        self._segmenter = Segmenter(self.settings)
        self._identities = Identities()
        self._snakes: list[Snake] = []
        self._without_edge = False
        self._region: NDArray[np.uint8] | None = None
        self._whole: Window | None = None
        self._looked = 0

    @property
    def learnt(self) -> int:
        """How many frames of the empty rig it was shown."""
        model = self._segmenter.background
        return 0 if model is None or self.settings.background_image else model.frames

    def empty_rig(self) -> dict[str, NDArray]:
        """The model of the empty rig; large, and settled once it is learnt."""
        model = self._segmenter.background
        return {} if model is None else model.state()

    def state(self) -> dict[str, NDArray]:
        """All else that the next image is held against, as arrays by name."""
        snakes = {
            f"snake {k} {item.name}": getattr(snake, item.name)
            for k, snake in enumerate(self._snakes)
            for item in fields(snake)
        }
        return {
            "segmentation": np.array(self._segmenter.chosen or ""),
            "without edge": np.array(self._without_edge),
            "snakes": np.array(len(self._snakes)),
            **snakes,
            **self._identities.state(),
        }

    def restore(self, state: dict[str, NDArray]) -> None:
        """Go on from a ``state`` or an ``empty_rig``."""
        if "frames" in state:
            self._segmenter.background = BackgroundModel.restored(state)
            return
        self._segmenter.chosen = str(state["segmentation"]) or None
        self._without_edge = bool(state["without edge"])
        self._snakes = [
            Snake(**{item.name: state[f"snake {k} {item.name}"] for item in fields(Snake)})
            for k in range(int(state["snakes"]))
        ]
        self._identities.restore(state)

    def events(self) -> list[str]:
        """Sentences for the log that came up since this was last asked."""
        said, self._events = self._events, []
        return said

    def process(
        self,
        image: NDArray,
        camera: Camera,
        stamp_ns: int,
        frame_id: str,
        mask: NDArray | None = None,
    ) -> Contours:
        """Find the contours in one image.

        Args:
            image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
            camera: the view.
            stamp_ns: time of the image, nanoseconds.
            frame_id: name of the object frame.
            mask: (h, w), 0 = background; where it holds 255, levels between are coverage.

        Raises:
            ContourError: with the reason, when there are no contours to be had.
        """
        _check_image(image, camera)
        window = Window.of(image, self.settings)
        if mask is None and not self._segmenter.by_background:
            window = self._without_bars(window, image)
        self._region = self._seen_volume(camera)
        if self.settings.tracking == "snake":
            outlines = self._track(image, mask, window)
        else:
            outlines = self._find(image, mask, window)
        # Where the lens folds, as it may in corners, a pixel has no ray.
        rays = [have_ray(camera, np.asarray(o.points, np.float64)) for o in outlines]
        outlines = [replace(o, inside=o.inside & r) for o, r in zip(outlines, rays, strict=True)]
        cut = [o.cut(self.settings.min_loop_px, self.settings.spacing_px) for o in outlines]
        kept = [self._off_border(*loop) for loop in cut if loop is not None]
        if not kept:
            raise ContourError(
                "no_object", white_around(mask) or "no loop is left inside the image"
            )
        edges = [bool(np.isfinite(sigma).any()) for _, sigma in kept]
        if not any(edges):
            raise ContourError("no_edge", "no edge is found along any outline of the object")
        if not all(edges) and not self._without_edge:
            self._events.append(
                f"no edge is found along {edges.count(False)} of {len(edges)} outlines: they "
                "tell inside from outside, and give no points"
            )
        self._without_edge = not all(edges)
        names, said = self._identities.name([points for points, _ in kept])
        self._events += said
        return contours_from_loops(
            camera,
            [np.asarray(points, np.float64) for points, _ in kept],
            names,
            [np.asarray(sigma, np.float64) for _, sigma in kept],
            stamp_ns,
            frame_id,
        )

    def _without_bars(self, window: Window, image: NDArray) -> Window:
        """The picture within its bars, which stay from image to image: it is looked for in the
        first image, the second, the fourth, the eighth ..., and in those of another size."""
        self._looked += 1
        if window != self._whole or self._looked.bit_count() == 1:
            self._whole, self._picture = window, window.without_bars(image)
        return self._picture

    def _seen_volume(self, camera: Camera) -> NDArray[np.uint8] | None:
        try:
            volume = Volume.of(self.settings)
        except ValueError as error:
            raise ContourError("volume", str(error)) from None
        return None if volume is None else volume.region(camera)

    def _off_border(self, points: Array, sigma: Array) -> tuple[Array, Array]:
        """A loop whose samples on the border of the scan volume tell inside from outside and
        give no points."""
        if self._region is None:
            return points, sigma
        depth = cv2.distanceTransform(self._region, cv2.DIST_L2, cv2.DIST_MASK_5)
        x, y = np.rint(points).astype(np.intp).T
        x = np.clip(x, 0, depth.shape[1] - 1)
        y = np.clip(y, 0, depth.shape[0] - 1)
        return points, np.where(depth[y, x] <= self.settings.border_px, np.inf, sigma)

    def _find(self, image: NDArray, mask: NDArray | None, window: Window) -> list[Outline]:
        """Outlines by segmentation."""
        found, by_mask = self._segment(image, mask, window)
        if self._region is not None:
            found = np.asarray(cv2.bitwise_and(found, self._region), np.uint8)
        solid = (found > _HALF).astype(np.uint8) if by_mask else found
        least_hole = 0.0 if by_mask else _LEAST_HOLE
        loops = mask_loops(solid, self.settings.min_loop_px, self.settings.spacing_px, least_hole)
        if not loops:
            why = white_around(mask if by_mask else None)
            raise ContourError("no_object", why or "no loop is long enough (min_loop_px)")
        return [self._outline(image, found, loop, by_mask, window) for loop in loops]

    def _track(self, image: NDArray, mask: NDArray | None, window: Window) -> list[Outline]:
        """Outlines by snakes, checked against the segmentation."""
        failure, found = None, []
        try:
            found = self._find(image, mask, window)
        except ContourError as error:
            failure = error
        tracked = [follow(image, snake, self.settings, window) for snake in self._snakes]
        tracked = [
            (outline, snake)
            for (outline, snake), last in zip(tracked, self._snakes, strict=True)
            if not collapsed(outline.points, last.points, self.settings.min_loop_px)
        ]
        outlines, snakes = [o for o, _ in tracked], [s for _, s in tracked]
        why = resegment(found, outlines, snakes) if tracked else "start"
        if not why and trusted(found, outlines):
            matches = match_loops([o.points for o in outlines], [o.points for o in found])
            before = [snakes[matches[i]] if i in matches else None for i in range(len(found))]
            outlines = found
            snakes = [
                start_snake(image, outline, self.settings, last)
                for outline, last in zip(found, before, strict=True)
            ]
        if why and failure is not None:
            raise failure
        if why:
            if tracked:
                self._events.append(f"segmented anew: {why}")
            outlines = found
            snakes = [start_snake(image, o, self.settings) for o in found]
        self._snakes = snakes
        return outlines

    def _segment(
        self, image: NDArray, mask: NDArray | None, window: Window
    ) -> tuple[NDArray[np.uint8], bool]:
        before = self._segmenter.chosen
        try:
            found = self._segmenter.mask(image, mask, window)
        finally:
            if self._segmenter.chosen != before:
                self._events.append(f"segmentation: {self._segmenter.chosen}")
        return found, self._segmenter.chosen == "mask"

    def _outline(
        self,
        image: NDArray,
        mask: NDArray[np.uint8],
        loop: NDArray[np.floating],
        by_mask: bool,
        window: Window,
    ) -> Outline:
        if self.settings.refine == "none":
            return mask_outline(None, mask, loop, self.settings, window)
        if by_mask:
            return mask_outline(image, mask, loop, self.settings, window)
        return image_outline(image, loop, self.settings, window)


def _check_image(image: NDArray, camera: Camera) -> None:
    if image.dtype not in (np.uint8, np.uint16):
        raise ContourError("image_type", f"images must be uint8 or uint16, got {image.dtype}")
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        raise ContourError("image_shape", f"image of shape {image.shape}: need (h, w) or (h, w, 3)")
    if min(image.shape[:2]) < 3:
        raise ContourError("image_shape", f"image of shape {image.shape} is too small")
    if (camera.width, camera.height) != image.shape[1::-1]:
        raise ContourError(
            "image_size",
            f"image is {image.shape[1::-1]} px, camera_info says {camera.width, camera.height}",
        )
