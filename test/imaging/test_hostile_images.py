"""Images in which there is no object, or none whose edge can be found."""

import cv2
import numpy as np
import pytest
from discs import camera_for, coverage, photograph

from occ_recon_ros.geometry import RimReconstructor
from occ_recon_ros.geometry.viewing import contours_from_loops
from occ_recon_ros.imaging import ContourError, ContourSettings, ContourTracker
from occ_recon_ros.imaging.fit import fit_outline
from occ_recon_ros.imaging.joint import joint_masks
from occ_recon_ros.scene import TurntableSettings, turntable_cameras

HEIGHT, WIDTH = 90, 120
VIEWS = turntable_cameras(TurntableSettings(width=WIDTH, height=HEIGHT, focal_px=160.0))[:5]


def surface(rng):
    y, x = np.mgrid[:HEIGHT, :WIDTH] / 100.0
    a = rng.normal(size=5)
    return 128 + 80 * (a[0] * x + a[1] * y + a[2] * x * x + a[3] * x * y + a[4] * y * y)


def noise(rng):
    wide = cv2.GaussianBlur(rng.normal(size=(HEIGHT, WIDTH)), (0, 0), rng.uniform(0.5, 20))
    return 128 + rng.uniform(10, 300) * wide / wide.std()


def text(rng):
    image = np.clip(surface(rng), 0, 255).astype(np.uint8)
    for _ in range(rng.integers(1, 6)):
        at = tuple(int(v) for v in rng.integers(0, [WIDTH, HEIGHT]))
        size, thick = float(rng.uniform(0.3, 4)), int(rng.integers(1, 12))
        cv2.putText(image, "Aq8#"[: rng.integers(1, 5)], at, 0, size, int(rng.integers(256)), thick)
    return image


def grating(rng):
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    angle, period = rng.uniform(0, 3.14), rng.uniform(1.5, 60)
    wave = np.sin(2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / period)
    return 128 + rng.uniform(5, 200) * np.sign(wave)


def saturated(rng):
    return 255.0 * (noise(rng) > rng.uniform(60, 200))


def flat(rng):
    image = np.full((HEIGHT, WIDTH), float(rng.choice([0, 255, 128])))
    image[rng.integers(HEIGHT), rng.integers(WIDTH)] = 128
    return image


def ball(rng):
    image = np.full((HEIGHT, WIDTH), 30, np.uint8)
    cv2.circle(image, (WIDTH // 2, HEIGHT // 2), int(rng.integers(3, HEIGHT)), 160, -1)
    return image + rng.uniform(0, 40) * rng.normal(size=image.shape)


@pytest.mark.parametrize("kind", [surface, noise, text, grating, saturated, flat, ball])
def test_no_image_breaks_the_way_from_contours_to_rims(kind):
    """Contours that can be used, or a named drop; and rims of whatever contours there are."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        chosen = ContourSettings(
            tracking="snake" if seed % 3 == 2 else "none",
            min_loop_px=float(rng.choice([8.0, 40.0])),
            spacing_px=float(rng.choice([0.5, 1.0, 3.0])),
        )
        tracker, reconstructor = ContourTracker(chosen), RimReconstructor()
        rims, frames, image = [], 0, kind(rng)
        for k, camera in enumerate(VIEWS):
            image = image if k % 2 else kind(rng)
            grey = np.clip(image, 0, 255).astype(np.uint8)
            try:
                found = tracker.process(grey, camera, k + 1, "turntable")
            except ContourError:
                continue
            frames += 1
            assert np.isfinite(found.N).all()
            assert (found.sigma > 0).all()
            rims += reconstructor.add(found)
        rims += reconstructor.finish()
        assert len({rim.stamp_ns for rim in rims}) == frames


@pytest.mark.slow
@pytest.mark.parametrize("kind", [text, grating, flat, ball])
def test_no_images_break_the_masks_of_all_views_together(kind, monkeypatch):
    """Masks of the images' size and a belief in them, or a named reason for none."""
    monkeypatch.setattr("occ_recon_ros.imaging.joint.solve._GRIDS", (24, 32, 36))
    rng = np.random.default_rng(7)
    images = [np.clip(kind(rng), 0, 255).astype(np.uint8) for _ in VIEWS]
    try:
        found, masks = joint_masks(zip(images, VIEWS, strict=True))
    except ContourError:
        return
    assert 0 <= found.belief <= 1
    assert all(mask.shape == (HEIGHT, WIDTH) and set(np.unique(mask)) <= {0, 255} for mask in masks)


def test_a_loop_keeps_to_the_curve_searched_where_there_is_no_edge():
    angle = np.linspace(0, 2 * np.pi, 628, endpoint=False)
    circle = 100 * np.column_stack([np.cos(angle), -np.sin(angle)]) + 200
    rng = np.random.default_rng(0)
    edges = circle + 0.1 * rng.standard_normal(circle.shape)
    sigma = np.full(len(angle), np.inf)
    sigma[200:216] = 0.1  # one short stretch is seen, and that a little askew
    edges[200:216] += np.linspace(-1, 1, 16)[:, None] * (circle[208] - 200) / 100
    inside = np.ones(len(angle), bool)
    points, found = fit_outline(edges, sigma, inside, 30.0, 1.0, start=circle)
    away = np.abs(np.linalg.norm(points - 200, axis=1) - 100)
    assert away.max() < 6
    assert np.isfinite(found[204:212]).all()
    assert np.isinf(found[300:]).all()
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() < 2


def test_samples_between_two_gaps_and_samples_that_coincide_have_a_normal_and_no_sigma():
    angle = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    loop = 60 + 30 * np.column_stack([np.cos(angle), -np.sin(angle)])
    loop[50] = [5.0, 5.0]  # far from both its neighbours
    loop[20:23] = loop[20]
    contours = contours_from_loops(VIEWS[0], [loop], [0], [np.full(100, 0.1)], 1, "turntable")
    assert np.isinf(contours.sigma[[21, 50]]).all()
    assert np.isfinite(np.delete(contours.sigma, [20, 21, 22, 49, 50])).all()
    np.testing.assert_allclose(np.linalg.norm(contours.N, axis=1), 1)
    np.testing.assert_allclose(np.einsum("nk,nk->n", contours.N, contours.T), 0, atol=1e-12)


def test_outlines_without_an_edge_are_named():
    image = photograph(coverage((90, 120), np.array([60.0, 45.0]), np.array([30.0, 30.0]), 0.0))
    two = np.pad(image, ((0, 0), (0, 60)), mode="edge")
    small = coverage(two.shape, np.array([145.0, 45.0]), np.array([20.0, 20.0]), 0.0)
    two = np.where(small > 0, photograph(small), two)

    class Blind(ContourTracker):
        """Shown an even image wherever the outline is longer than this."""

        longest = 0

        def _outline(self, image, mask, loop, by_mask, window):
            seen = image if len(loop) < self.longest else np.full_like(image, 100)
            return super()._outline(seen, mask, loop, by_mask, window)

    tracker = Blind(ContourSettings(segmentation="threshold"))
    with pytest.raises(ContourError) as error:
        tracker.process(two, camera_for(two), 1, "turntable")
    assert error.value.reason == "no_edge"
    tracker.longest = 150
    found = tracker.process(two, camera_for(two), 2, "turntable")
    assert np.isinf(found.sigma[found.loop == found.loop[0]]).all()
    assert np.isfinite(found.sigma).any()
    again = tracker.process(two, camera_for(two), 3, "turntable")
    assert len(again) == len(found)
    (said,) = [event for event in tracker.events() if "no edge" in event]
    assert "1 of 2" in said
