"""contour_tracker: what it takes, what it drops, what it says."""

import cv2
import numpy as np
import pytest
from rig import SECOND, Rig, scan, send_until_seen, views
from sensor_msgs.msg import CompressedImage

from msg_adapters import (
    Level,
    decode_compressed,
    decode_contours,
    encode_camera_info,
    encode_image,
    encode_pose,
)
from msg_adapters.cloud import to_byte_array
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode


def send_next(graph, view=None, **changes):
    """A frame with some messages changed; returns what the tracker made or dropped."""
    graph.count = getattr(graph, "count", 0) + 1
    stamp = graph.count * SECOND
    camera, pixels = view or views()[0]
    messages = {
        "info": encode_camera_info(camera, stamp, "camera"),
        "pose": encode_pose(camera, stamp, "turntable"),
        "image": encode_image(pixels, stamp, "camera"),
    }
    for name, change in changes.items():
        change(messages[name])
    made, drops = len(graph.rig.got["contours"]), graph.tracker.drops.total()
    for name, message in messages.items():
        getattr(graph.rig, name).publish(message)
    graph.ros.spin_until(
        lambda: len(graph.rig.got["contours"]) > made or graph.tracker.drops.total() > drops
    )
    return len(graph.rig.got["contours"]) - made


def _set(**values):
    return lambda msg: [setattr(msg, k, v) for k, v in values.items()]


def _blank(value, shape=(240, 320), at=(), of=0):
    pixels = np.full(shape, value, np.uint8)
    if at:
        pixels[at] = of
    image = encode_image(pixels, 0, "camera")
    return _set(data=image.data, height=image.height, width=image.width, step=image.step)


@pytest.mark.parametrize(
    ("reason", "changes"),
    [
        ("bad_image", {"image": _set(encoding="magic")}),
        ("bad_image", {"image": _set(step=7)}),
        ("bad_image", {"image": _set(height=239)}),
        ("bad_image", {"image": _set(height=0, width=0, step=0, data=[])}),
        ("image_size", {"image": _blank(0, (100, 100))}),
        ("no_object", {"image": _blank(200)}),
        ("no_object", {"image": _blank(200, at=(slice(100, 101), slice(100, 102)))}),
        ("no_object", {"image": _blank(40, at=(slice(2, -2), slice(2, -2)), of=200)}),
        ("bad_camera_info", {"info": _set(k=np.zeros(9))}),
        ("bad_camera_info", {"info": _set(distortion_model="magic", d=[0.1])}),
        ("bad_camera_info", {"info": _set(d=[46.6, -3690.0, 0.4, 2.4, 0.0])}),
        ("bad_camera_pose", {"pose": lambda m: _set(x=float("nan"))(m.pose.position)}),
        (
            "bad_camera_pose",
            {"pose": lambda m: _set(w=0.0, x=0.0, y=0.0, z=0.0)(m.pose.orientation)},
        ),
        ("bad_camera_pose", {"pose": lambda m: _set(x=5e4)(m.pose.position)}),
        ("pose_frame", {"pose": lambda m: _set(frame_id="world")(m.header)}),
        ("bad_image", {"image": lambda m: _set(nanosec=2**32 - 1)(m.header.stamp)}),
    ],
)
def test_a_bad_frame_is_a_named_drop_and_the_next_good_one_works(graph, reason, changes):
    assert send_next(graph) == 1
    assert send_next(graph, **changes) == 0
    assert set(graph.tracker.drops) == {reason}
    key = f"dropped {reason}"  # in the first report that was made after it
    assert graph.report(graph.tracker, lambda r: key in r.values).values[key] == "1"
    send_next(graph)
    graph.ros.spin_until(lambda: len(graph.rig.got["contours"]) == 2)


def test_contours_carry_the_stamp_of_the_image_and_the_object_frame(graph):
    send_next(graph)
    got = decode_contours(graph.rig.got["contours"][0])
    assert (got.stamp_ns, got.frame_id) == (SECOND, "turntable")
    np.testing.assert_allclose(got.centre, views()[0][0].centre, atol=1e-6)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_compressed_images_serve_as_well(graph, suffix):
    _, pixels = views()[0]
    publisher = graph.rig.create_publisher(CompressedImage, "image/compressed", 5)
    graph.ros.spin_until(publisher.get_subscription_count)
    stamp = encode_image(pixels, 5 * SECOND, "camera").header
    data = to_byte_array(cv2.imencode(suffix, pixels)[1])
    graph.rig.send(views()[0], 5 * SECOND, parts=("info", "pose"))
    publisher.publish(CompressedImage(header=stamp, format=suffix[1:], data=data))
    graph.ros.spin_until(lambda: graph.rig.got["contours"])
    graph.rig.send(views()[0], 6 * SECOND)  # raw now: the compressed one still lives
    graph.settle()
    assert len(graph.rig.got["contours"]) == 1
    graph.rig.destroy_publisher(publisher)
    graph.rig.send(views()[0], 7 * SECOND)
    graph.ros.spin_until(lambda: len(graph.rig.got["contours"]) == 2)
    a, b = (decode_contours(msg).uv for msg in graph.rig.got["contours"])
    if suffix == ".png":
        np.testing.assert_array_equal(a, b)
    else:
        assert abs(a.mean(axis=0) - b.mean(axis=0)).max() < 0.2


def test_a_mask_is_awaited_when_someone_publishes_masks(graph):
    _, pixels = views()[0]
    mask = np.where(pixels < 200, 255, 0).astype(np.uint8)
    graph.rig.publish_mask(mask, SECOND)
    graph.ros.spin_until(lambda: graph.tracker.publishers_of("mask"))
    graph.rig.send(views()[0], 2 * SECOND)
    graph.settle()
    assert not graph.rig.got["contours"]
    graph.rig.publish_mask(mask, 2 * SECOND)
    graph.ros.spin_until(lambda: len(graph.rig.got["contours"]) == 1)
    graph.rig.send(views()[0], 3 * SECOND)
    graph.rig.send(views()[0], 4 * SECOND)
    graph.rig.publish_mask(mask, 4 * SECOND)
    graph.ros.spin_until(lambda: len(graph.rig.got["contours"]) == 2)
    assert graph.tracker.drops["no_mask"] == 1


def test_images_faster_than_the_work_drop_the_oldest_by_name(graph):
    for k, view in enumerate(views()[:9]):
        graph.rig.send(view, (k + 1) * SECOND, parts=("info", "pose"))
        graph.ros.spin_until(lambda n=k + 1: len(graph.tracker._pairing) == n)
        graph.settle(8)
    # All images at once, more than the queue for work holds, and none is worked on meanwhile.
    for k, (_, pixels) in enumerate(views()[:9]):
        graph.tracker._take("image", encode_image(pixels, (k + 1) * SECOND, "camera"))
    graph.ros.spin_until(lambda: len(graph.rig.got["contours"]) >= 5, what="the newest")
    graph.settle()
    assert graph.tracker.drops == {"overload": 4}
    stamps = [decode_contours(msg).stamp_ns // SECOND for msg in graph.rig.got["contours"]]
    assert stamps == [5, 6, 7, 8, 9]


def test_a_flood_over_the_topic_is_accounted_for_frame_by_frame(graph):
    send_next(graph)  # numbers are counted from the first that came
    total = 200
    for k in range(total):
        graph.rig.send(views()[k % 18], (k + 2) * SECOND)
        if k % 3 == 0:
            graph.ros.executor.spin_once(timeout_sec=0.0)
    contours = graph.rig.got["contours"]
    newest = (total + 1) * SECOND  # is not the one to go
    graph.ros.spin_until(lambda: decode_contours(contours[-1]).stamp_ns == newest, what="the last")
    drops, made = graph.tracker.drops, len(graph.rig.got["contours"]) - 1
    assert drops["lost_image"] > 0
    named = sum(drops[name] for name in ("overload", "no_camera_info", "no_camera_pose"))
    waiting = sum("image" in f.parts for f in graph.tracker._pairing._frames.values())
    assert made + named + waiting == total - drops["lost_image"]


def test_poses_of_another_rate_are_interpolated(make_graph):
    graph = make_graph({"tracker": {"pose_sync": "interpolate", "max_pose_gap": 0.2}})
    a, b = views()[0][0], views()[1][0]
    graph.rig.pose.publish(encode_pose(a, 1_000_000_000, "turntable"))
    graph.rig.send(views()[0], 1_050_000_000, parts=("info", "image"))
    graph.settle()
    assert not graph.rig.got["contours"]
    graph.rig.pose.publish(encode_pose(b, 1_100_000_000, "turntable"))
    graph.ros.spin_until(lambda: graph.rig.got["contours"])
    centre = decode_contours(graph.rig.got["contours"][0]).centre
    np.testing.assert_allclose(centre, a.pose.towards(b.pose, 0.5).centre, atol=1e-6)
    radii = [np.linalg.norm(c[:2]) for c in (a.centre, b.centre, centre)]
    np.testing.assert_allclose(radii, radii[0], atol=1e-6)  # around the table, not across


def test_a_gap_in_the_poses_drops_the_frame_by_name(make_graph):
    graph = make_graph({"tracker": {"pose_sync": "interpolate", "max_pose_gap": 0.05}})
    graph.rig.send(views()[0], 1_000_000_000)
    graph.rig.send(views()[1], 1_050_000_000, parts=("info", "image"))
    graph.rig.send(views()[2], 1_100_000_000)
    graph.ros.spin_until(lambda: len(graph.rig.got["contours"]) == 2)
    assert graph.tracker.drops == {"pose_gap": 1}


def test_the_drawn_contours_are_made_only_for_someone_who_looks(graph):
    send_next(graph)
    assert not graph.tracker.stages["draw"]
    seen = []
    graph.rig.create_subscription(CompressedImage, "contour_image/compressed", seen.append, 5)
    graph.ros.spin_until(lambda: graph.rig.count_publishers("contour_image/compressed"))
    graph.ros.spin_until(lambda: graph.tracker._drawn.get_subscription_count())
    send_next(graph)
    graph.ros.spin_until(lambda: seen)
    picture = decode_compressed(seen[0])
    assert picture.shape == (240, 320, 3)
    assert seen[0].header.stamp == graph.rig.got["contours"][1].header.stamp


def test_in_words_nothing_comes(graph):
    report = graph.report(graph.tracker, lambda r: "no images" in r.message)
    assert report.level == Level.WARN
    assert "/image (publishers: /rig)" in report.message


def test_in_words_the_pose_is_missing(make_graph, ros):
    graph = make_graph()
    graph.rig.destroy_publisher(graph.rig.pose)
    for k in range(3):
        graph.rig.send(views()[0], (k + 1) * SECOND, parts=("info", "image"))

    def says(report):
        return "images arrive but no camera_pose on /camera_pose" in report.message

    report = graph.report(graph.tracker, says)
    assert "publishers: none" in report.message
    assert report.level == Level.WARN


def test_in_words_a_publisher_offers_less_than_is_asked(ros):
    tracker = ros.start(
        ContourTrackerNode,
        params={"qos_overrides./image.subscription.reliability": "reliable"},
    )
    rig = ros.start(Rig)
    ros.spin_until(lambda: "RELIABILITY" in rig.reports.get("/contour_tracker", _Nothing).message)
    message = rig.reports["/contour_tracker"].message
    assert "publisher of /image cannot be used: its RELIABILITY" in message
    assert tracker.count_publishers("image") == 1


class _Nothing:
    message = ""


def test_reset_begins_a_new_scan_at_any_stamp(graph):
    scan(graph.ros, graph.rig, views()[:3], finish=False)
    for name in ("contour_tracker", "reconstructor", "mesher"):
        assert graph.ros.call(*graph.rig.trigger(f"{name}/reset")).success
    scan(graph.ros, graph.rig, views()[:3], start_s=7, finish=False)
    graph.settle()
    assert len(graph.rig.got["contours"]) == 6
    assert len(graph.rig.got["rim"]) == 2
    assert not graph.tracker.drops + graph.reconstructor.drops + graph.mesher.drops


def test_no_image_is_copied_into_the_wrong_frame(graph):
    """Messages of two frames that mix on the way still pair by stamp."""
    a, b = views()[0], views()[4]
    for view, stamp, part in (
        (a, 1, "image"),
        (b, 2, "image"),
        (b, 2, "pose"),
        (a, 1, "pose"),
        (a, 1, "info"),
        (b, 2, "info"),
    ):
        graph.rig.send(view, stamp * SECOND, parts=(part,))
        graph.settle(5)
    graph.ros.spin_until(lambda: len(graph.rig.got["contours"]) == 2)
    got = [decode_contours(msg) for msg in graph.rig.got["contours"]]
    for contours, (camera, _) in zip(got, (a, b), strict=True):
        np.testing.assert_allclose(contours.centre, camera.centre, atol=1e-6)


def test_one_stamp_far_ahead_is_dropped_and_the_scan_goes_on(graph):
    stamps = [100 * SECOND + k * SECOND // 10 for k in range(7)]
    for k, (view, stamp) in enumerate(zip(views(), stamps, strict=False)):
        if k == 3:
            graph.rig.send(view, stamp + 3600 * SECOND)
            graph.settle()
        else:
            send_until_seen(graph.ros, graph.rig, view, stamp)
    graph.ros.spin_until(lambda: graph.reconstructor.figures()["frames"] == 6)
    assert dict(graph.tracker.drops) == {"far_ahead": 1}
    assert "10 minutes ahead" in graph.tracker.last_drops["far_ahead"]
    assert not graph.reconstructor.drops + graph.mesher.drops
