"""Images that were dropped before an outline was sought in them are no fault of their masks."""

import json

import pytest
from plaster import imported
from recordings import read_all

from occ_recon_ros.bags.views import BagViews
from occ_recon_ros.bags.writer import new_bag
from occ_recon_ros.evaluation.advice import EMPTY, of_drops
from occ_recon_ros.evaluation.alone import each_alone
from occ_recon_ros.evaluation.evidence import Evidence
from occ_recon_ros.evaluation.verdict import judge
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras

CAMERAS = turntable_cameras(TurntableSettings(frames=13, width=480, height=360, focal_px=600.0))


def judged(drops, without=7):
    contours = [make_object("vase").exact_contours(c, stamp_ns=k) for k, c in enumerate(CAMERAS)]
    evidence = Evidence(contours, (), 20, 0.8, given=True, lost=of_drops(drops, without))
    verdict = judge(evidence)
    return verdict.reasons[0], verdict.advice[0]


@pytest.mark.parametrize(
    ("drops", "said", "advised"),
    [
        ({"no_camera_pose": 7}, ": 7 had no camera_pose", "each image has a pose"),
        ({"pose_gap": 4, "no_object": 3}, ": 4 had no poses near", "max_pose_gap"),
        (
            {"no_camera_info": 6, "bad_mask": 1},
            ": 6 had no camera_info, 1 had",
            "camera_info comes",
        ),
        ({"left_out": 5, "no_object": 5}, ": 5 were left out", "what is said of each view"),
        ({"pose_frame": 7}, ": 7 had a pose in another frame", "object_frame=NAME"),
    ],
)
def test_the_reason_is_said_and_what_helps(drops, said, advised):
    what, do = judged(drops)
    assert "7 of 20 images gave no outline" + said in what
    assert advised in do
    assert not do.startswith(("mend", "give"))


@pytest.mark.parametrize("drops", [{}, {"no_object": 7}, {"no_camera_pose": 1, "no_object": 6}])
def test_where_most_had_all_they_need_masks_are_looked_at(drops):
    assert judged(drops) == ("7 of 20 images gave no outline", EMPTY)


def test_outlines_of_a_bag_agree_without_the_images_that_lack_a_pose(command, toy, tmp_path):
    # They were counted as images that gave no outline, and all views were looked at together.
    content = json.loads((toy / "cameras.json").read_text())
    for frame in content["frames"]:
        frame["file"] = str(toy / frame["file"])
    messages = read_all(imported(command, content, tmp_path))
    poses = [m for m in messages if m.topic == "/camera_pose"]
    with new_bag(tmp_path / "fewer", "mcap") as writer:
        for m in messages:
            if not any(m is pose for pose in poses[-3:]):
                writer.write(m.topic, m.msgtype, m.time_ns, m.cdr)
    views = BagViews(tmp_path / "fewer")
    assert len(views) == len(poses)
    alone = each_alone(views, lambda *_: None)
    assert len(alone.masks) == len(poses) - 3
    assert alone.doubts == ()
