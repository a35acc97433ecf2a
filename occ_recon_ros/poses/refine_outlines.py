"""What the outlines of all views say of cameras: planes that touch two of them, and their rays."""

from collections.abc import Sequence

import numpy as np

from occ_recon_ros.geometry import Camera, Contours
from occ_recon_ros.geometry.arrays import Array, Index, nearest_to_rays

from .refine_coherence import Coherence
from .refine_rig import Rig
from .refine_tangencies import HullView, Residuals, Tangencies, half_angles, joined

_BLOCKS = 6  # of views that follow each other; pairs of blocks are left out together
FOLDS = 3


class OutlineResiduals:
    """Tangencies and rays of all views.

    The places of the list of all residuals: two for each pair of views, then one for each ray.

    Args:
        contours: one a view, None where it has none; made with the cameras.
        cameras: n, as given.
        hulls: of the contours, None where a view is not to be used.

    Attributes:
        middle, radius: of the object, metres.
        touching: (all,) which places are those of pairs of views.
    """

    def __init__(
        self,
        contours: Sequence[Contours | None],
        cameras: Sequence[Camera],
        hulls: Sequence[HullView | None],
    ) -> None:
        self.given = Rig.of(cameras)
        self.tangencies = Tangencies(hulls)
        self.middle, self.radius = place(self.tangencies.rays(self.given), self.given, hulls)
        kept = [None if h is None else c for c, h in zip(contours, hulls, strict=True)]
        self.coherence = Coherence(kept, cameras)
        pairs = 2 * self.tangencies.pairs.shape[1]
        self.touching = np.arange(pairs + len(self.coherence)) < pairs

    def search(self, rig: Rig) -> None:
        """Find where the rays pass best, to look near there from now on."""
        self.coherence.search(rig, self.middle, self.radius)

    def residuals(self, rig: Rig) -> tuple[Residuals, Index]:
        """All residuals of cameras, and the place of each."""
        touching, where = self.tangencies.residuals(rig)
        rays = self.coherence.residuals(rig, self.middle, self.radius)
        camera = np.column_stack([touching.camera, touching.camera[:, 0]])
        none = np.zeros((len(touching), 1, touching.by_camera.shape[2]))
        by_camera = np.concatenate([touching.by_camera, none], axis=1)
        found = joined([Residuals(touching.value, touching.sigma, camera, by_camera), rays])
        first_ray = np.count_nonzero(self.touching)
        return found, np.concatenate([where, first_ray + np.arange(len(rays))])

    def owners(self) -> Index:
        """(all, 2) the views whose outlines each residual compares; a ray's own twice."""
        pairs = np.repeat(self.tangencies.pairs, 2, axis=1).T
        return np.concatenate([pairs, np.column_stack([self.coherence.view] * 2)])

    def cells(self) -> Index:
        """(all,) number of the pair of blocks of views that each residual belongs to; rays belong
        to that of their view. By the number modulo FOLDS every block has a part in each fold."""
        pairs = self.tangencies.pairs
        seen = np.unique(pairs)
        blocks = min(_BLOCKS, max(2, len(seen) // 2))
        of = np.zeros(int(seen.max()) + 1, np.intp)
        of[seen] = np.arange(len(seen)) * blocks // len(seen)
        (i, j), own = of[pairs], of[self.coherence.view]
        cells = (i + j) % FOLDS + FOLDS * (i * blocks + j)
        rays = own % FOLDS + FOLDS * (blocks * blocks + own)
        return np.concatenate([np.repeat(cells, 2), rays])


def place(rays: Array, rig: Rig, hulls: Sequence[HullView | None]) -> tuple[Array, float]:
    """The point (3,) nearest to the views' middle rays, and the object's radius, metres."""
    seen = np.array([h is not None for h in hulls])
    C, looks = rig.C[seen], rays[seen].mean(axis=1)
    looks /= np.linalg.norm(looks, axis=1, keepdims=True)
    middle = nearest_to_rays(C, looks)
    away = np.linalg.norm(C - middle, axis=1)
    return middle, float(np.median(away * np.tan(np.minimum(half_angles(rays[seen]), 1.4))))
