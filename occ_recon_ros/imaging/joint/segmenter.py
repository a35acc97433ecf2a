"""Takes the views of a turn one by one, then finds all their masks."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import repeat

import cv2
import numpy as np
from numpy.typing import NDArray

from ...geometry import Camera
from ..settings import ContourError
from ..volume import Volume
from .cuts import cut_image
from .each import each
from .edges import SOME_WITHOUT_EDGE
from .finer import BODY, STIFFNESS, signed_distance
from .gains import gains_between
from .holes import holes_of
from .in_place import told_in_place
from .judge import GOOD_SUPPORT, MUCH_BESIDE, agreement_of, judge
from .kept import Kept
from .masks import JointMasks, Window, score
from .plane import Backdrop, Ground, find_ground
from .ramps import MUCH_IN_SHADOW, REACH, shadow_ramps
from .regions import Mask, disc, grown
from .shadow import shadow_coloured
from .small_view import SmallView
from .solve import ROUNDS, Solution, Trial, cut_back, joined, pierced, solve
from .space import Array

_SMALL = 0.6  # of the image: an object smaller than this is looked at again from near
_MARGIN = 0.35  # of the object's size, of its surroundings that are looked at too
_BAND = 2.0  # times its blur about the projected body in which an outline is looked for
_LEAST_VIEWS = 5
_SOLID = (0.07, 0.16)  # how much is taken to be filled (``occupied``), tried in this order
_FIRST, _LAST = Trial(_SOLID[0]), Trial(_SOLID[0], ROUNDS)
_SURE = 0.8  # belief at which nothing more is tried
_TINY = 0.004  # of the picture: who photographs an object has more of it in the image than that
_BELIEF_TINY = 0.65
_CUTS = 3  # times ``REACH`` that a soft shadow is cut off, while the views agree no worse
_CONTRARY = 0.02  # of the agreement of the views, that holes may cost
_MUCH_MORE = 1.3  # times the area of an object that is cut short: edges enclose a plate as well
_AGREED = 0.9  # agreement of the views, with less of which colours have found nothing


class JointSegmenter:
    """Takes the views of a turn one by one, then finds all their masks.

    segmenter = JointSegmenter()
    for image, camera in views:
        segmenter.add(image, camera)     # keeps a packed copy, some 0.3 MB
    masks = segmenter.solve()
    for k, (image, _) in enumerate(views):
        mask = masks.mask(k, image)      # (h, w) uint8, 255 = object

    Args:
        volume: where the object is, None: where all views look.
        backdrop: the plane on which the object stands, where it is known.

    Attributes:
        trying: told each trial of ``solve`` that begins, the first is 1; may be set.
    """

    def __init__(
        self,
        volume: Volume | None = None,
        backdrop: Backdrop | None = None,
    ) -> None:
        self.trying: Callable[[int], None] = lambda trial: None
        self._backdrop = backdrop
        self._volume = None if volume is None or volume.kind == "none" else volume
        self._kept: list[Kept] = []
        self._grounds: dict[tuple[Window, ...], Ground | None] = {}

    def __len__(self) -> int:
        return len(self._kept)

    def add(
        self,
        image: NDArray,
        camera: Camera,
        mask: NDArray | None = None,
        guess: NDArray | None = None,
    ) -> None:
        """Take a view.

        Args:
            image: (h, w) or (h, w, 3) BGR, uint8 or uint16.
            camera: the view, in the object frame; of the size of the image.
            mask: (h, w) a mask that came with it, 0 = background, 255 = object.
            guess: (h, w) the same, of which only the colours are begun from.

        Raises:
            ContourError: image_size, where image and camera are not of one size.
        """
        self._kept.append(Kept.of(image, camera, mask, guess, self._backdrop))
        self._grounds.clear()

    def solve(
        self,
        asks_again: Callable[[JointMasks], bool] = lambda _: False,
        like: Trial | None = None,
    ) -> JointMasks:
        """The masks of all views taken so far.

        Args:
            asks_again: whether masks that agree, but are doubtful, are all that is wanted, since
                what they tell changes what is asked: nothing more is tried then.
            like: the trial that found these views' masks best when other cameras or masks were
                begun from: only this and the first are tried.

        Raises:
            ContourError: few_views; no_common_space, where the views do not look at one place;
                no_object, where no body agrees with the views.
        """
        if (n := len(self._kept)) < _LEAST_VIEWS:
            raise ContourError("few_views", f"{n} views: masks from all views need {_LEAST_VIEWS}")
        self._even_out()
        tried = list[JointMasks]()
        found = self._tried(tried, asks_again, like)
        if found.trial == _LAST and any(other.beside > MUCH_BESIDE for other in tried[:-1]):
            # Of what edges enclosed beside the first bodies a part may be what stands still.
            with suppress(ContourError):
                tried.append(self._solve(_LAST._replace(still=False)))
        sizes = {kept.size for kept in self._kept}
        rivals = [other for other in tried if other is not found and other.agreement > _AGREED]
        return told_in_place(found, rivals, sizes.pop()) if len(sizes) == 1 else found

    def _tried(
        self,
        tried: list[JointMasks],
        asks_again: Callable[[JointMasks], bool],
        like: Trial | None,
    ) -> JointMasks:
        """The best masks of all trials, which are added to ``tried``."""
        trial = 0
        failure = ContourError("no_object", "nothing stands out from the backdrop in all views")
        # Colours alone; then edges beside them until the last round, where holes are opened; and
        # to the end where colours tell no body at all, or one beside which edges enclose more, or
        # confirm too little of each outline: a part of it looks as the backdrop does.
        # An outline that lies where images show no edge is asked of edges at once: a reflection,
        # say, has colours of the object, and ends in none. But a print is full of edges.
        # What stands on the axis of the table and is round looks the same in all views, as a
        # backdrop does: edges enclose it beside what turns.
        # Print that is dimmed has all greys, and whatever is grey may be ground in shadow.
        turned, unshaded = _FIRST._replace(still=False), _FIRST._replace(shaded=False)
        plan = [*map(Trial, _SOLID), Trial(_SOLID[0], ROUNDS - 1), _LAST]
        if like is not None:
            plan = list(dict.fromkeys([plan[0], like]))
        begun = any(kept.guess is not None for kept in self._kept)
        while plan:
            how = plan.pop(0)
            agreed = [found for found in tried if found.agreement > _AGREED]
            more = any(found.beside > MUCH_BESIDE for found in agreed)
            faint = any(map(self._asks_edges, agreed))
            if 0 < how.edged < ROUNDS and more:
                continue
            unsure = all(map(self._unconfirmed, agreed))
            if how.edged == ROUNDS and agreed and not (more or faint or unsure):
                continue
            self.trying(trial := trial + 1)
            try:
                found = self._solve(how)
            except ContourError as error:
                failure = error
                continue
            tried.append(found)
            much_more = how.edged == ROUNDS and any(
                other.cut_short and self._share(found) > _MUCH_MORE * self._share(other)
                for other in agreed
            )
            if found.belief >= _SURE and (how.edged < ROUNDS or plan) and not much_more:
                return found
            # Views that show more than a part of the object are no strangers to the whole of it.
            told = found.agreement > _AGREED and not self._unconfirmed(found)
            if told and asks_again(found):
                return found
            lost = found.beside > MUCH_BESIDE or self._unconfirmed(found)
            round_on_axis = found.agreement > _AGREED and lost
            if round_on_axis and len(tried) == 1 and not begun and turned not in plan:
                plan.insert(0, turned)
            if how == _FIRST and unshaded not in plan and self._on_print():
                plan.insert(0, unshaded)
            if found.agreement > _AGREED and self._asks_edges(found) and _LAST in plan:
                plan = [_LAST, *(trial for trial in plan if trial != _LAST)]
        if not tried:
            raise failure
        return max(tried, key=JointMasks.score)

    def _even_out(self) -> None:
        """Take back what light and white balance changed from image to image."""
        if self._backdrop is not None:  # that is compared with each image by itself
            return
        gains = gains_between(each(Kept.thumbnail, self._kept))
        if (gains != 1).any():
            self._kept = [replace(k, gains=g) for k, g in zip(self._kept, gains, strict=True)]

    def _asks_edges(self, found: JointMasks) -> bool:
        """Whether outlines lie where images show no edge, or edges beside them."""
        off_edges = found.edgeless > SOME_WITHOUT_EDGE or found.cut_short
        return self._backdrop is None and off_edges

    def _on_print(self) -> bool:
        """Whether a pattern was found that the object stands on."""
        found = any(ground is not None for ground in self._grounds.values())
        return self._backdrop is None and found

    def _unconfirmed(self, found: JointMasks) -> bool:
        return self._backdrop is None and found.support < GOOD_SUPPORT

    def _solve(self, how: Trial) -> JointMasks:
        windows = [(0, 0, k.camera.width, k.camera.height) for k in self._kept]
        views = each(Kept.part, self._kept, windows)
        try:
            sheet = None if self._backdrop is None else self._backdrop.size
            seek = self._seeking(windows)
            found = solve(views, self._volume, how, sheet, seek)
            # A body of revolution alone looks the same however far it has turned.
            if found is None and how.still:
                how = how._replace(still=False)
                found = solve(views, self._volume, how, sheet, seek)
        except ValueError as error:
            raise ContourError("no_common_space", str(error)) from None
        if found is None:
            raise ContourError("no_object", "nothing stands out from the backdrop in all views")
        nearer = self._windows(found)
        if nearer is not None:
            near = each(Kept.part, self._kept, nearer)
            with suppress(ValueError):
                seek = self._seeking(nearer, found.ground)
                again = solve(near, self._volume, how, sheet, seek)
                if again is not None:
                    found, views, windows = again, near, nearer
        found, small = _without_shadow(views, found)
        judged = judge(views, found, small)
        one = joined(views, found)
        if one is not None:
            one, outlines = _without_shadow(views, one)
            told = judge(views, one, outlines)
            if score(told.views) > score(judged.views):
                found, small, judged = one, outlines, told
        opened = _with_holes(views, found, small)
        if opened is not None:
            told = judge(views, *opened)
            # Places that are painted as dark, on all sides, leave a body that views contradict.
            as_much = told.agreement > judged.agreement - _CONTRARY
            if told.belief >= judged.belief and as_much:
                (found, small), judged = opened, told
        given = np.mean([k.given is not None for k in self._kept]) >= 0.5
        masks = JointMasks(
            "given" if given else "joint",
            judged.belief,
            tuple(judged.doubts),
            tuple(judged.views),
            small,
            found,
            tuple(map(Kept.of_whole, self._kept, windows)),
            how,
            cut_short=judged.cut_short,
        )
        share = self._share(masks)
        if share >= _TINY or given:
            return masks
        words = (
            f"what was found fills {share:.1%} of the pictures: a part alone of the object, it may "
            "be, which looks else as the room does"
        )
        belief = min(masks.belief, _BELIEF_TINY)
        return replace(masks, belief=belief, warnings=(*masks.warnings, words))

    def _share(self, masks: JointMasks) -> float:
        """How much of the usual picture a mask is."""
        whole = [k.camera.width * k.camera.height for k in self._kept]
        parts = [(x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in masks.windows]
        rows = zip(masks.small, parts, whole, strict=True)
        return float(np.median([m.mean() * part / size for m, part, size in rows]))

    def _seeking(
        self, windows: Sequence[Window], other: Ground | None = None
    ) -> Callable[..., Ground | None]:
        """``find_ground`` that looks but once at each choice of windows, whatever is tried; where
        it finds none, for the object hides most, the one that was found from farther away."""

        def seek(views: Sequence[SmallView], centre: Array, half: float) -> Ground | None:
            if (key := tuple(windows)) not in self._grounds:
                self._grounds[key] = find_ground(views, centre, half)
            if self._grounds[key] is None and other is not None:
                self._grounds[key] = other.nearer(views, centre, half)
            return self._grounds[key]

        return seek

    def view(self, k: int, window: Window) -> SmallView:
        """A part of view k, in pixels of its image, in the size of the joint pass."""
        kept = self._kept[k]
        return kept.part(kept.of_packed(window))

    def _windows(self, found: Solution) -> list[Window] | None:
        """Where to look at each view from nearer; None where the object is large in them.

        One window for all where the object stays in its place, as before a fixed camera.
        """
        boxes = []
        for kept, outline in zip(self._kept, found.outlines, strict=True):
            x, y, w, h = cv2.boundingRect((outline > 0.5).astype(np.uint8))
            size = np.array([kept.camera.width, kept.camera.height])
            shape = np.array(outline.shape[::-1])
            boxes.append(np.array([x, y, x + w, y + h]) * np.tile(size / shape, 2))
        low, high = np.min(boxes, axis=0)[:2], np.max(boxes, axis=0)[2:]
        margin = _MARGIN * float((high - low).max())
        windows = []
        for kept in self._kept:
            size = np.array([kept.camera.width, kept.camera.height])
            first = np.maximum(np.floor(low - margin), 0).astype(int)
            last = np.minimum(np.ceil(high + margin), size).astype(int)
            if (last - first).max() > _SMALL * size.max() or (last - first).min() < 8:
                return None
            windows.append((int(first[0]), int(first[1]), int(last[0]), int(last[1])))
        return windows


def _without_shadow(
    views: Sequence[SmallView], found: Solution
) -> tuple[Solution, tuple[Mask, ...]]:
    """The body without the soft shadow at its foot, and its outline in each view (h, w)."""
    masks = _outlined(views, found)
    if any(view.given is not None or view.known is not None for view in views):
        return found, masks
    shadows = [shadow_coloured(view.bins, found.models.shaded) for view in views]
    ramps, share = shadow_ramps(views, masks, shadows)
    found = replace(found, in_shadow=share)
    agreed = agreement_of(views, found) if share > MUCH_IN_SHADOW else 0.0
    for _ in range(_CUTS):
        if share <= MUCH_IN_SHADOW:
            break
        near = [grown(r, disc(2 * REACH)) & s for r, s in zip(ramps, shadows, strict=True)]
        less = cut_back(views, found, near)
        if less is None:
            break
        now = agreement_of(views, less)
        if now < agreed:  # what is no shadow but a part of the object, other views miss
            break
        found, masks, agreed = less, _outlined(views, less), now
        ramps, share = shadow_ramps(views, masks, shadows)
    return found, masks


def _with_holes(
    views: Sequence[SmallView], found: Solution, masks: Sequence[Mask]
) -> tuple[Solution, tuple[Mask, ...]] | None:
    """The body with the holes through which the dark backdrop is seen, and its outline in each view
    (h, w); None where there are none."""
    if any(view.given is not None or view.known is not None for view in views):
        return None
    holes = holes_of(views, found.grid, found.body, masks)
    if not any(map(np.any, holes)):
        return None
    found = pierced(views, found, holes)
    return found, _outlined(views, found)


def _outlined(views: Sequence[SmallView], found: Solution) -> tuple[Mask, ...]:
    how = found.outlining, found.outlines, repeat(found.blur)
    return tuple(each(outline_again, views, *how))


def joint_masks(
    views: Iterable[tuple[NDArray, Camera]], volume: Volume | None = None
) -> tuple[JointMasks, list[NDArray[np.uint8]]]:
    """Masks of all views of a turn, where they fit into memory; else use ``JointSegmenter``.

    Returns:
        The judgement, and of each view its mask (h, w) uint8, 255 = object.

    Raises:
        ContourError: as ``JointSegmenter.solve``.
    """
    views = list(views)
    segmenter = JointSegmenter(volume)
    for image, camera in views:
        segmenter.add(image, camera)
    found = segmenter.solve()
    return found, [found.mask(k, image) for k, (image, _) in enumerate(views)]


def outline_again(
    view: SmallView, nats: NDArray[np.float32], outline: NDArray[np.float32], blur: float
) -> Mask:
    """(h, w) bool, the outline found again about that of the body."""
    away = signed_distance(outline > 0.5)
    band = max(_BAND * blur, 2.0)
    evidence = nats + BODY * np.tanh(away / band)
    free = np.abs(away) < 3 * band
    evidence = np.where(free, evidence, np.where(away > 0, BODY, -BODY))
    found = cut_image(evidence.astype(np.float64), free, view.image, STIFFNESS)
    return np.asarray(found & view.picture)
