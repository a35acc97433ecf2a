"""Which silhouettes contradict the others: right ones are never named, spoilt ones are."""

from dataclasses import replace

import numpy as np
import pytest
from exact_turns import exact_turn

from occ_recon_ros.geometry import Camera, Contours, contours_from_loops
from occ_recon_ros.surface.agreement import silhouette_agreement

VIEWS = 24
BAD = 5


def turn(name: str) -> tuple[list[Camera], list[Contours]]:
    return exact_turn(name, VIEWS, 0.4, np.radians(10), width=640)[1:]


def loops_of(contours: Contours) -> list[np.ndarray]:
    return np.split(contours.uv, contours.loop_starts[1:-1])


def drawn_anew(camera: Camera, contours: Contours, loops: list[np.ndarray]) -> Contours:
    """The contours with other loops in the image."""
    sigmas = [np.full(len(loop), 0.1) for loop in loops]
    stamp, frame = contours.stamp_ns, contours.frame_id
    return contours_from_loops(camera, loops, list(range(len(loops))), sigmas, stamp, frame)


def shifted(loop: np.ndarray) -> np.ndarray:
    return np.add(loop, [0.12 * np.ptp(loop[:, 0]), 0])


def too_large(loop: np.ndarray) -> np.ndarray:
    return loop.mean(axis=0) + 1.25 * (loop - loop.mean(axis=0))


def a_speck(loop: np.ndarray) -> np.ndarray:
    return loop.mean(axis=0) + 0.1 * (loop - loop.mean(axis=0))


def bitten(loop: np.ndarray) -> np.ndarray:
    """The lowest quarter is missing."""
    low, high = loop[:, 1].min(), loop[:, 1].max()
    return np.column_stack([loop[:, 0], np.minimum(loop[:, 1], high - 0.25 * (high - low))])


@pytest.mark.parametrize("name", ["vase", "torus", "mug", "figure"])
def test_right_silhouettes_are_not_named(name):
    agreement = silhouette_agreement(turn(name)[1])
    assert not agreement.doubtful.any()
    assert agreement.share.max() < 0.005


@pytest.mark.parametrize("spoil", [shifted, too_large, a_speck, bitten])
@pytest.mark.parametrize("name", ["vase", "figure"])
def test_a_spoilt_silhouette_is_named_and_no_other(name, spoil):
    cameras, contours = turn(name)
    outer = max(loops_of(contours[BAD]), key=len)
    contours[BAD] = drawn_anew(cameras[BAD], contours[BAD], [spoil(outer)])
    assert np.flatnonzero(silhouette_agreement(contours).doubtful).tolist() == [BAD]


def test_a_fifth_of_the_views_may_be_wrong():
    cameras, contours = turn("figure")
    wrong = dict(zip([1, 6, 11, 15], [shifted, too_large, a_speck, bitten], strict=True))
    for k, spoil in wrong.items():
        outer = max(loops_of(contours[k]), key=len)
        contours[k] = drawn_anew(cameras[k], contours[k], [spoil(outer)])
    assert np.flatnonzero(silhouette_agreement(contours).doubtful).tolist() == list(wrong)


def test_of_a_third_that_show_another_place_the_rest_is_told():
    cameras, contours = turn("figure")
    wrong = [1, 4, 7, 10, 13, 16, 19, 22]
    for k in wrong:
        elsewhere = [np.add(loop, [1.2 * np.ptp(loop[:, 0]), 0]) for loop in loops_of(contours[k])]
        contours[k] = drawn_anew(cameras[k], contours[k], elsewhere)
    assert np.flatnonzero(silhouette_agreement(contours).doubtful).tolist() == wrong


def test_a_view_without_outline_is_named():
    contours = turn("vase")[1]
    empty = slice(0, 0)
    contours[3] = replace(
        contours[3],
        **{k: getattr(contours[3], k)[empty] for k in ("T", "N", "uv", "loop", "sigma")},
    )
    assert np.flatnonzero(silhouette_agreement(contours).doubtful).tolist() == [3]


def test_views_of_different_things_all_disagree():
    """Each outline is of a thing that turned another way: nothing holds them together."""
    contours = turn("figure")[1]
    mixed = [
        replace(c, T=other.T, N=other.N, uv=other.uv, loop=other.loop, sigma=other.sigma)
        for c, other in zip(contours, contours[7:] + contours[:7], strict=True)
    ]
    assert silhouette_agreement(mixed).doubtful.mean() > 0.5


def test_two_views_cannot_be_judged():
    with pytest.raises(ValueError, match="three views"):
        silhouette_agreement(turn("vase")[1][:2])
