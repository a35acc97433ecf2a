"""Masks from photographs by an independent, path-tracing renderer, with exact masks and cameras.

    python -m venv blender && blender/bin/pip install bpy==4.2.0 opencv-python-headless
    blender/bin/python benchmarks/path_traced.py render FOLDER [--only SCENE ...] [--samples N]
    python benchmarks/path_traced.py judge FOLDER [--only SCENE ...]

``render`` needs Blender as a module (CPython 3.11; some 10 s a view on two cores), and nothing of
ours; what is there already is kept. ``judge`` puts each folder through `occ-recon import
--no-masks` and `occ-recon segment`, as a user would, and holds the masks found against the exact
ones. What stands under a figure and is no part of it is not in the exact masks; of the fruit on a
plate `segment` says how to leave that out, and ``judge`` does so. What stands on a printed sheet
goes through `occ-recon scan` instead, which is given the photographs and the sheet alone; with
--told it is given the cameras and not the sheet, as the others are. Folders of photographs by
anybody are judged as well, if their cameras.json names masks.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from path_traced_desk import DESK
from path_traced_home import HOME
from path_traced_rough import ROUGH
from path_traced_scenes import SCENES as TURNS
from path_traced_seller import SELLER
from path_traced_studio import Shot, Studio

SCENES = TURNS | DESK | ROUGH | SELLER | HOME
_UNIT = 0.1  # metres a unit of the scenes
_MASK_SAMPLES = 9
_PLATE = {"fruit"}  # scenes of which the advice of `segment` is followed


def render(scene: str, out: Path, samples: int, views: int | None) -> None:
    """Photographs, masks and cameras.json of one scene."""
    studio = Studio(samples)
    shot = SCENES[scene](studio)
    (out / "masks").mkdir(parents=True, exist_ok=True)
    studio.begin(shot)
    count, frames = views or shot.views, []
    rng, calibration = np.random.default_rng(5), np.random.default_rng(6)
    for k in range(count):
        turn = 2 * np.pi * shot.share * (k + rng.normal(0, 0.1)) / count
        pose = studio.pose(shot, turn)
        told = cv2.Rodrigues(calibration.normal(0, shot.off / shot.focal, 3))[0] @ pose[:3]
        name = f"{k:03d}." + ("jpg" if shot.jpeg else "png")
        image = finished(shot.through_lens(studio.photograph(out)), shot, rng)
        mask = shot.through_lens(studio.mask(out, _MASK_SAMPLES))
        if shot.bars:
            image, mask = (
                cv2.copyMakeBorder(i, 0, 0, shot.bars, shot.bars, cv2.BORDER_CONSTANT, value=0)
                for i in (image, mask)
            )
        quality = [cv2.IMWRITE_JPEG_QUALITY, shot.jpeg] if shot.jpeg else []
        cv2.imwrite(str(out / name), image, quality)
        cv2.imwrite(str(out / "masks" / f"{k:03d}.png"), mask)
        frames.append(
            {
                "file": name,
                "mask": f"masks/{k:03d}.png",
                "width": image.shape[1],
                "height": image.shape[0],
                "K": (shot.K + np.array([[0, 0, shot.bars + shot.off], [0] * 3, [0] * 3])).tolist(),
                "D": list(shot.lens) or [0.0] * 5,
                "R": told[:, :3].tolist(),
                "t": told[:, 3].tolist(),
            }
        )
    (out / "shot.png").unlink()
    if shot.board:
        (out / "board.yaml").write_text(shot.board, encoding="utf-8")
    what = {"unit_in_metres": _UNIT, "name": scene, "frames": frames}
    (out / "cameras.json").write_text(json.dumps(what), encoding="utf-8")


def finished(image: np.ndarray, shot: Shot, rng: np.random.Generator) -> np.ndarray:
    """(h, w, 3) uint8, as a camera would give it: blurred a little, noise that grows with light."""
    light = np.exp(rng.normal(0, shot.exposure)) if shot.exposure else 1.0
    soft = light * cv2.GaussianBlur(image.astype(np.float64), (0, 0), 0.5)
    noise = rng.normal(0, shot.noise, soft.shape) * np.sqrt(0.3 + soft / 128)
    return np.clip(soft + noise, 0, 255).astype(np.uint8)


def judge(folder: Path, told: bool = False) -> str:
    """A line: IoU of the masks found, mean and least, by which way, and how far believed."""
    if (folder / "board.yaml").exists() and not told:
        return _judge_scan(folder)
    bag, found = folder / "images.mcap", folder / "masked.mcap"
    occ_recon("import", folder, bag, "--no-masks", "--overwrite", "--quiet")
    report = occ_recon("segment", bag, found, "--overwrite", "--json")
    if report is None:
        return f"{folder.name:14} refused"
    advice = " ".join(w for w in report.get("warnings", ()) if "--set" in w)
    if folder.name in _PLATE and advice:
        options = [o for o in advice[advice.index("--set") :].split() if o]
        report = occ_recon("segment", bag, found, "--overwrite", "--json", *options)
    scores = list(_scores(folder, found))
    way, belief = report["way"], report.get("belief")
    said = "" if belief is None else f", belief {belief:.2f}"
    return f"{folder.name:14} {np.mean(scores):.3f} {min(scores):.3f}  {way}{said}"


def _judge_scan(folder: Path) -> str:
    """The same of photographs on a board, by `scan`."""
    out = folder / "scan"
    board = ("--board", folder / "board.yaml")
    report = occ_recon("scan", folder, *board, "--out", out, "--overwrite", "--json", "--quiet")
    if report is None:
        return f"{folder.name:14} refused"
    scores = list(_scores(folder, out / "scan.mcap"))
    way = report["source"]["segmentation"]
    said = f"{way['way']}, belief {way.get('belief', 1.0):.2f}, {report['verdict']['word']}"
    return f"{folder.name:14} {np.mean(scores):.3f} {min(scores):.3f}  {said}"


def occ_recon(*arguments: object) -> Any:
    """What a command prints as JSON; None where it ends with an error."""
    command = [str(Path(sys.executable).with_name("occ-recon")), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        print(done.stderr.strip(), file=sys.stderr)
        return None
    return json.loads(done.stdout) if "--json" in arguments else {}


def _scores(folder: Path, found: Path) -> Any:
    from occ_recon_ros.bags.views import BagViews

    frames = json.loads((folder / "cameras.json").read_text(encoding="utf-8"))["frames"]
    views = list(BagViews(found))
    if len(views) < len(frames):  # `scan` gives a photograph a tenth of a second, used or not
        frames = [frames[round((view.stamp_ns - 10**9) / 10**8)] for view in views]
    for frame, view in zip(frames, views, strict=True):
        true = cv2.imread(str(folder / frame["mask"]), cv2.IMREAD_GRAYSCALE) > 127
        mask = np.zeros_like(true) if view.mask is None else view.mask > 127
        yield np.count_nonzero(mask & true) / np.count_nonzero(mask | true)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["render", "judge"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", help="scenes, or folders to be judged")
    parser.add_argument("--samples", type=int, default=4, help="paths a pixel, before denoising")
    parser.add_argument("--views", type=int, help="fewer than the scene has")
    parser.add_argument(
        "--told", action="store_true", help="judge those on a sheet by their cameras too"
    )
    given = parser.parse_args()
    if given.what == "judge":
        for cameras in sorted(given.folder.glob("*/cameras.json")):
            if given.only is None or cameras.parent.name in given.only:
                print(judge(cameras.parent, given.told), flush=True)
        return
    if unknown := set(given.only or ()) - set(SCENES):
        parser.error(f"--only {' '.join(sorted(unknown))}: scenes are {', '.join(sorted(SCENES))}")
    for name in sorted(SCENES) if given.only is None else given.only:
        if not (given.folder / name / "cameras.json").exists():
            # Blender keeps a scene of a process to its end.
            command = [sys.executable, __file__, "render", str(given.folder), "--only", name]
            more = ["--samples", str(given.samples)]
            more += ["--views", str(given.views)] if given.views else []
            if given.only is None or len(given.only) > 1:
                subprocess.run([*command, *more], check=True)
            else:
                render(name, given.folder / name, given.samples, given.views)


if __name__ == "__main__":
    main()
