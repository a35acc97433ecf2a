"""Thousands of frames through the three nodes as three processes: do memory and latency stay?

    python benchmarks/soak.py [--frames N] [--scans N] [--out FILE.json]

A small vase turns and turns; each frame goes when the one before has become its strip. With
--scans it does so in whole turns, one scan after the other: each is seen to close, is finished,
closed, saved and forgotten by the nodes themselves, with their defaults but for
``reset_when_saved``; a row of the table is ten scans. Prints a table and writes it to a JSON file.
Memory is what Linux counts as resident; that of the mesher is given without the arrays of its
mesh and the newest message of it (twice: serialised, and in the middleware for those who come
late), which have to grow.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from msg_adapters import (
    decode_diagnostics,
    decode_status,
    encode_camera_info,
    encode_image,
    encode_pose,
)
from occ_recon_ros.cli.pipeline import prepare_environment
from occ_recon_ros.nodes.qos import latched, reliable, sensor
from occ_recon_ros.scene import TurntableSettings, make_object, render, turntable_cameras
from occ_recon_ros.streams.domains import claim_domain

NODES = {"contour_tracker": "contours", "reconstructor": "rim", "mesher": "strip"}
TURN = TurntableSettings(frames=72, step=np.pi / 36, width=160, height=120, focal_px=200.0)
LAG = 2  # a rim needs a later frame 10 degrees on
STEP_NS = 33_333_333
TRIANGLE_BYTES = 3 * 28  # of the mesh message
MESSAGES = 2  # serialised, and kept for those who come late
SETTLED = 1000  # frames after which nothing more may grow

Row = dict[str, Any]


class Rig(Node):
    """Sends the views of a turn over and over, and times what comes back."""

    def __init__(self, settings: TurntableSettings = TURN) -> None:
        super().__init__("rig")
        self.image = self.create_publisher(Image, "image", sensor())
        self.info = self.create_publisher(CameraInfo, "camera_info", sensor())
        self.pose = self.create_publisher(PoseStamped, "camera_pose", reliable(100))
        self.reports: dict[str, dict[str, str]] = {}
        self.came: dict[str, int] = dict.fromkeys(NODES.values(), 0)
        self.when: dict[str, float] = {}
        for topic in self.came:
            self.create_subscription(PointCloud2, topic, self._counter(topic), 100, raw=True)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, 10)
        vase = make_object("vase")
        self._views = [(c, render(vase, c)) for c in turntable_cameras(settings)]
        self._start_ns = time.time_ns()

    def _counter(self, topic: str) -> Callable[[Any], None]:
        def count(_: Any) -> None:
            self.came[topic] += 1
            self.when[topic] = time.perf_counter()

        return count

    def _on_report(self, msg: DiagnosticArray) -> None:
        self.reports |= {r.name.strip("/"): dict(r.values) for r in decode_diagnostics(msg)}

    def joined(self) -> bool:
        """Whether every node has found its neighbours."""
        found = [self.reports.get(n, {}).get(f"{t} subscribers") for n, t in NODES.items()]
        ours = (self.image, self.info, self.pose)
        return found == ["3", "2", "1"] and all(p.get_subscription_count() for p in ours)

    def stamp(self, k: int) -> int:
        """Of frame k, nanoseconds."""
        return self._start_ns + k * STEP_NS

    def send(self, k: int) -> float:
        """Publish frame k; when that was."""
        camera, pixels = self._views[k % len(self._views)]
        stamp = self.stamp(k)
        self.info.publish(encode_camera_info(camera, stamp, "camera"))
        self.pose.publish(encode_pose(camera, stamp, "turntable"))
        self.image.publish(encode_image(pixels, stamp, "camera"))
        return time.perf_counter()


def memory_mb(pid: int) -> float:
    """Resident memory of a process that is its own, shared memory of the transport left out."""
    status = Path(f"/proc/{pid}/status").read_text()
    values = dict(line.split(":", 1) for line in status.splitlines())
    return (int(values["RssAnon"].split()[0])) / 1024


def mesh_mb(report: dict[str, str]) -> float:
    """The part of the mesher's memory that is the mesh and the message of it."""
    message = int(report["triangles"]) * TRIANGLE_BYTES / 2**20
    return float(report["surface MB"]) + MESSAGES * message


# The closed body, whose messages are as large as it is, is left out.
STRIPS_ALONE = {"close_body": False, "finish_when_closed": False, "save_on_shutdown": False}


def start(name: str, parameters: dict[str, Any] | None = None) -> subprocess.Popen:
    """A node as a process of its own, which says nothing but errors."""
    given: list[str] = []
    for key, value in (parameters or {}).items():
        given += ["-p", f"{key}:={str(value).lower() if isinstance(value, bool) else value}"]
    module = f"occ_recon_ros.nodes.{name}"
    quiet = ["--ros-args", "--log-level", "error"]
    return subprocess.Popen([sys.executable, "-m", module, *quiet, *given])


@contextmanager
def three_processes(
    mesher: dict[str, Any] | None = None,
) -> Iterator[dict[str, subprocess.Popen]]:
    """The nodes, which end with the block; with parameters of the mesher."""
    children = {
        name: start(name, (mesher or STRIPS_ALONE) if name == "mesher" else None) for name in NODES
    }
    try:
        yield children
    finally:
        for child in children.values():
            child.terminate()
        for child in children.values():
            child.wait(30)


def spin_until(node: Node, condition: Callable[[], bool], timeout_s: float) -> bool:
    """Whether the condition came true in time."""
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            return False
        rclpy.spin_once(node, timeout_sec=0.05)
    return True


def soak(frames: int, every: int = 500) -> list[Row]:
    """One row each so many frames: memory and latency of each node.

    Raises:
        RuntimeError: the nodes do not come up, or a frame is lost.
    """
    rig = Rig()
    rows: list[Row] = []
    with three_processes() as children:
        if not spin_until(rig, rig.joined, 180):
            raise RuntimeError("the three processes do not find each other")
        times: dict[str, list[float]] = {topic: [] for topic in NODES.values()}
        for k in range(frames):
            sent = rig.send(k)
            want = {"contours": k + 1, "rim": max(k + 1 - 2 * LAG, 0)}
            want["strip"] = want["rim"]

            def all_there(want: dict[str, int] = want) -> bool:
                return all(rig.came[t] >= n for t, n in want.items())

            if not spin_until(rig, all_there, 180):
                raise RuntimeError(f"frame {k}: {rig.came}, wanted {want}; {rig.reports}")
            for topic, each in times.items():
                if want[topic]:
                    each.append(1e3 * (rig.when[topic] - sent))
            if (k + 1) % every == 0:
                rows.append(_row(rig, k + 1, children, times))
                print(_line(rows[-1]), flush=True)
                times = {topic: [] for topic in NODES.values()}
    rig.destroy_node()
    return rows


def scan_after_scan(count: int, folder: Path, every: int = 10) -> list[Row]:
    """So many turns, each a scan that nobody ends; a row each so many.

    Raises:
        RuntimeError: one is not saved, or not whole.
    """
    rig, states = Rig(), [""]
    rig.create_subscription(
        DiagnosticStatus,
        "mesher/scan",
        lambda msg: states.append(decode_status(msg).values["state"]),
        latched(),
    )
    rows: list[Row] = []
    turn = range(TURN.frames)
    begun, frame, seconds = time.perf_counter(), 0, []
    with three_processes({"output_dir": str(folder), "reset_when_saved": True}) as children:
        if not spin_until(rig, rig.joined, 180):
            raise RuntimeError(f"the three processes do not find each other: {rig.reports}")
        for number in range(1, count + 1):
            for k in turn:
                had = rig.came["contours"]
                rig.send(frame + k)
                spin_until(rig, lambda n=had: rig.came["contours"] > n, 60)  # type: ignore[misc]
            frame += len(turn) + 30  # a second later, from wherever the table is
            del states[:-1]
            last = time.perf_counter()
            if not spin_until(rig, lambda: not {"saved", "failed"}.isdisjoint(states), 300):
                raise RuntimeError(f"scan {number} is not saved: {states}; {rig.reports}")
            seconds.append(time.perf_counter() - last)
            files = {p.name for p in sorted(folder.iterdir())[-1].iterdir()}
            if "failed" in states or files != {"mesh.ply", "closed.ply"}:
                raise RuntimeError(f"scan {number}: {states}, {files}")
            spin_until(rig, lambda: states[-1] == "waiting", 60)
            spin_until(rig, lambda: False, 0.5)  # the resets of the other two have come
            if number % every == 0:
                row: Row = {"scans": number, "folders": len(list(folder.iterdir()))}
                row |= {f"{n} MB": memory_mb(c.pid) for n, c in children.items()}
                row |= {
                    f"{n} files": len(os.listdir(f"/proc/{c.pid}/fd")) for n, c in children.items()
                }
                row |= {"saved after s": float(np.median(seconds))}
                rows.append(row | {"minutes": (time.perf_counter() - begun) / 60})
                print(_line(rows[-1]), flush=True)
                seconds = []
    rig.destroy_node()
    return rows


def _row(
    rig: Rig, frames: int, children: dict[str, subprocess.Popen], times: dict[str, list[float]]
) -> Row:
    rig.reports.clear()
    if not spin_until(rig, lambda: len(rig.reports) >= len(NODES), 180):
        raise RuntimeError(f"only {list(rig.reports)} report")
    row: Row = {"frames": frames}
    for name, child in children.items():
        row[f"{name} MB"] = memory_mb(child.pid)
        row[f"{name} files"] = len(os.listdir(f"/proc/{child.pid}/fd"))
    row["mesh MB"] = mesh_mb(rig.reports["mesher"])
    row["mesher MB"] -= row["mesh MB"]
    for topic, each in times.items():
        row[f"{topic} ms"], row[f"{topic} p95 ms"] = np.percentile(each, [50, 95]).tolist()
    row["drops"] = {
        key: value
        for report in rig.reports.values()
        for key, value in report.items()
        if key.startswith("dropped ")
    }
    return row


def _line(row: Row) -> str:
    return "  ".join(
        f"{value:.1f}".rjust(len(key)) if isinstance(value, float) else str(value).rjust(len(key))
        for key, value in row.items()
    )


def growth(rows: list[Row], name: str) -> float:
    """How much a column grows from the first rows after ``SETTLED`` frames to the last ones:
    difference of the medians of a quarter at either end."""
    values = [row[name] for row in rows if row["frames"] >= min(SETTLED, rows[-1]["frames"] // 2)]
    some = max(len(values) // 4, 1)
    return float(np.median(values[-some:]) - np.median(values[:some]))


def keep_apart() -> None:
    """The environment of a benchmark's nodes: a ROS domain with nobody else's frames."""
    prepare_environment(local=True)
    os.environ.setdefault("ROS_DOMAIN_ID", str(claim_domain()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=20_000)
    parser.add_argument("--scans", type=int, default=0, help="so many scans instead")
    parser.add_argument("--every", type=int, default=500, help="frames a row of the table")
    parser.add_argument("--out", type=Path, default=Path("out/soak.json"))
    arguments = parser.parse_args()
    keep_apart()
    rclpy.init()
    try:
        if arguments.scans:
            with tempfile.TemporaryDirectory() as folder:
                rows = scan_after_scan(arguments.scans, Path(folder))
        else:
            rows = soak(arguments.frames, arguments.every)
    finally:
        rclpy.try_shutdown()
    names = [name for name in rows[0] if name.endswith((" MB", " ms", " files", " s"))]
    if arguments.scans:
        summary = {name: rows[-1][name] - rows[0][name] for name in names}
        print("\nGrowth from the first ten scans to the last ten")
    else:
        summary = {name: growth(rows, name) for name in names}
        print(f"\nGrowth after {SETTLED} frames")
    for name, value in summary.items():
        print(f"  {name.ljust(22)} {value:+.2f}")
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps({"growth": summary, "rows": rows}, indent=1))
    print(f"written to {arguments.out}")


if __name__ == "__main__":
    main()
