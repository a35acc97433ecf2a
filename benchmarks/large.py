"""What very many frames and very many samples cost: time and memory against a line.

    python benchmarks/large.py [--quick] [--out FILE.json]

A vase by exact contours, rims and strips, each case in a process of its own. The time is that of
the processor, the median over the frames for one and the end of the scan beside it; the memory is
what the process has grown by, at most. "of linear": what a frame and sample costs in a case over
what it costs in the first of its table; no more than 2 is asked.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from table import Row, show, within

from occ_recon_ros.geometry import RimReconstructor
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.surface import Surface

FRAMES = [(frames, 1000) for frames in (36, 90, 180, 360, 720)]
SAMPLES = [(24, samples) for samples in (1250, 2500, 5000, 10000)]
_MOST = 2.0  # times a line
_USUAL = 1000  # samples of the vase, a pixel apart, at f = 1600 px


def most_mb() -> float:
    """The most memory that this process has had, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def case(frames: int, samples: int) -> Row:
    """One scan, in this process."""
    vase, step = make_object("vase"), 2 * np.pi / max(frames, 36)
    focal = 1600.0 * samples / _USUAL
    width, height = (round(n * focal / 1600) for n in (1280, 960))
    settings = TurntableSettings(
        frames=frames, step=step, focal_px=focal, width=width, height=height
    )
    views = [
        vase.exact_contours(c, stamp_ns=k + 1) for k, c in enumerate(turntable_cameras(settings))
    ]
    # What is compiled or imported at the first rim: finer steps make none of four views.
    _scan(views[:: -(-frames // FRAMES[0][0])][:4])
    before = most_mb()
    spent, end = _scan(views)
    return {
        "frames": frames,
        "samples": int(np.median([len(v) for v in views])),
        "ms a frame": 1e3 * float(np.median(spent[4:])),
        "last tenth ms": 1e3 * float(np.median(spent[-max(len(spent) // 10, 3) :])),
        "end s": end,
        "MB": most_mb() - before,
    }


def _scan(views: list) -> tuple[list[float], float]:
    """Seconds of each frame, and of the end."""
    reconstructor, surface, spent = RimReconstructor(), Surface(), []
    for view in views:
        start = time.process_time()
        for rim in reconstructor.add(view):
            surface.add(rim)
        spent.append(time.process_time() - start)
    start = time.process_time()
    for rim in reconstructor.finish():
        if rim.stamp_ns in surface:
            surface.revise(rim)
        else:
            surface.add(rim)
    return spent, time.process_time() - start


def table(cases: list[tuple[int, int]]) -> list[Row]:
    """All cases of a table, each over a line through the first."""
    rows: list[Row] = []
    for frames, samples in cases:
        command = [sys.executable, __file__, "--case", str(frames), str(samples)]
        found = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        row = json.loads(found)
        first = rows[0] if rows else row
        per_sample = row["ms a frame"] / row["samples"]
        size = row["frames"] * row["samples"]
        row["time of linear"] = per_sample / (first["ms a frame"] / first["samples"])
        row["memory of linear"] = (
            row["MB"] / size / (first["MB"] / first["frames"] / first["samples"])
        )
        worst = max(row["time of linear"], row["memory of linear"])
        rows.append(row | within(worst, _MOST))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="the smaller half of the cases")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--case", nargs=2, type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.case:
        print(json.dumps(case(*given.case)))
        return
    some = slice(0, 2 if given.quick else None)
    found = {
        "frames": show("Frames a turn", table(FRAMES[some])),
        "samples": show("Samples a frame", table(SAMPLES[some])),
    }
    if given.out:
        given.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
