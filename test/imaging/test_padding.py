"""Bars and frames around the picture, as far as the outlines of single images go."""

import cv2
import numpy as np
import pytest

from occ_recon_ros.geometry import Camera
from occ_recon_ros.imaging import ContourSettings, ContourTracker
from occ_recon_ros.imaging.padding import picture_area
from occ_recon_ros.imaging.window import Window

SIZE = (240, 320)


def picture(level=45):
    """A light egg before a backdrop that is darker above than below."""
    light = np.linspace(0.7, 1.3, SIZE[0])[:, None] * np.full(SIZE, float(level))
    cv2.ellipse(light, (160, 120), (50, 70), 0, 0, 360, 200.0, -1)
    noise = np.random.default_rng(0).normal(0, 2, SIZE)
    return np.clip(cv2.GaussianBlur(light, (0, 0), 1.0) + noise, 0, 255).astype(np.uint8)


def outline(image, tracker=None):
    height, width = image.shape[:2]
    K = np.array([[500.0, 0, width / 2], [0, 500, height / 2], [0, 0, 1]])
    camera = Camera(K, width, height, np.eye(3), np.array([0, 0, 1.0]))
    return (tracker or ContourTracker()).process(image, camera, 0, "object")


@pytest.mark.parametrize("bars", [(0, 0, 40, 40), (30, 50, 0, 0), (20, 20, 30, 30), (0, 0, 0, 60)])
@pytest.mark.parametrize("quality", [None, 75])
@pytest.mark.parametrize("value", [0, 128])
def test_the_outline_is_that_of_the_object_and_not_of_the_picture(bars, quality, value):
    bare = outline(picture())
    padded = cv2.copyMakeBorder(picture(), *bars, cv2.BORDER_CONSTANT, value=value)
    if quality:
        code = cv2.imencode(".jpg", padded, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        padded = cv2.imdecode(code, cv2.IMREAD_GRAYSCALE)
    found = outline(padded)
    assert len(found.loop_starts) == len(bare.loop_starts)
    shift = np.array([bars[2], bars[0]])
    ends = np.array(
        [f(c.uv - s, axis=0) for f in (np.min, np.max) for c, s in ((found, shift), (bare, 0))]
    ).reshape(2, 2, 2)
    assert np.abs(ends[:, 0] - ends[:, 1]).max() < 0.5


def test_what_a_bar_cuts_off_is_no_outline():
    cut = cv2.copyMakeBorder(picture()[:, 140:], 0, 0, 80, 0, cv2.BORDER_CONSTANT, value=0)
    found = outline(cut)
    assert found.uv[:, 0].min() >= 80
    beside = np.abs(found.uv[:, 0] - 80) < 1.5
    assert not beside.any()


def test_bars_are_looked_for_now_and_then(monkeypatch):
    tracker, looks, look = ContourTracker(ContourSettings()), [], Window.without_bars
    monkeypatch.setattr(Window, "without_bars", lambda w, i: looks.append(k) or look(w, i))
    bars = {"borderType": cv2.BORDER_CONSTANT, "value": 0}
    for k in range(1, 11):  # the bars come with the second image
        image = cv2.copyMakeBorder(picture(), 0, 0, 40, 40, **bars) if k > 1 else picture()
        found = outline(image, tracker)
    assert looks == [1, 2, 4, 8]
    assert found.uv[:, 0].min() > 100
    outline(picture(), tracker)  # of another size again
    assert looks == [1, 2, 4, 8, 10]


@pytest.mark.parametrize("shape", ["block", "front", "beam", "egg"])
def test_an_object_before_painted_black_is_no_picture(shape):
    image = np.zeros(SIZE, np.uint8)
    if shape == "block":  # turned a little, as a turntable shows it but for an instant
        corners = np.array([[60, 70], [250, 74], [246, 180], [64, 176]])
        cv2.fillPoly(image, [corners], 150)
    elif shape == "beam":  # that leaves the image on both sides
        cv2.fillPoly(image, [np.array([[0, 50], [319, 62], [319, 185], [0, 173]])], 150)
    elif shape == "front":
        image[70:180, 60:250] = 150
    else:
        cv2.ellipse(image, (160, 120), (140, 60), 0, 0, 360, 150, -1)
    assert picture_area(image) == (slice(0, 240), slice(0, 320))
