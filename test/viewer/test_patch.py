"""Pieces of surface as a page draws them."""

import io
import json
import struct

import numpy as np
import pytest
import trimesh

from occ_recon_ros.surface import Strip
from occ_recon_ros.viewer.glb import encode_glb
from occ_recon_ros.viewer.page import export
from occ_recon_ros.viewer.patch import SHADINGS, joined, merged, patch_colours, sigma_range


def strip_of(mesh, stamp_ns=1, rgb=None):
    faces = mesh.faces
    corners = np.asarray(mesh.vertices, np.float32)[faces]
    normals = np.asarray(mesh.vertex_normals, np.float32)[faces]
    sigma = np.abs(corners[..., 2]) + np.float32(1e-4)
    return Strip(
        stamp_ns,
        "turntable",
        corners,
        normals,
        sigma,
        None if rgb is None else np.broadcast_to(np.uint8(rgb), corners.shape).copy(),
    )


BALL = trimesh.creation.icosphere(3, radius=0.1)


def test_equal_corners_become_one_vertex():
    patch = merged(strip_of(BALL))
    assert len(patch.vertices) == len(BALL.vertices)
    assert len(patch) == len(BALL.faces)
    again = trimesh.Trimesh(patch.vertices, patch.faces, process=False)
    assert again.is_watertight
    assert again.volume == pytest.approx(BALL.volume, rel=1e-5)
    np.testing.assert_allclose(patch.normals, patch.vertices / 0.1, atol=2e-2)


def test_zero_of_either_sign_is_one_place():
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[-0.0, 0, 0], [0, 1, 0], [1, 0, 0]]])
    corners = corners.astype(np.float32)
    patch = merged(Strip(1, "", corners, corners, corners[..., 0]))
    assert len(patch.vertices) == 3


def test_patches_join_with_their_faces_renumbered():
    far = BALL.copy()
    far.apply_translation([1, 0, 0])
    both = joined([merged(strip_of(BALL, 5)), merged(strip_of(far, 7))])
    again = trimesh.Trimesh(both.vertices, both.faces, process=False)
    assert again.volume == pytest.approx(2 * BALL.volume, rel=1e-5)
    assert both.stamp_ns == 7
    assert len(joined([])) == 0


def test_colour_is_given_up_where_one_piece_has_none():
    red = merged(strip_of(BALL, rgb=(200, 10, 10)))
    assert (joined([red, red]).rgb == (200, 10, 10)).all()
    assert joined([red, merged(strip_of(BALL))]).rgb is None


@pytest.mark.parametrize("shading", SHADINGS)
def test_every_shading_colours_every_vertex(shading):
    patch = merged(strip_of(BALL))
    colours = patch_colours(patch, shading, sigma_range(patch))
    assert colours.shape == patch.vertices.shape
    assert colours.dtype == np.uint8
    varied = len(np.unique(colours, axis=0)) > 20
    assert varied == (shading in ("normals", "depth sigma"))


def test_unknown_sigmas_are_grey_and_large_ones_yellow():
    patch = merged(strip_of(BALL))
    patch.sigma[0], patch.sigma[1], patch.sigma[2] = np.nan, 1.0, 1e-9
    colours = patch_colours(patch, "depth sigma", (1e-4, 1e-1))
    assert colours[0].tolist() == [150, 150, 150]
    assert colours[1].tolist() == [253, 231, 37]
    assert colours[2].tolist() == [68, 1, 84]


def test_gltf_holds_the_surface_scaled():
    patch = merged(strip_of(BALL, rgb=(0, 128, 255)))
    data = encode_glb(patch, patch_colours(patch, "colour"), scale=10.0)
    loaded = trimesh.load(io.BytesIO(data), file_type="glb", force="mesh", process=False)
    np.testing.assert_allclose(loaded.vertices, 10 * patch.vertices, rtol=1e-6)
    np.testing.assert_array_equal(loaded.faces, patch.faces)
    # Colours of vertices are linear: 128 of sRGB is 0.216 of full light.
    (length,) = struct.unpack_from("<I", data, 12)
    content = json.loads(data[20 : 20 + length])
    view = content["bufferViews"][content["accessors"][2]["bufferView"]]
    assert tuple(data[28 + length + view["byteOffset"] :][:4]) == (0, 55, 255, 255)


@pytest.mark.parametrize("suffix", ["ply", "glb", "stl"])
def test_what_is_downloaded_is_the_surface_in_metres(suffix):
    patch = merged(strip_of(BALL, rgb=(0, 128, 255)))
    data = io.BytesIO(export(patch, suffix))
    loaded = trimesh.load(data, file_type=suffix, force="mesh")
    assert loaded.volume == pytest.approx(BALL.volume, rel=1e-5)
