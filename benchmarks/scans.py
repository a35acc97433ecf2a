"""Whole scans by the command itself: against the truth, and against recorded silhouettes.

    python benchmarks/scans.py [--out FILE.json] [--data FOLDER] [--quick]

demo        rim points with status 0 against the true surface; an object of 0.2 m, 1 m away,
            1280x960, f = 1600 px, where a pixel is 0.63 mm
recorded    the closed body against the masks that came with the sequences
scanned     the same of photographs on a printed board, of which nothing else is told
"""

import argparse
import json
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from boards import APPLE_BOARD
from table import Row, show

from occ_recon_ros.cli import main as occ_recon
from occ_recon_ros.poses import board_to_yaml

DEMOS = (
    ("occ-recon demo", ["--object", "vase"]),
    ("occ-recon demo --object mug", ["--object", "mug"]),
    ("occ-recon demo --object torus --noise 0.5", ["--object", "torus", "--noise", "0.5"]),
)
RECORDED = (
    ("oxford_dino", []),
    ("oxford_dino", ["--no-masks"]),
    ("dino_ring", []),
    ("dino_ring", ["--no-masks"]),
    ("apple_aruco", []),
)


def run(*arguments: object) -> None:
    """A command that must go well; 3, judged as failed, is a result too."""
    code = occ_recon([str(argument) for argument in arguments])
    if code not in (0, 3):
        raise SystemExit(f"occ-recon {' '.join(map(str, arguments))}: exit code {code}")


def report_of(folder: Path) -> dict[str, Any]:
    """report.json of a folder of results."""
    report: dict[str, Any] = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    return report


def demo(command: str, arguments: list[str], folder: Path) -> Row:
    """A row of a virtual scan."""
    run("demo", *arguments, "--out", folder / "out", "--quiet")
    report = report_of(folder / "out")
    distance = report["truth"]["distance"]
    return {
        "command": command,
        "mean mm": distance["mean_mm"],
        "99th percentile mm": distance["p99_mm"],
        "good samples": report["samples"]["fraction_good"],
        "decode to strip ms": report["decode_to_strip_ms"]["median_ms"],
        "verdict": report["verdict"]["word"],
    }


def recorded(sequence: Path, options: list[str], folder: Path) -> Row:
    """A row of a recorded scan: imported with ``options``, judged by the masks it came with."""
    run("import", sequence, folder / "played.mcap", *options, "--quiet")
    run("import", sequence, folder / "masked.mcap", "--quiet")
    run("replay", folder / "played.mcap", "--out", folder / "out", "--quiet")
    report = report_of(folder / "out")
    row: Row = {
        "sequence": " ".join([sequence.name, *options]),
        "images": report["frames"]["images"],
        "good samples": report["samples"]["fraction_good"],
        "masks": report["source"]["segmentation"]["way"] if options else "as they came",
        "verdict": report["verdict"]["word"],
    }
    return row | agreement(ious(folder / "out", folder / "masked.mcap"))


def ious(results: Path, bag: Path) -> list[float]:
    """IoU of the closed body of a folder of results with each mask of a bag; none without one."""
    body, figures = results / "closed.ply", results.parent / "figures.json"
    if not body.exists():
        return []
    run("evaluate", body, "--bag", bag, "--out", figures, "--overwrite", "--quiet")
    return [v["iou"] for v in json.loads(figures.read_text(encoding="utf-8"))["views"]]


def agreement(values: Sequence[float]) -> Row:
    """Columns of a table, none where there are no values."""
    return {"IoU mean": sum(values) / len(values), "IoU least": min(values)} if values else {}


def scanned(sequence: Path, folder: Path) -> Iterator[Row]:
    """Rows of `scan`, which is given the photographs and their board alone: with the masks that
    came, and without. Judged by these masks."""
    board = folder / "board.yaml"
    board.write_text(board_to_yaml(APPLE_BOARD))
    masked = folder / "masked"
    for how, out in ((["--masks", sequence / "masks"], masked), ([], folder / "bare")):
        command = ("scan", sequence / "images", "--board", board, *how, "--out", out, "--quiet")
        run(*command)
        report = report_of(out)
        yield {
            "photographs": " ".join([sequence.name, *map(str, how[:1])]),
            "images": report["frames"]["images"],
            "good samples": report["samples"]["fraction_good"],
            "verdict": report["verdict"]["word"],
            **agreement(ious(out, masked / "scan.mcap")),
        }


def main() -> None:
    """Run the scans."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/scans.json"))
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=beside, help="recorded sequences")
    parser.add_argument("--quick", action="store_true", help="the first demo and recording alone")
    given = parser.parse_args()
    few = slice(0, 1) if given.quick else slice(None)
    result: dict[str, list[Row]] = {"demo": [], "recorded": [], "scanned": []}
    with tempfile.TemporaryDirectory() as scratch:
        for number, (command, arguments) in enumerate(DEMOS[few]):
            (folder := Path(scratch) / f"demo{number}").mkdir()
            result["demo"].append(demo(command, arguments, folder))
        for number, (name, options) in enumerate(RECORDED[few]):
            if (given.data / name).is_dir():
                (folder := Path(scratch) / f"recorded{number}").mkdir()
                result["recorded"].append(recorded(given.data / name, options, folder))
        apple = given.data / "apple_aruco"
        if apple.is_dir() and not given.quick:
            (folder := Path(scratch) / "scanned").mkdir()
            result["scanned"] += scanned(apple, folder)
    for name, rows in result.items():
        if rows:
            show(name, rows)
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
