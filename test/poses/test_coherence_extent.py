"""The image of distances to an outline: its size is bounded, its distances are right."""

import cv2
import numpy as np
import pytest

from occ_recon_ros.geometry import Camera, contours_from_loops
from occ_recon_ros.poses import refine_coherence
from occ_recon_ros.poses.refine_coherence import DistanceImage

SIZE = 4000


def ring(radius, D=()):
    """The outline of a disk in the middle of an image, walked with it on the left."""
    camera = Camera(
        K=[[SIZE, 0, SIZE / 2], [0, SIZE, SIZE / 2], [0, 0, 1]],
        width=SIZE,
        height=SIZE,
        R_camera_object=np.eye(3),
        t_camera_object=np.zeros(3),
        D=np.array(D, float),
        distortion="plumb_bob" if len(D) else "none",
    )
    angle = -np.linspace(0, 2 * np.pi, 1500, endpoint=False)
    loop = SIZE / 2 + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return contours_from_loops(camera, [loop], [0], [np.full(len(loop), 0.1)], 1, "o"), camera


@pytest.fixture
def drawn(monkeypatch):
    """Pixels of what is drawn."""
    sizes, draw = [], cv2.fillPoly

    def watched(image, *args, **kwargs):
        sizes.append(image.size)
        return draw(image, *args, **kwargs)

    monkeypatch.setattr(cv2, "fillPoly", watched)
    monkeypatch.setattr(refine_coherence, "_LARGE", 2**13)
    return sizes


def test_a_large_outline_is_drawn_the_smaller(drawn):
    silhouette = DistanceImage(*ring(1500.0))
    assert max(drawn) < 20 * 2**13
    angle = np.linspace(0, 6, 50)
    way = np.stack([np.cos(angle), np.sin(angle)])
    for away in (-800.0, -30.0, 0.0, 10.0, 25.0):
        found = silhouette.outside(SIZE / 2 + (1500 + away) * way)
        np.testing.assert_allclose(found, away, atol=8 if abs(away) > 500 else 2)


@pytest.mark.parametrize("D", [(46.6, -3690.0, 0.44, 2.4), (-1.5, 0, 0, 0)])
def test_no_lens_makes_it_larger(drawn, D):
    silhouette = DistanceImage(*ring(1500.0, D))
    assert max(drawn) < 20 * 2**13
    assert np.isfinite(silhouette.outside(np.full((2, 3), SIZE / 2.0))).all()
