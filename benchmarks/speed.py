"""What a frame costs, stage by stage, beside the least that it can cost and beside carving.

    python benchmarks/speed.py [--quick] [--out FILE.json] [--data FOLDER]

stages    median ms of each stage of a frame, from the messages to the strip, in one thread. The
          floor is what anyone has to do: decode, blur, threshold and cv2.findContours, on the same
          images in the same run
late      the same at the beginning and at the end of many turns: a frame must not cost more
peers     a view of ours against one of a carving of 200^3 cells, from the same contours
start     seconds of CPU until `import occ_recon_ros.geometry` is done, NumPy's own beside it

Times of one thread, by the clock; the ratios are what to quote from a machine that others use too.
"""

import argparse
import json
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
from numpy.typing import NDArray
from recorded import real_frames
from table import Row, show

from msg_adapters import (
    decode_contours,
    decode_image,
    decode_mask,
    decode_rim,
    encode_contours,
    encode_image,
    encode_rim,
    encode_strip,
)
from occ_recon_ros.geometry import Camera, RimReconstructor, compute, matching
from occ_recon_ros.imaging import ContourTracker
from occ_recon_ros.scene import TurntableSettings, make_object, render, turntable_cameras
from occ_recon_ros.surface import Surface

SIZES = ((640, 480), (1280, 960), (1920, 1080), (3840, 2160))
VASE_WIDTH = 1280  # where f = 1600 px shows the vase 0.13 of its distance wide
PARTS = {  # of the two large stages; who does them
    "segment": (ContourTracker, "_segment"),
    "refine": (ContourTracker, "_outline"),
    "correspond": (matching.Partner, "of"),
    "check": (compute._Work, "give_up_outside"),
}
Frame = tuple[NDArray, NDArray | None, Camera]
Times = dict[str, list[float]]


@contextmanager
def timed(times: Times, stage: str) -> Iterator[None]:
    """Add what the block takes, ms."""
    start = time.perf_counter()
    yield
    times[stage].append(1e3 * (time.perf_counter() - start))


def summed(times: Times, stage: str, work: Callable) -> Callable:
    """Add what each call takes to the newest frame's entry, ms."""

    def call(*args: Any, **kwargs: Any) -> Any:
        start = time.perf_counter()
        try:
            return work(*args, **kwargs)
        finally:
            times[stage][-1] += 1e3 * (time.perf_counter() - start)

    return call


def vase_frames(width: int, height: int, colour: bool, frames: int = 36) -> list[Frame]:
    """The rendered vase as a camera of that size sees it."""
    focal = 1600.0 * min(width / VASE_WIDTH, height / 960)
    step = 2 * np.pi / frames
    settings = TurntableSettings(
        frames=frames, step=step, width=width, height=height, focal_px=focal
    )
    vase = make_object("vase")
    images = [(render(vase, camera), camera) for camera in turntable_cameras(settings)]
    return [(cv2.cvtColor(i, cv2.COLOR_GRAY2BGR) if colour else i, None, c) for i, c in images]


def run(frames: Iterable[Frame]) -> Times:
    """A turn through all stages; the ms of each frame by stage."""
    times: Times = defaultdict(list)
    tracker, reconstructor, surface = ContourTracker(), RimReconstructor(), Surface()
    with _parts(times):
        for k, (image, mask, camera) in enumerate(frames):
            for stage in PARTS:
                times[stage].append(0.0)
            one_frame(times, k, (image, mask, camera), tracker, reconstructor, surface)
            floor(times, image)
    return times


@contextmanager
def _parts(times: Times) -> Iterator[None]:
    patches = []
    for stage, (owner, name) in PARTS.items():
        work = summed(times, stage, getattr(owner, name))
        static = isinstance(owner.__dict__[name], staticmethod)
        patches.append(patch.object(owner, name, staticmethod(work) if static else _method(work)))
    for each in patches:
        each.start()
    try:
        yield
    finally:
        for each in patches:
            each.stop()


def _method(work: Callable) -> Callable:
    """A function in a class becomes a method."""
    return lambda self, *args, **kwargs: work(self, *args, **kwargs)


def one_frame(
    times: Times,
    k: int,
    frame: Frame,
    tracker: ContourTracker,
    reconstructor: RimReconstructor,
    surface: Surface,
) -> None:
    """From an image message to a strip message."""
    image, mask, camera = frame
    message = encode_image(image, k, "camera")
    mask_message = None if mask is None else encode_image(mask, k, "camera")
    begun = time.perf_counter()
    with timed(times, "decode"):
        pixels = decode_image(message)
        given = None if mask_message is None else decode_mask(mask_message)
    with timed(times, "contours"):
        contours = tracker.process(pixels, camera, k, "object", given)
    with timed(times, "code"):
        contours = decode_contours(encode_contours(contours))
    with timed(times, "rim"):
        rims = reconstructor.add(contours)
    for rim in rims:
        with timed(times, "code rim"):
            heard = decode_rim(encode_rim(rim))
        with timed(times, "strip"):
            strip = surface.add(heard)
        with timed(times, "code strip"):
            encode_strip(strip)
    if rims:  # not in the first frames of a turn
        times["whole"].append(1e3 * (time.perf_counter() - begun))
        times["samples"].append(len(contours))


def floor(times: Times, image: NDArray) -> None:
    """The least that becomes of an image before there are outlines."""
    message = encode_image(image, 0, "camera")
    with timed(times, "floor"):
        pixels = decode_image(message)
        grey = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
        grey = cv2.GaussianBlur(grey, (5, 5), 0)
        _, binary = cv2.threshold(grey, 0, 255, cv2.THRESH_OTSU)
        cv2.findContours(binary, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)


STAGES = ("decode", "segment", "refine", "contours", "correspond", "check", "rim", "strip", "whole")


def stages_row(name: str, frames: list[Frame]) -> Row:
    """Medians over a turn, the first frames left out."""
    times = run(frames)
    medians = {stage: float(np.median(times[stage][3:])) for stage in (*STAGES, "floor")}
    row: Row = {"input": name, "samples": int(np.median(times["samples"]))}
    row |= {f"{stage} ms": medians[stage] for stage in STAGES}
    return row | {"floor ms": medians["floor"], "ratio": medians["whole"] / medians["floor"]}


def late_row(turns: int) -> Row:
    """The whole of a frame in the second turn and in the last, in the median."""
    frames = vase_frames(640, 480, False)
    whole = run(frame for _ in range(turns) for frame in frames)["whole"]
    early, late = whole[36:72], whole[-36:]
    return {
        "frames": len(frames) * turns,
        "early ms": float(np.median(early)),
        "late ms": float(np.median(late)),
        "late / early": float(np.median(late) / np.median(early)),
    }


def peers_rows(cells: int) -> list[Row]:
    """Time a view of ours, contours to strips, beside carvings of the same contours."""
    from surface_peers import open3d_carving, sdf_carving

    frames = vase_frames(1280, 960, False)
    tracker = ContourTracker()
    contours = [tracker.process(i, c, k, "object") for k, (i, _, c) in enumerate(frames)]
    cameras = [camera for _, _, camera in frames]
    reconstructor, surface = RimReconstructor(), Surface()
    start = time.perf_counter()
    rims = [rim for each in contours for rim in reconstructor.add(each)]
    for rim in rims:
        surface.add(rim)
    ours = (time.perf_counter() - start) / len(rims)
    corners = np.concatenate([rim.points[np.isfinite(rim.points).all(axis=1)] for rim in rims])
    low, size = corners.min(axis=0), float(np.ptp(corners, axis=0).max())
    rows: list[Row] = [{"way": "rims and strips", "ms a view": 1e3 * ours, "of ours": 1.0}]
    for name, carve in (("signed distances", sdf_carving), ("Open3D", open3d_carving)):
        start = time.perf_counter()
        try:
            carve(contours, cameras, low, size / cells, cells)
        except ImportError as error:
            rows.append({"way": f"{name}: {error}"})
            continue
        each = (time.perf_counter() - start) / len(contours)
        rows.append({"way": name, "ms a view": 1e3 * each, "of ours": each / ours})
    return rows


def start_rows(tries: int = 5) -> list[Row]:
    """CPU seconds, user and system, of a program that imports and ends."""
    rows = []
    for module in ("numpy", "occ_recon_ros.geometry", "occ_recon_ros.nodes.reconstructor"):
        code = f"import time; import {module}; print(time.process_time())"
        command = [sys.executable, "-c", code]
        found = [
            float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
            for _ in range(tries)
        ]
        rows.append({"import": module, "least CPU s": min(found)})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer sizes, turns and cells")
    parser.add_argument("--out", type=Path, default=Path("out/speed.json"))
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    given = parser.parse_args()
    cv2.setNumThreads(1)
    rows = []
    for width, height in SIZES[:3] if given.quick else SIZES:
        for colour in (False, True):
            name = f"vase {width}x{height} {'bgr8' if colour else 'mono8'}"
            rows.append(stages_row(name, vase_frames(width, height, colour)))
    if (given.data / "oxford_dino").is_dir():
        frames = list(real_frames(given.data / "oxford_dino"))
        rows.append(stages_row("oxford_dino, masks", frames))
        rows.append(stages_row("oxford_dino", [(image, None, c) for image, _, c in frames]))
    found = {"stages": show("Stages of a frame", rows)}
    found["late"] = show("Early and late", [late_row(20 if given.quick else 140)])
    found["peers"] = show("Beside carving", peers_rows(100 if given.quick else 200))
    found["start"] = show("Until it is imported", start_rows())
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(found, indent=1))
    print(f"written to {given.out}")


if __name__ == "__main__":
    main()
