"""Whole turns: items 4, 5 and 6 of what accuracy.py shows."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
from errors import errors, one_rim, smooth, together
from numpy.typing import NDArray
from recorded import real_frames
from scenes import noisy, paper_sphere
from table import Row, reaches, within

from occ_recon_ros.geometry import Camera, Contours, Rim, RimReconstructor, RimSettings, Status
from occ_recon_ros.imaging import ContourTracker
from occ_recon_ros.scene import SceneObject, TurntableSettings, make_object, turntable_cameras

Array = NDArray[np.float64]

BODIES = ("ellipsoid", "torus", "wavy", "mug", "figure")
CASES = ((20.0, 0.0), (10.0, 0.0), (5.0, 0.0), (10.0, 0.3))  # degrees a step, px of noise
NEAR_FOCAL_PX, NEAR_M = 1600.0, 1.0
OUTSIDE_PX = 1.5


def turn(name: str, step_deg: float, noise_px: float) -> tuple[SceneObject, list[Contours]]:
    """Contours of a full turn about an axis that is off the body and tilted."""
    body = make_object(name)
    settings = TurntableSettings(
        frames=round(360 / step_deg),
        step=float(np.deg2rad(step_deg)),
        # From high enough to see through the torus.
        elevation=0.7 if name == "torus" else 0.26,
        axis_offset_x=0.01,
        axis_offset_y=-0.005,
        axis_tilt=0.1,
    )
    rng = np.random.default_rng(0)
    contours = []
    for k, camera in enumerate(turntable_cameras(settings)):
        exact = body.exact_contours(camera, stamp_ns=k + 1)
        if noise_px:
            spoiled = noisy(exact, camera, noise_px, rng, smooth)
            exact = replace(spoiled, sigma=np.where(np.isinf(exact.sigma), np.inf, spoiled.sigma))
        contours.append(exact)
    return body, contours


def rims_of(contours: Sequence[Contours], settings: RimSettings) -> dict[int, Rim]:
    """The last word on each frame's rim, by stamp."""
    reconstructor = RimReconstructor(settings)
    rims = [rim for c in contours for rim in reconstructor.add(c)]
    return {rim.stamp_ns: rim for rim in rims + reconstructor.finish()}


def bodies() -> list[Row]:
    """Item 4: errors over whole turns. The torus has limits; the others are for comparison."""
    rows: list[Row] = []
    for name in BODIES:
        for step, noise_px in CASES:
            body, contours = turn(name, step, noise_px)
            rims = rims_of(contours, RimSettings(baseline=float(np.deg2rad(step)) * 0.8))
            e = together(errors(body, contours[stamp - 1], rim) for stamp, rim in rims.items())
            size = 1e3 * np.ptp(body.surface_samples(64)[0], axis=0).max()
            far = int((np.abs(e["distance"]) > 0.01 * size).sum())
            row: Row = {
                "body": name,
                "step deg": step,
                "noise px": noise_px,
                "distance mm": float(np.median(np.abs(e["distance"]))),
                "depth mm": float(np.median(np.abs(e["depth"]))),
                "curvature": float(np.median(np.abs(e["curvature"]))),
                "error/sigma": float(1.4826 * np.median(np.abs(e["score"]))) if noise_px else "",
                "worst distance mm": float(np.abs(e["distance"]).max()),
                "points": len(e["depth"]),
                "status 0": float(e["good"].mean()),
                "over 1 %": far,
            }
            rows.append(row | (within(far, 0) if name == "torus" else {}))
    return rows


def plot_bodies(rows: list[Row], path: Path) -> None:
    """Errors against the step, without noise."""
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.2), sharex=True)
    for axis, what in zip(axes, ("distance mm", "depth mm", "curvature"), strict=True):
        for name in BODIES:
            mine = [r for r in rows if r["body"] == name and r["noise px"] == 0]
            axis.loglog([r["step deg"] for r in mine], [r[what] for r in mine], "o-", label=name)
        axis.set_xlabel("step, degrees")
        axis.set_title(f"median error: {what if 'mm' in what else 'k_t, relative'}")
        axis.set_xticks([5, 10, 20], ["5", "10", "20"])
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=80)
    plt.close(figure)


def near_orthographic() -> list[Row]:
    """The limit of Giblin and Weiss 1987, orthographic views and planar motion."""
    rows: list[Row] = []
    for factor in (1.0, 50.0):
        body = make_object("ellipsoid")
        cameras = turntable_cameras(
            TurntableSettings(
                frames=3,
                step=float(np.deg2rad(5)),
                distance=NEAR_M * factor,
                focal_px=NEAR_FOCAL_PX * factor,
            )
        )
        contours = [body.exact_contours(c, 0.5, stamp_ns=k) for k, c in enumerate(cameras)]
        e = errors(body, contours[1], one_rim(contours, RimSettings(baseline=0.08)))
        rows.append(
            {
                "distance m": NEAR_M * factor,
                "focal px": NEAR_FOCAL_PX * factor,
                "depth mm": float(np.median(np.abs(e["depth"]))),
                "distance mm": float(np.median(np.abs(e["distance"]))),
                "curvature": float(np.median(np.abs(e["curvature"]))),
                "status 0": float(e["good"].mean()),
            }
        )
    return rows


def dinosaur(folder: Path) -> list[Row]:
    """Item 5: real images, masks made by others, a calibration that is off by pixels."""
    frames = list(real_frames(folder))
    tracker = ContourTracker()
    contours = [
        tracker.process(image, camera, k + 1, "turntable", mask)
        for k, (image, mask, camera) in enumerate(frames)
    ]
    reconstructor = RimReconstructor()
    rims = {rim.stamp_ns: rim for c in contours for rim in reconstructor.add(c)}
    published = len(rims)
    seen = [("as published", rims), ("when finished", rims | {
        rim.stamp_ns: rim for rim in reconstructor.finish()})]  # fmt: skip
    rows: list[Row] = []
    for name, found in seen:
        points = np.concatenate([r.points[r.status == Status.GOOD] for r in found.values()])
        share = len(points) / sum(map(len, found.values()))
        outside = np.max([_outside_px(points, mask, camera) for _, mask, camera in frames], axis=0)
        over = float((outside > OUTSIDE_PX).mean())
        row: Row = {"rims": f"{len(found)} {name}", "pose error px": reconstructor.pose_error_px}
        rows.append(row | {"figure": "over 1.5 px outside", "value": over} | within(over, 0.005))
        rows.append(row | {"figure": "status 0", "value": share} | reaches(share, 0.6))
    assert published < len(seen[1][1])
    return rows


def _outside_px(points: Array, mask: NDArray[np.uint8], camera: Camera) -> Array:
    """(n,) distance from the nearest pixel of the mask, px."""
    distance = cv2.distanceTransform((mask == 0).astype(np.uint8), cv2.DIST_L2, 5)
    u, v = np.rint(camera.project(points)).astype(int).T
    inside = (u >= 0) & (v >= 0) & (u < mask.shape[1]) & (v < mask.shape[0])
    found = np.full(len(points), np.inf)
    found[inside] = distance[v[inside], u[inside]]
    return found


def times() -> list[Row]:
    """Item 6: processor time of a frame, against the number of samples and the window.

    A turn of 36 frames of the paper's sphere; the least of several runs for each frame,
    the median over the frames from the tenth on.
    """
    cases = [("osculating_quadric", n, 1) for n in (500, 1000, 2000, 4000, 8000)]
    cases += [(name, 2000, m) for name in ("multi_frame", "linear_smoother") for m in (2, 5, 10)]
    rows: list[Row] = []
    for estimator, samples, side in cases:
        spacing = 2 * np.pi * 1600 * 0.2 / np.sqrt(1.3**2 - 0.2**2) / samples
        step = np.deg2rad(10) / side
        body, cameras, _ = paper_sphere(step, 36 if side == 1 else 2 * side + 12, 0)
        contours = [body.exact_contours(c, spacing, stamp_ns=k) for k, c in enumerate(cameras)]
        settings = RimSettings(estimator=estimator, frames=side, baseline=0.17)
        each = 1e3 * _of_each(contours, settings)
        row: Row = {
            "estimator": estimator,
            "samples": len(contours[0]),
            "frames": 2 * side + 1,
            "ms": float(np.median(each[2 * side + 8 :])),
        }
        row["us a sample and frame"] = 1e3 * row["ms"] / (row["samples"] * row["frames"])
        rows.append(row | (within(row["ms"], 3.0) if (samples, side) == (2000, 1) else {}))
    return rows


def _of_each(contours: Sequence[Contours], settings: RimSettings, runs: int = 5) -> Array:
    """Seconds of the processor for each frame of a scan, the least of several runs: what the
    machine did besides is left out."""
    spent = np.empty((runs, len(contours)))
    for run in range(runs):
        reconstructor = RimReconstructor(settings)
        for k, one in enumerate(contours):
            fresh = replace(one)  # what a frame works out once is part of its time
            start = time.process_time()
            reconstructor.add(fresh)
            spent[run, k] = time.process_time() - start
    least: Array = spent.min(axis=0)
    return least


def plot_times(rows: list[Row], path: Path) -> None:
    """Time against samples and against frames."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2))
    quadric = [r for r in rows if r["estimator"] == "osculating_quadric"]
    axes[0].plot([r["samples"] for r in quadric], [r["ms"] for r in quadric], "o-")
    axes[0].plot([0, 2000, 2000], [3, 3, 0], "--", color="grey", label="asked: 3 ms at 2,000")
    axes[0].set_xlabel("samples, three frames")
    axes[0].legend()
    for name in ("multi_frame", "linear_smoother"):
        mine = [r for r in rows if r["estimator"] == name]
        axes[1].plot([r["frames"] for r in mine], [r["ms"] for r in mine], "o-", label=name)
    axes[1].set_xlabel("frames, 2,000 samples")
    axes[1].legend()
    for axis in axes:
        axis.set_xlim(left=0)
        axis.set_ylim(bottom=0)
        axis.set_ylabel("processor time of a frame, ms")
        axis.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(path, dpi=80)
    plt.close(figure)
