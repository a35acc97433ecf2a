"""A segmentation that cannot be is refused at the start, in words."""

import cv2
import numpy as np
import pytest

from occ_recon_ros.errors import SettingsError
from occ_recon_ros.nodes.contour_tracker import ContourTrackerNode


def test_background_without_a_source_is_refused(ros):
    with pytest.raises(SettingsError, match="set background_image, or background_frames"):
        ros.start(ContourTrackerNode, params={"segmentation": "background"})


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "cannot be read: No such file"), (b"no image", "is not an image"), (b"", "is not an")],
)
def test_a_background_that_is_no_image_is_refused(ros, tmp_path, capfd, content, words):
    path = tmp_path / "empty.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SettingsError, match=rf"empty\.png' {words}"):
        ros.start(ContourTrackerNode, params={"background_image": str(path)})
    assert "WARN" not in capfd.readouterr().err  # of OpenCV


def test_the_home_folder_may_be_written_short(ros, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((24, 32), 30, np.uint8))
    ros.start(ContourTrackerNode, params={"background_image": "~/empty.png"})


@pytest.mark.parametrize("frames", [0, 3])
def test_background_with_one_source_is_taken(ros, frames):
    wanted = "background" if frames else "auto"
    ros.start(ContourTrackerNode, params={"segmentation": wanted, "background_frames": frames})
