"""All benchmarks in their quick forms, and docs/BENCHMARKS.md from what they measure.

    python benchmarks/all.py [--only NAME ...] [--json FOLDER] [--tables]

Each writes its numbers to FOLDER (out/bench), from which the tables are made: one that is not run
now keeps those of its last time. What stands in the page above the tables is kept: what programs
measured that need more than this one has. ``make bench`` calls this.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
BELOW = "<!-- Below: written by `make bench`. -->"
PACKAGES = ("numpy", "scipy", "opencv-python-headless", "trimesh", "ros-jazzy-rclpy")


@dataclass(frozen=True)
class Benchmark:
    """A program beside this one.

    Attributes:
        title: what it is about.
        arguments: of the quick form; {out} is where the numbers go.
        numbers: the file they are in.
    """

    title: str
    arguments: tuple[str, ...]
    numbers: str


def _quick(name: str, title: str, *arguments: str) -> Benchmark:
    return Benchmark(title, (f"benchmarks/{name}.py", *arguments, "--out", "{out}"), f"{name}.json")


BENCHMARKS = {
    "scans": _quick("scans", "Whole scans by the command"),
    "photographs": _quick("photographs", "Photographs as they come", "--quick"),
    "poses": _quick("poses", "Poses: boards, axis, refinement"),
    "contours": _quick("contours", "Contours next to OpenCV's and scikit-image's", "--quick"),
    "accuracy": Benchmark(
        "Depth and curvature next to the paper's figures, its rivals and the Cramer-Rao bound",
        ("benchmarks/accuracy.py", "--out", "{folder}/accuracy"),
        "accuracy/accuracy.json",
    ),
    "surface": _quick("surface", "The closed body next to the exact hull and carvings", "--quick"),
    "speed": _quick("speed", "What a frame costs", "--quick"),
    "strips": _quick("strips", "A strip in the second turn and in the twentieth", "--turns", "20"),
    "large": _quick("large", "Very many frames and very many samples", "--quick"),
    "rigs": _quick("rigs", "One to eight rigs on one machine", "--seconds", "20"),
    "kills": _quick("kills", "Nodes killed at random moments", "--kills", "4"),
    "live": _quick(
        "live", "What worker and page cost a live scan", "turn", "worker", "page", "--pairs", "2"
    ),
    "soak": _quick("soak", "Two thousand frames through three processes", "--frames", "2000"),
}


def here() -> dict[str, Benchmark]:
    """Those whose program is there."""
    return {n: b for n, b in BENCHMARKS.items() if (ROOT / b.arguments[0]).exists()}


def command(benchmark: Benchmark, folder: Path) -> list[str]:
    """Its command line."""
    out = folder / benchmark.numbers
    return ["python", *(a.format(out=out, folder=folder) for a in benchmark.arguments)]


def page(folder: Path, before: str = "# Benchmarks\n\n") -> str:
    """docs/BENCHMARKS.md, from the numbers in a folder; its head is that of the page before."""
    cores = os.cpu_count()
    lines = [
        before.partition(BELOW)[0] + BELOW,
        "",
        "`python benchmarks/all.py` runs the quick form of each program, whose head says what is",
        "measured and how; without `--quick` it takes longer and says more.",
        "",
        f"On {_cpu()}, {cores} cores, {platform.system()}, Python {platform.python_version()}, "
        f"{', '.join(f'{name} {version(name)}' for name in PACKAGES)}.",
        "",
    ]
    for benchmark in here().values():
        numbers = folder / benchmark.numbers
        if not numbers.exists():
            continue
        words = command(benchmark, Path("out/bench"))
        lines += [f"## {benchmark.title}", "", f"    {' '.join(words)}", ""]
        found = json.loads(numbers.read_text(encoding="utf-8"))
        for name, rows in tables(found):
            lines += [f"### {name}", "", *markdown(rows), ""]
    return "\n".join(lines)


def tables(found: Any) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Titles and rows of what a program has written: lists of rows, or rows by name."""
    if isinstance(found, list):
        found = {"figures": found}
    loose: dict[str, Any] = {}
    for name, value in found.items():
        if isinstance(value, list) and value and all(isinstance(row, dict) for row in value):
            yield name, value
        elif isinstance(value, dict):
            loose[name] = value
    plain = {k: v for k, v in found.items() if isinstance(v, (int, float, str))}
    if plain:
        yield "figures", [plain]
    if loose:
        yield "figures", [{"": name, **row} for name, row in loose.items()]


def markdown(rows: list[dict[str, Any]], most: int = 40) -> Iterator[str]:
    """A table; of very many rows some, evenly spread."""
    rows = rows[:: -(-len(rows) // most)]
    flat = [{k: v for k, v in row.items() if not isinstance(v, (dict, list))} for row in rows]
    names = list(dict.fromkeys(name for row in flat for name in row))
    yield f"| {' | '.join(map(_cell, names))} |"
    yield "|" + "---|" * len(names)
    for row in flat:
        yield f"| {' | '.join(_cell(row.get(name, '')) for name in names)} |"


def _cell(value: Any) -> str:
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return text.replace("|", "\\|")


def _cpu() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def main() -> int:
    """Run them and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=list(here()), default=list(here()))
    parser.add_argument("--json", type=Path, default=Path("out/bench"), help="of the numbers")
    parser.add_argument("--tables", action="store_true", help="run none, write the page alone")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "BENCHMARKS.md")
    given = parser.parse_args()
    given.json.mkdir(parents=True, exist_ok=True)
    failed = []
    for name in () if given.tables else given.only:
        words = command(here()[name], given.json.resolve())
        print(f"\n== {' '.join(words)}", flush=True)
        if subprocess.run([sys.executable, *words[1:]], cwd=ROOT, check=False).returncode:
            failed.append(name)
    before = given.page.read_text(encoding="utf-8") if given.page.exists() else "# Benchmarks\n\n"
    given.page.write_text(page(given.json, before), encoding="utf-8")
    print(f"\n{given.page}" + (f"; failed: {', '.join(failed)}" if failed else ""))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
