"""Accuracy and speed of the contours, next to OpenCV's and scikit-image's.

    python benchmarks/contours.py [--out FILE.json] [--data FOLDER] [--quick]

Prints tables and writes every number to a JSON file.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from contour_cases import STRESS, distances, ellipse_case, stress_distances, stress_frames
from numpy.typing import NDArray
from recorded import from_mask, real_frames, region

from occ_recon_ros.imaging import ContourSettings, ContourTracker
from occ_recon_ros.scene import RenderSettings, TurntableSettings, make_object, render
from occ_recon_ros.scene import turntable_cameras as cameras

Array = NDArray[np.float64]
Row = dict[str, Any]


def by_opencv(image: NDArray) -> Array:
    """The longest chain of cv2.findContours after Otsu's threshold, object pixels."""
    dark = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)[1]
    chains = cv2.findContours(dark, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    return max(chains, key=len).reshape(-1, 2).astype(np.float64)


def by_skimage(image: NDArray) -> Array:
    """The longest of skimage's iso-contours at Otsu's threshold."""
    from skimage.measure import find_contours

    level = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[0] + 0.5
    return max(find_contours(image.astype(float), level), key=len)[:, ::-1]


def discs(trials: int) -> list[Row]:
    """Rendered discs and ellipses at random sub-pixel places: bias and scatter."""
    rows = []
    for radius in (8, 12, 20, 50, 150, 400):
        for blur, contrast, noise in (
            (0.5, 100, 0), (1, 100, 4), (2, 100, 4), (1, 40, 4), (1, 200, 8), (2, 40, 8),
        ):  # fmt: skip
            errors: dict[str, list[Array]] = {"ours": [], "opencv": [], "skimage": []}
            ratios = []
            for trial in range(trials):
                case = ellipse_case(radius, blur, contrast, noise, seed=trial)
                found = ContourTracker().process(case.image, case.camera, 0, "turntable")
                error = case.errors(found.uv)
                errors["ours"].append(error)
                sigma = found.sigma / found.radians_per_pixel
                ratios.append((error / sigma)[np.isfinite(sigma)])
                errors["opencv"].append(case.errors(by_opencv(case.image)))
                errors["skimage"].append(case.errors(by_skimage(case.image)))
            row: Row = {"radius": radius, "blur": blur, "contrast": contrast, "noise": noise}
            for name, each in errors.items():
                row[f"{name} bias"] = float(np.mean([e.mean() for e in each]))
                row[f"{name} scatter"] = float(np.sqrt(np.mean([e.var() for e in each])))
            row["bias is good to"] = float(
                np.std([e.mean() for e in errors["ours"]]) / np.sqrt(trials)
            )
            row["error / sigma"] = float(np.std(np.concatenate(ratios)))
            rows.append(row)
    return rows


def stress(quick: bool) -> list[Row]:
    """The stress sequences by threshold and by snake, against the truth."""
    rows = []
    for case in STRESS:
        frames = stress_frames(case, 8 if quick else 24)
        row: Row = {"case": case, "unseen share": 0.0}
        for name, tracking in (("threshold", "none"), ("snake", "snake")):
            seen, unseen, drops = stress_distances(frames, tracking)
            row[f"{name} seen"] = float(seen.mean())
            row[f"{name} unseen"] = float(unseen.mean()) if len(unseen) else None
            row[f"{name} drops"] = drops
            row["unseen share"] = len(unseen) / (len(unseen) + len(seen))
        rows.append(row)
    return rows


def loops(quick: bool) -> list[Row]:
    """Loop counts and identities of a mug and a torus through a turn."""
    rows = []
    for name, tilt, elevation in (("mug", 0.0, 0.26), ("torus", 0.6, 0.6)):
        thing = make_object(name)
        views = cameras(TurntableSettings(elevation=elevation, axis_tilt=tilt))
        for tracking in ("none", "snake"):
            tracker = ContourTracker(ContourSettings(tracking=tracking))
            wrong, kept, broken, error, said = 0, 0, 0, [], []
            before: set[int] = set()
            for i, camera in enumerate(views[:12] if quick else views):
                image = render(thing, camera, RenderSettings(noise=1.0), seed=i)
                found = tracker.process(image, camera, i, "turntable")
                truth = thing.exact_contours(camera, 0.5)
                ids = set(found.loop.tolist())
                count = len(truth.loop_starts)
                wrong += len(found.loop_starts) != count
                if len(before) == count - 1:
                    kept += ids == before
                    broken += ids != before
                before = ids
                error.append(float(np.mean(distances(truth, found))))
                said += tracker.events()
            rows.append(
                {
                    "object": name,
                    "tracking": tracking,
                    "wrong counts": wrong,
                    "identities kept": kept,
                    "identities broken": broken,
                    "mean error": float(np.mean(error)),
                    "reports": said,
                }
            )
    return rows


def real(folder: Path) -> list[Row]:
    """The recorded sequences: without masks the region, with them the distance to them."""
    rows = []
    for name, use_mask in (("oxford_dino", False), ("oxford_dino", True), ("apple_aruco", True)):
        tracker = ContourTracker()
        iou, away, rough, mask_rough = [], [], [], []
        for i, (image, mask, camera) in enumerate(real_frames(folder / name)):
            found = tracker.process(image, camera, i, "turntable", mask if use_mask else None)
            inside, given = region(found, mask.shape), mask > 0
            iou.append(float((inside & given).sum() / (inside | given).sum()))
            edge = max(
                cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)[0], key=len
            ).reshape(-1, 2)
            away.append(from_mask(found.uv, mask))
            rough.append(_roughness(found.uv[found.loop == found.loop[0]]))
            mask_rough.append(_roughness(edge.astype(np.float64)))
        distance = np.concatenate(away)
        rows.append(
            {
                "sequence": name,
                "masks given": use_mask,
                "IoU mean": float(np.mean(iou)),
                "IoU min": float(np.min(iou)),
                "px from mask p99": float(np.percentile(distance, 99)),
                "px from mask max": float(distance.max()),
                "roughness": float(np.mean(rough)),
                "roughness of mask": float(np.mean(mask_rough)),
                "segmentation": tracker.events()[0],
            }
        )
    return rows


def _roughness(points: Array) -> float:
    """Mean turn of the tangent over what it must turn, from chords of 2 px."""
    chord = np.roll(points, -2, axis=0) - points
    angle = np.arctan2(chord[:, 1], chord[:, 0])
    turn = np.abs((np.diff(angle) + np.pi) % (2 * np.pi) - np.pi)
    return float(turn.sum() / (2 * np.pi))


def speed() -> Row:
    """The whole work on a 1920x1080 mono8 image, next to blur + threshold + findContours."""
    camera = cameras(TurntableSettings(frames=1, width=1920, height=1080, focal_px=2400))[0]
    image = render(make_object("vase"), camera, RenderSettings(noise=2.0))
    row: Row = {"size": "1920x1080"}

    def plain() -> None:
        soft = cv2.GaussianBlur(image, (5, 5), 0)
        dark = cv2.threshold(soft, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)[1]
        cv2.findContours(dark, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)

    trackers = {t: ContourTracker(ContourSettings(tracking=t)) for t in ("none", "snake")}
    work: dict[str, Callable[[], object]] = {"plain ms": plain}
    for name, tracker in trackers.items():
        work[f"{name} ms"] = lambda t=tracker: t.process(image, camera, 0, "turntable")
    spent: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(40):  # by turns, so that all meet the same load of the machine
        for name, run in work.items():
            start = time.perf_counter()
            run()
            spent[name].append(1e3 * (time.perf_counter() - start))
    row |= {name: statistics.median(each) for name, each in spent.items()}
    row["samples"] = len(trackers["none"].process(image, camera, 0, "turntable"))
    row["ratio"] = row["none ms"] / row["plain ms"]
    return row


def show(title: str, rows: list[Row]) -> None:
    print(f"\n{title}")
    names = [n for n in rows[0] if n != "reports"]
    table = [[_cell(row[n]) for n in names] for row in rows]
    widths = [max(len(n), *(len(line[i]) for line in table)) for i, n in enumerate(names)]
    for line in [names, *table]:
        print("  ".join(cell.rjust(w) for cell, w in zip(line, widths, strict=True)))
    for row in rows:
        for sentence in row.get("reports", []):
            print(f"    {row['object']}, tracking {row['tracking']}: {sentence}")


def _cell(value: Any) -> str:
    return f"{value:.4f}" if isinstance(value, float) else "-" if value is None else str(value)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/contours.json"))
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=beside, help="recorded sequences")
    parser.add_argument("--quick", action="store_true", help="fewer trials")
    arguments = parser.parse_args()
    result: dict[str, list[Row]] = {"discs": discs(3 if arguments.quick else 20)}
    show("Discs and ellipses, px", result["discs"])
    result["stress"] = stress(arguments.quick)
    show("Stress sequences, mean px from the true outline", result["stress"])
    result["loops"] = loops(arguments.quick)
    show("Loops through a turn", result["loops"])
    if arguments.data.is_dir():
        result["real"] = real(arguments.data)
        show("Recorded sequences", result["real"])
    result["speed"] = [speed()]
    show("Time of a frame, median", result["speed"])
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(result, indent=1))
    print(f"\nwritten to {arguments.out}")


if __name__ == "__main__":
    main()
