"""Whether corners that are not where they are printed are those of a sheet that curls."""

import numpy as np
import pytest
from scenes.standing import cameras_around

from occ_recon_ros.poses.sheet_shape import SheetView, sheet_shape


@pytest.mark.parametrize(("curl", "print_", "curled"), [(8e-4, 0.0, True), (0.0, 5e-5, False)])
def test_only_a_sheet_that_curls_is_called_curled(curl, print_, curled):
    # An exactly flat one was said to be curled: its corners were seen .05 mm beside their places.
    rng = np.random.default_rng(2)
    x, y = (k.ravel() for k in np.meshgrid(np.linspace(-0.1, 0.1, 8), np.linspace(-0.1, 0.1, 6)))
    flat = np.column_stack([x, y, 0 * x])
    real = flat + np.column_stack([*rng.normal(0, print_, (2, len(x))), curl * (x / 0.1) ** 2])
    views = []
    cameras = cameras_around(12, (1200, 900), 1500.0)
    for camera in cameras:
        uv = camera.project(real) + rng.normal(0, 0.05, (len(real), 2))
        views.append(SheetView(np.arange(len(flat)), uv, camera.pose))
    found = sheet_shape(cameras[0], flat, views)
    assert found.worth_it
    assert found.curled == curled
