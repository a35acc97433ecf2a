"""Poses and calibration: how well they are found, and how well they are corrected.

    python benchmarks/poses.py [--out FILE.json] [--data FOLDER] [SECTION ...]

``apple``, ``hidden``, ``axis`` and ``intrinsics`` are those of boards.py.
``turns``: objects of the virtual turntable whose cameras are then told wrong; the corrected
ones are judged by the distance of rim points to the true surface, after the similarity that the
contours cannot know. ``recorded``: sequences of others, as given and with errors added, judged
by their masks. Prints tables with each figure that misses its limit.
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from boards import SECTIONS as BOARDS
from numpy.typing import NDArray
from recorded import real_frames
from scenes import hand_held_cameras, mesh_object
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from table import Row, reaches, show, within

from occ_recon_ros.evaluation.raycast import RayCaster
from occ_recon_ros.geometry import (
    Camera,
    Contours,
    Rim,
    RimReconstructor,
    Status,
    contours_from_loops,
)
from occ_recon_ros.imaging import ContourTracker
from occ_recon_ros.poses.refine import refine
from occ_recon_ros.scene import SceneObject, TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.surface.closing import close_surface

Array = NDArray[np.float64]
Masks = Sequence[NDArray[np.uint8]]

NOISE_PX = 0.15  # of the outlines, over some 4 samples
_SPAN = 4.0
_POINTS = 600


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(SECTIONS))
    parser.add_argument("--out", type=Path, default=Path("poses.json"))
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    args = parser.parse_args()
    unknown = set(args.sections) - {*SECTIONS}
    if unknown:
        parser.error(f"no section {unknown.pop()}: use {', '.join(SECTIONS)}")
    results = {}
    for name in args.sections or SECTIONS:
        results[name] = SECTIONS[name](args.data)
    args.out.write_text(json.dumps(results, indent=1) + "\n")


# Errors that calibrations have.


def axis_off(cameras: Sequence[Camera], rng: np.random.Generator) -> list[Camera]:
    """The axis off by 1 degree and 3 mm, the steps by 0.2 degrees, the principal point by 5 px."""
    way = rng.normal(size=(2, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    tilt = Rotation.from_rotvec(np.deg2rad(1) * way[0]).as_matrix()
    found = []
    for camera, slip in zip(cameras, np.deg2rad(0.2) * rng.normal(size=len(cameras)), strict=True):
        R = tilt @ camera.R_camera_object @ Rotation.from_rotvec([0, 0, slip]).as_matrix()
        K = camera.K.copy()
        K[:2, 2] += np.array([3.0, -4.0])
        t = tilt @ camera.t_camera_object + 3e-3 * way[1]
        found.append(replace(camera, K=K, R_camera_object=R, t_camera_object=t))
    return found


def jitter(px: float) -> Callable[[Sequence[Camera], np.random.Generator], list[Camera]]:
    """Every pose off by itself, by so many pixels at the object in each of its six ways."""

    def off(cameras: Sequence[Camera], rng: np.random.Generator) -> list[Camera]:
        found = []
        for camera in cameras:
            f, away = camera.K[0, 0], np.linalg.norm(camera.t_camera_object)
            turn = Rotation.from_rotvec(px / f / np.sqrt(2) * rng.normal(size=3)).as_matrix()
            t = turn @ camera.t_camera_object
            t = t + px / f / np.sqrt(2) * away * rng.normal(size=3)
            found.append(
                replace(camera, R_camera_object=turn @ camera.R_camera_object, t_camera_object=t)
            )
        return found

    return off


def focal_off(cameras: Sequence[Camera], rng: np.random.Generator) -> list[Camera]:
    """The focal length told 2 % too large."""
    return [replace(c, K=c.K @ np.diag([1.02, 1.02, 1])) for c in cameras]


def principal_point_off(cameras: Sequence[Camera], rng: np.random.Generator) -> list[Camera]:
    """cx told 3 px too large."""
    return [replace(c, K=c.K + np.array([[0, 0, 3.0], [0, 0, 0], [0, 0, 0]])) for c in cameras]


def right(cameras: Sequence[Camera], rng: np.random.Generator) -> list[Camera]:
    """No error at all."""
    return list(cameras)


# Outlines and what comes of them.


def seen(
    thing: SceneObject, cameras: Sequence[Camera], rng: np.random.Generator, wrong: int = 0
) -> list[Contours]:
    """Noisy outlines of all views; some of the views show a bite that the object has not."""
    bitten = set(rng.choice(len(cameras), wrong, replace=False).tolist())
    found = []
    for k, camera in enumerate(cameras):
        exact = thing.exact_contours(camera, 1.0, k + 1)
        loops, sigmas = [], []
        for a, b in pairwise(exact.loop_starts):
            uv = exact.uv[a:b]
            along = np.roll(uv, -1, axis=0) - np.roll(uv, 1, axis=0)
            normal = np.column_stack([-along[:, 1], along[:, 0]])
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            noise = gaussian_filter1d(rng.normal(size=len(uv)), _SPAN, mode="wrap")
            noise *= NOISE_PX * np.sqrt(2 * np.sqrt(np.pi) * _SPAN)
            uv = uv + noise[:, None] * normal
            if k in bitten:
                middle = uv.mean(axis=0)
                high = uv[:, 1] < np.quantile(uv[:, 1], 0.2)
                uv = np.where(high[:, None], middle + 0.8 * (uv - middle), uv)
            loops.append(uv)
            sigmas.append(np.where(np.isfinite(exact.sigma[a:b]), NOISE_PX, np.inf))
        ids = [int(exact.loop[a]) for a in exact.loop_starts[:-1]]
        found.append(contours_from_loops(camera, loops, ids, sigmas, k + 1, "object"))
    return found


def as_seen_by(contours: Sequence[Contours], cameras: Sequence[Camera]) -> list[Contours]:
    """The same outlines with other cameras."""
    found = []
    for c, camera in zip(contours, cameras, strict=True):
        parts = list(pairwise(c.loop_starts))
        px = c.sigma / c.radians_per_pixel
        found.append(
            contours_from_loops(
                camera,
                [c.uv[a:b] for a, b in parts],
                [int(c.loop[a]) for a, _ in parts],
                [px[a:b] for a, b in parts],
                c.stamp_ns,
                c.frame_id,
            )
        )
    return found


def rims_of(contours: Sequence[Contours]) -> list[Rim]:
    """The last rim of every stamp."""
    reconstructor, rims = RimReconstructor(), {}
    for one in contours:
        rims |= {rim.stamp_ns: rim for rim in reconstructor.add(one)}
    rims |= {rim.stamp_ns: rim for rim in reconstructor.finish()}
    return [rims[stamp] for stamp in sorted(rims)]


def good_share(rims: Sequence[Rim]) -> float:
    """Percent of the samples with status good."""
    return 100 * float(np.mean(np.concatenate([r.status for r in rims]) == Status.GOOD))


def rim_error(thing: SceneObject, rims: Sequence[Rim]) -> tuple[float, float]:
    """Mean distance of good rim points to the true surface, mm, after the similarity that brings
    them nearest; and the share of samples that are good, percent."""
    points = np.concatenate([r.points[r.status == Status.GOOD] for r in rims])
    points = points[:: max(1, len(points) // _POINTS)]

    def off(x: Array) -> Array:
        moved = np.exp(x[6]) * Rotation.from_rotvec(x[:3]).apply(points) + 0.1 * x[3:6]
        return thing.distance(moved)

    x = least_squares(off, np.zeros(7), loss="soft_l1", f_scale=1e-4, max_nfev=20).x
    return 1e3 * float(np.abs(off(x)).mean()), good_share(rims)


def spot(data: Path) -> SceneObject:
    """A cow, of triangles made by others."""
    return mesh_object(data / "meshes" / "spot.obj")


def turns(data: Path) -> list[Row]:
    """Objects of the virtual turntable with cameras that are told wrong."""
    full = turntable_cameras()
    half = turntable_cameras(TurntableSettings(frames=24, step=np.deg2rad(7)))
    cases = [
        ("vase", "axis", full, axis_off, 0),
        ("mug", "axis", full, axis_off, 0),
        ("figure", "axis", full, axis_off, 0),
        ("torus", "axis", full, axis_off, 0),
        ("gourd", "axis", full, axis_off, 0),
        ("spot", "axis", full, axis_off, 0),
        ("gourd", "axis, 12 views", turntable_cameras(_of(12)), axis_off, 0),
        ("gourd", "axis, 72 views", turntable_cameras(_of(72)), axis_off, 0),
        ("gourd", "axis, 161 degrees", half, axis_off, 0),
        ("figure", "axis, 3 masks wrong", full, axis_off, 3),
        ("figure", "right, 3 masks wrong", full, right, 3),
        ("gourd", "poses by 1 px", full, jitter(1.0), 0),
        ("figure", "poses by 3 px", full, jitter(3.0), 0),
        ("figure", "poses by 2 px, in hand", hand_held_cameras(), jitter(2.0), 0),
        ("gourd", "focal length by 2 %", full, focal_off, 0),
        ("figure", "cx by 3 px", full, principal_point_off, 0),
        ("vase", "right", full, right, 0),
        ("figure", "right", full, right, 0),
        ("spot", "right", full, right, 0),
        ("bottle", "right; of revolution", full, right, 0),
        ("bottle", "axis; of revolution", full, axis_off, 0),
    ]
    rows = []
    for name, what, cameras, wrong, bitten in cases:
        rng = np.random.default_rng(1)
        thing = spot(data) if name == "spot" else make_object(name)
        outlines = seen(thing, cameras, rng, bitten)
        told = wrong(cameras, rng)
        start = time.process_time()
        found = refine(as_seen_by(outlines, told), told)
        spent = time.process_time() - start
        truth, _ = rim_error(thing, rims_of(outlines))
        before, good_before = rim_error(thing, rims_of(as_seen_by(outlines, told)))
        after, good = rim_error(thing, rims_of(as_seen_by(outlines, found.cameras)))
        row: Row = {
            "object": name,
            "told wrong": what,
            "corrected": "+".join(found.groups) or "-",
            "not determined": "+".join(found.undetermined) or "-",
            "apart px": f"{found.before_px:.2f} {found.after_px:.2f}",
            "rims mm: told": before,
            "true": truth,
            "corrected mm": after,
            "good %": f"{good_before:.0f} {good:.0f}",
            "s": spent,
        }
        rows.append(row | within(after / truth, 1.5))
        show("Turns", rows[-1:])
    return show("Turns told wrong, and corrected by the contours", rows)


def _of(frames: int) -> TurntableSettings:
    return TurntableSettings(frames=frames, step=2 * np.pi / frames)


def recorded(data: Path) -> list[Row]:
    """Sequences of others: as given, corrected, with errors added, and these corrected."""
    limits = {
        "oxford_dino": (0.988, 61.0),
        "dino_ring": (0.984, 40.0),
        "apple_aruco": (0.985, 75.0),
    }
    rows: list[Row] = []
    for name, (least_iou, least_good) in limits.items():
        tracker, contours, cameras, masks = ContourTracker(), [], [], []
        for k, (image, mask, camera) in enumerate(real_frames(data / name)):
            contours.append(tracker.process(image, camera, k + 1, "object", mask))
            cameras.append(camera)
            masks.append(mask)
        for what, wrong in (
            ("as given", right),
            ("cx by 3 px", principal_point_off),
            ("poses by 1 px", jitter(1.0)),
        ):
            told = wrong(cameras, np.random.default_rng(2))
            row: Row = {"sequence": name, "error added": what}
            row |= _judged("told", contours, told, masks)
            start = time.process_time()
            found = refine(contours, told)
            row["s"] = time.process_time() - start
            row["corrected"] = "+".join(found.groups) or "-"
            row["apart px"] = f"{found.before_px:.2f} {found.after_px:.2f}"
            after = _judged("corrected", contours, found.cameras, masks)
            row |= after
            row |= reaches(after["corrected IoU"], least_iou)
            row |= {"good": "pass" if after["corrected good %"] >= least_good else "SHORT"}
            rows.append(row)
            show("Recorded", rows[-1:])
    return show("Recorded sequences, corrected by the contours", rows)


def _judged(
    name: str, contours: Sequence[Contours], cameras: Sequence[Camera], masks: Masks
) -> Row:
    """The closed body against the masks, and the share of good samples."""
    outlines = as_seen_by(contours, cameras)
    rims = rims_of(outlines)
    caster = RayCaster(close_surface(outlines, rims).triangles)
    iou = []
    for camera, mask in zip(cameras, masks, strict=True):
        drawn, shown = caster.silhouette(camera), mask > 0
        iou.append((drawn & shown).sum() / (drawn | shown).sum())
    return {f"{name} IoU": float(np.mean(iou)), f"{name} good %": good_share(rims)}


SECTIONS: dict[str, Callable[[Path], list[Row]]] = {
    **BOARDS,
    "turns": turns,
    "recorded": recorded,
}

if __name__ == "__main__":
    main()
