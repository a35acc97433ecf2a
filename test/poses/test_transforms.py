"""Frames in frames, in between stamps, and trees that are none."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from occ_recon_ros.geometry.pose import CameraPose
from occ_recon_ros.poses.transforms import NoTransform, Transform, TransformTree

S = 10**9


def pose(x=0.0, y=0.0, z=0.0, turn=(0.0, 0.0, 0.0)):
    return CameraPose(Rotation.from_rotvec(turn).as_matrix(), np.array([x, y, z]))


def tree(*transforms, static=()):
    found = TransformTree()
    for parent, child, stamp, place in transforms:
        found.add(Transform(parent, child, stamp, place))
    for parent, child, place in static:
        found.add(Transform(parent, child, 0, place), static=True)
    return found


def rig():
    """A table that turns by 90 degrees in a second before a camera that stands."""
    return tree(
        ("world", "table", 0, pose()),
        ("world", "table", S, pose(turn=(0, 0, np.pi / 2))),
        static=[
            ("world", "arm", pose(x=1.0)),
            ("arm", "optical", pose(z=0.5, turn=(0, np.pi, 0))),
        ],
    )


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 1.0])
def test_the_camera_goes_around_the_table_that_turns(share: float) -> None:
    found = rig().lookup("table", "optical", int(share * S))
    angle = -share * np.pi / 2
    assert found.centre == pytest.approx([np.cos(angle), np.sin(angle), 0.5], abs=1e-9)
    turn = Rotation.from_rotvec([0, 0, angle]) * Rotation.from_rotvec([0, np.pi, 0])
    assert found.R_object_camera == pytest.approx(turn.as_matrix(), abs=1e-9)


@given(st.integers(0, S), st.sampled_from(["world", "arm", "optical", "table"]))
def test_there_and_back_is_nowhere(stamp: int, other: str) -> None:
    there, back = rig().lookup("table", other, stamp), rig().lookup(other, "table", stamp)
    assert there.R_object_camera @ back.R_object_camera == pytest.approx(np.eye(3), abs=1e-9)
    assert there.R_object_camera @ back.centre + there.centre == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("reason", "found", "stamp"),
    [
        ("tf_early", rig(), -1),
        ("tf_late", rig(), S + 1),
        ("tf_gap", rig(), S // 2),
        ("tf_unconnected", tree(("world", "table", 0, pose())), 0),
        (
            "tf_loop",
            tree(("a", "optical", 0, pose()), ("b", "a", 0, pose()), ("optical", "b", 0, pose())),
            0,
        ),
    ],
)
def test_what_cannot_be_had_has_a_name(reason: str, found: TransformTree, stamp: int) -> None:
    with pytest.raises(NoTransform) as error:
        found.lookup("table", "optical", stamp, S // 10)
    assert error.value.reason == reason


def test_transforms_come_in_any_order() -> None:
    places = [("w", "c", k * S, pose(x=k)) for k in (3, 1, 2, 0)]
    # The first two are out of order, not a jump back in time.
    assert tree(*places).lookup("w", "c", int(2.5 * S)).centre[0] == pytest.approx(2.5)


def test_time_that_goes_back_forgets_what_was() -> None:
    found = tree(("w", "c", 50 * S, pose(x=5)), ("w", "c", 60 * S, pose(x=6)))
    found.add(Transform("w", "c", S, pose(x=1)))
    with pytest.raises(NoTransform, match="until"):
        found.lookup("w", "c", 55 * S)


@pytest.mark.parametrize(("parent", "child"), [("", "a"), ("a", ""), ("a", "a"), ("/a", "a")])
def test_frames_without_sense_are_refused(parent: str, child: str) -> None:
    with pytest.raises(ValueError, match="frame"):
        TransformTree().add(Transform(parent, child, 0, pose()))
