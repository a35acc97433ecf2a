"""Colour of a surface, against a colour that is a known function of the place."""

from functools import cache

import numpy as np
import pytest
import trimesh
from rims import sphere_turn

from occ_recon_ros.evaluation.raycast import RayCaster
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.surface import Surface, ViewColours, reduced_camera, write_surface

BACKDROP = np.array([0, 255, 0], np.uint8)
VIEWS = 18


def paint(points):
    """A smooth pattern of 40 mm over space, without green: that is the backdrop alone."""
    wave = np.sin(points * (2 * np.pi / 0.04))
    rgb = np.column_stack([140 + 100 * wave[:, 0], 0 * wave[:, 0], 140 + 100 * wave[:, 2]])
    return rgb.round().astype(np.uint8)


@cache
def photographs(name):
    """The object's mesh and its images from a full turn, without any light."""
    mesh = make_object(name).mesh(200)
    settings = TurntableSettings(
        frames=VIEWS, step=2 * np.pi / VIEWS, width=480, height=360, focal_px=650.0
    )
    caster, views = RayCaster(mesh.triangles), []
    for camera in turntable_cameras(settings):
        v, u = np.mgrid[: camera.height, : camera.width]
        hits = caster.cast(camera, np.column_stack([u.ravel(), v.ravel()]).astype(float))
        places = np.einsum("kc,kcj->kj", hits.weights, caster.corners[hits.triangle])
        image = np.tile(BACKDROP, (camera.height * camera.width, 1))
        image[hits.ray] = paint(places)
        views.append((image.reshape(camera.height, camera.width, 3), camera))
    return mesh, views


def seen_by_some(mesh, cameras):
    """Vertices that some camera sees well: facing it, the ray to it free."""
    points, normals = np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals)
    seen = np.zeros(len(points), bool)
    for camera in cameras:
        to_camera = camera.centre - points
        to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
        facing = np.flatnonzero((to_camera * normals).sum(axis=1) > 0.3)
        start = points[facing] + 1e-4 * to_camera[facing]
        blocked = mesh.ray.intersects_any(start, to_camera[facing])
        seen[facing[~blocked]] = True
    return seen


@pytest.mark.parametrize("name", ["vase", "torus", "mug"])
def test_each_place_gets_its_own_colour(name):
    mesh, views = photographs(name)
    colours = ViewColours()
    for image, camera in views:
        colours.add(image, camera)
    colours.hide_behind(mesh.triangles)
    rgb = colours.of(mesh.vertices, mesh.vertex_normals).astype(int)
    seen = seen_by_some(mesh, [camera for _, camera in views])
    assert seen.mean() > 0.5
    error = np.abs(rgb - paint(mesh.vertices)).max(axis=1)[seen]
    # The pattern changes by 24 grey levels a pixel, of a surface that is seen frontally.
    assert np.median(error) <= 2
    assert np.percentile(error, 95) <= 6
    assert (rgb[seen, 1] > 40).mean() < 0.01


def test_without_looking_what_is_hidden_the_handle_colours_the_body():
    mesh, views = photographs("mug")
    colours = ViewColours()
    for image, camera in views:
        colours.add(image, camera)
    blind = colours.of(mesh.vertices, mesh.vertex_normals).astype(int)
    colours.hide_behind(mesh.triangles)
    rgb = colours.of(mesh.vertices, mesh.vertex_normals).astype(int)
    seen = seen_by_some(mesh, [camera for _, camera in views])
    truth = paint(mesh.vertices)
    wrong = [(np.abs(c - truth).max(axis=1)[seen] > 40).mean() for c in (blind, rgb)]
    assert wrong[0] > 0.02
    assert wrong[1] < wrong[0] / 4


def test_a_place_at_the_edge_of_the_only_view_takes_no_colour_of_the_backdrop():
    mesh, views = photographs("vase")
    colours = ViewColours()
    image, camera = views[0]
    colours.add(image, camera)
    to_camera = camera.centre - mesh.vertices
    cosine = (to_camera * mesh.vertex_normals).sum(axis=1) / np.linalg.norm(to_camera, axis=1)
    rim = np.abs(cosine) < 0.02
    assert rim.sum() > 100
    rgb = colours.of(mesh.vertices[rim], mesh.vertex_normals[rim])
    assert (rgb[:, 1] < 40).mean() > 0.98


def test_without_views_a_place_is_grey_and_one_never_seen_is_as_its_neighbour():
    colours = ViewColours()
    up = np.array([[0.0, 0, 1]])
    assert colours.of(np.zeros((1, 3)), up).tolist() == [[128, 128, 128]]
    image, camera = photographs("vase")[1][0]
    colours.add(np.full_like(image, 77), camera)
    towards = camera.centre / np.linalg.norm(camera.centre)
    both = colours.of(np.zeros((2, 3)), np.array([towards, -towards]))
    assert both.tolist() == [[77] * 3] * 2


def test_the_number_of_views_is_bounded_and_they_stay_spread_out():
    settings = TurntableSettings(frames=720, step=np.radians(0.5), width=40, height=30)
    colours, kept = ViewColours(), 0
    for _ in range(2):
        for camera in turntable_cameras(settings):
            if colours.wants(camera):
                kept += 1
                colours.add(np.zeros((30, 40, 3), np.uint8), camera)
    assert len(colours) <= 48
    # A second turn brings nothing that the first has not.
    assert kept == len(colours)
    assert colours.nbytes == len(colours) * 30 * 40 * 3
    nearest = [not colours.wants(camera) for camera in turntable_cameras(settings)]
    assert all(nearest)
    for elevation in np.radians([5.0, 50.0]):
        other = TurntableSettings(
            frames=72, step=np.radians(5), width=40, height=30, elevation=elevation
        )
        for camera in turntable_cameras(other):
            colours.add(np.zeros((30, 40, 3), np.uint8), camera)
    assert len(colours) == 48


def test_an_image_that_does_not_fit_its_camera_is_refused():
    _, camera = photographs("vase")[1][0]
    with pytest.raises(ValueError, match="colour needs"):
        ViewColours().add(np.zeros((5, 5, 3), np.uint8), camera)


def test_a_reduced_camera_sees_the_same_places():
    _, camera = photographs("vase")[1][0]
    small = reduced_camera(camera, 120, 90)
    points = trimesh.creation.icosphere(radius=0.05).vertices
    # Pixel 0 of the small image covers pixels 0 to 3 of the large one: its centre is at 1.5.
    np.testing.assert_allclose(4 * small.project(points) + 1.5, camera.project(points), atol=1e-9)


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".obj"])
def test_a_file_of_a_coloured_surface_has_its_colours(tmp_path, suffix):
    image, camera = photographs("vase")[1][0]
    colours = ViewColours()
    surface = Surface(colours=colours)
    strips = [surface.add(rim) for rim in sphere_turn()[:3]]
    assert all(strip.rgb is None for strip in strips)
    colours.add(np.full_like(image, [10, 100, 200]), camera)
    strip = surface.add(sphere_turn()[3])
    assert (strip.rgb == [10, 100, 200]).all()
    path = write_surface(surface, tmp_path / f"mesh{suffix}")
    found = trimesh.load_mesh(path, process=False)
    rgb = np.asarray(found.visual.vertex_colors)[:, :3].astype(int)
    assert len(rgb) == len(surface.mesh().vertices)
    np.testing.assert_allclose(rgb, np.tile([10, 100, 200], (len(rgb), 1)), atol=1)
