"""A mesh that holds more than the object is told to, and where the object is in it."""

import pytest
import trimesh
from cast import cast

from occ_recon_ros.evaluation.agreeing_part import agreeing_part


def body(centre=(0.0, 0.0, 0.0)):
    return trimesh.creation.icosphere(subdivisions=4, radius=0.05).apply_translation(centre)


@pytest.fixture(scope="module")
def seen():
    return cast(body())


def plate():
    return trimesh.creation.box((0.2, 0.2, 0.005)).apply_translation((0, 0, -0.053))


@pytest.mark.parametrize("beside", [plate(), plate().subdivide(), body((0.12, 0.03, 0))])
def test_what_is_beside_the_object_is_told(seen, beside):
    words = agreeing_part(trimesh.util.concatenate([body(), beside]), seen, iou=0.4)
    assert "from (-0.05, -0.05, -0.05) to (0.05, 0.05, 0.05) m, agrees" in words
    share = beside.area / (beside.area + body().area)
    assert f"the rest, {share:.0%} of its surface" in words


def test_an_object_that_is_elsewhere_or_too_large_is_not_taken_for_more(seen):
    for mesh in (body((0.02, 0, 0)), body((1, 0, 0)), body().apply_scale(1.3), plate()):
        assert agreeing_part(mesh, seen, iou=0.5) == ""
    assert agreeing_part(body(), seen, iou=1.0) == ""
    assert agreeing_part(body(), [], iou=0.5) == ""
