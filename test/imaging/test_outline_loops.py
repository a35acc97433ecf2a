"""The compiled loops of outlines against closed forms, SciPy and the plainest form in NumPy."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.ndimage import (
    distance_transform_edt,
    map_coordinates,
    maximum_filter1d,
    uniform_filter1d,
)
from scipy.sparse import diags_array
from scipy.sparse.linalg import spsolve
from scipy.special import erf

from occ_recon_ros.geometry.arrays import median
from occ_recon_ros.geometry.compiled import compiled
from occ_recon_ros.imaging import outline, subpixel
from occ_recon_ros.imaging.curves import along, curvature, for_loops, largest, normals, resample
from occ_recon_ros.imaging.identity import match_loops
from occ_recon_ros.imaging.smooth import smooth_closed
from occ_recon_ros.imaging.subpixel import across, profiles

LOOPS, PIXEL_LOOPS = compiled("imaging.kernels"), compiled("imaging.pixel_kernels")
RNG = np.random.default_rng(0)


def wavy(n: int) -> np.ndarray:
    """A loop with the object on its left, as displayed."""
    angle = -2 * np.pi * (np.arange(n) + RNG.uniform(-0.3, 0.3, n)) / n
    radius = 60 + 5 * np.cos(5 * angle)
    return np.array([300, 200]) + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("reach", [1, 3])
def test_normals_stand_on_chords_and_point_out_of_the_object(reach):
    points = wavy(200)
    chord = np.roll(points, -reach, axis=0) - np.roll(points, reach, axis=0)
    expected = np.column_stack([-chord[:, 1], chord[:, 0]]) / np.linalg.norm(chord, axis=1)[:, None]
    np.testing.assert_allclose(normals(points, reach), expected, rtol=1e-12)
    assert ((points - points.mean(axis=0)) * normals(points, reach)).sum(axis=1).min() > 0
    np.testing.assert_array_equal(normals(np.ones((9, 2))), np.zeros((9, 2)))


@pytest.mark.parametrize("reach", [1, 3])
def test_curvature_is_the_turn_of_the_chords_by_their_length(reach):
    points = wavy(200)
    z = points @ [1, 1j]
    before, after = z - np.roll(z, reach), np.roll(z, -reach) - z
    expected = -2 * np.angle(after / before) / (np.abs(before) + np.abs(after))
    np.testing.assert_allclose(curvature(points, reach), expected, rtol=1e-12)
    assert expected.min() < 0 < expected.mean()  # a hollow, and a body as a whole
    np.testing.assert_array_equal(curvature(np.ones((9, 2))), np.zeros(9))


def test_points_off_a_curve_are_measured_along_its_normals():
    curve = wavy(200)
    points = curve + RNG.normal(0, 2, curve.shape)
    expected = ((points - curve) * normals(curve, 2)).sum(axis=1)
    np.testing.assert_allclose(LOOPS.off_curve(points, curve, 2), expected, atol=1e-12)


def test_the_scatter_of_edges_is_told_without_those_that_are_on_something_else():
    """Noise of 0.3 px, 0.6 px in a half, its neighbours alike by 0.5; every tenth edge far off."""
    rng, n = np.random.default_rng(2), 20000
    sigma = np.where(np.arange(n) < n // 2, 0.3, 0.6)
    white = rng.normal(0, 1, n + 1)
    off = sigma * (white[1:] + white[:-1]) / np.sqrt(2)
    weight = np.where(np.arange(n) % 3, 1.0, 0.25)
    off /= np.sqrt(weight)
    off[::10] = rng.choice([-9.0, 9.0], n // 10)
    weight[5::10] = 0.0
    off[5::10] = np.nan
    variance, alike = LOOPS.scatter(np.nan_to_num(off), weight, np.full(n, 0.8), 2001, 4.0, 2)
    inner = (np.arange(n) % (n // 2) > 1000) & (np.arange(n) % (n // 2) < n // 2 - 1000)
    np.testing.assert_allclose(np.sqrt(0.8 * variance[inner]), sigma[inner], rtol=0.08)
    assert alike == pytest.approx(0.5 * 6 / 8, abs=0.03)  # six of the eight have their neighbour
    alone = np.where(np.arange(n) == 7, 1.0, 0.0)
    whole, _ = LOOPS.scatter(np.full(n, 0.1), alone, np.ones(n), 61, 4.0, 2)
    np.testing.assert_allclose(whole[n // 2], 0.01, rtol=0.01)


@pytest.mark.parametrize("spacing", [0.7, 2.0])
def test_a_loop_is_sampled_anew_along_its_hermite_pieces(spacing):
    points = wavy(120)
    found = resample(np.repeat(points, 1 + (np.arange(120) % 7 == 0), axis=0), spacing)
    closed = np.concatenate([points, points, points])
    s = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    slope = np.gradient(closed, axis=0) * 2 / np.gradient(s)[:, None] / 2
    length = s[240] - s[120]
    count = round(length / spacing)
    curve = CubicHermiteSpline(s, closed, slope)
    np.testing.assert_allclose(found, curve(s[120] + np.arange(count) * length / count), rtol=1e-12)


def test_a_loop_of_no_length_is_refused():
    with pytest.raises(ValueError, match="no length"):
        resample(np.ones((5, 2)), 1.0)


def test_the_smooth_curve_is_the_least_of_its_sum():
    """By the normal equations of a loop gone on with at both ends."""
    n, pad = 300, 120
    points, weight = wavy(n), RNG.uniform(0, 2, n) * (np.arange(n) % 9 > 0)
    k = RNG.uniform(1.0, 200.0, n)
    k[100:104] = 0.0  # a corner
    rows = np.arange(-pad, n + pad) % n
    stiff = np.minimum(k[rows][1:-2], k[rows][2:-1])
    ones = np.ones(len(stiff))
    third = diags_array(
        [-ones, 3 * ones, -3 * ones, ones], offsets=[0, 1, 2, 3], shape=(len(stiff), len(rows))
    )
    w = weight[rows] + 1e-9
    system = third.T @ diags_array(stiff) @ third + diags_array(w)
    expected = spsolve(system.tocsc(), w[:, None] * points[rows])[pad : pad + n]
    np.testing.assert_allclose(smooth_closed(points, weight, k), expected, atol=1e-8)
    one = smooth_closed(points[:, :1], weight, k)
    np.testing.assert_allclose(one, expected[:, :1], atol=1e-8)


@pytest.mark.parametrize("cutoff", [0.0131, 0.2])
def test_rounding_does_not_tell_in_the_stiffest_curve(cutoff):
    """Far from the ends, to which the loop is gone on with, each wave keeps its share."""
    n = 2400
    points = 1000 + wavy(n) * 6 + RNG.normal(0, 1, (n, 2))
    found = smooth_closed(points, np.ones(n), np.full(n, cutoff**-6))
    frequency = 2 * np.pi * np.fft.fftfreq(n)[:, None]
    kept = 1 / (1 + cutoff**-6 * (2 - 2 * np.cos(frequency)) ** 3)
    expected = np.fft.ifft(np.fft.fft(points, axis=0) * kept, axis=0).real
    np.testing.assert_allclose(found[1150:1250], expected[1150:1250], rtol=0, atol=2e-4)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_values_across_a_curve_are_bilinear_and_the_nearest_ones_outside(kind, channels):
    image = RNG.integers(0, np.iinfo(kind).max, (60, 80, *channels)).astype(kind)
    image.flags.writeable = False  # as in a message
    angle = np.arange(50) / 50 * 2 * np.pi
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    points, u = np.array([40, 30]) + 28 * out, np.arange(-4, 4.5, 0.5)
    found = across(image, points, out, u)
    at = points[:, None] + u[:, None] * out[:, None]
    x, y = np.clip(at[..., 0], 0, 79 - 1e-3), np.clip(at[..., 1], 0, 59 - 1e-3)
    assert (y != at[..., 1]).sum() > 10
    layers = image.reshape(60, 80, -1).astype(float)
    for c in range(layers.shape[2]):
        expected = map_coordinates(layers[..., c], [y, x], order=1)
        np.testing.assert_allclose(found[..., c], expected, rtol=3e-6, atol=1e-3)
    assert np.isfinite(across(image, np.full((3, 2), np.nan), out[:3], u)).all()


def test_colour_is_seen_along_the_step_from_the_object_to_the_backdrop():
    inside, outside = np.array([200, 40, 60]), np.array([80, 90, 60])
    y, x = np.mgrid[:100, :100]
    share = np.clip(np.hypot(x - 50, y - 50) - 29.5, 0, 1)[..., None]
    image = np.rint(inside + share * (outside - inside)).astype(np.uint8)
    angle = -np.arange(180) / 180 * 2 * np.pi
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    u, values = profiles(image, 50 + 30 * out, out, 4.0, 0.5)
    assert values.shape == (180, len(u))
    step = (outside - inside) / np.linalg.norm(outside - inside)
    np.testing.assert_allclose(values[:, u <= -2], inside @ step, atol=0.1)
    np.testing.assert_allclose(values[:, u >= 2], outside @ step, atol=0.1)
    dark_inside = 255 - image[..., 0]
    for grey in (dark_inside, 255 - dark_inside):
        _, values = profiles(grey, 50 + 30 * out, out, 4.0, 0.5)
        assert np.ptp(values[:, -3:] - values[:, :3]) < 5
        assert (values[:, -1] - values[:, 0]).min() > 100


def test_how_far_outside_of_a_mask_points_are():
    y, x = np.mgrid[:70, :90]
    mask = (np.hypot(x - 20, 0.7 * (y - 30)) < 25) & ~((x > 40) & (y < 40))  # cut by two borders
    mask = np.where(mask, 200, RNG.integers(0, 127, mask.shape)).astype(np.uint8)
    inside = distance_transform_edt(np.pad(mask > 127, 1))[1:-1, 1:-1]
    signed = distance_transform_edt(mask <= 127) - inside + np.where(inside > 0, 0.5, -0.5)
    points = RNG.uniform(-3, 92, (500, 2))
    expected = map_coordinates(
        signed, np.clip(points.T[::-1], 0, [[69 - 1e-3], [89 - 1e-3]]), order=1
    )
    np.testing.assert_allclose(PIXEL_LOOPS.outside_by(for_loops(mask), points), expected, atol=1e-9)
    assert expected.min() < -5 < 15 < expected.max()


def test_pixels_beyond_a_plane_of_colours_are_the_object():
    image = RNG.integers(0, 256, (41, 37, 3)).astype(np.uint8)
    plane = np.array([0.4, -0.5, 0.2, -3.0], np.float32)
    found = np.full((41, 37), 7, np.uint8)
    PIXEL_LOOPS.beyond(for_loops(image), plane, found)
    expected = image @ plane[:3].astype(float) + plane[3]
    sure = np.abs(expected) > 1e-4
    np.testing.assert_array_equal(found[sure], np.where(expected > 0, 255, 0)[sure])
    assert set(found.ravel()) == {0, 255}


@pytest.mark.parametrize("given", [False, True])
def test_the_sums_of_a_step_are_those_of_its_formulas(given):
    u, n = np.arange(-4, 4.5, 0.5), 60
    x, blur = RNG.normal(0, 0.5, n), RNG.uniform(0.3, 3.5, n)
    x[0], blur[0] = -4, 0.3  # all but the first value far down one side
    values = 100 + 40 * erf((u - x[:, None] - 0.2) / 1.2) + RNG.normal(0, 2, (n, len(u)))
    half = RNG.uniform(30, 50, n) if given else np.full(n, np.nan)
    half_found = half.copy()
    found = LOOPS._step_sums(np.float32(u), np.float32(values), x, blur, half_found)

    distance = u - x[:, None]
    z = distance / blur[:, None]
    taper = np.exp(-0.5 * (distance / (1 + 1.5 * blur[:, None])) ** 2)
    taper /= taper.sum(axis=1, keepdims=True)

    def mean(values: np.ndarray) -> np.ndarray:
        return (taper * values).sum(axis=1, keepdims=True)

    step, slope = erf(z / np.sqrt(2)), np.exp(-0.5 * z**2)
    step, even, rest = step - mean(step), slope - mean(slope), values - mean(values)
    power = np.maximum(mean(step**2), 1e-6)
    expected_half = half[:, None] if given else mean(step * rest) / power
    rest = rest - expected_half * step
    odd = z * slope - step * mean(z * slope * step) / power
    sums = [even**2, even * rest, odd**2, odd * rest, rest**2, taper * even**2]
    np.testing.assert_allclose(half_found, expected_half[:, 0], rtol=3e-4, atol=1e-2)
    for got, of in zip(found, sums, strict=True):
        size = np.sqrt(mean(of**2))[:, 0]
        np.testing.assert_allclose(got, mean(of)[:, 0], rtol=5e-4, atol=2e-4 * size.max())

    # Neighbours share their blur and their noise; position and blur move by 1 and 0.6 px at most.
    singles = np.float32(u), np.float32(values)
    at, width, half_found = x.copy(), blur.copy(), half.copy()
    sigma = LOOPS.edge_step(*singles, at, width, half_found)
    sharpness = half_found * np.sqrt(2 / np.pi) / blur
    even_power, even_rest, odd_power, odd_rest, rest_power, spread = found.astype(float)
    even_power = np.maximum(even_power, 1e-6)
    pull, weight, noise = (
        uniform_filter1d(each, 41, mode="wrap")
        for each in (sharpness * odd_rest, sharpness**2 * odd_power, rest_power)
    )
    expected_sigma = np.sqrt((noise + 1 / 12) * spread) / np.abs(sharpness * even_power)
    np.testing.assert_allclose(sigma, expected_sigma, rtol=1e-5)
    move = np.clip(-even_rest / even_power / sharpness, -1, 1)
    np.testing.assert_allclose(at, np.clip(x + move, -4, 4), atol=1e-5)
    np.testing.assert_allclose(
        width, np.clip(blur - np.clip(pull / weight, -0.6, 0.6), 0.3, 3.5), atol=1e-5
    )
    assert (np.abs(move) == 1).any()
    at, width = np.zeros(n), np.full(n, 3.2)
    LOOPS.edge_step(*singles, at, width, half.copy())
    np.testing.assert_allclose(width, 3.2 - 0.6)


@pytest.mark.parametrize(("noise", "off", "contrast"), [(0, 0.015, 0.5), (20, 0.75, 10)])
def test_edges_are_found_by_all_profiles_alone_or_where_noise_is_high_by_their_neighbours_too(
    noise, off, contrast
):
    """A disc seen from 1 px outside of its edge; the root mean square of both errors."""
    y, x = np.mgrid[:200, :200] - 100
    image = 120 + 30 * erf((np.hypot(x, y) - 70) / (1.2 * np.sqrt(2)))
    image += np.random.default_rng(3).normal(0, noise, image.shape)
    angle = -np.arange(440) / 440 * 2 * np.pi
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    edge = subpixel.find_edges(np.uint8(np.rint(image).clip(0, 255)), 100 + 71 * out, out, 4.0)
    assert np.sqrt(np.mean((edge.offset + 1) ** 2)) < off
    assert np.sqrt(np.mean((edge.contrast - 60) ** 2)) < contrast


def test_an_outline_is_drawn_back_to_the_edge_of_its_mask_from_both_sides():
    mask = np.zeros((90, 90), np.uint8)
    mask[20:70, 20:70] = 255
    angle = -np.arange(200) / 200 * 2 * np.pi
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    middle = 44.5 + 25 * out / np.abs(out).max(axis=1, keepdims=True)  # the square itself
    side = (np.abs(out).min(axis=1) < 0.5)[:, None]
    off = np.where(np.arange(200) // 25 % 2, 2.0, -2.0)[:, None] * side
    found, moved = outline._kept_near(middle + off * out, mask)
    away = PIXEL_LOOPS.outside_by(for_loops(mask), found)
    assert np.abs(away[side[:, 0]]).max() < 0.81  # the chords turn where the offset jumps
    assert np.median(np.abs(moved[side[:, 0]] - 1.2)) < 0.1
    assert (moved[~side[:, 0]] < 0.3).all()


def test_an_outline_along_the_border_of_its_image_stays_there():
    mask = np.zeros((90, 90), np.uint8)
    mask[30:, :] = 255
    x, y = np.linspace(-0.5, 89.5, 91)[1:], np.linspace(29.5, 89.5, 61)[1:]
    bottom = np.column_stack([x[::-1], np.full(90, 89.5)])
    sides = [
        np.column_stack([np.full(60, side), rows]) for side, rows in ((89.5, y), (-0.5, y[::-1]))
    ]
    points = np.concatenate([np.column_stack([x, np.full(90, 29.5)]), sides[0], bottom, sides[1]])
    found, moved = outline._kept_near(points[::-1], mask)
    assert max(moved.max(), np.abs(found - points[::-1]).max()) < 0.3


def test_a_loop_before_one_loop_is_the_same_where_it_is_near_and_of_like_size():
    near, far, small = wavy(100), wavy(100) + 200, 300 + 0.1 * (wavy(100) - 300)
    assert match_loops([far, near], [near + 1]) == {0: 1}
    assert match_loops([near], [far, near + 1, small]) == {1: 0}
    assert match_loops([near], [far]) == match_loops([near, near], [near[::-1]]) == {}


@pytest.mark.parametrize(("n", "width"), [(50, 7), (50, 60), (51, 60), (3, 9), (1, 5)])
def test_a_mean_runs_around_the_loop(n, width):
    values = RNG.normal(0, 1, (n, 2))
    reach = min(width | 1, (n - 1) | 1) // 2
    expected = np.mean([np.roll(values, k, axis=0) for k in range(-reach, reach + 1)], axis=0)
    np.testing.assert_allclose(along(values, width), expected, atol=1e-12)
    np.testing.assert_allclose(along(values[:, 0], width), expected[:, 0], atol=1e-12)


@pytest.mark.parametrize(("n", "width"), [(50, 1), (50, 6), (50, 7), (5, 7), (1, 3)])
def test_the_largest_around_the_loop_is_scipys(n, width):
    values = RNG.normal(0, 1, n)
    expected = maximum_filter1d(values, width, mode="wrap")
    np.testing.assert_array_equal(largest(values, width), expected)
    np.testing.assert_array_equal(largest(values > 0.5, width), expected > 0.5)


def test_a_first_guess_is_the_middle_of_the_steepest_part():
    u, n = np.arange(-4, 4.5, 0.5, dtype=np.float32), 40
    values = RNG.normal(100, 5, (n, len(u))).astype(np.float32)
    values[:, 10:] += 80 * RNG.uniform(0.2, 1, (n, 1)).astype(np.float32)
    rise = np.maximum(uniform_filter1d(values[:, 2:] - values[:, :-2], 5, axis=0, mode="wrap"), 0)
    power = (rise * np.exp(-0.5 * (u[1:-1] / 2.4) ** 2)) ** 3
    expected = (power * u[1:-1]).sum(axis=1) / power.sum(axis=1)
    found = subpixel._steepest(u, values)
    np.testing.assert_allclose(found, expected, atol=1e-4)
    np.testing.assert_allclose(found, 0.75, atol=0.3)
    np.testing.assert_array_equal(subpixel._steepest(u, np.zeros_like(values)), np.zeros(n))


@pytest.mark.parametrize("n", [1, 2, 7, 8])
def test_the_median_is_numpys(n):
    values = RNG.normal(0, 1, (n, 3))
    assert median(values) == np.median(values)
    assert median(values[:, 0]) == np.median(values[:, 0])


def test_warming_up_compiles_what_contours_need():
    """In a process of its own, for that of the tests has seen images of other kinds."""
    code = """if True:
        import numpy as np
        from numba.core.dispatcher import Dispatcher
        from occ_recon_ros.geometry.compiled import compiled
        from occ_recon_ros.imaging import ContourSettings, ContourTracker
        from occ_recon_ros.imaging.warming import warm_up
        from occ_recon_ros.scene import make_object, render, turntable_cameras

        def signatures():
            loops = vars(compiled("imaging.kernels")) | vars(compiled("imaging.pixel_kernels"))
            asked = [k for k in loops if isinstance(loops[k], Dispatcher) and k[0] != "_"]
            return {k: len(loops[k].signatures) for k in asked}

        warm_up()
        before = signatures()
        camera = turntable_cameras()[0]
        image = render(make_object("vase"), camera)
        message = np.frombuffer(image.tobytes(), np.uint8).reshape(image.shape)
        for given in (message, np.stack([image] * 3, axis=2)):
            for mask in (None, np.uint8(255) * (image < 100)):
                for tracking in ("none", "snake"):
                    tracker = ContourTracker(ContourSettings(tracking=tracking))
                    for k in range(2):
                        tracker.process(given, camera, k, "object", mask)
        print({*before.values()}, before == signatures())
    """
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.split() == ["{1}", "True"]
