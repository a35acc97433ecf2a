"""The picture that people look at: loops in colours, normals as ticks, doubt in another colour."""

from dataclasses import replace

import numpy as np

from occ_recon_ros.imaging import draw_contours
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras

GREY = np.full((480, 640), 128, np.uint8)


def ring():
    """Two loops, the first tenth of the outer one without confidence."""
    settings = TurntableSettings(
        width=640, height=480, focal_px=800.0, elevation=0.9, axis_tilt=0.6
    )
    contours = make_object("torus").exact_contours(turntable_cameras(settings)[9], 1.0)
    assert len(contours.loop_starts) == 3
    sigma = np.full(len(contours), 1e-4)
    sigma[: contours.loop_starts[1] // 10] = np.inf
    return replace(contours, sigma=sigma)


def colours_at(picture, points):
    x, y = np.round(points).astype(int).T
    return picture[y, x].astype(int)


def test_each_loop_has_its_colour_and_doubt_another():
    contours = ring()
    picture = draw_contours(GREY, contours)
    doubt, start, end = contours.loop_starts[1] // 10, *contours.loop_starts[1:]
    # Between the ticks, on the line.
    seen = [
        np.median(colours_at(picture, contours.uv[a + 3 : b - 3]), axis=0)
        for a, b in ((0, doubt), (doubt, start), (start, end))
    ]
    for k in range(3):
        assert np.ptp(seen[k]) > 60  # a colour
        assert np.abs(seen[k] - seen[k - 1]).max() > 60
    assert (picture[5, 5] == 128).all()  # nothing where no loop is


def test_ticks_point_out_of_the_object():
    contours = ring()
    drawn = (draw_contours(GREY, contours) != 128).any(axis=2)
    after, before = contours.uv[contours.next_row], contours.uv[contours.previous_row]
    along = after - before
    out = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    outside, inside = (
        drawn[tuple(np.round(contours.uv + side * 5 * out).astype(int).T[::-1])] for side in (1, -1)
    )
    assert outside.sum() >= len(contours) // 25 > 0
    assert inside.sum() < 0.1 * outside.sum()


def test_an_image_of_sixteen_bits_is_shown_in_eight():
    deep = np.repeat(np.linspace(1000, 3000, 640).astype(np.uint16)[None], 480, axis=0)
    shown = draw_contours(deep, replace(ring(), sigma=np.ones(len(ring()))))
    assert shown.dtype == np.uint8
    assert np.ptp(shown[5, :, 0].astype(int)) > 240
