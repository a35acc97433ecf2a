"""Scans that are bumped, end oddly or are told wrong poses, by the command itself.

    python benchmarks/odd_scans.py [--sequences NAME ...] [--only WORDS ...] [--with-masks]
                                   [--segment] [--data FOLDER] [--out FILE]

A recorded turn is spoilt, imported without its masks and replayed; its body is held against the
right masks of the views that are not spoilt, in the cameras that `replay` found (as `evaluate`
does). With --with-masks they are played, or what was brought in their place; with --segment the
masks of `segment` are judged, in place of the body. Seconds and memory are those of the command, in
a process of its own.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from odd_turns import SPOILERS, Turn, View
from recorded import real_frames
from scans import agreement, ious, report_of, run
from table import Row, show

from occ_recon_ros.bags.views import BagViews

SEQUENCES = ("oxford_dino", "dino_ring")
_COMMAND = "from occ_recon_ros.cli import main; main()"


def write(turn: Sequence[View], folder: Path) -> None:
    """A folder that `occ-recon import` takes, lengths in metres."""
    frames = []
    for k, view in enumerate(turn):
        names = f"{k:03d}.png", f"{k:03d}_mask.png"
        cv2.imwrite(str(folder / names[0]), view.image)
        cv2.imwrite(str(folder / names[1]), view.mask)
        c = view.camera
        frames.append(
            {
                "file": names[0],
                "mask": names[1],
                "stamp": 0.2 * k,
                "width": c.width,
                "height": c.height,
                "K": c.K.tolist(),
                "D": c.D.tolist(),
                "R": c.R_camera_object.tolist(),
                "t": c.t_camera_object.tolist(),
            }
        )
    content = {"unit_in_metres": 1.0, "frames": frames}
    (folder / "cameras.json").write_text(json.dumps(content))


def spent(*arguments: object) -> tuple[float, float]:
    """Seconds, and MB at most, of a command that must go well; 3, judged as failed, is a result."""
    started = time.monotonic()
    child = subprocess.Popen([sys.executable, "-c", _COMMAND, *map(str, arguments)])
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = code = os.waitstatus_to_exitcode(status)
    if code not in (0, 3):
        raise SystemExit(f"occ-recon {' '.join(map(str, arguments))}: exit code {code}")
    return time.monotonic() - started, usage.ru_maxrss / 1024


def measured(name: str, turn: Turn, given: argparse.Namespace, folder: Path) -> Row:
    """A row of the table."""
    bare, masked, brought = (folder / f"{kind}.mcap" for kind in ("bare", "masked", "brought"))
    write([v if v.brought is None else replace(v, mask=v.brought) for v in turn], folder)
    run("import", folder, brought, "--quiet")
    write(turn, folder)
    judged = [not view.spoilt for view in turn]
    turn.clear()  # images of many pixels take more than the command does
    run("import", folder, masked, "--quiet")
    run("import", folder, bare, "--no-masks", "--quiet")
    if given.segment:
        found = folder / "found.mcap"
        seconds, most = spent("segment", bare, found, "--quiet")
        row: Row = {"turn": name}
        views = zip(BagViews(found), BagViews(masked), strict=True)
        values = [_iou(own.mask, right.mask) for own, right in views]
    else:
        out = folder / "out"
        played = brought if given.with_masks else bare
        seconds, most = spent("replay", played, "--out", out, "--quiet")
        report = report_of(out)
        row = {
            "turn": name,
            "verdict": report["verdict"]["word"],
            "good samples": report["samples"]["fraction_good"],
            "views named": len(report["source"]["segmentation"].get("bad_views", {})),
        }
        values = ious(out, masked)
    row |= agreement([iou for iou, right in zip(values, judged, strict=False) if right])
    return row | {"seconds": seconds, "MB": most}


def _iou(own: NDArray[np.uint8] | None, right: NDArray[np.uint8] | None) -> float:
    if own is None or right is None:
        return 0.0
    both = np.count_nonzero((own > 127) & (right > 127))
    return both / max(1, np.count_nonzero((own > 127) | (right > 127)))


def main() -> None:
    """Spoil, replay, judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/odd_scans.json"))
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=beside, help="recorded sequences")
    parser.add_argument("--only", nargs="*", default=[""], help="cases with one of these in them")
    parser.add_argument("--sequences", nargs="*", default=SEQUENCES)
    parser.add_argument("--with-masks", action="store_true", help="play the masks as well")
    parser.add_argument("--segment", action="store_true", help="judge the masks of segment")
    given = parser.parse_args()
    rows: list[Row] = []
    for sequence in given.sequences:
        if not (given.data / sequence).is_dir():
            continue
        turn = [View(*frame) for frame in real_frames(given.data / sequence)]
        for how, spoil in SPOILERS.items():
            name = f"{sequence}, {how}"
            if any(words in name for words in given.only):
                with tempfile.TemporaryDirectory() as scratch:
                    rows.append(measured(name, [*spoil(turn)], given, Path(scratch)))
                show("odd scans", rows[-1:])
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
