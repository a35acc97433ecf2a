"""Images that show nothing are named, where the others of their set show something."""

import numpy as np
import pytest

from occ_recon_ros.bags.exposure import ends_of, nothing_to_see, numbered


def image(low, high, dtype=np.uint8):
    ramp = np.linspace(low, high, 64 * 48).reshape(48, 64) * np.iinfo(dtype).max
    return ramp.astype(dtype)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(("low", "high", "said"), [(0, 0.04, "black"), (0.98, 1, "white")])
def test_black_and_white_ones_are_named_among_others(dtype, low, high, said):
    images = [image(0.1, 0.9, dtype)] * 7 + [image(low, high, dtype)]
    names = [f"{k}.png" for k in range(8)]
    (sentence,) = nothing_to_see(names, [ends_of(one) for one in images])
    assert sentence.startswith(f"1 of 8 images are nearly {said} all over")
    assert sentence.endswith(": 7.png")


@pytest.mark.parametrize(("low", "high"), [(0, 0.04), (0.97, 1), (0.1, 0.9), (0, 0.3)])
def test_where_all_are_so_none_is_named(low, high):
    assert nothing_to_see(["a"] * 5, [ends_of(image(low, high))] * 5) == []
    assert nothing_to_see([], []) == []


def test_a_dark_side_and_a_bright_backdrop_are_no_blackness():
    images = [image(0.2, 1)] * 5 + [image(0, 0.5), image(0.9, 1)]
    assert nothing_to_see(["a"] * 7, [ends_of(one) for one in images]) == []


def test_a_view_is_called_by_its_number_and_its_image_where_that_has_a_name():
    images = [{"name": "a.jpg"}, {"name": ""}]
    assert [numbered(k, images) for k in range(3)] == ["0 (a.jpg)", "1", "2"]
    assert numbered(5, []) == "5"
