"""The nodes that a command turns by hand."""

from std_srvs.srv import Trigger

from occ_recon_ros.cli import pipeline as module
from occ_recon_ros.cli.pipeline import pipeline


def test_a_long_callback_is_work_and_no_silence(monkeypatch, ros):
    monkeypatch.setattr(module, "_SERVICE_TIMEOUT_S", 0.5)
    with pipeline(["--ros-args", "--log-level", "error"], {}, ros.domain_id) as nodes:
        tracker = nodes.nodes["contour_tracker"]

        def slow() -> str:
            end = tracker.get_clock().now().nanoseconds + 1_500_000_000
            while tracker.get_clock().now().nanoseconds < end:
                pass
            return "done"

        tracker.offer("~/slow", slow)
        assert nodes.call(tracker, Trigger, "contour_tracker/slow").message == "done"


def test_silence_has_an_end(ros):
    with pipeline(["--ros-args", "--log-level", "error"], {}, ros.domain_id) as nodes:
        assert not nodes.spin_until(lambda: False, 0.3)
