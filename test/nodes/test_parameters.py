"""Parameters: described, ranged, refused with a reason, never unknown in silence."""

import io
import math
from contextlib import redirect_stderr
from dataclasses import dataclass, fields

import pytest
import yaml
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter

from occ_recon_ros.errors import SettingsError
from occ_recon_ros.geometry.settings import setting
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode
from occ_recon_ros.nodes.mesher import MesherNode
from occ_recon_ros.nodes.parameters import Parameters, unknown_names
from occ_recon_ros.nodes.reconstructor import ReconstructorNode
from occ_recon_ros.nodes.rig_yaml import rig_yaml
from occ_recon_ros.nodes.settings import NODE_SETTINGS, all_names
from occ_recon_ros.nodes.virtual_turntable import VirtualTurntableNode
from occ_recon_ros.resources import config_file


@dataclass(frozen=True)
class Sample:
    rate: float = setting(1.0, "A rate.", within=(0.5, 8.0))
    count: int = setting(3, "A count.", within=(1, 9))
    mode: str = setting("a", "A mode.", choices=("a", "b"))
    on: bool = setting(False, "A switch.")
    fixed: int = setting(1, "Not to change.", read_only=True)

    def __post_init__(self):
        if self.on and self.mode == "b":
            raise ValueError("on: not in mode b")


class Holder(Node):
    def __init__(self, **kwargs):
        super().__init__("holder", **kwargs)
        self.mirror = Parameters(self, Sample)

    def set(self, **values):
        return self.set_parameters([Parameter(k, value=v) for k, v in values.items()])


def test_every_field_is_declared_described_and_ranged(ros):
    node = ros.start(Holder)
    rate, count, mode, fixed = (
        node.describe_parameter(n) for n in ("rate", "count", "mode", "fixed")
    )
    assert rate.description == "A rate."
    assert (rate.floating_point_range[0].from_value, rate.floating_point_range[0].to_value) == (
        0.5,
        8.0,
    )
    assert rate.type == ParameterType.PARAMETER_DOUBLE
    assert count.integer_range[0].from_value == 1
    assert mode.additional_constraints == "one of a, b"
    assert fixed.read_only
    assert not rate.read_only


def test_initial_values_are_taken(ros):
    node = ros.start(Holder, params={"rate": 2.5, "mode": "b"})
    assert node.mirror.values == Sample(rate=2.5, mode="b")


def test_a_whole_number_serves_for_a_real_one_at_the_start(ros):
    node = ros.start(Holder, params={"rate": 2})
    assert node.mirror.values.rate == 2.0
    assert isinstance(node.get_parameter("rate").value, float)


BAD = [
    ({"rate": 9.0}, "rate: must be 0.5 to 8.0, got 9.0"),
    ({"rate": math.nan}, "rate: must be finite"),
    ({"count": 0}, "count: must be 1 to 9, got 0"),
    ({"mode": "c"}, "mode: must be one of a, b"),
    ({"on": True, "mode": "b"}, "on: not in mode b"),
]


@pytest.mark.parametrize(("values", "says"), [*BAD, ({"count": "x"}, "must be a whole number")])
def test_a_bad_initial_value_is_refused_with_the_reason(ros, values, says):
    with pytest.raises(SettingsError, match=says):
        ros.start(Holder, params=values)


@pytest.mark.parametrize(("values", "says"), BAD)
def test_a_bad_value_at_run_time_is_refused_with_a_reason_and_changes_nothing(ros, values, says):
    node = ros.start(Holder)
    results = node.set_parameters_atomically([Parameter(k, value=v) for k, v in values.items()])
    assert not results.successful
    assert results.reason
    if not set(values) <= {"rate", "count"}:  # those are judged by rclpy first, in its words
        assert says in results.reason
    assert node.mirror.values == Sample()
    assert node.get_parameter("mode").value == "a"


def test_a_good_value_at_run_time_counts_at_once(ros):
    node = ros.start(Holder)
    assert all(r.successful for r in node.set(rate=4.0, mode="b"))
    assert node.mirror.values == Sample(rate=4.0, mode="b")


@pytest.mark.parametrize(
    ("kind", "name", "value", "says"),
    [
        (ContourTrackerNode, "smoothing_px", 20.0, "takes effect in the next scan: call ~/reset"),
        (ReconstructorNode, "baseline", 0.2, "takes effect in the next scan: call ~/reset"),
        (MesherNode, "longest_step", 4.0, "takes effect in the next scan: call ~/reset"),
        (MesherNode, "mesh_rate", 4.0, ""),
        (VirtualTurntableNode, "frames", 10, "takes effect when the node is started again"),
        (VirtualTurntableNode, "noise", 3.0, ""),
    ],
)
def test_the_answer_says_when_a_value_does_not_count_at_once(ros, kind, name, value, says):
    node = ros.start(kind)
    client = ros.start(Node, "client").create_client(
        SetParameters, f"{node.get_name()}/set_parameters"
    )
    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    for expected in (says, ""):  # the second time nothing changes
        (result,) = ros.call(client, request).results
        assert (result.successful, result.reason) == (True, expected)


def test_read_only_values_stay(ros):
    node = ros.start(Holder)
    (result,) = node.set(fixed=2)
    assert not result.successful
    assert node.mirror.values.fixed == 1


def test_a_name_that_no_node_knows_is_named_with_the_nearest(ros):
    node = ros.start(Holder, params={"mesh_rat": 1.0, "baseline": 0.2, "rate": 1.0})
    sentences = unknown_names(node, all_names())
    assert sentences == ["no node has a parameter 'mesh_rat': did you mean 'mesh_rate'?"]


def test_qos_can_be_overridden_and_a_misspelt_topic_is_named(ros):
    node = ros.start(
        MesherNode,
        params={
            "qos_overrides./rim.subscription.depth": 7,
            "qos_overrides./rims.subscription.depth": 7,
            "qos_overrides./image.subscription.depth": 7,  # which it hears where it colours
        },
    )
    (rim,) = [s for s in node.subscriptions if s.topic_name == "/rim"]
    assert rim.qos_profile.depth == 7
    (sentence,) = unknown_names(node, all_names())
    assert "qos_overrides./rims.subscription.depth" in sentence


def test_rig_yaml_is_what_the_declarations_say():
    written = config_file("rig.yaml").read_text(encoding="utf-8")
    assert written == rig_yaml(), "run: python -m occ_recon_ros.nodes.rig_yaml > config/rig.yaml"


def test_rig_yaml_holds_every_parameter_with_its_default_and_words():
    tree = yaml.safe_load(rig_yaml())
    for name, kind in NODE_SETTINGS.items():
        assert tree[f"/**/{name}"]["ros__parameters"] == {f.name: f.default for f in fields(kind)}
        assert all(f.metadata["doc"] for f in fields(kind))


@pytest.mark.parametrize("namespace", ["", "/rigs/left"])
def test_ros_reads_rig_yaml_in_any_namespace(ros, namespace, tmp_path):
    text = rig_yaml().replace("mesh_rate: 1.0", "mesh_rate: 2.5")
    file = tmp_path / "rig.yaml"
    file.write_text(text, encoding="utf-8")
    arguments = ["--ros-args", "--params-file", str(file)]
    with redirect_stderr(io.StringIO()):
        node = ros.start(MesherNode, namespace=namespace, cli_args=arguments)
    assert node.settings.mesh_rate == 2.5
    assert unknown_names(node, all_names()) == []
