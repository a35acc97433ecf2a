"""Masks that came are not given up for some that leave out what is no backdrop."""

import cv2
import numpy as np
import pytest

from msg_adapters import View
from occ_recon_ros.evaluation.given_up import given_up

SIZE = (240, 320)


def figure(k):
    """(h, w) a tall body on a wide foot, and both parts."""
    body, foot = np.zeros(SIZE, np.uint8), np.zeros(SIZE, np.uint8)
    cv2.ellipse(body, (160 + k, 100), (30, 70), 0, 0, 360, 255, -1)
    cv2.rectangle(foot, (110 + k, 170), (210 + k, 200), 255, -1)
    return body | foot, body, foot


def turn(foot_colour, given):
    """Views of the figure before dark cloth, with these masks of it."""
    rng, views = np.random.default_rng(0), []
    for k in range(6):
        _, body, foot = figure(k)
        image = np.full((*SIZE, 3), 18.0)
        image[body > 0], image[foot > 0] = (40, 40, 170), foot_colour
        image = cv2.GaussianBlur(image, (0, 0), 0.8) + rng.normal(0, 2, image.shape)
        shown = np.clip(image, 0, 255).astype(np.uint8)
        views.append(View(k, None, shown, given(figure(k)[0])))
    return views


def brushed(px):
    return lambda mask: cv2.dilate(mask, np.ones((2 * px + 1, 2 * px + 1), np.uint8))


def hull(mask):
    points = np.argwhere(mask)[:, ::-1].astype(np.int32)
    return cv2.fillConvexPoly(np.zeros(SIZE, np.uint8), cv2.convexHull(points), 255)


GREEN = (60, 150, 40)


@pytest.mark.parametrize("given", [lambda m: m, brushed(4), brushed(15), hull])
def test_what_is_as_the_backdrop_is_not_missed(given):
    found = {k: figure(k)[0] for k in range(6)}
    assert given_up(turn(GREEN, given), found) < 0.02


@pytest.mark.parametrize("given", [lambda m: m, brushed(4)])
def test_a_foot_that_is_taken_for_the_backdrop_is(given):
    # A round foot looks the same in all views of a fixed camera.
    found = {k: figure(k)[1] for k in range(6)}
    views = turn(GREEN, given)
    share = np.count_nonzero(figure(0)[2]) / np.count_nonzero(views[0].mask)
    assert given_up(views, found) == pytest.approx(share, rel=0.15)
    assert given_up(turn((18, 18, 18), given), found) < 0.02  # of its colour nothing tells


def test_views_without_a_mask_are_not_asked():
    assert given_up([], {}) == 0
    views = turn(GREEN, lambda m: m)
    assert given_up(views, {0: figure(0)[1]}) > 0.1
    assert given_up(views, {0: np.zeros(SIZE, np.uint8)}) == 0
