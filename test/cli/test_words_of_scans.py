"""What a scan says on the terminal, of its size and of what was doubtful before it was played."""

from occ_recon_ros.cli import scan


def test_a_scan_says_how_large_the_body_is():
    report = {
        "frames": {"images": 9, "contours": 9, "rims": 9, "unanswered_stamps_ns": []},
        "samples": {"fraction_good": 0.5, "total": 100},
        "mesh": {"triangles": 7, "size_m": [0.0995, 0.1313, 1.579]},
        "turn": {"closed": True, "covered_deg": 360.0},
        "decode_to_strip_ms": {},
        "source": {},
        "verdict": {"word": "good", "reasons": [], "advice": []},
        "drops": {},
    }
    assert scan.headline(report)[0].endswith("7 triangles, 99.5 x 131.3 x 1579 mm")


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
