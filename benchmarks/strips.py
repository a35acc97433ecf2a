"""What a strip costs early and late in a scan, and how much memory the surface takes.

    python benchmarks/strips.py [--turns 100] [--frames 36] [--out FILE.json]

The rims of one exact turn of the vase come again and again with stamps of their own. Time is that
of this process for adding a rim and encoding its message, the median over a turn: one surface in
its second turn and one in its last, frame by frame side by side.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from msg_adapters import encode_strip
from occ_recon_ros.geometry import Rim, RimReconstructor
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.surface import Surface


def turn(frames: int) -> list[Rim]:
    """The rims of a closed turn; the rim before the first is the last."""
    vase, reconstructor = make_object("vase"), RimReconstructor()
    settings = TurntableSettings(frames=frames, step=2 * np.pi / frames)
    rims: dict[int, Rim] = {}
    for k, camera in enumerate(turntable_cameras(settings)):
        for rim in reconstructor.add(vase.exact_contours(camera, stamp_ns=k + 1)):
            rims[rim.stamp_ns] = rim
    rims |= {rim.stamp_ns: rim for rim in reconstructor.finish()}
    return [rims[stamp] for stamp in sorted(rims)]


class Scan:
    """A surface that the rims of one turn come to again and again."""

    def __init__(self, rims: list[Rim]) -> None:
        self._rims, self._surface, self._frame = rims, Surface(), 0
        self.most_bytes = 0

    def go(self, frames: int = 1) -> tuple[float, int]:
        """Milliseconds for the last strip and its message, and the bytes of that."""
        milliseconds, size = 0.0, 0
        for _ in range(frames):
            self._frame += 1
            rim = self._rims[(self._frame - 1) % len(self._rims)]
            rim = replace(rim, stamp_ns=self._frame, prev_stamp_ns=self._frame - 1 or None)
            started = time.process_time_ns()
            message = encode_strip(self._surface.add(rim))
            milliseconds = 1e-6 * (time.process_time_ns() - started)
            size = len(message.data)
            self.most_bytes = max(self.most_bytes, self._surface.nbytes)
        return milliseconds, size


def main() -> None:
    """Print the table, write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--turns", type=int, default=100)
    parser.add_argument("--frames", type=int, default=36)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    rims, n = turn(given.frames), given.frames
    scans = {"early": Scan(rims), "late": Scan(rims)}
    scans["early"].go(n)
    after_a_turn = scans["early"].most_bytes
    scans["late"].go(n * (given.turns - 1))
    # The two by turns, for the machine does not stay as fast as it is.
    pairs = np.array([[scan.go() for scan in scans.values()] for _ in range(n)])
    rows = dict(zip(scans, pairs.transpose(1, 0, 2), strict=True))
    report = {
        name: {
            "after_frames": n if name == "early" else n * (given.turns - 1),
            "strip_ms_median": float(np.median(row[:, 0])),
            "message_bytes_median": float(np.median(row[:, 1])),
        }
        for name, row in rows.items()
    }
    early, late = report.values()
    report["late_over_early"] = {key: late[key] / early[key] for key in list(early)[1:]}
    most = scans["late"].most_bytes
    report["memory"] = {
        "after_a_turn_bytes": after_a_turn,
        "most_bytes": most,
        "ratio": most / after_a_turn,
    }
    for name, figures in report.items():
        print(name, "  ".join(f"{key} {value:.4g}" for key, value in figures.items()))
    if given.out:
        given.out.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
