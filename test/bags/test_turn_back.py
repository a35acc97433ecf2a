"""Photographs of a table that went back, and what looks like it and is none."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from turned import RIG, images_of

from occ_recon_ros.bags import turn_outlines
from occ_recon_ros.bags.photographs import open_pictures
from occ_recon_ros.bags.turn_outlines import TurnOutlines, find_outlines
from occ_recon_ros.bags.turn_scanning import find_turn
from occ_recon_ros.bags.turn_steps import ALIKE, even_steps, steps_back
from occ_recon_ros.poses.camera_yaml import camera_to_yaml
from occ_recon_ros.scene import turntable_cameras

TURN = list(range(24))
ROUND = "like the first image: the turn was over"


def seen(places, shown=lambda angle: angle, unseen=1):
    """Views of a table at these of 24 places, which differ as what they show of angles does."""
    angle = 2 * np.pi * np.array(places) / 24
    there = np.exp(1j * shown(angle))
    apart = np.abs(there[:, None] - there)
    return TurnOutlines(
        camera=turntable_cameras(RIG)[0],
        focal_sigma=0.0,
        names=[f"{k}.png" for k in range(len(places))],
        contours=[],
        numbers=list(range(len(places))),
        apart=np.stack([apart, apart], axis=2).astype(np.float32),
        images=len(places) + unseen - 1,
        unseen=unseen,
        masks={},
        left_out={},
    )


@pytest.mark.parametrize("by", [1, 2, 5])
def test_a_table_that_goes_back_at_the_end_is_recognised(by) -> None:
    steps = steps_back(seen(TURN + TURN[-2 : -2 - by : -1]), whole=True)
    assert steps is not None
    assert steps.rows.tolist() == TURN
    assert steps.turned.tolist() == TURN
    assert steps.count == 24
    assert steps.back == "24.png"
    assert steps.left_out == {
        f"{24 + k}.png": f"the table had gone back: as {22 - k}.png" for k in range(by)
    }


def test_a_table_that_goes_back_and_on_again_goes_on_where_it_was() -> None:
    steps = steps_back(seen([*TURN[:12], 10, 9, 10, 11, *TURN[12:]]), whole=True)
    assert steps is not None
    assert steps.turned.tolist() == TURN
    assert steps.count == 24
    assert list(steps.left_out) == ["12.png", "13.png", "14.png", "15.png"]


def test_empty_images_behind_a_table_that_went_back_are_no_steps() -> None:
    steps = steps_back(seen([*TURN, 0, 1, 1, 0], unseen=3), whole=True)
    assert steps is not None
    assert steps.count == 24
    assert steps.left_out == {
        "24.png": ROUND,
        "25.png": "the turn was over: as 1.png",
        "26.png": "the turn was over: as 1.png",
        "27.png": "the table had gone back: as 0.png",
    }


@pytest.mark.parametrize(
    "places",
    [
        TURN,
        [*TURN, 0, 1, 2],  # on beyond the first image
        [*TURN[:9], 8, *TURN[9:]],  # a pause
        [*TURN, *TURN],
    ],
)
def test_a_table_that_only_goes_on_has_not_gone_back(places) -> None:
    assert steps_back(seen(places), whole=True) is None


def test_what_looks_the_same_from_behind_has_not_gone_back() -> None:
    assert steps_back(seen(TURN, lambda angle: 2 * angle), whole=True) is None
    noise = np.random.default_rng(0).normal(1, 0.1, (24, 24, 2))  # all that a round one shows
    assert steps_back(replace(seen(TURN), apart=noise.astype(np.float32)), whole=True) is None


def test_of_one_that_is_like_the_first_image_it_is_not_said_that_the_table_stood_still() -> None:
    assert even_steps(seen([*TURN[:9], 8, *TURN[9:]]), True, False).left_out == {"9.png": ALIKE}
    places = [*TURN[:-1], 23.9, 0, 1, 2]
    assert even_steps(seen(places), True, False).left_out == {"24.png": ROUND}
    places = [*TURN[:9], 7.9, 8, *TURN[9:]]
    assert even_steps(seen(places), True, False).left_out == {
        "9.png": ALIKE,
        "10.png": "like 8.png: the table was there before",
    }


def test_photographs_of_one_place_are_alike_for_all_their_noise(tmp_path) -> None:
    images, rng = images_of(360.0, 12), np.random.default_rng(1)
    for k, image in enumerate([*images, images[10], images[7]]):
        noisy = np.clip(image + rng.normal(0, 3, image.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(tmp_path / f"{k}.png"), noisy)
    found = find_outlines(open_pictures(str(tmp_path)), None, None, lambda *_: None)
    steps = steps_back(found, whole=True)
    assert steps is not None
    assert list(steps.left_out.values()) == [
        "the table had gone back: as 10.png",
        "the table had gone back: as 7.png",
    ]
    beside = found.alike[np.arange(11), np.arange(1, 12)]
    assert (beside.max(axis=1) > turn_outlines._STILL).all()


@pytest.mark.slow
@pytest.mark.parametrize("back", [[10], [0, 1, 0], []])
def test_images_after_which_a_table_had_gone_back_are_left_out_by_name(tmp_path, back) -> None:
    lens = tmp_path / "camera.yaml"
    lens.write_text(camera_to_yaml(turntable_cameras(RIG)[0]))
    images = images_of(360.0, 12)
    for k, image in enumerate([*images, *(images[at] for at in back)]):
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
    found = find_turn(open_pictures(str(tmp_path)), lens, None, 360.0, 1.0, lambda *_: None)
    assert found.names == [f"{k}.png" for k in range(12)]
    assert found.report["step_deg"] == pytest.approx(30)
    assert found.axis.elevation_deg == pytest.approx(20, abs=0.5)
    said = "\n".join(found.lines)
    for at in back[-1:]:
        assert f"{11 + len(back)}.png: the table had gone back: as {at}.png" in said
    assert ("is the first image for which the table had gone back" in said) == bool(back)
