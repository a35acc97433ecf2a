"""What the command line may say about parameters and topics."""

import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from occ_recon_ros.bags.choice import choose_topics
from occ_recon_ros.bags.reader import Bag
from occ_recon_ros.cli.arguments import (
    parse_namespace,
    parse_remaps,
    parse_settings,
    ros_arguments,
)
from occ_recon_ros.errors import UserError

IMAGE = "sensor_msgs/msg/Image"
INFO = "sensor_msgs/msg/CameraInfo"
POSE = "geometry_msgs/msg/PoseStamped"
RIG = {"mask": IMAGE, "image": IMAGE, "camera_info": INFO}


def bag(**types: str) -> Bag:
    named = {"/" + name.replace("__", "/"): msgtype for name, msgtype in types.items()}
    return Bag(Path("scan"), named, Counter(dict.fromkeys(named, 5)))


def test_values_take_the_type_of_their_parameter():
    values = parse_settings(
        [
            "mesher.color=Yes",
            "mesher.marker_triangles=7",
            "reconstructor.baseline=1",
            "mesher.output_dir=a=b",
        ]
    )
    assert values == {
        "mesher": {"color": True, "marker_triangles": 7, "output_dir": "a=b"},
        "reconstructor": {"baseline": 1.0},
    }
    assert type(values["reconstructor"]["baseline"]) is float


@pytest.mark.parametrize(
    ("assignment", "words"),
    [
        ("mesher", "NODE.PARAM=VALUE"),
        ("color=true", "NODE.PARAM=VALUE"),
        ("messer.color=true", "did you mean 'mesher'"),
        ("mesher.mesh_rat=1", "did you mean 'mesh_rate'"),
        ("mesher.color=maybe", "true or false"),
        ("mesher.marker_triangles=1.5", "whole number"),
        ("reconstructor.baseline=wide", "a number"),
        ("reconstructor.baseline=nan", "finite"),
        ("reconstructor.baseline=100", "0.001 to 1.0"),
        ("contour_tracker.segmentation=magic", "one of"),
    ],
)
def test_a_value_that_cannot_be_is_refused_in_words(assignment, words):
    with pytest.raises(UserError, match=words):
        parse_settings([assignment])


def test_topics_by_their_own_names():
    recording = bag(
        image=IMAGE, camera_info=INFO, camera_pose=POSE, mask=IMAGE, tf="tf2_msgs/msg/TFMessage"
    )
    expected = {t: t for t in ("/image", "/camera_info", "/camera_pose", "/mask")}
    assert choose_topics(recording, {}) == expected


def test_topics_by_remapping():
    recording = bag(rig__image_raw=IMAGE, rig__camera_info=INFO, arm__pose=POSE, image=POSE)
    remaps = parse_remaps(
        ["rig/image_raw:=image", "/rig/camera_info:=/camera_info", "/arm/pose:=/camera_pose"]
    )
    assert choose_topics(recording, remaps) == {
        "/rig/image_raw": "/image",
        "/rig/camera_info": "/camera_info",
        "/arm/pose": "/camera_pose",
    }


def test_compressed_images_serve_where_there_are_no_others():
    compressed = "sensor_msgs/msg/CompressedImage"
    recording = bag(image__compressed=compressed, camera_info=INFO, camera_pose=POSE)
    assert "/image/compressed" in choose_topics(recording, {})
    recording.types["/image"] = IMAGE
    recording.counts["/image"] = 5
    assert "/image/compressed" not in choose_topics(recording, {})


def test_missing_topics_are_named_with_what_there_is_and_what_to_try():
    with pytest.raises(UserError) as error:
        choose_topics(bag(rig__image=IMAGE, camera_info=INFO), {})
    message = str(error.value)
    assert "has no /image (sensor_msgs/msg/Image), /camera_pose (geometry_msgs" in message
    assert "it has /rig/image (sensor_msgs/msg/Image), /camera_info" in message
    assert "--remap /rig/image:=/image" in message
    with pytest.raises(UserError, match="it has nothing"):
        choose_topics(bag(), {})


def test_the_only_topic_that_can_be_it_is_taken():
    compressed, odometry = "sensor_msgs/msg/CompressedImage", "nav_msgs/msg/Odometry"
    recording = bag(
        rig__image=IMAGE, rig__image__compressed=compressed, rig__info=INFO, vio__odom=odometry
    )
    expected = {"/rig/image": "/image", "/rig/info": "/camera_info", "/vio/odom": "/camera_pose"}
    assert choose_topics(recording, {}) == expected
    del recording.types["/rig/image"]
    assert choose_topics(recording, {})["/rig/image/compressed"] == "/image/compressed"
    with_covariance = "geometry_msgs/msg/PoseWithCovarianceStamped"
    alone = bag(image=IMAGE, camera_info=INFO, camera_pose_cov=with_covariance)
    assert choose_topics(alone, {})["/camera_pose_cov"] == "/camera_pose"


def test_of_several_that_can_be_it_all_are_named_and_the_first_is_a_way_on():
    compressed = "sensor_msgs/msg/CompressedImage"
    recording = bag(a__raw__compressed=compressed, b__raw=IMAGE, info=INFO, p=POSE, q=POSE)
    with pytest.raises(UserError) as error:
        choose_topics(recording, {})
    assert str(error.value).endswith(
        "try --remap /b/raw:=/image --remap /info:=/camera_info --remap /p:=/camera_pose "
        "(or /a/raw/compressed for /image, /q for /camera_pose)"
    )
    remaps = {"/a/raw/compressed": "/image", "/info": "/camera_info", "/q": "/camera_pose"}
    assert choose_topics(recording, remaps)["/a/raw/compressed"] == "/image/compressed"


def test_of_two_cameras_the_topics_of_one_are_proposed_and_masks_as_masks():
    cameras = {f"cam{k}__{name}": kind for k in (0, 1) for name, kind in RIG.items()}
    with pytest.raises(UserError) as error:
        choose_topics(bag(**{"cam1__camera_info": INFO, **cameras, "camera_pose": POSE}), {})
    assert str(error.value).endswith(
        "try --remap /cam0/image:=/image --remap /cam0/camera_info:=/camera_info "
        "--remap /cam0/mask:=/mask (or /cam1/image for /image, /cam1/camera_info for "
        "/camera_info, /cam1/mask for /mask)"
    )


def test_of_one_camera_all_is_taken_and_what_is_no_picture_is_left():
    topics = {f"d__color__{name}": kind for name, kind in RIG.items()}
    depth = {"d__depth__camera_info": INFO, "d__depth__image_rect_raw": IMAGE}
    chosen = choose_topics(bag(**depth, **topics, camera_pose=POSE), {})
    assert chosen == {
        "/d/color/image": "/image",
        "/d/color/camera_info": "/camera_info",
        "/d/color/mask": "/mask",
        "/camera_pose": "/camera_pose",
    }
    # Images of such a name are images where there are no others.
    assert choose_topics(bag(mask_out=IMAGE, camera_info=INFO, camera_pose=POSE), {}) == {
        "/mask_out": "/image",
        "/camera_info": "/camera_info",
        "/camera_pose": "/camera_pose",
    }


def test_an_empty_topic_is_a_missing_one():
    recording = bag(image=IMAGE, camera_info=INFO, camera_pose=POSE)
    recording.counts["/camera_pose"] = 0
    with pytest.raises(UserError, match="has no /camera_pose"):
        choose_topics(recording, {})


def test_wrong_types_and_remaps_are_refused():
    recording = bag(image=POSE, camera_info=INFO, camera_pose=POSE)
    with pytest.raises(UserError, match="/image of the bag is geometry_msgs"):
        choose_topics(recording, {})
    with pytest.raises(UserError, match="the bag has no /picture"):
        choose_topics(recording, {"/picture": "/image"})
    with pytest.raises(UserError, match="/photo is none of"):
        choose_topics(recording, {"/image": "/photo"})
    with pytest.raises(UserError, match="FROM:=TO"):
        parse_remaps(["/image=/photo"])
    with pytest.raises(UserError, match="renamed twice"):
        parse_remaps(["a:=image", "/a:=mask"])


def test_what_is_no_bag_is_told_of_before_what_replays_it_is_loaded(tmp_path):
    script = (
        "import sys; from occ_recon_ros.cli.app import run; code = run(sys.argv[1:]); "
        "print(code, [m for m in ('rclpy', 'numba', 'cv2', 'trimesh') if m in sys.modules])"
    )
    words = ["replay", str(tmp_path / "none.mcap"), "--out", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-c", script, *words], capture_output=True, text=True, check=True
    )
    assert "does not exist" in done.stderr
    assert done.stdout.split(maxsplit=1) == ["2", "[]\n"]


@pytest.mark.parametrize("key", ["contour_traker:", "/**/contour_traker:", "/rig2/contour_traker:"])
def test_a_node_of_a_parameter_file_that_is_misspelt_is_refused(tmp_path, key):
    file = tmp_path / "rig.yaml"
    file.write_text(f"{key}\n  ros__parameters:\n    spacing_px: 2.0\n")
    with pytest.raises(UserError, match="no node 'contour_traker': did you mean 'contour_tracker'"):
        ros_arguments(file, "info")


def test_a_parameter_file_may_hold_other_nodes_which_is_said(tmp_path, capsys):
    file = tmp_path / "rig.yaml"
    known = "  ros__parameters:\n    a: 1\n"
    nested = "rig2:\n  mesher:\n    ros__parameters:\n      mesh_rate: 2.0\n"
    file.write_text(f"/**:\n{known}/rig/viewer:\n{known}/**/turntable_driver:\n{known}{nested}")
    assert str(file) in ros_arguments(file, "info")
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "'turntable_driver' is none of our nodes" in said


def test_the_parameter_files_that_come_along_name_our_nodes(capsys):
    for file in Path(__file__).resolve().parents[2].glob("config/*.yaml"):
        ros_arguments(file, "info")
    assert not capsys.readouterr().err


def test_a_namespace_that_cannot_be_is_refused_in_words():
    assert parse_namespace("") == "/"
    assert parse_namespace("rig2/left/") == "/rig2/left"
    for wrong in ("2rig", "a b", "rig-2", "a//b"):
        with pytest.raises(UserError, match=f"--namespace {wrong}: each part of it must begin"):
            parse_namespace(wrong)
