"""import: what is said of calibrations that are doubtful, and of single ones that are none."""

import json

import pytest
from colmap_nerf import N, turn, write_images, write_transforms


@pytest.fixture
def said(command, tmp_path):
    """What import says of a transforms.json with these values, and of one frame with others."""

    def ask(one=None, **all_):
        write_images(tmp_path / "images")
        write_transforms(tmp_path, turn(), **all_)
        content = json.loads((tmp_path / "transforms.json").read_text())
        content["frames"][3].update(one or {})
        (tmp_path / "transforms.json").write_text(json.dumps(content))
        code, out, err = command("import", tmp_path, tmp_path / "a.mcap", "--overwrite")
        assert (code, err) == (0, "")
        return out

    return ask


def test_pixels_that_are_not_square_are_remarked(said):
    assert "square" not in said(fl_x=130, fl_y=145)
    assert f"of {N} images the pixels are not square (fy is 1.54 times fx)" in said(
        fl_x=130, fl_y=200
    )


def test_corners_that_fold_are_remarked(said):
    assert "folds" not in said(k1=-0.4, fl_x=130, fl_y=130)
    out = said(k1=-0.4, fl_x=90, fl_y=90)
    assert "towards the corners the distortion folds back, up to" in out
    assert "left out" not in out


def test_one_calibration_that_is_none_is_left_out(said):
    out = said({"k1": 46.6, "k2": -3690})
    assert out.count("left out: ") == 1
    assert "are of no lens: the distortion folds back within the image" in out
