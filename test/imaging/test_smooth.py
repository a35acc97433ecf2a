"""Smoothing of closed curves, however long its span."""

import numpy as np
import pytest

from occ_recon_ros.imaging.fit import fit_outline
from occ_recon_ros.imaging.smooth import smooth_closed, stiffness

ANGLE = np.arange(1500) / 1500 * 2 * np.pi
CIRCLE = 240 * np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=1)


def noisy(seed: int) -> np.ndarray:
    """The circle, by edges of 1 px on each coordinate."""
    return CIRCLE + np.random.default_rng(seed).normal(0, 1, CIRCLE.shape)


@pytest.mark.parametrize("cutoff", [0.2, 0.02])
def test_a_loop_has_no_beginning(cutoff):
    stiff, weight = stiffness(np.full(1500, cutoff)), np.ones(1500)
    found = smooth_closed(noisy(0), weight, stiff)
    rolled = smooth_closed(np.roll(noisy(0), 700, axis=0), weight, stiff)
    np.testing.assert_allclose(np.roll(rolled, -700, axis=0), found, atol=6e-3)  # px


def test_much_noise_is_averaged_as_far_as_the_bends_allow():
    off, told = [], []
    for seed in range(8):
        points, sigma = fit_outline(noisy(seed), np.ones(1500), np.ones(1500, bool), 27.0, 1.0)
        off.append(np.linalg.norm(points, axis=1) - 240)
        told.append(np.median(sigma))
    assert np.std(off) < 0.09
    assert 0.9 < np.std(off) / np.mean(told) < 1.15
