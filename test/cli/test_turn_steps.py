"""The steps of a turn without a board: even, or told by names, and what is said of them."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from turned import RIG, VIEWS, images_of

from occ_recon_ros.bags import turn_scanning
from occ_recon_ros.bags.photographs import open_pictures
from occ_recon_ros.bags.turn_scanning import find_turn
from occ_recon_ros.cli.turn_scan import Told
from occ_recon_ros.errors import UserError
from occ_recon_ros.poses.camera_yaml import camera_to_yaml
from occ_recon_ros.scene import make_object, render, turntable_cameras


@pytest.fixture
def lens(tmp_path):
    """A file that tells the lens: without it is found as well, in twice the time."""
    file = tmp_path / "camera.yaml"
    file.write_text(camera_to_yaml(turntable_cameras(RIG)[0]))
    return file


@pytest.mark.slow
def test_of_a_photograph_taken_twice_one_is_used(tmp_path, lens) -> None:
    images = images_of(360.0, 12)
    images.insert(5, images[4])
    for k, image in enumerate(images):
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
    found = find_turn(open_pictures(str(tmp_path)), lens, None, 360.0, 1.0, lambda *_: None)
    assert found.names == [f"{k}.png" for k in range(13) if k != 5]
    assert found.axis.elevation_deg == pytest.approx(20, abs=0.5)
    assert found.report["turned_deg"] == pytest.approx(330)


def test_a_whole_turn_may_end_with_the_first_image_again(tmp_path, lens) -> None:
    images = images_of(360.0, 12)
    seen_again = images[0] + np.random.default_rng(0).normal(0, 2, images[0].shape)
    for k, image in enumerate([*images, np.clip(seen_again, 0, 255).astype(np.uint8)]):
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
    found = find_turn(open_pictures(str(tmp_path)), lens, None, 360.0, 1.0, lambda *_: None)
    assert found.report["step_deg"] == pytest.approx(30)
    assert found.report["turned_deg"] == pytest.approx(330)
    assert found.left_out == {"12.png": "like the first image: the turn was over"}


@pytest.mark.slow
@pytest.mark.parametrize("told_deg", [210.0, 240.0])
def test_less_than_a_turn_may_be_told_from_the_first_image_to_the_last(
    tmp_path, lens, told_deg
) -> None:
    for k, image in enumerate(images_of(360.0, 12)[:8]):  # 30 degrees from each to the next
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
    found = find_turn(open_pictures(str(tmp_path)), lens, None, told_deg, 1.0, lambda *_: None)
    assert found.report["step_deg"] == pytest.approx(30)
    assert found.report["turned_deg"] == pytest.approx(210)
    assert found.axis.elevation_deg == pytest.approx(20, abs=0.5)
    said = "\n".join(found.lines)
    assert "30.00 degrees from image to image" in said
    assert ("from the first image to the last" in said) == (told_deg == 210.0)


@pytest.mark.slow
@pytest.mark.parametrize("again", [0, 3])
def test_where_photographs_were_deleted_their_numbers_are_the_steps(tmp_path, lens, again) -> None:
    images = images_of(360.0, 16)
    gone = (4, 9, 10)
    for k, image in enumerate([*images, *images[:again]]):  # more than the turn, where again
        if k not in gone:
            cv2.imwrite(str(tmp_path / f"DSC_{98 + k:04d}.png"), image)
    found = find_turn(open_pictures(str(tmp_path)), lens, None, 360.0, 1.0, lambda *_: None)
    assert found.axis.elevation_deg == pytest.approx(20, abs=0.5)
    assert found.report["step_deg"] == pytest.approx(22.5)
    said = "\n".join(found.lines)
    assert "the names lack 0102, 0107, 0108: numbers are taken for steps" in said
    over = "DSC_0114.png is the first image again: the turn is taken to end there" in said
    assert over == bool(again)
    assert found.report["notes"] == list(found.said)


@pytest.mark.slow
def test_where_the_last_photographs_are_gone_too_the_turn_is_found(tmp_path, lens) -> None:
    for k, image in enumerate(images_of(360.0, 24)[:-4]):
        if k not in (4, 9, 10):
            cv2.imwrite(str(tmp_path / f"DSC_{98 + k:04d}.png"), image)
    found = find_turn(open_pictures(str(tmp_path)), lens, None, 360.0, 1.0, lambda *_: None)
    assert found.report["step_deg"] == pytest.approx(15, abs=0.3)
    assert found.report["turned_deg"] == pytest.approx(19 * 15, abs=5)
    said = "\n".join(found.lines)
    assert "how far the table turned in all is found too" in said
    assert "--turn 360 in" not in said


def test_numbers_that_are_missing_are_said_where_no_steps_fit(tmp_path, lens, monkeypatch) -> None:
    for k, image in enumerate(images_of(360.0, 12)):
        if k != 5:
            cv2.imwrite(str(tmp_path / f"{k:02d}.png"), image)

    def refuse(*_) -> None:
        raise ValueError("the outlines fit no turn. In equal steps?")

    monkeypatch.setattr(turn_scanning, "_axis_of", refuse)
    with pytest.raises(
        UserError, match="Of the numbers the names lack 05: with these for steps they fit no turn"
    ):
        find_turn(open_pictures(str(tmp_path)), lens, None, 360.0, 1.0, lambda *_: None)


def told(uneven="", **refinement):
    """What is told of a turn whose poses were corrected so."""
    axis = SimpleNamespace(uneven=uneven, fits_px=0.4)
    report = {"turn_deg": 340.0, "warnings": [uneven] if uneven else []}
    found = SimpleNamespace(names=(), report=report, axis=axis)
    step = Told(found, SimpleNamespace(report={"corrected": [], **refinement}))
    assert step(None, None).cameras is None
    return step.report["warnings"]


@pytest.mark.parametrize(("off_deg", "doubts"), [(0.5, 0), (6.0, 1)])
def test_steps_that_turn_out_to_be_others_are_a_doubt(off_deg, doubts) -> None:
    assert len(told(steps_deg=np.linspace(-off_deg, off_deg, VIEWS).tolist())) == doubts


@pytest.mark.parametrize(
    ("corrected", "after_px", "doubts"),
    [
        (["each"], 0.2, []),
        (["each"], 0.9, ["fits to 1.3 px only, and with corrected poses to 0.9 px"]),
        ([], 0.2, ["fits to 1.3 px only"]),
    ],
)
def test_steps_that_the_correction_mends_are_no_doubt(corrected, after_px, doubts) -> None:
    assert told("fits to 1.3 px only", corrected=corrected, after_px=after_px) == doubts


def test_a_turn_that_starts_and_stops_slowly_is_named_where_no_equal_steps_fit(
    tmp_path, lens, monkeypatch
) -> None:
    camera = turntable_cameras(replace(RIG, frames=1))[0]
    for k, share in enumerate(0.5 - 0.5 * np.cos(np.pi * np.arange(16) / 16)):
        about = Rotation.from_rotvec([0, 0, 2 * np.pi * share]).as_matrix()
        turned = replace(camera, R_camera_object=camera.R_camera_object @ about)
        cv2.imwrite(str(tmp_path / f"{k}.png"), render(make_object("gourd"), turned))

    def refuse(*_) -> None:
        raise ValueError("the outlines fit no turn. In equal steps?")

    monkeypatch.setattr(turn_scanning, "_axis_of", refuse)
    with pytest.raises(UserError, match="starts and stops slowly") as said:
        find_turn(open_pictures(str(tmp_path)), lens, None, 360.0, 1.0, lambda *_: None)
    assert f"{tmp_path.name}: the outlines fit no turn. In equal steps? The" in str(said.value)
    assert "Left out: 1.png (like the image before: the table stood still); 15" in str(said.value)


@pytest.mark.parametrize("empty", [2, 4])
def test_images_of_the_empty_table_at_the_end_are_named(tmp_path, empty):
    images = images_of(360.0, 12)
    other = np.full_like(images[0], images[0][0, 0])
    cv2.circle(other, (30, other.shape[0] - 25), 18, 255 - int(other[0, 0]), -1)
    for k, image in enumerate([*images[: 12 - empty], *[other] * empty]):
        cv2.imwrite(str(tmp_path / f"{k:02d}.png"), image)
    with pytest.raises(UserError) as told:
        find_turn(open_pictures(str(tmp_path)), None, None, 360.0, 1.0, lambda *_: None)
    words = f"{12 - empty:02d}.png and the {empty - 1} images behind it are alike: if they do not"
    assert (words in str(told.value)) == (empty > 2)
