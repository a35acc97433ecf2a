"""The settings of each node: one frozen dataclass a node, each field a ROS parameter."""

from dataclasses import dataclass, fields
from itertools import product
from typing import Any

from occ_recon_ros.geometry import RimSettings
from occ_recon_ros.geometry.settings import setting
from occ_recon_ros.imaging import ContourSettings
from occ_recon_ros.scene import OBJECTS, RenderSettings, TurntableSettings
from occ_recon_ros.streams.pairing import MAX_POSE_GAP_NS
from occ_recon_ros.streams.scan_files import check_name
from occ_recon_ros.streams.topics import TOPICS
from occ_recon_ros.surface import SUFFIXES, SurfaceSettings


def _object_frame() -> Any:
    return setting(
        "turntable",
        "Name of the object frame; messages in another frame are dropped.",
        read_only=True,
    )


@dataclass(frozen=True)
class CheckpointSettings:
    """Parameters of the nodes that can go on with a scan after a crash."""

    checkpoint_every: int = setting(
        0,
        "Keep the scan in checkpoint_path, forced onto the disk each so many frames: "
        "a killed node loses none, a power cut at most these; 0: keep none.",
        within=(0, 1_000_000),
        read_only=True,
    )
    checkpoint_path: str = setting(
        "occ_recon_checkpoint", "Folder of the checkpoints, a file a node.", read_only=True
    )
    resume: bool = setting(
        False,
        "Go on with the scan in checkpoint_path, if there is one; else it is kept beside the new "
        "one as .previous.",
        read_only=True,
    )


@dataclass(frozen=True)
class TrackerSettings(ContourSettings, CheckpointSettings):
    """Parameters of contour_tracker."""

    object_frame: str = _object_frame()
    pose_source: str = setting(
        "topic",
        "topic: poses come on camera_pose; tf: from /tf and /tf_static, as the pose of the image's "
        "frame_id in object_frame at its stamp (needs tf2_msgs).",
        choices=("topic", "tf"),
        read_only=True,
    )
    pose_sync: str = setting(
        "exact",
        "exact: the pose has the stamp of the image; interpolate: it is taken from the poses "
        "before and after the image.",
        choices=("exact", "interpolate"),
        read_only=True,
    )
    max_pose_gap: float = setting(
        MAX_POSE_GAP_NS * 1e-9,
        "Widest gap between the two poses that interpolate or tf takes, s.",
        within=(0.0, 60.0),
        read_only=True,
    )
    sync_queue: int = setting(
        10,
        "Frames that wait for their camera_info, pose or mask; of more, the oldest goes.",
        within=(1, 1000),
        read_only=True,
    )
    work_queue: int = setting(
        5,
        "Whole frames that wait to be worked on; of more, the oldest goes.",
        within=(1, 1000),
        read_only=True,
    )
    learn_after: float = setting(
        270.0,
        "Angle of the turn from whose frames segmentation: learnt learns, degrees; of less, and "
        "with auto, it is learnt at ~/finish.",
        within=(30.0, 360.0),
    )
    learn_frames: int = setting(
        120,
        "Frames without masks that are kept, spread evenly, to be held against each other, and "
        "taken again at ~/finish where they contradict each other; 0: none, each image is taken "
        "by itself.",
        within=(0, 1000),
    )
    learn_memory: int = setting(
        128,
        "Most memory for these frames, MB, as JPEG of quality 95 (16 bits: PNG); fewer are kept "
        "where they are larger.",
        within=(1, 100_000),
    )


@dataclass(frozen=True)
class BoardPoseSettings:
    """Parameters of board_pose."""

    object_frame: str = _object_frame()
    board: str = setting(
        "board.yaml", "File of the printed board, as 'occ-recon board' writes it.", read_only=True
    )
    publish_mask: bool = setting(
        True,
        "Publish mask: what hides the board is the object, so that the board's own edges are no "
        "contours. False where somebody else makes masks.",
        read_only=True,
    )
    sync_queue: int = setting(
        10,
        "Images that wait for their camera_info; of more, the oldest goes.",
        within=(1, 1000),
        read_only=True,
    )


@dataclass(frozen=True)
class TurntablePoseSettings:
    """Parameters of turntable_pose."""

    object_frame: str = _object_frame()
    axis: str = setting(
        "axis.yaml",
        "File of the calibrated axis, as 'occ-recon calibrate axis' writes it.",
        read_only=True,
    )
    joint: str = setting(
        "", "Name of the joint in joint_states; empty: that of the axis file, or the only one."
    )
    max_speed: float = setting(
        10.0,
        "A joint that turns faster from message to message has jumped, rad/s; 0: any.",
        within=(0.0, 1e6),
    )
    slip_tolerance: float = setting(
        1.0,
        "Encoder and board_camera_pose, where there is one, may differ by this much, degrees.",
        within=(0.0, 180.0),
    )


@dataclass(frozen=True)
class ReconstructorSettings(RimSettings, CheckpointSettings):
    """Parameters of reconstructor."""

    object_frame: str = _object_frame()
    shape_fields: bool = setting(
        False,
        "Add to each rim point k_s, theta, gauss and mean: its curvature along the rim, "
        "the angle from ray to rim, Gaussian and mean curvature.",
    )


@dataclass(frozen=True)
class MesherSettings(SurfaceSettings, CheckpointSettings):
    """Parameters of mesher."""

    object_frame: str = _object_frame()
    color: bool = setting(
        False,
        "Colour each vertex from the images that see it most frontally: the node then hears image, "
        "camera_info and camera_pose too, and keeps up to 48 images of 0.75 megapixels (108 MB). "
        "Grey images give no colour.",
        read_only=True,
    )
    mesh_rate: float = setting(
        1.0,
        "The whole mesh is published at most this often, Hz; less often where that would take "
        "more than 4 % of the time.",
        within=(0.01, 30.0),
    )
    marker_triangles: int = setting(
        20_000, "Triangles of mesh_marker; more are thinned out.", within=(1, 1_000_000)
    )
    output_dir: str = setting(
        "occ_recon_scans",
        "Folder that all files are written into, a folder a scan; ~ is the home folder.",
        read_only=True,
    )
    output_format: str = setting(
        "ply",
        "Format of the surfaces: mesh and closed.",
        choices=tuple(suffix[1:] for suffix in SUFFIXES),
        read_only=True,
    )
    scan_name: str = setting(
        "",
        "Name of the scan's folder in output_dir; empty: scan_YYYYmmdd_HHMMSS, of its beginning.",
    )
    finish_when_closed: bool = setting(
        True, "Finish and save the scan, as ~/finish does, when the camera has been all around."
    )
    reset_when_saved: bool = setting(
        False, "Begin a new scan after one that finish_when_closed has saved: the next object."
    )
    closed_preview: float = setting(
        5.0,
        "Seconds between coarse previews of the closed body, made in a process of its own; 0: "
        "none. The whole body is made when the turn is finished.",
        within=(0.0, 3600.0),
    )
    close_body: bool = setting(
        True, "Whether the watertight body is made, on `closed` and in the files.", read_only=True
    )
    body_cells: int = setting(
        200,
        "Grid cells along the longest side of the watertight body: parts thinner than one may be "
        "lost; time and size grow with the square.",
        within=(16, 600),
    )
    save_on_shutdown: bool = setting(True, "Save what is not saved yet when the node ends.")

    def __post_init__(self) -> None:
        """Check what the fields alone do not say."""
        check_name(self.scan_name)


@dataclass(frozen=True)
class VirtualTurntableSettings(RenderSettings, TurntableSettings):
    """Parameters of virtual_turntable."""

    object_frame: str = _object_frame()
    object: str = setting(
        "vase", "The object on the table.", choices=tuple(OBJECTS), read_only=True
    )
    frame_rate: float = setting(
        5.0, "Frames a second; 0: only when asked by the program.", within=(0.0, 1000.0)
    )
    camera_frame: str = setting("camera", "Name of the camera optical frame.", read_only=True)
    broadcast_tf: bool = setting(
        False, "Send the camera's place on /tf too (needs tf2_msgs).", read_only=True
    )
    seed: int = setting(0, "Seed of the image noise.", within=(0, 2**31 - 1), read_only=True)


@dataclass(frozen=True)
class ViewerSettings:
    """Parameters of viewer."""

    host: str = setting(
        "127.0.0.1",
        "Address that the page is served on. Any other than one of this host alone, such as "
        "0.0.0.0, asks for a token.",
        read_only=True,
    )
    port: int = setting(
        8080,
        "Port of the page, or the next that is free; 0: any.",
        within=(0, 65535),
        read_only=True,
    )
    token: str = setting(
        "",
        "What the address of the page must end in (?token=...); made up at each start where "
        "it is empty and others than this host can reach the page.",
        read_only=True,
    )
    page_rate: float = setting(
        5.0, "The page is brought up to date so often, Hz.", within=(0.1, 30.0), read_only=True
    )


_POLICIES = ("depth", "durability", "history", "reliability")

NODE_SETTINGS: dict[str, type] = {
    "contour_tracker": TrackerSettings,
    "reconstructor": ReconstructorSettings,
    "mesher": MesherSettings,
    "board_pose": BoardPoseSettings,
    "turntable_pose": TurntablePoseSettings,
    "virtual_turntable": VirtualTurntableSettings,
    "viewer": ViewerSettings,
}


def all_names() -> set[str]:
    """The parameter names of all nodes, with the policies of all topics: which of them a node
    declares hangs on what it is asked to do."""
    policies = product(TOPICS, ("publisher", "subscription"), _POLICIES)
    topics = {
        f"qos_overrides./{row.name.lstrip('/')}.{end}.{policy}" for row, end, policy in policies
    }
    return topics | {item.name for kind in NODE_SETTINGS.values() for item in fields(kind)}
