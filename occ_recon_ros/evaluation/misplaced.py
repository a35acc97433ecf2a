"""Views whose poses alone are wrong, placed anew by the outlines of the others."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.views import BagViews, Progress, doing
from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.viewing import seen_by
from occ_recon_ros.imaging.joint.judge import STRANGE
from occ_recon_ros.poses.placed_anew import Placed, placed_anew, strays
from occ_recon_ros.streams.alone import DOUBT, MOST_DOUBTFUL, filled
from occ_recon_ros.surface.agreement import silhouette_agreement

from .corrected import camera_rows
from .left_out import SHOWS_NOTHING
from .refinement import Refine, outlines_of
from .segmentation import Segmentation

_MANY = 0.2  # of the views, more of which in wrong poses are a doubt of all
_EXCHANGED = 6  # suspects, up to which each is tried in the poses that the others were given
_SHIFT_TOLD = 0.002  # of the distance: less is not said

Outlines = Sequence[Contours | None]
"""One a view, None where it has none."""


class Misplaced:
    """Last, where all else is settled: views that were left out, and those that stand where the
    others contradict them. One at a time is placed anew by its outline; where it then agrees with
    the others as they do with each other, its pose was wrong. Else its mask is, or it shows
    something else, and it stays as it is.

    Args:
        masks: found the masks; of the ``bad_views`` of its report those that are placed go.
        poses: corrected the cameras; its ``report`` is told the views that were placed and where.
    """

    name = "wrong poses"

    def __init__(self, masks: Segmentation, poses: Refine) -> None:
        self._masks, self._poses = masks, poses

    def __call__(self, views: BagViews, progress: Progress) -> Changes:
        """Look at all views; the masks and cameras to be played, or none where those before
        stay."""
        if self._poses.way == "off" or self._masks.misread:
            return Changes()
        known = views.changes
        cameras, contours = outlines_of(views, progress)
        stamps, numbers = [*cameras], [k for k, c in enumerate(contours) if c is not None]
        bad = self._masks.report.get("bad_views", {})
        # The outline of what stands before the object, as a hand, fits some pose by chance.
        none = SHOWS_NOTHING, STRANGE
        left_out = [k for k, why in bad.items() if contours[k] is None and not why.startswith(none)]
        strange = {k for k, why in bad.items() if why.startswith(STRANGE)}
        astray = [k for k in strays(contours, [*cameras.values()]) if k not in strange]
        suspects = [*astray, *left_out]
        others = [k for k in numbers if k not in suspects and k not in strange]
        if not suspects or len(suspects) > MOST_DOUBTFUL * (len(numbers) + len(left_out)):
            return Changes()
        looks = [contours, *self._other_looks(views, progress)]
        agreed = Agreed([*cameras.values()], contours, others)
        doing(progress, "each placed anew")
        placed, taken = _each_placed(suspects, looks, agreed, progress)
        if not placed:
            return Changes()
        corrected = dict(cameras) | {stamps[k]: p.camera for k, (p, _) in placed.items()}
        self._tell(placed, taken, len(numbers) + len(left_out))
        self._poses.report["cameras"] = camera_rows(corrected, views.recorded_cameras)
        if known.masks is None:
            return Changes(cameras=corrected)
        drawn = {
            stamps[k]: filled(own.by_loop(own.uv), (p.camera.height, p.camera.width))
            for k, (p, own) in placed.items()
        }
        return Changes({**known.masks, **drawn}, corrected)

    def _other_looks(self, views: BagViews, progress: Progress) -> list[Outlines]:
        """Outlines of what came, or of images alone, where masks of all views are drawn where poses
        say; and those of what images show in the poses of others."""
        known, looks = views.changes, list[Outlines]()
        if known.masks is None:
            return looks
        views.changes = Changes(cameras=known.cameras)
        try:
            looks.append(outlines_of(views, progress)[1])
            if elsewhere := self._masks.elsewhere:
                views.changes = Changes({**known.masks, **elsewhere}, known.cameras)
                looks.append(outlines_of(views, progress)[1])
        finally:
            views.changes = known
        return looks

    def _tell(
        self, placed: dict[int, tuple[Placed, Contours]], taken: dict[int, int], count: int
    ) -> None:
        report = self._poses.report
        for k in placed:
            self._masks.report.get("bad_views", {}).pop(k, None)
        report["placed_anew"] = {
            k: {
                "deg": float(np.rad2deg(p.turn)),
                "of_distance": float(np.linalg.norm(p.shift)) / p.away,
                "all_told": p.untold is None,
                "words": _words(p, taken.get(k)),
            }
            for k, (p, _) in sorted(placed.items())
        }
        if len(placed) > _MANY * count:
            many = f"{len(placed)} of {count} views stood where the others contradict them, and"
            report["warnings"] = [
                *report.get("warnings", ()),
                f"{many} were placed anew by the outlines of the others",
            ]


def _each_placed(
    suspects: Sequence[int], looks: Sequence[Outlines], agreed: "Agreed", progress: Progress
) -> tuple[dict[int, tuple[Placed, Contours]], dict[int, int]]:
    """Where those of the suspects that can be placed stand, and their outlines there; and of
    those that stand where another was given to be, the number of that."""
    placed, taken = dict[int, tuple[Placed, Contours]](), dict[int, int]()
    for done, k in enumerate(suspects):
        progress(done, len(suspects))
        owns = [own for look in looks if (own := look[k]) is not None]
        left = [j for j in suspects if j != k and j not in taken.values()]
        if len(suspects) <= _EXCHANGED:
            pairs = [(j, one) for own in owns for j in left if (one := agreed.there(k, j, own))]
            if pairs:
                taken[k], placed[k] = pairs[0]
                continue
        found = (agreed.placed(k, own) for own in owns)
        if (one := next((one for one in found if one is not None), None)) is not None:
            placed[k] = one
    return placed, taken


class Agreed:
    """The views that are to be believed, and by how much they disagree among themselves."""

    def __init__(
        self, cameras: Sequence[Camera], contours: Sequence[Contours | None], others: Sequence[int]
    ) -> None:
        self._cameras, self._contours, self._others = cameras, contours, others
        self._theirs = [c for k in others if (c := contours[k]) is not None]
        self._shares = silhouette_agreement(self._theirs).share if len(others) > 2 else None

    def placed(self, k: int, own: Contours) -> tuple[Placed, Contours] | None:
        """View k of this outline by the others; None where it then does not agree with them."""
        if self._shares is None:
            return None
        contours = [*self._contours[:k], own, *self._contours[k + 1 :]]
        found = placed_anew(k, contours, self._cameras, self._others)
        if found is None or not found.agrees:
            return None
        own = seen_by(found.camera, own)
        return (found, own) if self._holds(own) else None

    def there(self, k: int, j: int, own: Contours) -> tuple[Placed, Contours] | None:
        """View k of this outline where view j was given to be; None where it does not agree with
        the others there."""
        there, given = self._cameras[j], self._cameras[k]
        R, t = there.R_camera_object, there.t_camera_object
        camera = replace(given, R_camera_object=R, t_camera_object=t)
        own = seen_by(camera, own)
        if self._shares is None or not self._holds(own):
            return None
        turn = Rotation.from_matrix(R @ given.R_camera_object.T).magnitude()
        shift, away = t - given.t_camera_object, float(np.linalg.norm(t))
        return Placed(camera, float(turn), shift, away, None, False, 0.0, 0.0), own

    def _holds(self, own: Contours) -> bool:
        """Whether an outline agrees with the others as they do with each other."""
        if self._shares is None:
            return False
        share = silhouette_agreement([*self._theirs, own]).share
        usual = max(DOUBT, float(self._shares.max()))
        return bool(share[-1] <= usual and not (share[:-1] > self._shares + DOUBT).any())


def _words(placed: Placed, taken: int | None = None) -> str:
    """What a view was off by, and how it was placed; taken: the number of that whose pose fits."""
    if taken is not None:
        stood = f"stood {np.rad2deg(placed.turn):.1f} degrees off"
        return f"{stood}: the outlines ask for the pose that view {taken} was given: taken"
    share = float(np.linalg.norm(placed.shift)) / placed.away
    off = [f"{np.rad2deg(placed.turn):.1f} degrees"]
    off += [f"{share:.1%} of its distance"] if share > _SHIFT_TOLD else []
    words = f"stood {' and '.join(off)} off and was placed anew by the outlines of the others"
    if placed.untold is None:
        return words
    by = "as the even steps of the others have it" if placed.predicted else "as it was given"
    return f"{words}; one turn of it, which they do not tell, is {by}"
