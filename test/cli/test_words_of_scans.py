"""What a scan says on the terminal, of its size and of what was doubtful before it was played."""

from dataclasses import replace

import numpy as np
import pytest

from occ_recon_ros.cli import boards, scan
from occ_recon_ros.cli.refining import refinement_lines
from occ_recon_ros.evaluation.refinement import not_taken
from occ_recon_ros.poses.refine_trials import NEEDLESS, Trial


def report(size_m, **more):
    return {
        "frames": {"images": 9, "contours": 9, "rims": 9, "unanswered_stamps_ns": []},
        "samples": {"fraction_good": 0.5, "total": 100},
        "mesh": {"triangles": 7, "size_m": size_m},
        "turn": {"closed": True, "covered_deg": 360.0},
        "per_frame": [{"angle_deg": float(a)} for a in range(0, 360, 40)],
        "decode_to_strip_ms": {},
        "source": {},
        "verdict": {"word": "good", "reasons": [], "advice": []},
        "drops": {},
        **more,
    }


@pytest.mark.parametrize(
    ("size_m", "said", "doubted"),
    [
        ([0.0995, 0.1313, 0.779], "99.5 x 131.3 x 779 mm", False),
        ([0.0995, 0.1313, 1.579], "0.0995 x 0.1313 x 1.579 m", False),
        ([44.04, 79.9, 79.91], "44.04 x 79.9 x 79.91 m", True),
        ([4.404e-5, 8e-5, 7.991e-5], "44.04 x 80 x 79.91 um", True),
        ([0.0006, 0.002, 0.001], "0.6 x 2 x 1 mm", False),
    ],
)
def test_a_scan_says_how_large_the_body_is(size_m, said, doubted):
    lines = scan.headline(report(size_m))
    assert lines[0].endswith(f"7 triangles, {said}")
    assert any("may be in another unit" in line for line in lines) == doubted


TABLE = np.arange(0, 720, 10)
BY_HAND = np.cumsum(np.resize([80, -50], 60))


@pytest.mark.parametrize(
    ("angles", "covered", "closed", "said"),
    [
        (TABLE[:36], 360, True, "360 degrees (the turn is closed), 7"),
        (TABLE[:37], 366, True, "360 degrees (the turn is closed), 7"),
        (TABLE[:40], 396, True, "360 degrees (the turn is closed, gone around 1.1 times), 7"),
        (-TABLE, 710, False, "360 degrees (gone around 2.0 times), 7"),
        (TABLE[:20], 190, False, "190 degrees, 7"),
        (BY_HAND, 920, True, "360 degrees (the turn is closed), 7"),
    ],
)
def test_a_scan_covers_no_more_than_all_around_and_counts_the_turns_of_a_table(
    angles, covered, closed, said
):
    turn = {"closed": closed, "covered_deg": float(covered)}
    frames = [{"angle_deg": float(angle % 360)} for angle in angles]
    lines = scan.headline(report([0.1, 0.1, 0.1], turn=turn, per_frame=frames))
    assert f"9 rims over {said} triangles" in lines[0]


def test_a_scan_without_a_surface_says_what_was_doubtful_before_it_was_played():
    said = scan._doubts(
        {
            "segmentation": {"single_images": ["they contradict"], "warnings": ["no masks"]},
            "refinement": {"warnings": ["rotations seem to be transposed"]},
        }
    )
    expected = ["images one by one: they contradict", "no masks", "rotations seem to be transposed"]
    assert said == expected
    assert scan._doubts({"topics": {}}) == []


def test_a_scan_says_what_of_its_poses_was_corrected():
    poses = {"corrected": ["common", "views"], "before_px": 0.42, "after_px": 0.01}
    lines = scan.headline(report([0.1, 0.1, 0.1], source={"refinement": poses}))
    assert any(
        "the poses as a whole, each pose; two views were 0.42 px apart (1 sigma), now 0.01" in line
        for line in lines
    )
    assert any("--no-refine leaves them" in line for line in lines)
    for photographs in ("turn", "board"):  # for which scan has no such option
        source = {"refinement": poses, photographs: {}}
        lines = scan.headline(report([0.1, 0.1, 0.1], source=source))
        assert any("the poses as a whole, each pose" in line for line in lines)
        assert not any("--no-refine" in line for line in lines)
    event = {"what": "object", "before_view": 10, "deg": 7.1, "mm": 0.2}
    lines = scan.headline(
        report([0.1, 0.1, 0.1], source={"refinement": {**poses, "moved": [event]}})
    )
    (line,) = (line for line in lines if "moved before view 10" in line)
    assert "0.42 px" not in line  # nearly all pairs agree all the same: that would belittle it
    assert "two views are now 0.01 px apart" in line
    poses["corrected"] = []
    lines = scan.headline(report([0.1, 0.1, 0.1], source={"refinement": poses}))
    assert not any("corrected" in line for line in lines)


def test_a_view_that_is_bad_is_named_by_its_image_where_that_is_known():
    source = {"segmentation": {"bad_views": {1: "left out"}}}
    assert "view 1: left out" in scan.headline(report([0.1, 0.1, 0.1], source=source))
    source["images"] = [{"name": "IMG_7.jpg"}, {"name": "IMG_9.jpg"}]
    lines = scan.headline(report([0.1, 0.1, 0.1], source=source))
    assert "view 1 (IMG_9.jpg): left out" in lines


def trial(*groups, px=0.1, gain=3.0, refused=""):
    row = {"groups": list(groups), "left_out_px": px, "gain_in_standard_errors": gain}
    return row | {"better": not refused, "refused": refused}


def test_refine_says_why_a_correction_that_gains_is_not_taken():
    beyond = "beyond what a lens may be off by: fy / fx, 5.7 times as far as usual"
    tried = [trial(), trial("common", "lens", gain=6.3, refused=beyond)]
    found = {"corrected": [], "before_px": 0.42, "after_px": 0.42, "tried": tried}
    lines = refinement_lines(found | {"not_determined": []})
    assert lines[0].endswith("no correction explains views that were left out")
    assert lines[-1].endswith(f"+6.3 standard errors; not taken: {beyond}")
    tried[1]["refused"] = NEEDLESS
    assert refinement_lines(found | {"not_determined": []})[0].endswith(NEEDLESS)


def test_a_clear_gain_that_is_not_taken_is_told():
    def tried(*groups, px, gain, refused=NEEDLESS):
        return Trial(groups, px, gain, refused=refused)

    given = Trial((), 0.114, better=True)
    steps = tried("common", "steps", px=0.058, gain=4.6)
    words = not_taken([given, tried("common", px=0.094, gain=3.4), steps])
    assert words.startswith("other steps of the table would fit better (0.11 px to 0.06, by 4.6")
    focal = tried("common", "focal", px=0.059, gain=3.4)
    assert not_taken([given, focal, steps]).startswith("another focal length")
    assert not_taken([given, replace(steps, gain=2.1), replace(focal, refused="chance")]) == ""
    assert not_taken([]) == ""


def test_notes_stand_under_the_verdict():
    verdict = {"word": "good", "reasons": [], "advice": [], "notes": ["a roof"]}
    lines = scan.headline(report([0.1, 0.1, 0.1], verdict=verdict))
    assert lines[lines.index("verdict: good") + 1] == "  note: a roof"


def test_a_chessboard_for_calibration_alone_is_printed_and_says_so(tmp_path, capsys):
    boards.board(tmp_path / "board.pdf", kind="chessboard", columns=9, rows=7, square=20.0)
    assert "serves 'occ-recon calibrate intrinsics' but tells no pose" in capsys.readouterr().out
