"""How accurate depth and curvature are, on bodies of which both are known exactly.

Reproduces the figures of Boyer and Berger 1997 (IJCV 22(3)) and goes beyond them: tables
on the screen, each figure with its limit beside it, accuracy.json and plots in the
directory given by --out. Takes about two minutes.

    python benchmarks/accuracy.py --out DIR [--data FOLDER] [--only TABLE ...]

sphere      the paper's sphere (200 mm, 1300 mm away, f = 1600 px, 1 px of noise on each
            coordinate), contours smoothed as the product does by default; depth error in
            mm by step, over all samples of the middle frame that could be solved, by which
            it is judged, and over those that are good (status 0) alone; multi_frame on the
            1-degree sequence extended to +-10 degrees; the plot of figure 10
general     figures 7 and 8: points where a_-1 and a_1 have one sign, exact contours
efficiency  variance of the depth over the Cramer-Rao bound, and errors over depth_sigma
bodies      ellipsoid, torus, wavy surface, mug and figure, off the axis and tilted, by step
far         the same ellipsoid from 50 times as far with 50 times the focal length
dinosaur    36 real images: points outside the masks, and how many there are
time        of one frame against samples and partners, processor time (turns.py)
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import turns
from errors import check_the_measure, errors, one_rim, smooth, together
from numpy.typing import NDArray
from scenes import looking_at, paper_sphere
from table import Row, between, reaches, show, within

from occ_recon_ros.geometry import Contours, RimSettings
from occ_recon_ros.geometry.correspondence import Pencil
from occ_recon_ros.geometry.estimators import ESTIMATORS, MANY_FRAMES, Rays
from occ_recon_ros.geometry.quadric import crossed_candidates, crossing
from occ_recon_ros.scene import SceneObject, make_object

Array = NDArray[np.float64]

PAPER_MM = {10: 0.69, 5: 1.4, 2: 3.53, 1: 9.0}
ASKED_MM = {10: 0.55, 5: 1.05, 2: 2.6, 1: 5.0}
THREE_FRAMES = ("osculating_quadric", "circle_epipolar", "circle_radial")
SEEDS = 4
SIGMA_SEEDS = 30  # errors go on along a contour: one rim alone spreads by 0.4 to 1.5 sigmas
PLOT_SEEDS = 16


def main() -> None:
    """Run the measurements."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="directory of JSON and plots")
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=beside, help="recorded sequences")
    tables = {
        "sphere": ("1. The paper's sphere, mm", sphere_table),
        "general": ("2. General motion, a_-1 and a_1 of one sign: mean depth error, mm",
                    general_motion),
        "efficiency": ("3. Variance over the Cramer-Rao bound", efficiency),
        "sigma": ("3. Errors over depth_sigma on the paper's sphere", sigmas),
        "bodies": ("4. Whole turns off the axis and tilted, medians", turns.bodies),
        "far": ("Near-orthographic: 50 times as far, 50 times the focal length",
                turns.near_orthographic),
        "dinosaur": ("5. The dinosaur",
                     lambda: turns.dinosaur(arguments.data / "oxford_dino")),
        "time": ("6. Processor time of a frame", turns.times),
    }  # fmt: skip
    parser.add_argument("--only", nargs="+", choices=tables, default=list(tables))
    arguments = parser.parse_args()
    out = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    show("The measure: truth against itself, and moved by 1 mm", check_the_measure())
    result: dict[str, list[Row]] = {}
    for name in arguments.only:
        if name == "dinosaur" and not (arguments.data / "oxford_dino").is_dir():
            print(f"\n5. left out: no oxford_dino in {arguments.data}")
            continue
        title, measure = tables[name]
        result[name] = show(title, measure())
    if "sphere" in result:
        figure_10(out / "figure10.png")
    if "bodies" in result:
        turns.plot_bodies(result["bodies"], out / "bodies.png")
    if "time" in result:
        turns.plot_times(result["time"], out / "time.png")
    (out / "accuracy.json").write_text(json.dumps(result, indent=1), encoding="utf-8")


def sphere_rims(
    step_deg: float, frames: int, estimator: str, seeds: int = SEEDS
) -> Iterator[dict[str, Array]]:
    """Errors on the paper's sphere, for each seed of the noise."""
    baseline = float(np.deg2rad(step_deg * (frames // 2))) * 0.99
    for seed in range(seeds):
        body, _, contours = paper_sphere(
            float(np.deg2rad(step_deg)), frames, seed=seed, smooth=smooth
        )
        settings = RimSettings(baseline=baseline, estimator=estimator)
        yield errors(body, contours[frames // 2], one_rim(contours, settings))


def sphere_table() -> list[Row]:
    """Item 1: three frames by step, and many frames over +-10 degrees.

    The paper's figures stand beside those of its method, with lower limits; that of multi_frame
    is half of the least of them. The circle methods stand below.
    """
    cases = [(step, 3, name) for name in THREE_FRAMES for step in PAPER_MM]
    cases += [(1, 21, name) for name in ("osculating_quadric", *MANY_FRAMES)]
    rows: list[Row] = []
    for step, frames, name in cases:
        e = together(sphere_rims(step, frames, name))
        every = float(np.abs(e["kept"]).mean())
        row: Row = {
            "estimator": name,
            "step deg": step,
            "frames": frames,
            "depth, all": every,
            "depth, good": float(np.abs(e["depth"]).mean()),
            "depth median": float(np.median(np.abs(e["depth"]))),
            "distance mean": float(np.abs(e["distance"]).mean()),
            "curvature": float(np.median(np.abs(e["curvature"]))),
            "status 0": float(e["good"].mean()),
        }
        if frames == 3 and name == "osculating_quadric":
            row |= {"paper": PAPER_MM[step]} | within(every, ASKED_MM[step])
        elif name == "multi_frame":
            row |= within(every, min(PAPER_MM.values()) / 2)
        rows.append(row)
    return rows


def sigmas() -> list[Row]:
    """Item 3, of the whole way from noisy contours: standard deviation of the errors over
    depth_sigma, status-0 points."""
    cases = [(step, 3, "osculating_quadric") for step in PAPER_MM] + [(1, 21, "multi_frame")]
    rows: list[Row] = []
    for step, frames, name in cases:
        e = together(sphere_rims(step, frames, name, SIGMA_SEEDS))
        spread, good = float(e["score"].std()), float(e["good"].mean())
        row: Row = {"estimator": name, "step deg": step, "frames": frames}
        rows.append(row | {"figure": "error/sigma", "value": spread} | between(spread, 0.9, 1.1))
        rows.append(row | {"figure": "status 0", "value": good} | reaches(good, 0.9))
    return rows


def correspondents(body: SceneObject, view: Contours, other: Contours) -> Rays:
    """The true correspondents: of the candidates the one whose ray passes nearest."""
    depth, _ = body.exact_depth(view)
    ray = view.centre + depth[:, None] * view.T - other.centre
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    found = crossed_candidates(Pencil(view, other)).candidates
    directions = other.directions_at(found.row, found.fraction)
    miss = np.linalg.norm(directions - ray[found.sample], axis=1)
    # Sample by sample the nearest last, so that it is the one that stays.
    order = np.argsort(-miss)
    T, N = np.full((2, len(view), 3), np.nan)
    T[found.sample[order]] = directions[order]
    N[found.sample[order]] = other.normals_at(found.row, found.fraction)[order]
    return Rays(other.centre, T, N, view.sigma)


def rays(contours: Contours) -> Rays:
    """A view's own rays."""
    return Rays(contours.centre, contours.T, contours.N, contours.sigma)


def general_motion() -> list[Row]:
    """Item 2: exact contours, both partners above the view and to either side.

    The limit is that of the paper's figures, which are of a sphere. On other bodies the
    shape of third order adds an error of its own to each method.
    """
    rows: list[Row] = []
    for which in ("sphere", "ellipsoid", "gourd", "wavy"):
        body = make_object(which) if which != "sphere" else paper_sphere(0.1, 1, 0)[0]
        reach = 1.3 if which == "sphere" else 1.0
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
        depths = {name: ESTIMATORS[name](view, partners).depth for name in THREE_FRAMES}
        mean = {
            name: float(1e3 * np.nanmean(np.abs(depth - truth)[same]))
            for name, depth in depths.items()
        }
        for method in THREE_FRAMES[1:]:
            ratio = mean["osculating_quadric"] / mean[method]
            row: Row = {"body": which, "points": int(same.sum()), "method": method,
                        "its error": mean[method], "the quadric's": mean["osculating_quadric"],
                        "ratio": ratio}  # fmt: skip
            rows.append(row | (within(ratio, 0.1) if which == "sphere" else {}))
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
            variance = float(off.var() / bound**2)
            spread = float((off / found.depth_sigma).std())
            row: Row = {
                "estimator": name,
                "frames": frames,
                "bound mm": 1e3 * bound,
                "sd mm": float(1e3 * off.std()),
                "bias mm": float(1e3 * off.mean()),
                "variance/bound": variance,
                **within(variance, 1.15),
                "error/sigma": spread,
                **between(spread, 0.85, 1.2),
            }
            rows.append(row)
    return rows


def figure_10(path: Path) -> None:
    """Depth and radius error along the rim of the paper's sphere, 10 degrees a step."""
    names = ("osculating_quadric", "circle_epipolar", "circle_radial")
    figure, axes = plt.subplots(2, 3, figsize=(13, 6.5), sharex=True, sharey="row")
    for column, name in zip(axes.T, names, strict=True):
        sums: list[list[NDArray[Any]]] = [[], []]
        for seed in range(PLOT_SEEDS):
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
