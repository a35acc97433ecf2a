"""A live scan: what the worker that closes the body and the page cost it, and how soon it is over.

    python benchmarks/live.py [turn worker page hour] [--pairs 3] [--frames 500] [--fps 30]
        [--hour-frames 18000] [--out FILE.json]

turn    the virtual turntable, nothing called: seconds from its last image to closed.ply on disk and
        on the topic `closed`, and the body next to that of `occ-recon demo`, which replays the same
worker  a table that goes on turning, with previews of the closed body every 5 s and without any:
        milliseconds from an image to its contours, and from the image that completes it to the rim
page    the same with a page open in Chromium, and with no viewer; its memory, and lost frames
hour    what the page does in an hour of scanning (18,000 frames, 500 turns), as quickly as it can:
        milliseconds of its process for bringing it up to date, and how soon the browser draws

Three processes, a camera of 640x480 at --fps. Those with and those without take turns, --pairs
times, for the machine does not stay as fast as it is; the ratios are those of all runs together.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
import soak
import strips
import trimesh
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2
from table import Row, show, within

from msg_adapters import decode_status
from msg_adapters.serialised import header_stamp_ns
from occ_recon_ros.nodes.qos import latched, sensor
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.surface import Surface
from occ_recon_ros.viewer.page import Page
from occ_recon_ros.viewer.scan_view import ScanView

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))
from browser import visit

TURN = replace(soak.TURN, width=640, height=480, focal_px=800.0)
PREVIEWS = {**soak.STRIPS_ALONE, "close_body": True, "closed_preview": 5.0}
WARM = 60  # frames before any is timed
MOST_RATIO = {"worker": 1.10, "page": 1.05}
MOST_PAGE_MB, MOST_END_S = 500.0, 10.0
HOUR_FPS, HOUR_TURN = 5, 36


class Camera(soak.Rig):
    """A rig that goes on at its own pace, and notes when what came of each image was there."""

    def __init__(self) -> None:
        self.at: dict[str, dict[int, float]] = {topic: {} for topic in soak.NODES.values()}
        super().__init__(TURN)

    def _counter(self, topic: str) -> Any:
        def note(raw: bytes) -> None:
            self.came[topic] += 1
            self.at[topic].setdefault(header_stamp_ns(raw), time.perf_counter())

        return note

    def heard_by(self, viewers: int) -> bool:
        """Whether all nodes, and so many viewers, have found each other."""
        found = [self.reports.get(n, {}).get(f"{t} subscribers") for n, t in soak.NODES.items()]
        ends = all(p.get_subscription_count() for p in (self.image, self.info, self.pose))
        return ends and found == [str(n + viewers) for n in (3, 2, 1)]

    def run(self, frames: int, fps: float) -> dict[str, Any]:
        """Send frames; the latencies in ms, and how many never became a rim."""
        sent: list[float] = []
        begin = time.perf_counter()
        for k in range(frames):
            while (left := begin + k / fps - time.perf_counter()) > 0:
                rclpy.spin_once(self, timeout_sec=min(left, 0.005))
            sent.append(self.send(k))
            rclpy.spin_once(self, timeout_sec=0)
        wanted = frames - 2 * soak.LAG
        soak.spin_until(self, lambda: self.came["strip"] >= wanted, 20)

        def late(topic: str, lag: int) -> list[float]:
            there = self.at[topic]
            stamps = [self.stamp(k) for k in range(WARM, frames - lag)]
            waited = [there[s] - sent[k + lag] for k, s in enumerate(stamps, WARM) if s in there]
            return [1e3 * w for w in waited]

        return {
            "contours": late("contours", 0),
            "rim": late("rim", soak.LAG),
            "lost": frames - len(self.at["contours"]),
            "lost rims": wanted - self.came["strip"],
            "sent in s": time.perf_counter() - begin,
        }


def niced_browser(scratch: Path) -> str:
    """Chromium: drawing without a graphics card is not what a scan shares a machine with.

    It is begun in a session of its own, and Linux shares its time among sessions first: what is
    nice in another one takes half of it all the same, unless the session is nice as well.
    """
    browser = scratch / "browser"
    yields = "[ -w /proc/self/autogroup ] && echo 19 > /proc/self/autogroup"
    browser.write_text(f'#!/bin/sh\n{yields}\nexec nice -n 19 chromium "$@"\n')
    browser.chmod(0o755)
    return str(browser)


@contextmanager
def opened_page(scratch: Path) -> Iterator[Any]:
    """A viewer, and a Chromium without a window that looks at it; its process."""
    viewer = subprocess.Popen(
        [sys.executable, "-m", "occ_recon_ros.nodes.viewer", "--ros-args", "-p", "port:=0"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert viewer.stdout is not None
        url = next(m[1] for line in viewer.stdout if (m := re.search(r"viewer: (http\S+)", line)))
        with visit(url, size=(480, 360), path=niced_browser(scratch)) as page:
            page.page.locator("#scan-state").wait_for()
            yield viewer
            assert not page.errors, page.errors
    finally:
        viewer.terminate()
        viewer.wait(30)


def once(kind: str, on: bool, frames: int, fps: float, scratch: Path) -> Row:
    """One run, with or without."""
    mesher = PREVIEWS if on and kind == "worker" else soak.STRIPS_ALONE
    viewed = opened_page(scratch) if on and kind == "page" else nullcontext()
    camera = Camera()
    with soak.three_processes({**mesher, "output_dir": str(scratch / "scans")}), viewed as viewer:
        if not soak.spin_until(camera, lambda: camera.heard_by(1 if viewer else 0), 180):
            raise RuntimeError(f"the processes do not find each other: {camera.reports}")
        row = camera.run(frames, fps)
        if viewer:
            status = Path(f"/proc/{viewer.pid}/status").read_text()
            row["page MB"] = int(re.search(r"VmHWM:\s+(\d+)", status)[1]) / 1024  # type: ignore[index]
    camera.destroy_node()
    return row


def compared(kind: str, given: argparse.Namespace, scratch: Path) -> list[Row]:
    """Runs with and without, by turns."""
    rows: dict[bool, list[Row]] = {True: [], False: []}
    for k in range(2 * given.pairs):
        on = k % 4 in (0, 3)  # with, without, without, with: neither is always the later
        rows[on].append(once(kind, on, given.frames, given.fps, scratch))
        lost = rows[on][-1]["lost"]
        print(f"{kind} {'with' if on else 'without'}: {lost} frames lost", flush=True)
    table: list[Row] = []
    for topic in ("contours", "rim"):
        both = {on: np.concatenate([row[topic] for row in rows[on]]) for on in rows}
        for name, share in (("median", 50), ("99th percentile", 99)):
            with_it, without = (float(np.percentile(both[on], share)) for on in (True, False))
            table.append(
                {
                    "latency": f"image to {topic}, {name}",
                    "with ms": with_it,
                    "without ms": without,
                    "ratio": with_it / without,
                    **within(with_it / without, MOST_RATIO[kind]),
                }
            )
    for what in ("lost", "lost rims"):
        counts = [sum(row[what] for row in rows[on]) for on in (True, False)]
        table.append({"latency": what, "with ms": counts[0], "without ms": counts[1]})
    if kind == "page":
        most = max(row["page MB"] for row in rows[True])
        table.append(
            {"latency": "page's process, MB", "with ms": most, **within(most, MOST_PAGE_MB)}
        )
    return table


def hour(scratch: Path, frames: int = 18_000) -> list[Row]:
    """A page that is open all the while, in tenths of the hour."""
    settings = TurntableSettings(frames=HOUR_TURN, step=2 * np.pi / HOUR_TURN)
    vase, surface = make_object("vase"), Surface()
    views = [vase.exact_contours(c, stamp_ns=1) for c in turntable_cameras(settings)]
    rims = strips.turn(HOUR_TURN)
    pieces = [surface.add(rim) for rim in rims]
    whole, view = surface.whole(), ScanView()
    page = Page(view, "127.0.0.1", 0, "")
    rows: list[Row] = []
    drawn = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
    page.update(0.0)
    try:
        with visit(page.url, size=(480, 360), path=niced_browser(scratch)) as seen:
            seen.page.locator("#scan-state").wait_for()
            updates: list[float] = []
            draws: list[float] = []
            for k in range(frames):
                n, stamp, now = k % HOUR_TURN, k + 1, k / HOUR_FPS
                view.add_contours(replace(views[n], stamp_ns=stamp), now)
                view.add_rim(replace(rims[n], stamp_ns=stamp))
                view.add_strip(replace(pieces[n], stamp_ns=stamp), now)
                if k % HOUR_FPS == 0:  # the whole mesh, once a second
                    view.set_mesh(replace(whole, stamp_ns=stamp))
                began = time.process_time()
                page.update(now)
                updates.append(1e3 * (time.process_time() - began))
                if k % 50 == 0:
                    began = time.monotonic()
                    seen.page.evaluate(drawn)
                    draws.append(1e3 * (time.monotonic() - began))
                if (k + 1) % (frames // 10) == 0:
                    row = {"frames": k + 1, "update ms, median": float(np.median(updates))}
                    row |= {"browser draws, ms": float(np.median(draws))}
                    rows.append(row | {"page's process, MB": soak.memory_mb(os.getpid())})
                    updates, draws = [], []
                    print(rows[-1], flush=True)
            assert not seen.errors, seen.errors
    finally:
        page.stop()
    return rows


class Watch(Node):
    """Hears when the last image went, what the mesher says, and the closed body."""

    def __init__(self) -> None:
        super().__init__("watch")
        self.image_at = self.closed_at = 0.0
        self.images, self.state = 0, {"state": ""}
        self.create_subscription(Image, "image", self._on_image, sensor(), raw=True)
        self.create_subscription(PointCloud2, "closed", self._on_closed, latched(), raw=True)
        self.create_subscription(DiagnosticStatus, "mesher/scan", self._on_state, latched())

    def _on_image(self, _: bytes) -> None:
        self.images, self.image_at = self.images + 1, time.monotonic()

    def _on_closed(self, _: bytes) -> None:
        self.closed_at = time.monotonic()

    def _on_state(self, msg: DiagnosticStatus) -> None:
        self.state = dict(decode_status(msg).values)


def turn(scratch: Path) -> list[Row]:
    """A turn of the virtual turntable that nobody ends."""
    command = Path(sys.executable).with_name("occ-recon")
    subprocess.run([command, "demo", "--out", scratch / "demo", "--quiet"], check=True)
    watch, scans = Watch(), scratch / "turn"
    with soak.three_processes({"output_dir": str(scans)}):
        everyone = {"contour_tracker", "reconstructor", "mesher"}
        soak.spin_until(watch, lambda: everyone <= set(watch.get_node_names()), 60)
        soak.spin_until(watch, lambda: watch.state["state"] == "waiting", 60)
        soak.spin_until(watch, lambda: False, 5)  # until they have found each other too
        table = soak.start("virtual_turntable", {"frame_rate": 5.0})
        written = 0.0

        def over() -> bool:
            nonlocal written
            if not written and list(scans.glob("*/closed.ply")):
                written = time.monotonic()
            return (
                written > 0 and watch.state["state"] == "saved" and watch.closed_at >= written - 5
            )

        try:
            if not soak.spin_until(watch, over, 300):
                raise RuntimeError(f"the turn does not end: {watch.state}")
        finally:
            table.terminate()
            table.wait(30)
    seconds = {"closed.ply on disk": written, "on the topic": watch.closed_at}
    live, replayed = (
        trimesh.load_mesh(path, process=False)
        for path in (next(scans.glob("*/closed.ply")), scratch / "demo" / "closed.ply")
    )
    same = live.faces.shape == replayed.faces.shape and bool((live.faces == replayed.faces).all())
    off = float(np.abs(live.vertices - replayed.vertices).max()) if same else float("nan")
    rows: list[Row] = [
        {
            "": name,
            "s after the last image": when - watch.image_at,
            **within(when - watch.image_at, MOST_END_S),
        }
        for name, when in seconds.items()
    ]
    words = f"the same triangles, vertices within {1e6 * off:.3g} um" if same else "another body"
    rows.append({"": f"next to the demo's: {words}; {watch.images} images"})
    watch.destroy_node()
    return rows


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    kinds = ("turn", "worker", "page", "hour")
    parser.add_argument("kinds", nargs="*", default=kinds, metavar="KIND", help=", ".join(kinds))
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--frames", type=int, default=500)
    parser.add_argument("--fps", type=float, default=30.0)
    parser.add_argument("--hour-frames", type=int, default=18_000)
    parser.add_argument("--out", type=Path, default=Path("out/live.json"))
    given = parser.parse_args()
    soak.keep_apart()
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    found: dict[str, list[Row]] = {}
    rclpy.init()
    try:
        for kind in given.kinds:
            with tempfile.TemporaryDirectory() as folder:
                scratch = Path(folder)
                if kind == "turn":
                    rows = turn(scratch)
                elif kind == "hour":
                    rows = hour(scratch, given.hour_frames)
                else:
                    rows = compared(kind, given, scratch)
            found[kind] = show(kind, rows)
    finally:
        rclpy.try_shutdown()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
