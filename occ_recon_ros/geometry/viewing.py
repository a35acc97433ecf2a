"""Image curves to Contours: viewing directions, contour tangents, outward normals."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .arrays import Array, lengths
from .camera import Camera
from .compiled import compiled
from .contours import Contours


def contours_from_loops(
    camera: Camera,
    loops_uv: Sequence[Array],
    loop_ids: Sequence[int],
    sigma_px: Sequence[Array],
    stamp_ns: int,
    frame_id: str,
) -> Contours:
    """Turn image curves into viewing directions and tangent planes.

    Every contour point fixes a tangent plane of the surface: T from the point,
    N = T x t from the contour's tangent t, outward because the object lies on the known
    side (Boyer and Berger 1997, section 2). A sample without a tangent, between two gaps, gets
    any normal across its ray and an infinite sigma.

    Args:
        camera: the view.
        loops_uv: one (n_i, 2) float64 array a closed loop, pixels, n_i >= 3, walked with
            the object on the left as the image is displayed.
        loop_ids: the identity of each loop, 0-65535, no two alike.
        sigma_px: one (n_i,) float64 array a loop, 1 sigma across the contour, pixels.
        stamp_ns: time of the image, nanoseconds.
        frame_id: name of the object frame.

    Raises:
        ValueError: a loop of fewer than 3 samples or lists of different lengths.
    """
    if not len(loops_uv) == len(loop_ids) == len(sigma_px):
        raise ValueError("loops_uv, loop_ids and sigma_px must be of one length")
    counts = [len(uv) for uv in loops_uv]
    if min(counts, default=3) < 3:
        raise ValueError("a loop needs at least 3 samples")
    uv = np.concatenate([np.zeros((0, 2)), *loops_uv])
    T = camera.viewing_directions(uv)
    bare = Contours(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        centre=camera.centre,
        T=T,
        N=np.zeros_like(T),
        uv=uv,
        loop=np.repeat(np.asarray(loop_ids, np.uint16), counts),
        sigma=np.concatenate([np.zeros(0), *sigma_px]),
    )
    N, scale = _normals(bare)
    known = np.isfinite(bare.sigma) & np.isfinite(scale)
    return replace(bare, N=N, sigma=np.where(known, bare.sigma * scale, np.inf))


def seen_by(camera: Camera, contours: Contours, stamp_ns: int | None = None) -> Contours:
    """The same image curves as another camera would see them, at another time if one is given."""
    return contours_from_loops(
        camera,
        contours.by_loop(contours.uv),
        contours.loop[contours.loop_starts[:-1]].tolist(),
        contours.by_loop(contours.sigma / contours.radians_per_pixel),
        contours.stamp_ns if stamp_ns is None else stamp_ns,
        contours.frame_id,
    )


def _normals(contours: Contours) -> tuple[Array, Array]:
    """Outward normals (n, 3) and the angle of a pixel at each row (n,), infinite where the
    outline has no tangent: gaps on both sides, or neighbours that coincide."""
    here = np.arange(len(contours))
    # Across a gap the tangent comes from the side that is there.
    after = np.where(contours.linked, contours.next_row, here)
    before = np.where(contours.linked[contours.previous_row], contours.previous_row, here)
    N, scale = compiled().tangent_planes(contours.T, contours.uv, before, after)
    none = np.isinf(scale)
    N[none] = _across(contours.T[none])
    return N, scale


def _across(T: Array) -> Array:
    """(k, 3) unit vectors, any across each of (k, 3) unit vectors."""
    N = np.cross(T, np.eye(3)[np.argmin(np.abs(T), axis=1)])
    return N / lengths(N)[:, None]
