"""Strips between rims, on a sphere and on rims made by hand."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from rims import SPHERE_RADIUS, cylinder_rim, sphere_turn

from occ_recon_ros.geometry import RimReconstructor, Status
from occ_recon_ros.imaging import ContourTracker
from occ_recon_ros.scene import TurntableSettings, make_object, render, turntable_cameras
from occ_recon_ros.surface import Surface, SurfaceSettings, write_rims, write_surface, zip_rims


def test_the_strip_between_two_straight_rims_is_the_sheet_between_them():
    first, second = cylinder_rim(0.0, 1), cylinder_rim(0.1, 2)
    triangles = zip_rims(second, first, longest=3.0)
    points = np.concatenate([second.points, first.points])
    mesh = trimesh.Trimesh(points, triangles, process=False)
    chord = 2 * np.sin(0.05)
    assert mesh.area == pytest.approx(chord * 1.0, rel=1e-9)
    assert mesh.is_winding_consistent
    assert (mesh.face_normals @ [1, 0.05, 0] > 0.99).all()
    assert np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1].max() == 2


def test_more_samples_on_one_side_make_more_triangles_and_the_same_sheet():
    first, second = cylinder_rim(0.0, 1, n=31), cylinder_rim(0.1, 2, n=81, previous_n=31)
    triangles = zip_rims(second, first, longest=3.0)
    points = np.concatenate([second.points, first.points])
    mesh = trimesh.Trimesh(points, triangles, process=False)
    assert len(mesh.faces) == 30 + 80
    assert mesh.area == pytest.approx(2 * np.sin(0.05), rel=1e-9)


@pytest.mark.parametrize("turned", [False, True])
def test_triangles_face_outward_whichever_way_the_table_turns(turned):
    angles = (0.0, -0.1) if turned else (0.0, 0.1)
    first, second = cylinder_rim(angles[0], 1), cylinder_rim(angles[1], 2)
    triangles = zip_rims(second, first, longest=3.0)
    points = np.concatenate([second.points, first.points])
    mesh = trimesh.Trimesh(points, triangles, process=False)
    assert (mesh.face_normals[:, 0] > 0.9).all()


def test_no_triangle_uses_a_point_that_is_not_good_or_bridges_its_gap():
    first, second = cylinder_rim(0.0, 1), cylinder_rim(0.1, 2)
    status = second.status.copy()
    status[40:60] = Status.OUTSIDE
    second = replace(second, status=status)
    triangles = zip_rims(second, first, longest=3.0)
    rows = triangles[triangles < len(second)]
    assert not np.isin(rows, np.arange(40, 60)).any()
    points = np.concatenate([second.points, first.points])
    height = points[triangles][:, :, 2]
    assert not ((height.min(axis=1) < 0.45) & (height.max(axis=1) > 0.55)).any()


def test_no_triangle_spans_a_jump_of_the_depth():
    first, second = cylinder_rim(0.0, 1), cylinder_rim(0.1, 2)
    points = second.points.copy()
    points[50:] *= [3, 3, 1]
    second = replace(second, points=points)
    triangles = zip_rims(second, first, longest=3.0)
    spans = ((triangles < 50).any(axis=1)) & (
        ((triangles >= 50) & (triangles < len(second))).any(axis=1)
    )
    assert not spans.any()


def test_rims_without_a_common_row_give_no_triangles():
    first, second = cylinder_rim(0.0, 1), cylinder_rim(0.1, 2)
    second = replace(second, prev=np.full(len(second), np.nan))
    assert zip_rims(second, first, longest=3.0).shape == (0, 3)
    beyond = replace(second, prev=np.full(len(second), 1e6))
    assert zip_rims(beyond, first, longest=3.0).shape == (0, 3)


def test_a_closed_turn_covers_the_sphere_on_both_sides_of_the_outline():
    surface = Surface()
    strips = [surface.add(rim) for rim in sphere_turn()]
    assert sum(map(len, strips)) == len(surface)
    mesh = surface.mesh()
    # Each place is seen on the left and on the right; the caps are seen by no camera.
    share = mesh.area / (4 * np.pi * SPHERE_RADIUS**2)
    assert 1.8 < share < 2.0
    away = np.linalg.norm(mesh.vertices, axis=1) - SPHERE_RADIUS
    assert np.abs(away).max() < 3e-3 * SPHERE_RADIUS
    assert np.median(np.abs(away)) < 1e-6 * SPHERE_RADIUS
    outward = np.einsum("fk,fk->f", mesh.face_normals, mesh.triangles_center)
    assert (outward > 0).all()


def test_the_seam_of_a_closed_turn_is_as_full_as_any_other_strip():
    surface = Surface()
    counts = [len(surface.add(rim)) for rim in sphere_turn()]
    # The first rim to come has nothing to join; the last closes both sides of the seam.
    assert counts[0] == 0
    assert counts[-1] == pytest.approx(2 * np.median(counts[1:-1]), rel=0.02)


def test_a_lost_rim_leaves_a_gap_and_no_wrong_triangle():
    rims = sphere_turn()
    whole, torn = Surface(), Surface()
    for rim in rims:
        whole.add(rim)
    for rim in rims[:10] + rims[11:]:
        torn.add(rim)
    lost = len(whole) - len(torn)
    assert lost == pytest.approx(2 * len(whole) / 36, rel=0.05)
    longest = [
        np.linalg.norm(np.diff(s.whole().corners, axis=1), axis=2).max() for s in (whole, torn)
    ]
    assert longest[1] <= longest[0]


def test_a_revised_rim_takes_its_triangles_back():
    rims = sphere_turn()
    surface = Surface()
    for rim in rims:
        surface.add(rim)
    before = surface.whole().corners
    status = rims[7].status.copy()
    status[100:150] = Status.OUTSIDE
    good = int((rims[7].status[100:150] == Status.GOOD).sum())
    assert good > 40
    assert surface.revise(replace(rims[7], status=status)) == good
    assert surface.revise(replace(rims[7], status=status)) == 0
    after = surface.whole().corners
    assert len(before) - 6 * good < len(after) < len(before) - 3 * good
    gone = rims[7].points[100:150].astype(np.float32)
    corners = {tuple(p) for p in after.reshape(-1, 3)}
    assert not corners & {tuple(p) for p in gone}


def test_a_revised_rim_brings_points_that_were_not_good_before():
    rims = sphere_turn()
    whole, patched = Surface(), Surface()
    for rim in rims:
        whole.add(rim)
    status, points = rims[7].status.copy(), rims[7].points.copy()
    status[100:150] = Status.NO_CORRESPONDENT
    points[300:310] += 0.001
    for rim in [*rims[:7], replace(rims[7], status=status, points=points), *rims[8:]]:
        patched.add(rim)
    assert len(patched) < len(whole)
    good = rims[7].status == Status.GOOD
    expected = good[100:150].sum() + good[300:310].sum()
    assert patched.revise(rims[7]) == expected
    assert patched.revise(rims[7]) == 0
    # The very triangles of a rim that was right at once, each as often.
    one, other = (np.sort(s.whole().corners.reshape(-1, 9), axis=0) for s in (whole, patched))
    np.testing.assert_array_equal(one, other)


def test_a_revised_rim_takes_back_the_strip_of_a_link_that_it_gave_up():
    first, second = cylinder_rim(0.0, 1), cylinder_rim(0.1, 2)
    surface = Surface()
    surface.add(first)
    surface.add(second)
    full = len(surface)
    prev = second.prev.copy()
    prev[40:61] = np.nan
    assert surface.revise(replace(second, prev=prev)) == 21
    assert len(surface) == full - 2 * 22
    assert surface.revise(replace(second, prev=prev)) == 0


@pytest.mark.slow
def test_no_strip_leads_from_one_leg_to_the_other():
    """From the side one leg hides the other, and a frame later it is the other that is seen."""
    body, surface, reconstructor = make_object("figure"), Surface(), RimReconstructor()
    cameras = turntable_cameras(TurntableSettings(frames=36))
    stamps = set()
    track = ContourTracker().process
    frames = [track(render(body, c), c, k + 1, "table") for k, c in enumerate(cameras)]
    rims = [rim for contours in frames for rim in reconstructor.add(contours)]
    for rim in rims + reconstructor.finish():
        (surface.revise if rim.stamp_ns in stamps else surface.add)(rim)
        stamps.add(rim.stamp_ns)
    mesh = surface.mesh()
    assert len(mesh.faces) > 50_000
    # The legs are some 40 mm apart: the middle of such a sheet is 11 mm off.
    assert np.abs(body.distance(mesh.triangles_center)).max() < 4e-3


def test_a_revision_of_a_rim_that_never_came_is_refused():
    surface = Surface()
    rims = sphere_turn()
    surface.add(rims[0])
    with pytest.raises(ValueError, match="before"):
        surface.revise(rims[1])
    with pytest.raises(ValueError, match="before"):
        surface.add(rims[0])


def test_a_rim_in_another_frame_is_refused():
    surface = Surface()
    rims = sphere_turn()
    surface.add(rims[0])
    with pytest.raises(ValueError, match="elsewhere"):
        surface.add(replace(rims[1], frame_id="elsewhere"))


def test_reset_starts_from_nothing():
    surface = Surface(SurfaceSettings())
    for rim in sphere_turn()[:5]:
        surface.add(rim)
    surface.reset()
    assert len(surface) == 0
    assert len(surface.whole()) == 0


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".stl", ".obj"])
def test_a_file_read_by_another_library_is_the_surface(tmp_path, suffix):
    surface = Surface()
    for rim in sphere_turn()[:6]:
        surface.add(rim)
    path = write_surface(surface, tmp_path / f"mesh{suffix}")
    assert path.is_absolute()
    found = trimesh.load_mesh(path)
    assert len(found.faces) == len(surface)
    assert found.area == pytest.approx(surface.mesh().area, rel=1e-4)
    with pytest.raises(FileExistsError):
        write_surface(surface, path)
    assert write_surface(surface, path, overwrite=True) == path
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_what_cannot_be_written_is_said(tmp_path):
    surface = Surface()
    with pytest.raises(ValueError, match="no triangles"):
        write_surface(surface, tmp_path / "mesh.ply")
    for rim in sphere_turn()[:4]:
        surface.add(rim)
    with pytest.raises(ValueError, match=r"\.ply"):
        write_surface(surface, tmp_path / "mesh.docx")
    with pytest.raises(OSError, match="nowhere"):
        write_surface(surface, tmp_path / "nowhere" / "mesh.ply")
    assert not list(tmp_path.iterdir())


def test_rims_are_written_as_a_cloud_of_their_good_points(tmp_path):
    rims = sphere_turn()[:3]
    status = rims[1].status.copy()
    status[:50] = Status.OUTSIDE
    rims[1] = replace(rims[1], status=status)
    path = write_rims(rims, tmp_path / "rims.ply")
    good = np.concatenate([r.points[r.status == 0] for r in rims])
    cloud = trimesh.load(path)
    np.testing.assert_allclose(cloud.vertices, good, atol=1e-7)
    header, body = path.read_bytes().split(b"end_header\n")
    assert [line.split()[-1] for line in header.decode().splitlines() if "property" in line] == (
        ["x", "y", "z", "nx", "ny", "nz", "curvature", "depth_sigma"]
    )
    table = np.frombuffer(body, "<f4").reshape(-1, 8)
    np.testing.assert_allclose(
        table[:, 6], np.concatenate([r.curvature[r.status == 0] for r in rims]), rtol=1e-6
    )


def test_two_points_alone_between_gaps_are_no_piece_of_surface():
    first, second = cylinder_rim(0.0, 1), cylinder_rim(0.1, 2)
    status = np.full(len(second), Status.OUTSIDE, np.uint8)
    status[:30] = status[60:62] = Status.GOOD
    triangles = zip_rims(replace(second, status=status), first, longest=3.0)
    rows = triangles[triangles < len(second)]
    assert rows.max() == 29
    assert len(triangles) >= 2 * 29 - 1


def test_a_match_that_goes_astray_makes_no_triangle_across_the_object():
    first, second = cylinder_rim(0.0, 1), cylinder_rim(0.1, 2)
    points = first.points.copy()
    points[50:53] -= [1.5, 0, 0]
    triangles = zip_rims(second, replace(first, points=points), longest=1000.0)
    both = np.concatenate([second.points, points])
    corners = both[triangles]
    assert np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max() < 0.2
    assert len(triangles) > 190 - 12
