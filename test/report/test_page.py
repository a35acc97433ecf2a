"""report.html: one file, the surface in it to be turned."""

import base64
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from occ_recon_ros.report.page import write_page
from occ_recon_ros.report.solid import MOST_TRIANGLES, Solid, error_colours, pack, thinned
from occ_recon_ros.scene import TurntableSettings, turntable_cameras

sys.path.insert(0, str(Path(__file__).parents[1]))
from browser import visit

STATUS = ("good", "double", "ill_conditioned", "no_correspondent", "outside", "motion_along_ray")
NO_TIMES = {"count": 0}
CAMERA = turntable_cameras(TurntableSettings())[0]


def a_report(**more):
    """What a run of twelve frames would have in report.json."""
    frames = [
        {
            "stamp_ns": k,
            "angle_deg": 30.0 * k,
            "loops": 1,
            "samples": 100,
            "by_status": dict.fromkeys(STATUS, 0) | {"good": 100 - 5 * k, "outside": 5 * k},
        }
        for k in range(12)
    ]
    return {
        "command": "replay",
        "source": {
            "name": "cup </script><b>.mcap",
            "topics": {"/cam": "/image"},
            "messages": {"/cam": 14},
            "lost": "",
        },
        "frames": {"images": 14, "contours": 12, "rims": 12, "unanswered_stamps_ns": [1, 2]},
        "samples": {"total": 1200, "fraction_good": 0.7},
        "drops": {"contour_tracker": {"no_pose": 2}},
        "turn": {"covered_deg": 330.0, "mean_step_deg": 30.0, "closed": False},
        "per_frame": frames,
        "mesh": {"triangles": 1280, "size_m": [0.1, 0.1, 0.2]},
        "closed": {"reason": "the turn is not closed"},
        "verdict": {"word": "failed", "reasons": ["no turn"], "advice": [], "notes": []},
        "stages_ms": {"mesher": {"strip": NO_TIMES}},
        "decode_to_strip_ms": NO_TIMES,
        "wall_time_s": 3.0,
        "versions": {"python": "3"},
        **more,
    }


def a_body(subdivisions=4):
    """A dumb-bell that looks another way from every side, its ends of different size."""
    mesh = trimesh.creation.icosphere(subdivisions, radius=0.05)
    mesh.vertices *= [2.0, 1.0, 0.5]
    mesh.vertices[:, 1] += 0.4 * mesh.vertices[:, 0]
    return mesh


@pytest.fixture
def page(tmp_path):
    def write(report=None, **more):
        path = tmp_path / "report.html"
        write_page(report or a_report(), [], path, **more)
        return path

    return write


@pytest.mark.parametrize(
    ("covered", "closed", "said", "in_ring"),
    [
        (330.0, False, ("330 degrees, not closed", "330 degrees, 30.00"), "330°"),
        (
            624.0,
            True,
            ("360 degrees (the turn is closed", "360 degrees (the turn is closed"),
            "360°",
        ),
    ],
)
def test_no_view_is_said_to_be_farther_than_all_around(page, covered, closed, said, in_ring):
    turn = {"covered_deg": covered, "mean_step_deg": 30.0, "closed": closed}
    text = page(a_report(turn=turn)).read_text(encoding="utf-8")
    assert all(words in text for words in said)
    assert f">{in_ring}</text>" in text
    assert "624" not in re.sub(r"<script.*?</script>", "", text, flags=re.S)


def dark(visit):
    """Where in the window the body is."""
    box = visit.page.locator("#solid").bounding_box()
    x, y, w, h = (int(box[k]) for k in ("x", "y", "width", "height"))
    return visit.pixels()[y + 2 : y + h - 2, x + 2 : x + w - 2].astype(int).sum(axis=2) < 720


def changed(visit, before):
    return (dark(visit) != before).sum()


def blue_and_red(visit):
    """How many pixels are of either colour."""
    rest = visit.pixels()[..., ::2].astype(int) @ [1, -1]
    return (rest < -60).sum(), (rest > 60).sum()


def test_the_body_turns_zooms_and_shows_its_error(page):
    mesh = a_body()
    solid = Solid("closed surface", mesh, 1e-3 * np.asarray(mesh.vertices)[:, 0])
    path = page(solids=[solid, Solid("strips", a_body(2))], camera=CAMERA)
    with visit(path.as_uri(), size=(1100, 1000)) as there:
        there.wait_for(lambda: dark(there).sum() > 2000, "the body")
        before = dark(there)
        box = there.page.locator("#solid").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        there.page.mouse.move(x, y)
        there.page.mouse.down()
        there.page.mouse.move(x + 150, y + 40, steps=4)
        there.page.mouse.up()
        there.wait_for(lambda: changed(there, before) > 0.1 * before.sum(), "the turn")
        turned = dark(there).sum()
        there.page.mouse.wheel(0, -300)
        there.wait_for(lambda: dark(there).sum() > 1.5 * turned, "the body from near")
        there.page.locator("#solid").dblclick()
        there.wait_for(lambda: changed(there, before) < 0.02 * before.sum(), "the first view")
        there.page.get_by_role("button", name="error").click()
        there.wait_for(lambda: min(blue_and_red(there)) > 500, "the error")
        caption = there.page.locator("#solid-caption")
        there.wait_for(lambda: "red: outside" in caption.inner_text(), "what red means")
        there.page.get_by_role("button", name="strips").click()
        there.wait_for(lambda: "320 triangles" in caption.inner_text(), "the strips")
        assert there.requests == [path.as_uri()]
        assert not there.errors
        assert len(there.page.pdf()) > 10_000  # and it can be printed


def test_names_are_text_and_nothing_is_fetched(page):
    html = page(solids=[Solid("</script>", a_body(1))]).read_text(encoding="utf-8")
    assert "cup &lt;/script&gt;" in html
    assert html.count("</script>") == 2
    assert not re.search(r"(src|href)=[\"']?(?!data:)", html)
    assert "http" not in re.sub(r"\"[A-Za-z0-9+/=]{200,}\"", "", html)


def test_what_was_dropped_and_why_is_told(page):
    html = page().read_text(encoding="utf-8")
    assert "<td>dropped by contour_tracker</td><td>2: no_pose</td>" in html
    assert "<td>topic /cam as /image</td><td>14 messages</td>" in html
    assert "nothing came of 2 images" in html
    assert html.count("<circle cx") == 12


def test_the_verdict_comes_first(page):
    verdict = {
        "word": "doubtful",
        "reasons": ["41 % of the samples are good"],
        "advice": ["use more views & a <plain> background"],
        "notes": [],
    }
    html = page(a_report(verdict=verdict)).read_text(encoding="utf-8")
    assert '<div class="verdict doubtful"><b>doubtful</b>' in html
    assert html.index("41 % of the samples") < html.index("<h2>")
    assert "more views &amp; a &lt;plain&gt; background" in html


def test_large_surfaces_keep_the_page_small(page):
    mesh = a_body(7)  # 330,000 triangles: a page of 19 MB, were none left out
    mesh.visual.vertex_colors = np.full((len(mesh.vertices), 4), 200, np.uint8)
    error = np.asarray(mesh.vertices)[:, 0]
    path = page(solids=[Solid("closed", mesh, error), Solid("strips", mesh, error)])
    assert path.stat().st_size < 13e6


def test_thinned_surfaces_are_the_same_surface():
    mesh = a_body(6)
    rows, faces = thinned(np.asarray(mesh.vertices), np.asarray(mesh.faces), 8000)
    thin = trimesh.Trimesh(mesh.vertices[rows], faces, process=False)
    assert 2000 < len(faces) <= 8000
    assert thin.volume == pytest.approx(mesh.volume, rel=0.1)
    assert thin.area == pytest.approx(mesh.area, rel=0.1)
    outward = (thin.face_normals * thin.triangles_center).sum(axis=1)
    assert (outward > 0).mean() > 0.99


def test_surfaces_keep_their_place_in_sixteen_bits():
    mesh = a_body(3)
    packed = pack(Solid("x", mesh))
    assert packed["triangles"] == packed["shown"] == len(mesh.faces) < MOST_TRIANGLES
    q = np.frombuffer(base64.b64decode(packed["position"]), "<u2").reshape(-1, 4)[:, :3]
    back = np.array(packed["low"]) + q / 65535 * packed["size"]
    np.testing.assert_allclose(np.sort(back, axis=0), np.sort(mesh.vertices, axis=0), atol=2e-6)


def test_errors_are_blue_inside_and_red_outside():
    colours = error_colours(np.array([-1.0, 0.0, 1.0, np.nan, 9.0]), 1.0)[:, :3].astype(int)
    assert colours[0, 2] > colours[0, 0] + 100
    assert (colours[1] == 247).all()
    assert colours[2, 0] > colours[2, 2] + 100
    assert (colours[3] == 247).all()
    assert (colours[4] == colours[2]).all()


def test_what_was_done_before_the_first_frame_is_told(page):
    source = a_report()["source"]
    corrected = {"before_px": 1.31, "after_px": 0.42, "corrected": ["common", "steps"]}
    more = {"segmentation": {"way": "joint"}, "refinement": corrected}
    html = page(a_report(source={**source, **more})).read_text(encoding="utf-8")
    assert "<td>Masks</td><td>found in all views together</td>" in html
    assert "1.31 px apart (1 sigma), now 0.42: corrected common, steps" in html
    more = {"segmentation": {"way": "single"}, "refinement": {**corrected, "corrected": []}}
    more["topics"] = {**source["topics"], "/m": "/mask"}
    html = page(a_report(source={**source, **more})).read_text(encoding="utf-8")
    assert "<td>Masks</td><td>as recorded</td>" in html
    assert "as recorded; two views were 1.31 px apart" in html


def test_a_good_result_says_what_that_means(page):
    good = {"word": "good", "reasons": [], "advice": [], "notes": ["a roof & a tail"]}
    html = page(a_report(verdict=good)).read_text(encoding="utf-8")
    assert "nothing is amiss" in html
    assert "<p>Note: a roof &amp; a tail</p>" in html
    doubt = good | {"word": "doubtful", "reasons": ["two views differ"]}
    assert "nothing is amiss" not in page(a_report(verdict=doubt)).read_text(encoding="utf-8")
