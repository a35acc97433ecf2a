"""docs/REFERENCE.md, written from the running nodes so that it cannot drift from them.

make docs, or: python docs/reference.py > docs/REFERENCE.md
"""

import os
from collections.abc import Iterable, Iterator
from dataclasses import Field, fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "OFF"  # read when ROS is imported

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointCloud2, PointField

from msg_adapters import encode_contours, encode_rim, encode_strip
from occ_recon_ros.geometry import Contours, Rim, Status
from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.geometry.shape import Shape
from occ_recon_ros.nodes.board_pose import BoardPoseNode
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode
from occ_recon_ros.nodes.mesher import MesherNode
from occ_recon_ros.nodes.parameters import range_text
from occ_recon_ros.nodes.reconstructor import ReconstructorNode
from occ_recon_ros.nodes.settings import NODE_SETTINGS
from occ_recon_ros.nodes.turntable_pose import TurntablePoseNode
from occ_recon_ros.nodes.virtual_turntable import VirtualTurntableNode
from occ_recon_ros.poses import BoardSpec, board_to_yaml
from occ_recon_ros.poses.axis import Turntable, turntable_to_yaml
from occ_recon_ros.streams.topics import TOPICS, Topic
from occ_recon_ros.surface import Strip

NODES = (ContourTrackerNode, ReconstructorNode, MesherNode, VirtualTurntableNode)

HEAD = """\
# Reference

Written by `make docs` from the nodes themselves; a test compares the two.

Units are metres, radians, seconds. Camera optical frame: z forward, x right, y down. Pixel
(0, 0) is the centre of the top-left pixel. The object frame (`turntable` by default) is fixed to
the object: on a turntable it is the camera that moves in it.

Topic names are relative: they follow the namespace of the node and every one can be remapped.
Every quality of service can be overridden by a parameter `qos_overrides./TOPIC.subscription.depth`
(or `.publisher.`, `.reliability`, `.durability`, `.history`).
"""

SERVICES = {
    ("contour_tracker", "reset"): "Forget the object: the next image starts a new scan.",
    ("contour_tracker", "pause"): "`data: true`: images are dropped until `data: false`.",
    ("reconstructor", "reset"): "Forget all contours.",
    (
        "contour_tracker",
        "finish",
    ): "Where images without masks contradict each other: their frames are looked at together, "
    "and all contours of the scan come anew, after contours without "
    "samples. `mesher/finish` calls it.",
    ("reconstructor", "finish"): "Close the turn: the rims that need the first and the last "
    "frames together are computed and published. `mesher/finish` calls it.",
    ("mesher", "reset"): "Begin a new scan; what was not saved is saved first.",
    ("mesher", "save"): "Write the surface as it is into the folder of the scan in `output_dir`; "
    "answers with the absolute path and the counts, or why not. A checkpoint is forced onto the "
    "disk.",
    ("mesher", "finish"): "End the scan: the last rims, the closed body, the files; answers when "
    "all is there, or why not.",
    ("board_pose", "reset"): "Forget the images seen so far.",
    ("turntable_pose", "reset"): "Forget the angles, and what was wrong with them.",
    ("mesher", "pause"): "`data: true`: rims are dropped until `data: false`.",
}

FIELDS = {
    "contours": {
        "x y z": "point on the viewing ray at distance 1 from the camera centre",
        "vp_x vp_y vp_z": "camera centre",
        "normal_x normal_y normal_z": "outward unit surface normal on that ray",
        "u v": "pixel in the image as received (distorted)",
        "loop": "identity of the loop, kept from frame to frame while it is tracked",
        "sigma": "1 sigma of the contour position across itself, radians of viewing direction; "
        "infinite where no surface may be made of the sample",
    },
    "rim": {
        "x y z": "rim point; NaN where none could be computed",
        "normal_x normal_y normal_z": "outward unit normal",
        "curvature": "normal curvature k_t along the viewing direction, 1/m, positive on a convex "
        "object",
        "depth_sigma": "1 sigma of the depth along the ray, m",
        "loop": "as in `contours`",
        "prev": "row (fractional) of the epipolar correspondent in the previous rim, NaN if none",
        "vp_x vp_y vp_z": "camera centre, as in `contours`",
        "prev_sec prev_nanosec": "stamp of that previous rim; both 4294967295: there is none",
        "status": ", ".join(f"{int(s)} {s.name.lower().replace('_', ' ')}" for s in Status),
        "k_s": "with `shape_fields`: normal curvature along the rim, 1/m; NaN where unknown",
        "theta": "with `shape_fields`: angle from the viewing direction to the rim, 0 to pi, rad",
        "gauss": "with `shape_fields`: Gaussian curvature, 1/m^2",
        "mean": "with `shape_fields`: mean curvature, 1/m, positive where convex",
    },
    "strip": {
        "x y z": "corner of a triangle",
        "normal_x normal_y normal_z": "outward unit normal there",
        "rgb": "colour as PCL packs it; only with colour images",
        "depth_sigma": "1 sigma of the depth, m",
    },
}

TYPES = {
    PointField.UINT8: "uint8",
    PointField.UINT16: "uint16",
    PointField.UINT32: "uint32",
    PointField.FLOAT32: "float32",
}

LAYOUT = {
    "contours": "Loops are stored one after the other, each closed. As the image is displayed, "
    "walking a loop in stored order has the object on the left.",
    "rim": "One row for each row of the `contours` message of the same stamp, in the same order.",
    "strip": "Organised: height is the number of triangles, width is 3 (the corners, outward by "
    "the right-hand rule). An empty surface has height 0. `mesh` is laid out alike.",
}


def reference() -> str:
    """The text of docs/REFERENCE.md."""
    context = rclpy.Context()
    rclpy.init(context=context)
    nodes = [kind(context=context) for kind in NODES]
    with TemporaryDirectory() as folder:
        nodes += _pose_nodes(context, Path(folder))
    try:
        return "\n".join([HEAD, *_topics(), *_services(nodes), *_fields(), *_parameters()])
    finally:
        for node in nodes:
            node.destroy_node()
        context.shutdown()


def _pose_nodes(context: rclpy.Context, folder: Path) -> list[Node]:
    """Those that do not start without a file."""
    board, axis = folder / "board.yaml", folder / "axis.yaml"
    board.write_text(board_to_yaml(BoardSpec()))
    straight = CameraPose(np.eye(3), np.zeros(3))
    axis.write_text(turntable_to_yaml(Turntable(np.zeros(3), np.eye(3)[2], straight)))
    given = {BoardPoseNode: ("board", board), TurntablePoseNode: ("axis", axis)}
    return [
        kind(context=context, parameter_overrides=[Parameter(name, value=str(path))])
        for kind, (name, path) in given.items()
    ]


def _table(head: Iterable[str], rows: Iterable[Iterable[Any]]) -> Iterator[str]:
    head = list(head)
    yield f"| {' | '.join(head)} |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield f"| {' | '.join(str(cell).replace('|', chr(92) + '|') for cell in row)} |"
    yield ""


def _topics() -> Iterator[str]:
    yield "## Topics\n"
    yield from _table(
        ["topic", "type", "from", "to", "QoS", "meaning"],
        (
            (
                f"`{row.name}`",
                row.type_name.replace("/msg/", "/"),
                ", ".join(row.sources) if len(row.sources) < 4 else "all",
                ", ".join(row.readers),
                _qos(row),
                row.doc,
            )
            for row in TOPICS
        ),
    )


def _services(nodes: Iterable[Node]) -> Iterator[str]:
    texts = dict(SERVICES)
    rows = []
    for node in nodes:
        for service in node.services:
            if service.srv_type.__module__.startswith("std_srvs"):
                name = service.srv_name.split("/")[-1]
                text = texts.pop((node.get_name(), name))
                rows.append((node.get_name(), f"`~/{name}`", _type_name(service.srv_type), text))
    yield "## Services\n"
    yield from _table(["node", "service", "type", "what it does"], rows)
    assert not texts, f"no node offers these services of docs/reference.py: {sorted(texts)}"


def _fields() -> Iterator[str]:
    none = np.zeros((0, 3))
    both = {"stamp_ns": 0, "frame_id": "", "loop": np.zeros(0, np.uint16)}
    scalars = np.zeros(0)
    contours = Contours(
        **both, centre=np.zeros(3), T=none, N=none, uv=np.zeros((0, 2)), sigma=scalars
    )
    rim = Rim(
        **both,
        centre=np.zeros(3),
        points=none,
        normals=none,
        curvature=scalars,
        depth_sigma=scalars,
        prev=scalars,
        status=np.zeros(0, np.uint8),
    )
    corners = np.zeros((0, 3, 3), np.float32)
    strip = Strip(0, "", corners, corners, corners[..., 0], np.zeros((0, 3, 3), np.uint8))
    messages = {
        "contours": encode_contours(contours),
        "rim": encode_rim(rim, Shape(*np.zeros((5, 0)))),
        "strip": encode_strip(strip),
    }
    for topic, message in messages.items():
        yield f"## Fields of `{topic}`\n\n{LAYOUT[topic]}\n"
        yield from _table(["field", "type", "meaning"], _field_rows(topic, message))


def _field_rows(topic: str, message: PointCloud2) -> Iterator[tuple[str, str, str]]:
    types = {item.name: item.datatype for item in message.fields}
    for group, text in FIELDS[topic].items():
        (datatype,) = {types.pop(name) for name in group.split()}
        yield f"`{group}`", TYPES[datatype], text
    assert not types, f"describe these fields of {topic} in docs/reference.py: {sorted(types)}"


def _parameters() -> Iterator[str]:
    yield "## Parameters\n\n`config/rig.yaml` lists all of them too, ready to be edited.\n"
    for name, kind in NODE_SETTINGS.items():
        yield f"### {name}\n"
        yield from _table(
            ["parameter", "type", "default", "range", "meaning"],
            (
                (
                    f"`{item.name}`",
                    type(item.default).__name__,
                    f"`{item.default!r}`" if item.default != "" else "empty",
                    _limits(item),
                    _meaning(item),
                )
                for item in fields(kind)
            ),
        )


def _limits(item: Field) -> str:
    return ", ".join(item.metadata.get("choices", ())) or range_text(item)


def _meaning(item: Field) -> str:
    text = item.metadata["doc"].rstrip(".")
    read_only = " Read-only." if item.metadata.get("read_only") else ""
    return f"{text[0].upper()}{text[1:]}.{read_only}"


def _type_name(kind: type) -> str:
    return f"{kind.__module__.split('.')[0]}/{kind.__name__}"


def _qos(row: Topic) -> str:
    words = ["reliable" if row.reliable else "best effort", "transient local" * row.latched]
    return ", ".join([*filter(None, words), f"depth {row.depth}"])


if __name__ == "__main__":
    print(reference(), end="")
