"""Masks found without a hand: single images and all views together, before everything rooms have.

    python benchmarks/photographs.py [--quick] [--data FOLDER] [--only WORDS] [--sheets FOLDER]

FOLDER holds recorded turns (images, masks as the judge, cameras.json) and meshes/spot.obj; what is
not there is left out. Rendered turns have the exact mask. ``auto`` is what `occ-recon segment`
does.
"""

import argparse
import json
import resource
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from photograph_cases import Case, recordings, scenes
from table import Row, show

from msg_adapters import View
from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.evaluation.alone import each_alone
from occ_recon_ros.evaluation.segmentation import Segmentation

_MEAN, _LEAST = 0.97, 0.93


@dataclass
class Turn:
    """A case as if it were a bag."""

    case: Case
    changes: Changes = field(default_factory=Changes)

    def __len__(self) -> int:
        return len(self.case.shots)

    def __iter__(self) -> Iterator[View]:
        for k, shot in enumerate(self.case.shots):
            yield View(k + 1, shot.camera, shot.image, shot.given)

    def masked(self) -> bool:
        return any(s.given is not None for s in self.case.shots)


def measured(case: Case, sheets: Path | None) -> Row:
    """A row of the table."""
    turn = Turn(case)
    row: Row = {"turn": case.name, "views": len(turn)}
    alone = each_alone(turn, lambda *_: None).masks  # type: ignore[arg-type]
    found: dict[str, list[float]] = {"single": _scores(case, alone)}
    for way in ("joint", "auto"):
        step, start = Segmentation(way, case.volume), time.process_time()
        masks = step(turn, lambda *_: None).masks  # type: ignore[arg-type]
        seconds = (time.process_time() - start) / len(turn)
        found[way] = _scores(case, alone if masks is None else masks)
        row |= {f"{way} way": step.report["way"]}
    row |= {
        f"{way} {k}": v
        for way, s in found.items()
        for k, v in (("mean", float(np.mean(s))), ("least", float(min(s))))
    }
    named = set(step.report.get("bad_views", {}))
    row |= {
        "belief": float(step.report.get("belief", 0.0)),
        "s/view": seconds,
        "missed": len(case.spoilt - named),
        "wronged": len(named - case.spoilt),
        "": "pass" if row["auto mean"] >= _MEAN and row["auto least"] >= _LEAST else "SHORT",
    }
    if sheets is not None and masks is not None:
        _write_sheet(case, masks, sheets / (case.name.replace(" ", "_").replace(",", "") + ".png"))
    return row


def _scores(case: Case, masks) -> list[float]:
    out = []
    for k, shot in enumerate(case.shots):
        mask = masks.get(k + 1)
        if mask is None:
            out.append(0.0)
            continue
        a = mask > 127
        out.append(np.count_nonzero(a & shot.truth) / max(1, np.count_nonzero(a | shot.truth)))
    return out


def _write_sheet(case: Case, masks, path: Path) -> None:
    """Found outlines in red, true ones in green."""
    tiles = []
    for k in np.unique(np.linspace(0, len(case.shots) - 1, 12).astype(int)):
        shot = case.shots[k]
        tile = shot.image if shot.image.ndim == 3 else cv2.cvtColor(shot.image, cv2.COLOR_GRAY2BGR)
        tile = tile.copy()
        for mask, colour in ((shot.truth, (0, 255, 0)), (masks.get(k + 1), (0, 0, 255))):
            if mask is not None:
                loops = cv2.findContours(
                    (mask > (0 if mask.dtype == bool else 127)).astype(np.uint8),
                    cv2.RETR_CCOMP,
                    cv2.CHAIN_APPROX_NONE,
                )[0]
                cv2.drawContours(tile, loops, -1, colour, 1)
        tiles.append(cv2.resize(tile, (400, round(400 * tile.shape[0] / tile.shape[1]))))
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % 4)
    cv2.imwrite(
        str(path), np.vstack([np.hstack(tiles[k : k + 4]) for k in range(0, len(tiles), 4)])
    )


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="fewer and smaller views")
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=beside, help="recorded turns and meshes")
    parser.add_argument("--only", default="", help="parts of names of cases, with + between")
    parser.add_argument("--sheets", type=Path, help="folder for pictures of the masks")
    parser.add_argument("--out", type=Path, help="JSON")
    chosen = parser.parse_args(arguments)
    if chosen.sheets:
        chosen.sheets.mkdir(parents=True, exist_ok=True)
    rows = []
    for case in _cases(chosen):
        rows.append(measured(case, chosen.sheets))
        print(
            "  ".join(
                f"{k} {v:.3f}" if isinstance(v, float) else f"{k} {v}" for k, v in rows[-1].items()
            ),
            flush=True,
        )
    show("Masks of all views", rows)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"\n{sum(r[''] == 'pass' for r in rows)} of {len(rows)} pass; peak memory {peak:.0f} MB")
    if chosen.out:
        chosen.out.write_text(json.dumps(rows, indent=1))


def _cases(chosen: argparse.Namespace) -> Iterator[Case]:
    words = [w.strip() for w in chosen.only.split("+") if w.strip()]

    def wanted(name: str) -> bool:
        return not words or any(w in name for w in words)

    n, size = (18, (400, 300)) if chosen.quick else (36, (640, 480))
    table = recordings(chosen.data, 2 if chosen.quick else 1)
    table |= scenes(chosen.data / "meshes", n, size)
    for name, make in table.items():
        if wanted(name):
            yield make()


if __name__ == "__main__":
    main()
