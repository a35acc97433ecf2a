"""Holes that few views show carve the body, but where others show a surface in them."""

import pytest
from exact_turns import exact_turn
from test_evidence import SPOILT, true_volume

from occ_recon_ros.geometry import Contours, contours_from_loops
from occ_recon_ros.surface.evidence import weigh
from occ_recon_ros.surface.hull import Hull

CELLS = 64


def with_wrong_hole(name: str, how: str, views: int, wrong: int) -> list[Contours]:
    _, cameras, contours = exact_turn(name, views, 0.4, width=1280)
    found, c = list(contours), contours[wrong]
    loops = SPOILT[how](max(c.by_loop(c.uv), key=len), [])
    sigmas = [c.sigma[: len(loop)].mean().repeat(len(loop)) for loop in loops]
    found[wrong] = contours_from_loops(
        cameras[wrong], loops, [0, 1], sigmas, c.stamp_ns, c.frame_id
    )
    return found


@pytest.mark.parametrize(
    ("name", "elevation", "views"),
    [("torus", 0.6, 6), ("mug", 0.25, 8), ("mug", 0.3, 8), ("mug", 0.6, 6)],
)
def test_a_hole_that_no_other_view_sees_through_carves_where_none_refutes_it(
    name, elevation, views
):
    contours = exact_turn(name, views, elevation, width=1280)[2]
    evidence = weigh(contours)
    assert evidence.left_out == evidence.mended == ()
    hull = Hull(evidence.cones).mesh(CELLS)
    assert max(hull.split(), key=lambda body: body.volume).euler_number == 0
    assert hull.volume == pytest.approx(Hull(contours).mesh(CELLS).volume, rel=2e-3)


@pytest.mark.parametrize("views", [8, 12])
@pytest.mark.parametrize(
    ("name", "how"),
    [("vase", "a large hole"), ("figure", "a large hole"), ("bottle", "a small hole")],
)
def test_a_hole_of_one_view_in_which_others_show_a_surface_carves_nothing(name, how, views):
    contours = with_wrong_hole(name, how, views, 2)
    evidence = weigh(contours)
    assert 2 in evidence.left_out + evidence.mended
    hull = Hull(evidence.cones).mesh(CELLS)
    assert hull.volume == pytest.approx(true_volume(name, views), rel=0.03)
