"""evaluate and render, tried on a ball whose silhouettes are known without any mesh."""

import json

import cv2
import numpy as np
import pytest
import trimesh

from occ_recon_ros.evaluation.distances import compare_surfaces, distances
from occ_recon_ros.geometry import Camera

RADIUS, AWAY, FOCAL = 0.1, 1.0, 900.0
WIDTH, HEIGHT = 320, 240
CENTRE = np.array([0.01, -0.02, 0.015])
D = [-0.2, 0.05, 0.001, -0.002]


def camera(angle):
    out = np.array([np.cos(angle), np.sin(angle), 0.3])
    z = -out / np.linalg.norm(out)
    x = np.cross([0, 0, -1.0], z)
    x /= np.linalg.norm(x)
    R = np.array([x, np.cross(z, x), z])
    K = np.array([[FOCAL, 0, 165.0], [0, FOCAL, 118.0], [0, 0, 1]])
    return Camera(K, WIDTH, HEIGHT, R, np.array([0, 0, AWAY]), np.array(D), "plumb_bob")


def ball_mask(view, radius):
    """Pixels whose rays pass the centre of the ball at less than its radius."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    T = view.viewing_directions(np.column_stack([u.ravel(), v.ravel()]))
    along = T @ (CENTRE - view.centre)
    squared = ((CENTRE - view.centre) ** 2).sum() - along**2
    return ((squared < radius**2) & (along > 0)).reshape(HEIGHT, WIDTH)


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Three views of the ball, distorted: with masks and without."""
    from occ_recon_ros.cli import main

    folder = tmp_path_factory.mktemp("ball")
    frames = []
    for i in range(3):
        view = camera(0.7 * i)
        mask = ball_mask(view, RADIUS)
        image = np.where(mask[..., None], np.uint8([40, 60, 90]), np.uint8([200, 220, 230]))
        cv2.imwrite(str(folder / f"{i}.png"), image)
        cv2.imwrite(str(folder / f"m{i}.png"), 255 * mask.astype(np.uint8))
        frames.append(
            {
                "file": f"{i}.png",
                "mask": f"m{i}.png",
                "width": WIDTH,
                "height": HEIGHT,
                "K": view.K.tolist(),
                "D": D,
                "R": view.R_camera_object.tolist(),
                "t": view.t_camera_object.tolist(),
            }
        )
    (folder / "cameras.json").write_text(json.dumps({"unit_in_metres": 1.0, "frames": frames}))
    assert main(["import", str(folder), str(folder / "masks.mcap")]) == 0
    assert main(["import", str(folder), str(folder / "plain.mcap"), "--no-masks"]) == 0
    return folder


def ball(radius=RADIUS, centre=CENTRE):
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    mesh.apply_translation(centre)
    return mesh


def saved(mesh, path):
    mesh.export(path)
    return path


@pytest.mark.parametrize(("bag", "source"), [("masks", "mask"), ("plain", "contours")])
def test_a_mesh_fits_its_own_silhouettes(bags, tmp_path, command, bag, source):
    mesh, out = saved(ball(), tmp_path / "ball.ply"), tmp_path / "figures.json"
    code, said, _ = command("evaluate", mesh, "--bag", bags / f"{bag}.mcap", "--out", out)
    assert code == 0
    assert "3 views" in said
    report = json.loads(out.read_text())
    assert [row["source"] for row in report["views"]] == [source] * 3
    # Half a pixel of a disc of 90 px is 1 % of its area: the tool is far below that.
    assert report["iou"]["min"] > 0.995
    assert report["xor_per_outline_px"]["max"] < 0.12
    assert report["surface"]["volume_m3"] == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=2e-3)


def test_a_surface_that_is_too_large_is_found_to_be_so_by_the_right_number_of_pixels(
    bags, tmp_path, command
):
    mesh, out = saved(ball(RADIUS * 1.02), tmp_path / "ball.ply"), tmp_path / "figures.json"
    assert command("evaluate", mesh, "--bag", bags / "masks.mcap", "--out", out)[0] == 0
    for i, row in enumerate(json.loads(out.read_text())["views"]):
        small, large = (ball_mask(camera(0.7 * i), r) for r in (RADIUS, RADIUS * 1.02))
        assert row["iou"] == pytest.approx(small.sum() / large.sum(), abs=2e-3)
        grown = np.sqrt(large.sum() / np.pi) - np.sqrt(small.sum() / np.pi)
        assert 1.5 < grown < 2.5
        assert row["xor_per_outline_px"] == pytest.approx(grown, rel=0.05)


def test_a_surface_moved_by_a_known_way_is_found_to_be_there(bags, tmp_path, command):
    # A disc moved by d leaves 4 R d uncovered on both sides, of an outline of 2 pi R.
    view = camera(0.0)
    moved = CENTRE + 0.004 * view.R_camera_object[0]
    mesh, out = saved(ball(centre=moved), tmp_path / "ball.ply"), tmp_path / "figures.json"
    assert command("evaluate", mesh, "--bag", bags / "masks.mcap", "--out", out)[0] == 0
    d = np.linalg.norm(np.diff(view.project(np.array([CENTRE, moved])), axis=0))
    row = json.loads(out.read_text())["views"][0]
    assert row["xor_per_outline_px"] == pytest.approx(2 * d / np.pi, rel=0.04)


@pytest.mark.parametrize(
    ("scale", "says", "unit"),
    [
        (1, None, ""),
        (1000, "the mesh is 200 m large, the cameras are ", "if its unit is mm"),
        pytest.param(1e-3, "is 0.0002 m large", "if its unit is 1000 m", marks=pytest.mark.slow),
    ],
)
def test_a_mesh_in_another_unit_is_named(bags, tmp_path, command, scale, says, unit):
    mesh = saved(ball().apply_scale(scale), tmp_path / "m.stl")
    code, out, error = command("evaluate", mesh, "--bag", bags / "masks.mcap")
    assert code == 0, error
    assert ("another unit" in out) == bool(says)
    assert says is None or says in out
    assert unit in out


@pytest.mark.parametrize(("radius", "share"), [(1.0, None), (1.05, None), (1.3, "66%")])
def test_a_mesh_that_is_far_off_its_views_is_in_doubt(bags, tmp_path, command, radius, share):
    mesh, out = saved(ball(RADIUS * radius), tmp_path / "m.ply"), tmp_path / "figures.json"
    code, said, _ = command("evaluate", mesh, "--bag", bags / "masks.mcap", "--out", out)
    assert code == 0
    found = json.loads(out.read_text())
    assert len(found["doubts"]) == bool(share)
    if share is not None:
        assert f"lies beyond {share}" in said
        assert "leaves out 0%" in said


def test_a_truth_in_another_unit_is_refused(bags, tmp_path, command):
    mesh, truth = saved(ball(), tmp_path / "m.ply"), ball().apply_scale(1000)
    truth = saved(truth, tmp_path / "t.stl")
    code, _, error = command("evaluate", mesh, "--bag", bags / "masks.mcap", "--truth", truth)
    assert code == 2
    assert "1e+03 times as large" in error


@pytest.mark.parametrize(("covered", "believed"), [(0.99, True), (0.89, False)])
def test_outlines_that_leave_no_body_are_no_judges(
    bags, monkeypatch, tmp_path, command, covered, believed
):
    monkeypatch.setattr("occ_recon_ros.evaluation.silhouettes.covered_by_hull", lambda _: covered)
    code, out, _ = command(
        "evaluate", saved(ball(), tmp_path / "ball.ply"), "--bag", bags / "plain.mcap"
    )
    assert code == 0
    assert ("which does not prove them right" in out) == believed
    assert ("the body that all of them leave covers 89% of them" in out) == (not believed)


def test_faces_that_are_turned_inwards_are_named(bags, tmp_path, command):
    turned = ball()
    turned.invert()
    mesh = saved(turned, tmp_path / "m.ply")
    code, out, error = command("evaluate", mesh, "--bag", bags / "masks.mcap")
    assert code == 0, error
    assert "its faces turned inwards" in out
    assert "volume -" not in out


@pytest.mark.slow
def test_a_mesh_that_is_open_is_said_to_be(bags, tmp_path, command):
    half = ball()
    half.update_faces(half.triangles_center[:, 0] > 0.3 * RADIUS)
    code, out, error = command(
        "evaluate", saved(half, tmp_path / "half.ply"), "--bag", bags / "masks.mcap"
    )
    assert code == 0, error
    assert "the mesh is open" in out
    assert "watertight" not in out
    assert "far off" not in out
    assert "the open mesh leaves out" in out
    assert "the closed body is" not in out
    saved(ball(), tmp_path / "closed.ply")
    _, out, _ = command("evaluate", tmp_path / "half.ply", "--bag", bags / "masks.mcap")
    assert f"the closed body is {tmp_path / 'closed.ply'}" in out


def test_the_truth_against_itself_is_at_zero():
    mesh = ball()
    report = compare_surfaces(mesh, mesh, within_m=1e-9, samples=10_000)
    assert report["mesh_to_truth"]["max_mm"] < 1e-9
    assert report["completeness"] == 1.0
    assert report["accuracy_mm"] < 1e-9


@pytest.mark.slow
def test_distances_between_two_balls_are_the_known_ones(bags, tmp_path, command):
    mesh, truth = saved(ball(0.1005), tmp_path / "m.obj"), saved(ball(), tmp_path / "t.stl")
    out, bag = tmp_path / "figures.json", bags / "masks.mcap"
    arguments = ("evaluate", mesh, "--bag", bag, "--truth", truth, "--out", out)
    assert command(*arguments, "--within", 0.4)[0] == 0
    figures = json.loads(out.read_text())["truth"]
    assert figures["accuracy_mm"] == pytest.approx(0.5, rel=0.05)
    assert figures["mesh_to_truth"]["mean_mm"] == pytest.approx(0.5, rel=0.05)
    assert figures["completeness"] == 0.0
    assert command(*arguments, "--within", 0.6, "--overwrite")[0] == 0
    assert json.loads(out.read_text())["truth"]["completeness"] == 1.0


def test_half_a_surface_is_accurate_and_half_complete():
    whole = ball(centre=np.zeros(3))
    upper = whole.triangles_center[:, 2] > 0
    half = trimesh.Trimesh(whole.vertices, whole.faces[upper], process=False)
    report = compare_surfaces(half, whole, within_m=1e-4, samples=3000)
    assert report["accuracy_mm"] < 1e-6
    assert report["completeness"] == pytest.approx(0.5, abs=0.03)
    assert report["volume_m3"] is None


def test_a_large_triangle_among_small_ones_is_not_passed_over():
    dust = trimesh.creation.icosphere(subdivisions=4, radius=0.001)
    plate = trimesh.Trimesh([[-1, -1, 0.01], [1, -1, 0.01], [0, 1, 0.01]], [[0, 1, 2]])
    mesh = trimesh.util.concatenate([dust, plate])
    assert distances(np.array([[0, 0, 0.008]]), mesh) == pytest.approx([0.002])


def test_a_picture_shows_the_image_and_the_surface_where_it_is(bags, tmp_path, command):
    mesh = saved(ball(), tmp_path / "ball.ply")
    out, bag = tmp_path / "pictures", bags / "masks.mcap"
    assert command("render", mesh, "--bag", bag, "--out", out, "--views", "0,2")[0] == 0
    assert sorted(path.name for path in out.iterdir()) == ["view_0000.png", "view_0002.png"]
    picture, original = cv2.imread(str(out / "view_0002.png")), cv2.imread(str(bags / "2.png"))
    np.testing.assert_array_equal(picture[:, :WIDTH], original)
    changed = (picture[:, -WIDTH:] != original).any(axis=2)
    inside = ball_mask(camera(1.4), RADIUS - 0.0015)
    outside = ~ball_mask(camera(1.4), RADIUS + 0.0015)
    assert changed[inside].all()
    assert not changed[outside].any()
    # Light comes from the upper left behind the camera.
    v, u = np.nonzero(inside)
    grey = picture[:, -WIDTH:].mean(axis=2)[v, u]
    lit = u - u.mean() + v - v.mean()
    assert grey[lit < -50].mean() > grey[lit > 50].mean() + 20


def test_a_coloured_mesh_is_drawn_in_its_colours(bags, tmp_path, command):
    mesh = ball()
    mesh.visual.vertex_colors = np.where(
        mesh.vertices[:, 2:] > CENTRE[2], [[255, 0, 0]], [[0, 0, 255]]
    )
    out = tmp_path / "pictures"
    path = saved(mesh, tmp_path / "ball.ply")
    assert command("render", path, "--bag", bags / "masks.mcap", "--out", out, "--views", 1)[0] == 0
    drawn = cv2.imread(str(out / "view_0001.png"))[:, -WIDTH:]
    rows = np.flatnonzero(ball_mask(camera(0.7), RADIUS).any(axis=1))
    middle = WIDTH // 2
    assert drawn[rows[10], middle, 2] > 100 > 10 > drawn[rows[10], middle, 0]
    assert drawn[rows[-10], middle, 0] > 100 > 10 > drawn[rows[-10], middle, 2]


def test_errors_are_one_line_and_exit_with_two(bags, tmp_path, command):
    mesh, bag = saved(ball(), tmp_path / "ball.ply"), bags / "masks.mcap"
    (tmp_path / "text.ply").write_text("no mesh at all")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("years of work")
    (tmp_path / "there.json").write_text("{}")
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "cameras.json").write_text("{}")
    for words, arguments in {
        "does not exist": ("evaluate", tmp_path / "none.ply", "--bag", bag),
        "give a file in it": ("evaluate", tmp_path / "full", "--bag", bag),
        "occ-recon import": ("evaluate", mesh, "--bag", tmp_path / "images"),
        "cannot be read": ("evaluate", tmp_path / "text.ply", "--bag", bag),
        "bag": ("evaluate", mesh, "--bag", tmp_path / "none.mcap"),
        "--truth": ("evaluate", mesh, "--bag", bag, "--truth"),
        "--within": ("evaluate", mesh, "--bag", bag, "--within", -1),
        "there.json exists": ("evaluate", mesh, "--bag", bag, "--out", tmp_path / "there.json"),
        "is not empty": ("render", mesh, "--bag", bag, "--out", tmp_path / "full"),
        "no view 3": ("render", mesh, "--bag", bag, "--out", tmp_path / "p", "--views", "0,3"),
        "--views a": ("render", mesh, "--bag", bag, "--out", tmp_path / "p", "--views", "a"),
    }.items():
        code, _, said = command(*arguments)
        assert code == 2, arguments
        assert words in said
        assert said.count("\n") == 1
    assert [p.name for p in (tmp_path / "full").iterdir()] == ["thesis.tex"]
