"""Errors of rims on bodies of which depth and curvature are known exactly."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from scenes import paper_sphere
from table import Row

from occ_recon_ros.geometry import Contours, Rim, RimReconstructor, RimSettings, Status
from occ_recon_ros.imaging import ContourSettings
from occ_recon_ros.imaging.fit import fit_outline
from occ_recon_ros.scene import SceneObject

Array = NDArray[np.float64]


def smooth(uv: Array) -> tuple[Array, Array]:
    """A noisy loop as the product smooths it by default."""
    n = len(uv)
    settings = ContourSettings()
    points, sigma = fit_outline(
        uv, np.ones(n), np.ones(n, bool), settings.smoothing_px, settings.spacing_px
    )
    return np.asarray(points, np.float64), np.asarray(sigma, np.float64)


def errors(body: SceneObject, contours: Contours, rim: Rim) -> dict[str, Array]:
    """Errors of the status-0 points: depth and distance in mm, curvature relative to the
    truth, depth error over depth_sigma; each (m,)."""
    good = rim.status == Status.GOOD
    truth, k_t = body.exact_depth(contours)
    depth = np.einsum("nk,nk->n", rim.points - contours.centre, contours.T)
    off = (depth - truth)[good]
    conditioned = np.isfinite(depth) & (rim.status != Status.ILL_CONDITIONED)
    return {
        "depth": 1e3 * off,
        "distance": 1e3 * body.distance(rim.points[good]),
        "curvature": (rim.curvature / k_t - 1)[good],
        "score": off / rim.depth_sigma[good],
        "good": good.astype(float),
        "kept": 1e3 * (depth - truth)[conditioned],
    }


def together(found: Iterable[dict[str, Array]]) -> dict[str, Array]:
    """The errors of several rims in one."""
    each = list(found)
    return {key: np.concatenate([one[key] for one in each]) for key in each[0]}


def check_the_measure() -> list[Row]:
    """Truth has no error, and a shift along the ray is seen as that shift."""
    body, _, contours = paper_sphere(0.1, frames=1, noise_px=0)
    depth, k_t = body.exact_depth(contours[0])
    n = len(depth)
    rows: list[Row] = []
    for shift in (0.0, 1e-3):
        points = contours[0].centre + (depth + shift)[:, None] * contours[0].T
        view = contours[0]
        rim = Rim(0, "", view.centre, points, view.N, k_t, np.full(n, 1.0), view.loop,
                  np.zeros(n), np.zeros(n, np.uint8))  # fmt: skip
        e = errors(body, contours[0], rim)
        if np.abs(e["depth"] - 1e3 * shift).max() > 1e-6 or np.abs(e["curvature"]).max() > 1e-6:
            raise RuntimeError("the measuring tool is wrong")
        rows.append({"moved mm": 1e3 * shift, "depth": float(np.mean(e["depth"])),
                     "distance": float(np.mean(e["distance"])),
                     "curvature": float(np.abs(e["curvature"]).max())})  # fmt: skip
    return rows


def one_rim(contours: Sequence[Contours], settings: RimSettings) -> Rim:
    """The rim of the middle frame."""
    reconstructor = RimReconstructor(settings)
    rims = [rim for c in contours for rim in reconstructor.add(c)]
    return next(r for r in rims if r.stamp_ns == contours[len(contours) // 2].stamp_ns)
