"""Nodes that are killed at any moment of a scan: what is lost?

    python benchmarks/kills.py [--kills 20] [--out FILE.json]

A table turns once while each of the three nodes, processes of their own with a checkpoint, is
killed (SIGKILL) so many times, at a random moment within the work on a frame, and started again.
Counted for each: messages that were on their way when it died, and never came to it; and of what
it had heard, what is missing in the end, which must be nothing: names of loops that the tracker
followed, frames that the reconstructor had taken without a rim, triangles of the mesher's strips
that are not in the mesh. That is held against the mesh that the library makes of the same.
"""

import argparse
import json
import random
import tempfile
import time
from collections import Counter, defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
import soak
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from table import Row, show

from msg_adapters import decode_contours, decode_rim, decode_strip
from msg_adapters.serialised import header_stamp_ns
from occ_recon_ros.geometry import Contours, Rim, RimReconstructor
from occ_recon_ros.nodes.qos import latched
from occ_recon_ros.streams.checkpoint_file import CheckpointFile
from occ_recon_ros.surface import Surface

BEFORE = {"reconstructor": "contour_tracker", "mesher": "reconstructor"}
FORGOTTEN_S = 25.0  # a participant that was killed counts as there for 20 s
MOMENT_S = 0.05  # after a frame was sent, at the latest, a node is killed


class Rig(soak.Rig):
    """A rig that keeps all that comes."""

    def __init__(self, frames: int) -> None:
        self.contours: dict[int, Contours] = {}
        self.rims: dict[int, Rim] = {}
        self.strips: dict[int, set[bytes]] = {}
        super().__init__(replace(soak.TURN, frames=frames, step=2 * np.pi / frames))

    def _counter(self, topic: str) -> Any:
        take = {
            "contours": self._take_contours,
            "rim": self._take_rim,
            "strip": self._take_strip,
        }[topic]
        return lambda raw: take(deserialize_message(raw, PointCloud2))

    def _take_contours(self, msg: PointCloud2) -> None:
        contours = decode_contours(msg)
        self.contours[contours.stamp_ns] = contours

    def _take_rim(self, msg: PointCloud2) -> None:
        rim = decode_rim(msg)
        self.rims[rim.stamp_ns] = rim

    def _take_strip(self, msg: PointCloud2) -> None:
        strip = decode_strip(msg)
        self.strips[strip.stamp_ns] = triangles(strip.corners)

    def subscribers(self, node: str) -> int:
        """Of what a node makes, as it said last; -1 if it has said nothing yet."""
        return int(self.reports.get(node, {}).get(f"{soak.NODES[node]} subscribers", -1))


def triangles(corners: Any) -> set[bytes]:
    """Each triangle as what it is made of."""
    return {np.asarray(corner, np.float32).tobytes() for corner in corners}


class Scan:
    """A turn in which nodes are killed."""

    def __init__(self, folder: Path, frames: int) -> None:
        self.rig = Rig(frames)
        self._keep = {"checkpoint_every": 10, "checkpoint_path": str(folder), "resume": True}
        self._children = {name: self._start(name) for name in soak.NODES}
        self._dead: dict[str, list[float]] = defaultdict(list)  # when those died
        self.sent: list[int] = []
        self.kills: Counter[str] = Counter()
        self.names: set[int] = set()  # of loops, before a tracker was killed
        self.triangles: set[bytes] = set()  # of strips, before a mesher was killed
        if not soak.spin_until(self.rig, self.rig.joined, 60):
            self.end()
            raise RuntimeError(f"the three processes do not find each other: {self.rig.reports}")

    def _start(self, name: str) -> Any:
        more = {**soak.STRIPS_ALONE, "mesh_rate": 30.0} if name == "mesher" else {}
        return soak.start(name, {**self._keep, **more})

    def send(self, k: int) -> int:
        """Frame k, without waiting; its stamp."""
        self.rig.send(k)
        self.sent.append(self.rig.stamp(k))
        return self.sent[-1]

    def send_and_wait(self, k: int) -> None:
        """Frame k, until its contours have come, and all that they bring with them."""
        stamp = self.send(k)
        there = soak.spin_until(self.rig, lambda: stamp in self.rig.contours, 30)
        if not there:
            raise RuntimeError(f"frame {k} gives no contours: {self.rig.reports}")
        soak.spin_until(self.rig, lambda: False, 0.1)

    def kill(self, name: str, k: int, wait_s: float) -> None:
        """Kill a node so long after frame k was sent, and wait for the next of its name."""
        self.send(k)
        soak.spin_until(self.rig, lambda: False, wait_s)
        self._children[name].kill()
        self._children[name].wait()
        self._dead[name].append(time.monotonic())
        soak.spin_until(self.rig, lambda: False, 0.2)  # what it had sent comes in
        rig = self.rig
        self.kills[name] += 1
        if name == "contour_tracker":
            self.names |= {int(n) for n in rig.contours[max(rig.contours)].loop}
        elif name == "mesher":
            self.triangles |= set().union(*rig.strips.values())
        self.rig.reports.clear()
        self._children[name] = self._start(name)
        if not soak.spin_until(self.rig, lambda: self._joined(name), 120):
            raise RuntimeError(f"{name} does not come back: {self.rig.reports}")

    def _joined(self, name: str) -> bool:
        """Whether it and its neighbours have each other; dead ones count for a while."""
        now = time.monotonic()
        still = {n: sum(now - t < FORGOTTEN_S for t in times) for n, times in self._dead.items()}
        after = {"contour_tracker": ("reconstructor", "mesher"), "reconstructor": ("mesher",)}
        least = {"contour_tracker": 3, "reconstructor": 2, "mesher": 1}
        before = BEFORE.get(name)
        if before is None:
            heard = self.rig.image.get_subscription_count() >= 1 + still.get(name, 0)
        else:
            dead = sum(still.get(n, 0) for n in after[before])
            heard = self.rig.subscribers(before) >= least[before] + dead
        return heard and self.rig.subscribers(name) >= least[name]

    def kept(self) -> set[int]:
        """The frames in the checkpoint of the reconstructor."""
        path = Path(str(self._keep["checkpoint_path"])) / "reconstructor.checkpoint"
        copy = path.with_suffix(".copy")  # it is locked
        copy.write_bytes(path.read_bytes())
        file = CheckpointFile(copy, "reconstructor", 1, resume=True)
        messages = [message for message in file.read() if message.startswith(b"\0")]
        file.close()
        return {header_stamp_ns(message) for message in messages}

    def mesh(self) -> set[bytes]:
        """The finished surface, as somebody sees it who comes late."""
        client = self.rig.create_client(Trigger, "reconstructor/finish")
        soak.spin_until(self.rig, client.service_is_ready, 60)
        answer = client.call_async(Trigger.Request())
        if not soak.spin_until(self.rig, answer.done, 120) or not answer.result().success:
            raise RuntimeError(f"the turn cannot be finished: {answer.result()}")
        soak.spin_until(self.rig, lambda: False, 3)
        seen: list[PointCloud2] = []
        self.rig.create_subscription(PointCloud2, "mesh", seen.append, latched())
        soak.spin_until(self.rig, lambda: bool(seen), 60)
        soak.spin_until(self.rig, lambda: False, 2)
        return triangles(decode_strip(seen[-1]).corners)

    def end(self) -> None:
        """End all processes."""
        for child in self._children.values():
            child.terminate()
        for child in self._children.values():
            child.wait(30)
        self.rig.destroy_node()


def undisturbed(contours: list[Contours], without: set[int]) -> tuple[set[bytes], set[int]]:
    """The triangles that the library makes of contours, and the frames with rims; without the
    rims of some frames."""
    reconstructor, surface = RimReconstructor(), Surface()

    def take(rim: Rim) -> None:
        if rim.stamp_ns in surface:
            surface.revise(rim)
        elif rim.stamp_ns not in without:
            surface.add(rim)

    stamps = set()
    for one in contours:
        for rim in reconstructor.add(one):
            take(rim)
            stamps.add(rim.stamp_ns)
    for rim in reconstructor.finish():
        take(rim)
        stamps.add(rim.stamp_ns)
    return triangles(surface.whole().corners), stamps


def main() -> None:
    """Run the scan, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=20, help="of each node")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/kills.json"))
    given = parser.parse_args()
    soak.keep_apart()
    chance = random.Random(given.seed)
    order = [name for name in soak.NODES for _ in range(given.kills)]
    chance.shuffle(order)
    frames = 2 * len(order) + 12
    rclpy.init()
    with tempfile.TemporaryDirectory() as folder:
        scan = Scan(Path(folder), frames)
        try:
            for k in range(6):
                scan.send_and_wait(k)
            for number, name in enumerate(order):
                k = 6 + 2 * number
                scan.kill(name, k, chance.uniform(0, MOMENT_S))
                scan.send_and_wait(k + 1)
                print(f"{number + 1} of {len(order)}: {name}", flush=True)
            for k in range(6 + 2 * len(order), frames):
                scan.send_and_wait(k)
            found = rows(scan, scan.mesh())
        finally:
            scan.end()
            rclpy.try_shutdown()
    show("What was lost", found)
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(found, indent=1))


def rows(scan: Scan, mesh: set[bytes]) -> list[Row]:
    """A row a node."""
    rig, kept = scan.rig, scan.kept()
    gone = {  # what never came to a node that was dead
        "contour_tracker": set(scan.sent) - set(rig.contours),
        "reconstructor": set(rig.contours) - set(rig.rims) - kept,
        "mesher": set(rig.rims) - set(rig.strips),
    }
    contours = [rig.contours[s] for s in sorted(set(rig.contours) - gone["reconstructor"])]
    whole, with_rims = undisturbed(contours, gone["mesher"])
    names = {int(n) for n in contours[-1].loop}
    lost = {
        "contour_tracker": scan.names - names,
        "reconstructor": kept - set(rig.rims),
        "mesher": scan.triangles & whole - mesh,
    }
    table: list[Row] = []
    for name in soak.NODES:
        row = {"killed": name, "times": scan.kills[name]}
        row |= {"on their way, lost": len(gone[name]), "heard, lost": len(lost[name])}
        table.append(row)
    table.append(
        {
            "killed": "all",
            "frames sent": len(scan.sent),
            "with contours": len(rig.contours),
            "with rims": len(set(rig.rims) & with_rims),
            "triangles": len(mesh),
            "of the library's, missing": len(whole - mesh),
            "not the library's": len(mesh - whole),
        }
    )
    return table


if __name__ == "__main__":
    main()
