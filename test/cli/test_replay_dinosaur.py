"""The main job on real images: import, replay, and a judgement that shares no code with it."""

import base64
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from scipy.ndimage import map_coordinates

from occ_recon_ros.cli import main

RIM_FIELDS = ("x", "y", "z", "nx", "ny", "nz", "curvature", "depth_sigma")


@pytest.fixture(scope="module")
def dinosaur(shared_data: Path) -> Path:
    return shared_data / "oxford_dino"


@pytest.fixture(scope="module")
def out(dinosaur: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of `occ-recon import` and `occ-recon replay`, as the README has them."""
    folder = tmp_path_factory.mktemp("dinosaur")
    assert main(["import", str(dinosaur), str(folder / "dino.mcap")]) == 0
    arguments = ["replay", str(folder / "dino.mcap"), "--out", str(folder / "out")]
    arguments.append("--set=mesher.body_cells=100")  # of 200 it takes four times as long to close
    assert main(arguments) == 0
    assert sorted(p.name for p in folder.iterdir()) == ["dino.mcap", "out"]
    return folder / "out"


@pytest.fixture(scope="module")
def report(out: Path) -> dict:
    return json.loads((out / "report.json").read_text())


def read_rims(path: Path) -> np.ndarray:
    """(n, 8) of a binary PLY of floats, by the letter of the format."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    lines = header.decode().split("\n")
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    assert [line.split() for line in lines if line.startswith("property")] == [
        ["property", "float", name] for name in RIM_FIELDS
    ]
    count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    table = np.frombuffer(body, "<f4").reshape(-1, len(RIM_FIELDS))
    assert len(table) == count
    return table.astype(np.float64)


def outside_px(points: np.ndarray, folder: Path) -> np.ndarray:
    """(n,) distance by which each point projects outside the mask where it does most.

    The distance is to the nearest pixel centre of the mask: half a pixel more than to its edge.
    """
    content = json.loads((folder / "cameras.json").read_text())
    worst = np.zeros(len(points))
    for frame in content["frames"]:
        mask = cv2.imread(str(folder / frame["mask"]), cv2.IMREAD_GRAYSCALE)
        assert mask is not None
        distance = cv2.distanceTransform(
            (mask == 0).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE
        )
        K, R, t = (np.array(frame[name], np.float64) for name in ("K", "R", "t"))
        camera = points @ R.T + t * content["unit_in_metres"]
        assert (camera[:, 2] > 0).all()
        uv = (camera @ K.T)[:, :2] / camera[:, 2:]
        here = map_coordinates(distance, uv[:, ::-1].T, order=1, cval=np.inf)
        worst = np.maximum(worst, here)
    return worst


def test_the_measuring_tool_tells_inside_from_outside(dinosaur):
    content = json.loads((dinosaur / "cameras.json").read_text())
    centres = np.array([-np.array(f["R"]).T @ f["t"] for f in content["frames"]])
    axes = np.array([f["R"][2] for f in content["frames"]])
    # The point nearest to all optical axes is in the object; beside it, well outside.
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    middle = np.linalg.solve(across.sum(axis=0), (across @ centres[..., None]).sum(axis=0)).ravel()
    far = middle + 0.3 * (centres[0] - centres.mean(axis=0))
    assert outside_px(middle[None], dinosaur)[0] < 30
    assert outside_px(far[None], dinosaur)[0] > 50


def test_every_image_gives_a_rim_and_the_turn_is_closed(report):
    frames = report["frames"]
    assert (frames["images"], frames["contours"], frames["rims"]) == (36, 36, 36)
    assert frames["unanswered_stamps_ns"] == []
    assert report["turn"]["closed"]
    for k in (0, -1):
        assert report["per_frame"][k]["by_status"]["good"] > 100


def test_rim_points_are_inside_all_silhouettes(out, dinosaur, report):
    rims = read_rims(out / "rims.ply")
    assert len(rims) == report["samples"]["by_status"]["good"]
    assert len(rims) >= 0.69 * report["samples"]["total"]
    assert np.isfinite(rims[:, :6]).all()
    np.testing.assert_allclose(np.linalg.norm(rims[:, 3:6], axis=1), 1, atol=1e-5)
    outside = outside_px(rims[:, :3], dinosaur)
    share = (outside <= 1.5).mean()
    print(f"{share:.2%} of {len(rims)} points within 1.5 px of the inside of all masks")
    assert share >= 0.994


def test_the_mesh_is_written_and_counted(out, report):
    mesh = trimesh.load_mesh(out / "mesh.ply", process=False)
    assert len(mesh.faces) == report["mesh"]["triangles"] > 10_000
    rims = read_rims(out / "rims.ply")
    low, high = np.percentile(rims[:, :3], [1, 99], axis=0)
    assert (mesh.bounds[0] <= low).all()
    assert (mesh.bounds[1] >= high).all()


def test_the_closed_surface_is_watertight_and_inside_the_masks(out, report, dinosaur):
    closed = trimesh.load_mesh(out / "closed.ply", process=False)
    assert closed.is_watertight
    assert closed.is_winding_consistent
    assert closed.body_count == report["closed"]["bodies"] == 1
    assert len(closed.faces) == report["closed"]["triangles"]
    assert closed.volume == pytest.approx(report["closed"]["volume_m3"], rel=1e-4)
    outside = outside_px(np.asarray(closed.vertices), dinosaur)
    assert (outside <= 1.5).mean() >= 0.97


def test_the_report_is_complete(report):
    for node in ("contour_tracker", "reconstructor", "mesher"):
        assert report["stages_ms"][node]["decode"]["median_ms"] > 0
    stages = report["stages_ms"]
    whole = report["decode_to_strip_ms"]["median_ms"]
    assert whole >= stages["contour_tracker"]["contours"]["median_ms"]
    assert whole >= stages["reconstructor"]["rim"]["median_ms"]
    assert len(report["per_frame"]) == 36
    total = sum(sum(frame["by_status"].values()) for frame in report["per_frame"])
    assert total == report["samples"]["total"]
    assert report["source"]["messages"] == dict.fromkeys(
        ("/image", "/camera_info", "/camera_pose", "/mask"), 36
    )
    assert report["source"]["lost"] == ""


def test_the_page_holds_its_pictures_and_needs_no_network(out):
    page = (out / "report.html").read_text()
    assert not re.search(r"(?:src|href)\s*=\s*[\"'](?!data:)|https?://|@import|url\(", page)
    embedded = re.findall(r'src="data:image/jpeg;base64,([^"]+)"', page)
    codes = [np.frombuffer(base64.b64decode(data), np.uint8) for data in embedded]
    shown = [cv2.imdecode(code, cv2.IMREAD_COLOR) for code in codes]
    for name in ("views.png", "contours.png"):
        picture = cv2.imread(str(out / name))
        same = [cv2.resize(p, picture.shape[1::-1]) for p in shown]
        assert min(np.abs(p.astype(int) - picture).mean() for p in same) < 8


def test_the_shaded_views_show_the_object_where_the_photographs_do(out, dinosaur, report):
    """Below each photograph are the strips on plain paper, and the closed surface drawn over
    the photograph, both inside the outline."""
    picture = cv2.imread(str(out / "views.png"))
    assert picture is not None
    height = (picture.shape[0] - 20) // 3
    above, strips, closed = (picture[k * (height + 10) :][:height].astype(int) for k in range(3))
    # The dinosaur is the only thing in the photographs that is not blue.
    body = (above[..., 2] > above[..., 0]).astype(np.uint8)
    body = cv2.morphologyEx(body, cv2.MORPH_CLOSE, np.ones((15, 15), np.uint8))
    paper = np.broadcast_to(strips[5, 5], strips.shape)
    for below, behind in ((strips, paper), (closed, above)):
        drawn = np.abs(below - behind).max(axis=2) > 30
        drawn &= below.min(axis=2) < 235
        assert drawn.mean() > 0.05
        assert body[drawn].mean() > 0.7
