"""Commands that read a bag whose topics have other names and whose poses other stamps."""

import pytest
import trimesh
from recordings import FRAMES, later, write_all

NAMES = {"/image": "/rig/image", "/camera_info": "/rig/info", "/camera_pose": "/arm"}


@pytest.fixture
def strange(messages, tmp_path):
    """A bag of two cameras with other names, its poses 50 ms late."""
    found = [later(m, 50_000_000) if m.topic == "/camera_pose" else m for m in messages]
    found = [m._replace(topic=NAMES[m.topic]) for m in found]
    return write_all(
        tmp_path / "strange",
        [*found, *(m._replace(topic="/b" + m.topic) for m in found if m.topic != "/arm")],
    )


REMAPS = [word for topic, name in NAMES.items() for word in ("--remap", f"{name}:={topic}")]


def test_replay_uses_every_image(replay, strange, tmp_path):
    code, text, err = replay(strange, tmp_path / "out", *REMAPS)
    assert code == 0, err
    assert f"{FRAMES} images, {FRAMES} contours, {FRAMES} rims" in text
    assert "poses come 50 ms" in err


@pytest.mark.parametrize("name", ["evaluate", "render", "refine", "segment"])
def test_each_command_reads_it_and_takes_the_options_that_it_advises(
    command, strange, tmp_path, name
):
    mesh = tmp_path / "ball.ply"
    trimesh.creation.icosphere(2, 0.03).export(mesh)
    arguments = {
        "evaluate": (mesh, "--bag", strange),
        "render": (mesh, "--bag", strange, "--out", tmp_path / "out", "--views", "0,11"),
        "refine": (strange, tmp_path / "new.mcap"),
        "segment": (strange, tmp_path / "new.mcap"),
    }[name]
    code, _, err = command(name, *arguments)
    assert code == 2
    assert "--remap /rig/image:=/image" in err
    exact = "--set=contour_tracker.pose_sync=exact"
    code, _, err = command(name, *arguments, *REMAPS, exact)
    assert code == 2
    assert "--set contour_tracker.pose_sync=interpolate" in err
    if name in ("evaluate", "render"):  # the others take their time
        code, _, err = command(name, *arguments, *REMAPS)
        assert code == 0, err
        assert "poses come 50 ms" in err
