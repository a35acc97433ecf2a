"""One to eight rigs on one machine: what does each cost, and how many can it bear?

    python benchmarks/rigs.py [--rigs 1 2 4 8] [--seconds 30] [--fps 5] [--out FILE.json]

Each rig is one `occ-recon run` in a namespace of its own and a virtual turntable of 640x480
pixels, two processes. All are in one ROS domain, or each in its own (--domains). Counted, when all
have found each other, over the seconds given: frames that became rims (of those sent), CPU
seconds that a frame takes in the nodes, CPU seconds a second of a rig that nothing comes to, and
memory. What a frame would weigh on a network is the size of its messages.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2
from table import show

from occ_recon_ros.nodes.qos import latched, reliable, sensor

WIDTH, HEIGHT, FOCAL = 640, 480, 800.0
FRAMES = 72
TICKS = os.sysconf("SC_CLK_TCK")
KINDS = {"image": (Image, sensor()), "contours": (PointCloud2, reliable(100))}
KINDS |= {"rim": (PointCloud2, reliable(100)), "strip": (PointCloud2, reliable(100))}

Row = dict[str, Any]


def cpu_s(pid: int) -> float:
    """CPU seconds of a process and of its children that have ended."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return sum(map(int, fields[11:15])) / TICKS


def memory_mb(pid: int) -> float:
    """Memory of a process that is its own."""
    status = dict(
        line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines()
    )
    return int(status["RssAnon"].split()[0]) / 1024


class Rig:
    """The processes of one rig, and a node that counts what they say."""

    def __init__(self, number: int, domain: int, fps: float, scratch: str) -> None:
        self.name = f"rig{number}"
        environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "OMP_NUM_THREADS": "1"}
        environment["OPENBLAS_NUM_THREADS"] = "1"
        settings = {"mesher.output_dir": scratch, "mesher.close_body": "false"}
        settings["mesher.finish_when_closed"] = "false"
        sets = [word for item in settings.items() for word in ("--set", "=".join(item))]
        command = [
            str(Path(sys.executable).with_name("occ-recon")),
            "run",
            "--quiet",
            "--namespace",
        ]
        self.run = subprocess.Popen([*command, self.name, *sets], env=environment)
        values = {"width": WIDTH, "height": HEIGHT, "focal_px": FOCAL, "frames": FRAMES}
        values |= {"step": 6.283185307179586 / FRAMES, "frame_rate": fps}
        given = [word for item in values.items() for word in ("-p", ":=".join(map(str, item)))]
        module = "occ_recon_ros.nodes.virtual_turntable"
        arguments = ["--ros-args", "-r", f"__ns:=/{self.name}", *given]
        self._show = [sys.executable, "-m", module, *arguments, "--log-level", "error"]
        self._environment = environment
        self.turntable: subprocess.Popen | None = None
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node("count", namespace=self.name, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.came = dict.fromkeys(KINDS, 0)
        self.bytes = dict.fromkeys(KINDS, 0)
        self.up = False
        for topic, (kind, qos) in KINDS.items():
            self.node.create_subscription(kind, topic, self._counter(topic), qos, raw=True)
        self.node.create_subscription(DiagnosticStatus, "mesher/scan", self._on_scan, latched())

    def begin(self) -> None:
        """Start the turntable."""
        self.turntable = subprocess.Popen(self._show, env=self._environment)

    def _counter(self, topic: str) -> Any:
        def count(raw: bytes) -> None:
            self.came[topic] += 1
            self.bytes[topic] = len(raw)

        return count

    def _on_scan(self, _: DiagnosticStatus) -> None:
        self.up = True

    def end(self) -> None:
        """Stop all of it."""
        for child in filter(None, (self.turntable, self.run)):
            child.terminate()
            child.wait(30)
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


def spin(rigs: list[Rig], seconds: float, until: Any = lambda: False) -> bool:
    """Hear all rigs for so long, or until something is so."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for rig in rigs:
            rig.executor.spin_once(timeout_sec=0.002)
        if until():
            return True
    return False


def measure(count: int, seconds: float, fps: float, own_domains: bool) -> Row:
    """So many rigs at once.

    Raises:
        RuntimeError: they do not come up.
    """
    with tempfile.TemporaryDirectory() as scratch:
        rigs = [Rig(k, 60 + (k if own_domains else 0), fps, scratch) for k in range(count)]
        try:
            if not spin(rigs, 30 + 10 * count, lambda: all(rig.up for rig in rigs)):
                raise RuntimeError("the nodes did not come up")
            spin(rigs, 3.0)  # what starts is not idle
            before = [cpu_s(rig.run.pid) for rig in rigs]
            spin(rigs, 0.3 * seconds)
            idle = sum(cpu_s(rig.run.pid) for rig in rigs) - sum(before)
            for rig in rigs:
                rig.begin()
            if not spin(rigs, 60 + 10 * count, lambda: all(r.came["rim"] > 3 for r in rigs)):
                raise RuntimeError("no rims came")
            before, started = [cpu_s(rig.run.pid) for rig in rigs], time.monotonic()
            came = {topic: [rig.came[topic] for rig in rigs] for topic in KINDS}
            spin(rigs, seconds)
            took = time.monotonic() - started
            cpu = sum(cpu_s(rig.run.pid) for rig in rigs) - sum(before)
            rims = sum(rig.came["rim"] for rig in rigs) - sum(came["rim"])
            memory = max(memory_mb(rig.run.pid) for rig in rigs)
            return {
                "rigs": count,
                "domains": count if own_domains else 1,
                "fps asked": fps,
                "rims/s a rig": rims / took / count,
                "CPU ms a frame": 1e3 * cpu / max(rims, 1),
                "idle CPU ms/s": 1e3 * idle / (0.3 * seconds) / count,
                "MB a rig": memory,
                **{f"kB {topic}": rigs[0].bytes[topic] / 1e3 for topic in KINDS},
            }
        finally:
            for rig in rigs:
                rig.end()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, nargs="+", default=[1, 2, 4, 8])
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--fps", type=float, default=5.0)
    parser.add_argument("--domains", action="store_true", help="each rig in a domain of its own")
    parser.add_argument("--out", type=Path, help="JSON")
    arguments = parser.parse_args()
    rows = [
        measure(count, arguments.seconds, arguments.fps, arguments.domains)
        for count in arguments.rigs
    ]
    show("Rigs on one machine", rows)
    if arguments.out:
        arguments.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
