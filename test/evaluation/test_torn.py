"""Masks that the others contradict at one place, and those that were drawn in their place."""

from types import SimpleNamespace

import numpy as np
import pytest
from exact_turns import exact_turn

from occ_recon_ros.evaluation.torn import no_better_drawn
from occ_recon_ros.streams.alone import filled
from occ_recon_ros.surface.agreement import contradicted

TORN = 5


@pytest.fixture(scope="module")
def right():
    """The contours of a turn of the vase, and their masks."""
    contours = exact_turn("vase", 12, 0.0)[2]
    return contours, [filled(c.by_loop(c.uv), (480, 640)) for c in contours]


def lacking(mask, share):
    """A mask without so much of its height, from below."""
    rows = np.flatnonzero(mask.any(axis=1))
    short = mask.copy()
    short[round(rows[-1] - share * np.ptp(rows)) :] = 0
    return short


@pytest.mark.parametrize(("drawn", "stays"), [(0.4, True), (0.13, True), (0.0, False)])
def test_a_torn_mask_stays_where_what_was_drawn_agrees_no_better(right, drawn, stays):
    # Colours lost both legs of a bird, of which the masks that came lacked one.
    _, masks = right
    came = [lacking(mask, 0.15) if k == TORN else mask for k, mask in enumerate(masks)]
    views = [
        SimpleNamespace(image=m, camera=c, stamp_ns=k, mask=m)
        for k, (m, c) in enumerate(zip(came, exact_turn("vase", 12, 0.0)[1], strict=True))
    ]
    kept = {k: m for k, m in enumerate(came) if k != TORN}
    anew = {**kept, TORN: lacking(masks[TORN], drawn)}
    found = no_better_drawn(views, kept, anew, {TORN})
    assert list(found) == [TORN] * stays
    assert all((found[k] == came[k]).all() for k in found)


def test_a_right_silhouette_is_not_contradicted_and_one_of_another_view_is(right):
    contours, _ = right
    others = contours[:TORN] + contours[TORN + 1 :]
    assert contradicted(contours[TORN], others) < 0.005
    with pytest.raises(ValueError, match="three views"):
        contradicted(contours[TORN], others[:1])
