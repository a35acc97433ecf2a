"""demo: the numbers it prints are true, and as good as promised."""

import json
from pathlib import Path

import numpy as np
import pytest
from fixtures import COARSE
from scipy.spatial import cKDTree

from occ_recon_ros.cli import main
from occ_recon_ros.scene import make_object

SMALL = [
    COARSE,
    "--set=virtual_turntable.width=320",
    "--set=virtual_turntable.height=240",
    "--set=virtual_turntable.focal_px=500",
]


def report(out: Path) -> dict:
    return json.loads((out / "report.json").read_text())


def rim_points(out: Path) -> np.ndarray:
    body = (out / "rims.ply").read_bytes().partition(b"end_header\n")[2]
    return np.frombuffer(body, "<f4").reshape(-1, 8)[:, :3].astype(np.float64)


@pytest.fixture(scope="module")
def vase(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of `make demo`, with images of a quarter of the width."""
    out = tmp_path_factory.mktemp("demo") / "out"
    assert main(["demo", "--out", str(out), *SMALL]) == 0
    return out


def test_the_vase_is_as_exact_as_promised(vase):
    found = report(vase)
    assert found["frames"]["rims"] == 36
    assert found["turn"]["closed"]
    assert found["turn"]["mean_step_deg"] == pytest.approx(10, abs=1e-3)
    assert found["truth"]["distance"]["mean_mm"] <= 0.03
    assert found["truth"]["distance"]["p99_mm"] <= 0.2
    assert found["samples"]["fraction_good"] >= 0.7


def test_the_distances_are_those_of_the_points_written(vase):
    """Against planes through the nearest vertices of a fine mesh of the vase."""
    truth = report(vase)["truth"]
    assert truth["tool_check_mm"] < 1e-6
    points = rim_points(vase)
    assert truth["distance"]["count"] == len(points)
    mesh = make_object("vase").mesh(768)
    nearest = cKDTree(mesh.vertices).query(points)[1]
    across = points - mesh.vertices[nearest]
    measured = 1e3 * np.abs((across * mesh.vertex_normals[nearest]).sum(axis=1))
    for key, value in (("mean_mm", measured.mean()), ("p99_mm", np.percentile(measured, 99))):
        assert truth["distance"][key] == pytest.approx(value, rel=0.1, abs=0.001)


@pytest.mark.slow
def test_a_body_with_a_roof_is_not_called_good(command, tmp_path, vase):
    assert report(vase)["verdict"]["reasons"] == []
    steep = ["--object", "mug", "--set=virtual_turntable.elevation=1.1", "--frames", "18", *SMALL]
    code, out, _ = command("demo", "--out", tmp_path / "out", *steep)
    assert code == 0
    found = report(tmp_path / "out")["verdict"]
    assert found["word"] == "doubtful"
    assert [reason for reason in found["reasons"] if "mm above" in reason and "mm below" in reason]
    assert "volume_kind=plane" in out


@pytest.mark.slow
def test_another_object_with_noise(command, tmp_path):
    arguments = ["--object", "torus", "--frames", "12", *SMALL]
    arguments += [f"--set=virtual_turntable.{k}" for k in ("width=160", "height=120")]
    arguments.append("--set=virtual_turntable.focal_px=250")
    # As JSON it says its report and nothing else, and nothing if it is to be quiet.
    told = command("demo", "--out", tmp_path / "a", *arguments, "--noise", "0.3", "--json")
    assert command("demo", "--out", tmp_path / "b", *arguments, "--quiet") == (0, "", "")
    noisy, clean = report(tmp_path / "a"), report(tmp_path / "b")
    assert (told[0], json.loads(told[1]), told[2]) == (0, noisy, "")
    assert noisy["source"]["name"] == "torus"
    assert noisy["frames"]["rims"] == clean["frames"]["rims"] == 12
    assert all(frame["loops"] >= 1 for frame in clean["per_frame"])
    for key in ("depth_error", "distance"):
        assert noisy["truth"][key]["median_mm"] > clean["truth"][key]["median_mm"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--object", "teapot"], "must be one of"),
        (["--frames", "2"], "3 or more"),
        (["--frames", "many"], "--frames"),
        (["--noise", "-1"], "0 to 20"),
        (["--noise", "nan"], "0 to 20"),
        (["--set", "virtual_turntable.width=0"], "width"),
        (["--sett", "a.b=1"], "--sett"),
    ],
)
def test_bad_arguments(command, tmp_path, arguments, words):
    code, out, err = command("demo", "--out", tmp_path / "out", *arguments)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert words in err
    assert list(tmp_path.iterdir()) == []
