"""What most views see at one place; and one thing done to every view, on all cores."""

import numpy as np
import pytest

from occ_recon_ros.imaging.joint.each import each
from occ_recon_ros.imaging.joint.scenes import LEAST_SEEN, typical


@pytest.mark.parametrize("height", [1, 3, 21])
def test_each_place_has_the_lower_median_of_those_that_see_it(height):
    rng = np.random.default_rng(height)
    stack = rng.integers(0, 256, (9, height, 5, 3)).astype(np.uint8)
    seen = rng.random(stack.shape[:3]) < 0.7
    median, spread = typical(stack, seen)
    for y, x in np.ndindex(height, 5):
        some = np.sort(stack[seen[:, y, x], y, x].astype(float), axis=0)
        if len(some) < LEAST_SEEN:
            assert np.isinf(spread[y, x])
            assert not median[y, x].any()
            continue
        middle = some[(len(some) - 1) // 2]
        away = np.sort(np.abs(some - middle), axis=0)[(len(some) - 1) // 2]
        np.testing.assert_array_equal(median[y, x], middle)
        assert spread[y, x] == pytest.approx(1.4826 * away.max(), rel=1e-6)


def test_results_come_in_order_and_errors_come_out():
    assert each(lambda a, b: a - b, range(50), [1] * 50) == list(range(-1, 49))
    with pytest.raises(ZeroDivisionError):
        each(lambda a: 1 // a, [1, 0, 2])
