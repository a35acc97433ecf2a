"""A camera file whose lens is none is refused when it is read, not by each image."""

from dataclasses import replace

import numpy as np
import pytest

from occ_recon_ros.poses.camera_yaml import camera_to_yaml, read_camera
from occ_recon_ros.scene import TurntableSettings, turntable_cameras


@pytest.mark.parametrize(("k2", "folds"), [(0.05, False), (-3690.0, True)])
def test_a_camera_file_is_of_a_lens(tmp_path, k2, folds):
    camera = turntable_cameras(TurntableSettings(frames=3))[0]
    bent = replace(camera, D=np.array([-0.2, k2, 0, 0, 0]), distortion="plumb_bob")
    (tmp_path / "camera.yaml").write_text(camera_to_yaml(bent))
    if not folds:
        np.testing.assert_array_equal(read_camera(tmp_path / "camera.yaml").D, bent.D)
        return
    with pytest.raises(ValueError, match=r"camera.yaml: .* folds back within the image"):
        read_camera(tmp_path / "camera.yaml")
