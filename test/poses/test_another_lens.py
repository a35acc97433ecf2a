"""A lens that outlines ask for, in words: which of its numbers, and what to do."""

import numpy as np
import pytest

from occ_recon_ros.poses.another_lens import AnotherLens

USUAL = np.array([10.0, 10.0, 0.015, 0.003, 0.03])


def asked(cx=0.0, cy=0.0, focal=1.0, wide=1.0, bend=0.0, whole=True):
    lens = np.array([cx, cy, np.log(focal), np.log(wide), bend])
    return AnotherLens.of(lens, USUAL, whole).said()


@pytest.mark.parametrize(
    ("lens", "said"),
    [
        ({"focal": 1.13}, "(focal length x 1.13), which"),
        ({"wide": 1.06}, "(pixels 1.06 times as wide as high: were the images stretched?), which"),
        ({"focal": 0.9, "cx": -3, "cy": 41}, "x 0.90, principal point off by (-3, 41) px), which"),
        ({"focal": 1.1, "bend": 0.24}, "x 1.10, distortion k1 -0.24), which"),
    ],
)
def test_what_is_off_is_named_with_by_how_much_and_nothing_else(lens, said):
    assert said in asked(**lens)
    assert ("its distortion D" in asked(**lens)) == ("bend" in lens)


def test_a_lens_that_explains_a_part_is_said_to():
    assert "better, but not as well as they are known" in asked(wide=1.06, whole=False)


def test_numbers_that_no_lens_has_are_not_said():
    # An outline has no width in pixels that are five times as wide as high: all agree.
    said = asked(cy=276, focal=1.35, wide=5.09)
    assert "5.09" not in said
    assert "do not tell which" in said
