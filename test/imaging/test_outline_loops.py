"""The compiled loops of outlines against closed forms, SciPy and the plainest form in NumPy."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.sparse import diags_array
from scipy.sparse.linalg import spsolve

from occ_recon_ros.imaging.curves import curvature, normals, resample
from occ_recon_ros.imaging.smooth import smooth_closed

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
            loops = vars(compiled("imaging.kernels"))
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
