"""Topics, services and diagnostics as the contract names them."""

from rig import SECOND, scan, views


def test_diagnostics_hold_rates_times_and_the_state_of_the_scan(graph):
    scan(graph.ros, graph.rig, views(), start_s=graph.rig.get_clock().now().nanoseconds // SECOND)
    tracker = graph.report(graph.tracker)
    for stage in ("contours", "decode", "encode", "latency"):
        median, p95 = (float(tracker.values[f"{stage} {which} ms"]) for which in ("median", "p95"))
        assert 0 < median <= p95
    assert 0 < float(tracker.values["memory MB"]) <= float(tracker.values["memory peak MB"])
    reconstructor = graph.report(graph.reconstructor)
    assert reconstructor.values["frames"] == "18"
    assert reconstructor.values["angle covered deg"] == "360"  # 18 steps of 20 degrees
    good = int(reconstructor.values["samples good"])
    every = sum(int(v) for k, v in reconstructor.values.items() if k.startswith("samples "))
    assert every == sum(msg.width for msg in graph.rig.got["rim"])
    assert good > every / 2
    mesher = graph.report(graph.mesher)
    assert mesher.values["triangles"] == str(len(graph.rig.triangles()))


def test_services_have_the_types_of_the_contract(graph):
    offered = dict(graph.rig.get_service_names_and_types())
    trigger, set_bool = "std_srvs/srv/Trigger", "std_srvs/srv/SetBool"
    for name in (
        "/contour_tracker/reset",
        "/reconstructor/reset",
        "/reconstructor/finish",
        "/mesher/reset",
        "/mesher/save",
    ):
        assert offered[name] == [trigger]
    assert offered["/mesher/pause"] == [set_bool]


def test_topics_have_the_types_and_qos_of_the_contract(graph):
    reliable, best_effort = "RELIABLE", "BEST_EFFORT"
    wanted = {
        "/image": ("Image", best_effort, "VOLATILE"),
        "/image/compressed": ("CompressedImage", best_effort, "VOLATILE"),
        "/mask": ("Image", best_effort, "VOLATILE"),
        "/mask/compressed": ("CompressedImage", best_effort, "VOLATILE"),
        "/camera_info": ("CameraInfo", best_effort, "VOLATILE"),
        "/camera_pose": ("PoseStamped", reliable, "VOLATILE"),
        "/contours": ("PointCloud2", reliable, "VOLATILE"),
        "/rim": ("PointCloud2", reliable, "VOLATILE"),
        "/strip": ("PointCloud2", reliable, "VOLATILE"),
        "/mesh": ("PointCloud2", reliable, "TRANSIENT_LOCAL"),
        "/mesh_marker": ("Marker", reliable, "TRANSIENT_LOCAL"),
        "/contour_image/compressed": ("CompressedImage", reliable, "VOLATILE"),
        "/diagnostics": ("DiagnosticArray", reliable, "VOLATILE"),
    }
    for topic, (kind, reliability, durability) in wanted.items():
        ends = [
            *graph.rig.get_publishers_info_by_topic(topic),
            *graph.rig.get_subscriptions_info_by_topic(topic),
        ]
        ours = [end for end in ends if end.node_name != "rig"]
        assert ours
        for end in ours:
            assert end.topic_type.endswith(f"/{kind}")
            assert end.qos_profile.reliability.name == reliability
            assert end.qos_profile.durability.name == durability
