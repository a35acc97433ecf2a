"""How accurate depth and curvature are, on bodies of which both are known exactly.

Reproduces the figures of Boyer and Berger 1997 (IJCV 22(3)) and goes beyond them: tables
on the screen, accuracy.json and plots in the directory given by --out. Takes about a
minute.

    python benchmarks/accuracy.py --out DIR

sphere      the paper's sphere (200 mm, 1300 mm away, f = 1600 px, 1 px of noise on each
            coordinate), contours smoothed as the product does by default; depth error in
            mm by step, over status-0 points of the middle frame, and with those that
            checks of continuity and silhouettes have rejected; multi_frame on the
            1-degree sequence extended to +-10 degrees; the plot of figure 10
general     figures 7 and 8: points of the sphere where a_-1 and a_1 have one sign
efficiency  variance of the depth over the Cramer-Rao bound, and errors over depth_sigma
objects     ellipsoid, torus and wavy surface, off the axis and tilted, by step
far         the same ellipsoid from 50 times as far with 50 times the focal length
time        of one frame against samples and partners, processor time
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.geometry import Contours, Rim, RimReconstructor, RimSettings, Status
from occ_recon_ros.geometry.epipolar import epipolar_candidates
from occ_recon_ros.geometry.estimators import ESTIMATORS, MANY_FRAMES, Rays
from occ_recon_ros.geometry.pencil import Pencil
from occ_recon_ros.geometry.quadric import crossing
from occ_recon_ros.imaging import ContourSettings
from occ_recon_ros.imaging.fit import fit_outline
from occ_recon_ros.scene import (
    SceneObject,
    TurntableSettings,
    looking_at,
    make_object,
    noisy,
    paper_sphere,
    turntable_cameras,
)

Array = NDArray[np.float64]
Row = dict[str, Any]

PAPER_MM = {10: 0.69, 5: 1.4, 2: 3.53, 1: 9.0}
SEEDS = 4
NEAR_FOCAL_PX, NEAR_M = 1600.0, 1.0


def main() -> None:
    """Run all measurements."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="directory of JSON and plots")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    tool = check_the_measure()
    result = {
        "measure": show("The measure: truth against itself, and moved by 1 mm", tool),
        "sphere": show("The paper's sphere, mm", sphere_table()),
        "general": show("General motion, a_-1 and a_1 of one sign, mm", general_motion()),
        "efficiency": show("Variance over the Cramer-Rao bound", efficiency()),
        "objects": show("Analytic objects, medians", objects()),
        "far": show("Near-orthographic: 50 times as far, 50 times the focal length", far()),
        "time": show("Processor time, ms", times()),
    }
    figure_10(out / "figure10.png")
    (out / "accuracy.json").write_text(json.dumps(result, indent=1), encoding="utf-8")


def show(title: str, rows: list[Row]) -> list[Row]:
    """Print a table and hand it on."""
    print(f"\n{title}")
    text = [[f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values()] for row in rows]
    names = list(rows[0])
    wide = [max(map(len, column)) for column in zip(names, *text, strict=True)]
    for line in (names, *text):
        print("  ".join(word.rjust(w) for word, w in zip(line, wide, strict=True)), flush=True)
    return rows


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


def check_the_measure() -> list[Row]:
    """Truth has no error, and a shift along the ray is seen as that shift."""
    body, _, contours = paper_sphere(0.1, frames=1, noise_px=0)
    depth, k_t = body.exact_depth(contours[0])
    n = len(depth)
    rows: list[Row] = []
    for shift in (0.0, 1e-3):
        points = contours[0].centre + (depth + shift)[:, None] * contours[0].T
        rim = Rim(0, "", points, contours[0].N, k_t, np.full(n, 1.0), contours[0].loop,
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


def sphere_rims(step_deg: float, frames: int, estimator: str) -> Iterator[dict[str, Array]]:
    """Errors on the paper's sphere, for each seed of the noise."""
    baseline = float(np.deg2rad(step_deg * (frames // 2))) * 0.99
    for seed in range(SEEDS):
        body, _, contours = paper_sphere(
            float(np.deg2rad(step_deg)), frames, seed=seed, smooth=smooth
        )
        settings = RimSettings(baseline=baseline, estimator=estimator)
        yield errors(body, contours[frames // 2], one_rim(contours, settings))


def sphere_table() -> list[Row]:
    """Item 1: three frames by step, and many frames over +-10 degrees."""
    cases = [(step, 3, name) for name in ("osculating_quadric", "circle_epipolar",
             "circle_radial") for step in PAPER_MM]  # fmt: skip
    cases += [(1, 21, name) for name in ("osculating_quadric", *MANY_FRAMES)]
    rows: list[Row] = []
    for step, frames, name in cases:
        found = list(sphere_rims(step, frames, name))
        e = {key: np.concatenate([f[key] for f in found]) for key in found[0]}
        limit = PAPER_MM[step] if frames == 3 else PAPER_MM[10] / 2
        rows.append(
            {
                "estimator": name,
                "step deg": step,
                "frames": frames,
                "depth mean": float(np.abs(e["depth"]).mean()),
                "limit": limit,
                "with rejected": float(np.abs(e["kept"]).mean()),
                "depth median": float(np.median(np.abs(e["depth"]))),
                "distance mean": float(np.abs(e["distance"]).mean()),
                "curvature": float(np.median(np.abs(e["curvature"]))),
                "error/sigma": float(e["score"].std()),
                "status 0": float(e["good"].mean()),
            }
        )
    return rows


def correspondents(body: SceneObject, view: Contours, other: Contours) -> Rays:
    """The true correspondents: of the candidates the one whose ray passes nearest."""
    depth, _ = body.exact_depth(view)
    ray = view.centre + depth[:, None] * view.T - other.centre
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    candidates = epipolar_candidates(Pencil(view, other))
    T = candidates.directions(other)
    miss = np.linalg.norm(T - ray[:, None], axis=-1)
    miss = np.where(candidates.valid, miss, np.inf)
    best = np.argmin(miss, axis=1)
    here = np.arange(len(view))
    T, N = T[here, best], candidates.interpolate(other.N, other.next_row)[here, best]
    T[~np.isfinite(miss[here, best])] = np.nan
    return Rays(other.centre, T, N / np.linalg.norm(N, axis=1, keepdims=True), view.sigma)


def rays(contours: Contours) -> Rays:
    """A view's own rays."""
    return Rays(contours.centre, contours.T, contours.N, contours.sigma)


def general_motion() -> list[Row]:
    """Item 2: exact contours, both partners above the view and to either side."""
    rows: list[Row] = []
    for name in ("sphere", "ellipsoid", "gourd", "wavy"):
        body = make_object(name) if name != "sphere" else paper_sphere(0.1, 1, 0)[0]
        reach = 1.3 if name == "sphere" else 1.0
        angles = [(0.0, 0.2), (-0.14, 0.34), (0.14, 0.34)]
        contours = [
            body.exact_contours(
                looking_at(
                    [
                        reach * np.cos(az) * np.cos(el),
                        reach * np.sin(az) * np.cos(el),
                        reach * np.sin(el),
                    ],
                    (0, 0, 0),
                ),
                0.25,
            )
            for az, el in angles
        ]
        view = rays(contours[0])
        partners = [correspondents(body, contours[0], other) for other in contours[1:]]
        a = [crossing(view.centre, view.T, view.N, p.centre, p.T).a for p in partners]
        with np.errstate(invalid="ignore"):
            same = (a[0] * a[1] > 0) & (np.minimum(*np.abs(a)) > 0.01)
            same &= np.abs(a[1] - a[0]) > 0.2 * (np.abs(a[0]) + np.abs(a[1]))
        truth, _ = body.exact_depth(contours[0])
        row: Row = {"body": name, "points": int(same.sum())}
        for estimator in ("osculating_quadric", "circle_epipolar", "circle_radial"):
            found = ESTIMATORS[estimator](view, partners)
            row[estimator] = float(1e3 * np.nanmean(np.abs(found.depth - truth)[same]))
        rows.append(row)
    return rows


def planar_trial(frames: int, sigma: float, trials: int) -> tuple[Rays, list[Rays], float, float]:
    """Rays that graze a circle of 0.2 m from views over +-10 degrees at 1.3 m, in a plane,
    with independent errors; the true depth and the bound on its standard deviation."""
    angle = np.radians(10) * np.array(sorted(np.linspace(-1, 1, frames), key=abs))
    # Before and after come first.
    angle[1:] = angle[1:][np.argsort(-np.abs(angle[1:]), kind="stable")]
    centres = 1.3 * np.column_stack([np.cos(angle), np.sin(angle)])

    def heading(circle: Array, C: Array) -> Array:
        to = circle[:2] - C
        return np.arctan2(to[1], to[0]) + np.arcsin(circle[2] / np.hypot(*to))

    def depth(circle: Array) -> float:
        return float(np.sqrt(np.sum((circle[:2] - centres[0]) ** 2) - circle[2] ** 2))

    circle = np.array([0.0, 0.0, 0.2])
    steps = 1e-6 * np.eye(3)
    J = np.array(
        [[(heading(circle + s, C) - heading(circle - s, C)) / 2e-6 for s in steps] for C in centres]
    )
    g = np.array([(depth(circle + s) - depth(circle - s)) / 2e-6 for s in steps])
    bound = sigma * np.sqrt(g @ np.linalg.solve(J.T @ J, g))
    rng = np.random.default_rng(frames)
    views = []
    for C in centres:
        psi = heading(circle, C) + sigma * rng.standard_normal(trials)
        T = np.column_stack([np.cos(psi), np.sin(psi), 0 * psi])
        N = np.column_stack([-np.sin(psi), np.cos(psi), 0 * psi])
        views.append(Rays(np.append(C, 0.0), T, N, np.full(trials, sigma)))
    return views[0], views[1:], depth(circle), float(bound)


def efficiency(trials: int = 20000) -> list[Row]:
    """Item 3: by estimator and number of frames, contour errors of 0.1 px at f = 1600."""
    rows: list[Row] = []
    for frames in (3, 5, 9):
        view, partners, truth, bound = planar_trial(frames, 0.1 / 1600, trials)
        for name, estimator in ESTIMATORS.items():
            if frames > 3 and name not in MANY_FRAMES:
                continue
            found = estimator(view, partners)
            off = found.depth - truth
            rows.append(
                {
                    "estimator": name,
                    "frames": frames,
                    "bound mm": 1e3 * bound,
                    "sd mm": float(1e3 * off.std()),
                    "bias mm": float(1e3 * off.mean()),
                    "efficiency": float(off.var() / bound**2),
                    "error/sigma": float((off / found.depth_sigma).std()),
                }
            )
    return rows


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


def objects() -> list[Row]:
    """Item 4: errors over whole turns."""
    rows: list[Row] = []
    for name in ("ellipsoid", "torus", "wavy"):
        for step, noise_px in ((20.0, 0.0), (10.0, 0.0), (5.0, 0.0), (10.0, 0.3)):
            body, contours = turn(name, step, noise_px)
            settings = RimSettings(baseline=float(np.deg2rad(step)) * 0.97)
            reconstructor = RimReconstructor(settings)
            rims = {r.stamp_ns: r for c in contours for r in reconstructor.add(c)}
            rims.update({r.stamp_ns: r for r in reconstructor.finish()})
            found = [errors(body, contours[stamp - 1], rim) for stamp, rim in rims.items()]
            e = {key: np.concatenate([f[key] for f in found]) for key in found[0]}
            size = 1e3 * np.ptp(body.surface_samples(64)[0], axis=0).max()
            rows.append(
                {
                    "body": name,
                    "step deg": step,
                    "noise px": noise_px,
                    "distance mm": float(np.median(np.abs(e["distance"]))),
                    "depth mm": float(np.median(np.abs(e["depth"]))),
                    "curvature": float(np.median(np.abs(e["curvature"]))),
                    "worst distance mm": float(np.abs(e["distance"]).max()),
                    "over 1 %": int((np.abs(e["distance"]) > 0.01 * size).sum()),
                    "points": len(e["depth"]),
                    "status 0": float(e["good"].mean()),
                }
            )
    return rows


def far() -> list[Row]:
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


def times() -> list[Row]:
    """Item 6: a rim of three frames, whole and its estimator alone, by samples and
    partners; the least of several runs."""
    rows: list[Row] = []
    for samples, estimator, side in (
        *((n, "osculating_quadric", 1) for n in (500, 1000, 2000, 4000, 8000)),
        *((2000, "multi_frame", m) for m in (2, 5, 10)),
        *((2000, "linear_smoother", m) for m in (2, 5, 10)),
    ):
        spacing = 2 * np.pi * 1600 * 0.2 / np.sqrt(1.3**2 - 0.2**2) / samples
        step = 0.18 / side
        body, cameras, _ = paper_sphere(step, 2 * side + 1, 0)
        contours = [body.exact_contours(c, spacing, stamp_ns=k) for k, c in enumerate(cameras)]
        settings = RimSettings(estimator=estimator, frames=side, silhouette_checks=0)
        view = rays(contours[side])
        near = [contours[0], contours[-1], *contours[1:side], *contours[side + 1 : -1]]
        partners = [correspondents(body, contours[side], other) for other in near]
        whole, alone = [], []
        for _ in range(7):
            reconstructor = RimReconstructor(settings)
            for c in contours[:-1]:
                reconstructor.add(c)
            start = time.process_time()
            (_,) = reconstructor.add(contours[-1])
            whole.append(time.process_time() - start)
            start = time.process_time()
            ESTIMATORS[estimator](view, partners)
            alone.append(time.process_time() - start)
        rows.append(
            {
                "estimator": estimator,
                "samples": len(contours[0]),
                "frames": 2 * side + 1,
                "estimator alone": 1e3 * min(alone),
                "whole frame": 1e3 * min(whole),
            }
        )
    return rows


def figure_10(path: Path) -> None:
    """Depth and radius error along the rim of the paper's sphere, 10 degrees a step."""
    names = ("osculating_quadric", "circle_epipolar", "circle_radial")
    figure, axes = plt.subplots(2, 3, figsize=(13, 6.5), sharex=True, sharey="row")
    for column, name in zip(axes.T, names, strict=True):
        sums: list[list[NDArray[Any]]] = [[], []]
        for seed in range(SEEDS):
            body, _, contours = paper_sphere(float(np.deg2rad(10)), seed=seed, smooth=smooth)
            settings = RimSettings(baseline=0.17, estimator=name, amplification=1e6)
            rim = one_rim(contours, settings)
            truth, k_t = body.exact_depth(contours[1])
            depth = np.einsum("nk,nk->n", rim.points - contours[1].centre, contours[1].T)
            at = np.linspace(0, 360, len(rim), endpoint=False)
            bins = np.linspace(0, 360, 181)
            for values, total in zip(
                (1e3 * np.abs(depth - truth), 1e3 * np.abs(1 / rim.curvature - 1 / k_t)),
                sums,
                strict=True,
            ):
                known = np.isfinite(values)
                count = np.histogram(at[known], bins)[0]
                total.append(
                    np.histogram(at[known], bins, weights=values[known])[0]
                    / np.where(count > 0, count, np.nan)
                )
        for axis, total, what in zip(column, sums, ("depth", "radius"), strict=True):
            axis.semilogy(bins[:-1] + 1, np.nanmean(total, axis=0))
            axis.set_title(f"{name}: {what}")
            axis.set_ylabel(f"mean {what} error, mm")
            axis.grid(alpha=0.3)
        column[1].set_xlabel("place along the rim, degrees")
    figure.tight_layout()
    figure.savefig(path, dpi=80)
    plt.close(figure)


if __name__ == "__main__":
    main()
