"""Stamps that do not meet: the nodes say which, by how much, and what helps."""

import pytest
from rig import SECOND, Rig, told, views

from occ_recon_ros.nodes.board_pose import BoardPoseNode
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode
from occ_recon_ros.poses import BoardSpec, board_to_yaml

MS = SECOND // 1000
YEARS = 1_700_000_000 * SECOND
BY_RATE = {"pose_sync": "interpolate", "max_pose_gap": 0.1}


def sent(
    rig,
    images=6,
    info=lambda stamp: stamp,
    pose=lambda stamp: stamp,
    frame="turntable",
    since=10 * SECOND,
):
    """Frames 100 ms apart, with stamps of their parts made other; None: none comes."""
    for k in range(images):
        stamp = since + k * 100 * MS
        for part, change in (("image", lambda s: s), ("info", info), ("pose", pose)):
            if change(stamp) is not None:
                rig.send(views()[0], change(stamp), frame, parts=(part,))


CASES = {
    "camera_info 1 us late": (
        {},
        {"info": lambda s: s + 1000},
        "camera_info has the stamp of no image, the nearest is 1 us later: it must have the stamp",
    ),
    "camera_info of 0": ({}, {"info": lambda s: 0}, "the stamps of camera_info are 0"),
    "poses 3 ms early": (
        {},
        {"pose": lambda s: s - 3 * MS},
        "camera_pose has the stamp of no image, the nearest is 3 ms earlier: poses of another "
        "rate need pose_sync: interpolate",
    ),
    "poses too far apart": (
        BY_RATE,
        {"pose": lambda s: s + 50 * MS if s // (100 * MS) % 2 else None},
        "the poses around an image are 0.200 s apart, and max_pose_gap is 0.1 s: set it to 0.3",
    ),
    "poses late": (
        {**BY_RATE, "sync_queue": 3},
        {"pose": lambda s: s - 400 * MS},
        "camera_pose comes 0.40 s after its image, when 4 later ones have come, and sync_queue is "
        "3: set it to 8",
    ),
    "poses of 0": (BY_RATE, {"pose": lambda s: 0}, "the stamps of camera_pose are 0"),
    "poses since a start": (
        BY_RATE,
        {"pose": lambda s: s - YEARS + 9 * SECOND, "since": YEARS},
        "the stamps of camera_pose are of another clock than those of the images (since a start",
    ),
    "poses that begin later": (
        BY_RATE,
        {"pose": lambda s: s + SECOND},
        "all poses are later than the images, by 500 ms",
    ),
    "no poses": ({}, {"pose": lambda s: None}, "no camera_pose on"),
}


@pytest.fixture
def start(ros):
    def started(params):
        node = ros.start(ContourTrackerNode, params=params)
        rig = ros.start(Rig)
        ends = (rig.image, rig.info, rig.pose)
        ros.spin_until(lambda: all(end.get_subscription_count() for end in ends))
        return node, rig

    return started


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_which_stamps_are_off_and_by_how_much(ros, start, case):
    params, changes, words = CASES[case]
    node, rig = start(params)
    rig.reports.clear()
    sent(rig, **changes)
    message = told(ros, rig, node, words).message
    if params:
        assert "interpolate" not in message
    assert not rig.got["contours"]


def test_poses_of_another_frame_are_not_said_to_have_other_stamps(ros, start):
    node, rig = start({})
    sent(rig, frame="table")
    assert "do not meet" not in told(ros, rig, node, "poses are in frame 'table'").message


@pytest.mark.parametrize("pose", [0, 5])
def test_images_that_all_have_one_stamp(ros, start, pose):
    node, rig = start({})
    for _ in range(5):
        rig.send(views()[0], 0, parts=("info", "image"))
        rig.send(views()[0], pose, parts=("pose",))
    told(ros, rig, node, "all images have the stamp 0 s: what sends them must set it")


def test_frames_a_microsecond_apart_are_not_named_alike(ros, start):
    node, rig = start({"sync_queue": 2})
    sent(rig, info=lambda s: s + 1000)
    ros.spin_until(lambda: {"no_image", "no_camera_info"} <= node.drops.keys(), what="drops")
    frames = {node.last_drops[reason].split(",")[0] for reason in ("no_image", "no_camera_info")}
    assert len(frames) == 2


def test_the_board_is_told_of_too(ros, tmp_path):
    board = tmp_path / "board.yaml"
    board.write_text(board_to_yaml(BoardSpec()))
    node = ros.start(BoardPoseNode, params={"board": str(board)})
    rig = ros.start(Rig)
    ros.spin_until(lambda: rig.image.get_subscription_count() and rig.info.get_subscription_count())
    sent(rig, info=lambda s: s + 2 * MS, pose=lambda s: None)
    told(ros, rig, node, "camera_info has the stamp of no image, the nearest is 2 ms later")
