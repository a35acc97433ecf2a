"""The page of a running scan, in a browser."""

import http.client
import re
import sys
from contextlib import closing
from pathlib import Path

import pytest
import trimesh
from rig import STRIPS_ONLY, Rig, scan, views

sys.path.insert(0, str(Path(__file__).parents[1]))
from browser import visit

_PATIENCE = 20  # looks, and views sent


class Live:
    """The nodes and the viewer as programs, the rig in the test."""

    def __init__(self, ros, folder):
        self.ros = ros
        self.rig = ros.start(Rig)
        self.children = [ros.process(name) for name in ("contour_tracker", "reconstructor")]
        self.saved = folder / "vase" / "mesh.ply"
        parameters = {**STRIPS_ONLY, "output_dir": folder, "scan_name": "vase"}
        arguments = [a for k, v in parameters.items() for a in ("-p", f"{k}:={str(v).lower()}")]
        self.children.append(ros.process("mesher", *arguments))
        self.url = start_viewer(ros)
        wanted = {"contours": 4, "rim": 3, "strip": 2}  # all four, and the rig's own ears
        ros.spin_until(self.rig.ready, what="the graph")
        ros.spin_until(
            lambda: all(self.rig.count_subscribers(t) == n for t, n in wanted.items()),
            what="the viewer",
        )


def start_viewer(ros, *parameters):
    """Start a viewer; where its page is."""
    child = ros.process("viewer", "-p", "port:=0", *parameters)
    for line in child.stdout:
        if found := re.search(r"viewer: (http\S+)", line):
            return found[1]
    raise AssertionError("the viewer did not start")


def surface_pixels(visit):
    """How many pixels of the scene have the plain colour of surfaces: blue above red."""
    scene = visit.pixels()[100:, :350].astype(int)
    return int(((scene[..., 2] - scene[..., 0] > 12) & (scene.sum(axis=2) < 720)).sum())


@pytest.fixture
def live(ros, tmp_path):
    return Live(ros, tmp_path)


def send(live, first, last):
    """Frames of the turn, each when the one before has become contours."""
    second = 1_000_000_000
    for k in range(first, last):
        stamp = 100 * second + k * second // 10
        live.rig.send(views()[k], stamp)
        live.ros.spin_until(lambda s=stamp: s in live.rig.stamps("contours"), what="contours")


def frames_on(panel):
    """How many frames the panel tells of."""
    found = re.search(r"frames\t(\d+)", panel.inner_text())
    return int(found[1]) if found else 0


def heard_by(page, live, panel):
    """Send the first view until the page has heard it: that the rig sees the graph whole does not
    say that the tracker does. How often it was heard."""
    for k in range(_PATIENCE):
        live.rig.send(views()[0], (60 + k) * 1_000_000_000)
        for _ in range(_PATIENCE):
            if frames := frames_on(panel):
                return frames
            page.page.wait_for_timeout(500)
    raise AssertionError("the page hears no contours")


def test_a_scan_is_seen_to_grow_and_obeys_the_buttons(live):
    with visit(live.url, scale=0.5) as page:
        state = page.page.locator("#scan-state")
        page.wait_for(lambda: state.inner_text() == "waiting", "the panel")
        panel = page.page.locator("#scan-panel")

        first = heard_by(page, live, panel)
        send(live, 0, 6)
        page.wait_for(lambda: surface_pixels(page) > 75, "the first strips")
        before = surface_pixels(page)
        send(live, 6, 12)
        page.wait_for(lambda: surface_pixels(page) > 1.3 * before, "more of the surface")
        # A busy machine may lose the viewer a few of the 12: nothing waits for it.
        page.wait_for(lambda: frames_on(panel) >= first + 6, "the number of frames")

        page.page.get_by_role("button", name="Pause").click()
        page.page.get_by_role("button", name="Go on").wait_for()
        page.wait_for(lambda: state.inner_text() == "paused", "the pause")
        live.rig.send(views()[12], 100_000_000_000 + 12 * 100_000_000)
        page.wait_for(lambda: "contour_tracker dropped" in panel.inner_text(), "the drop")
        page.page.get_by_role("button", name="Go on").click()
        page.page.get_by_role("button", name="Pause").wait_for()

        page.page.get_by_role("button", name="Save").click()
        page.wait_for(live.saved.exists, "the save")
        saved = trimesh.load_mesh(live.saved)
        for kind in ("PLY", "GLB", "STL"):
            with page.page.expect_download() as waiting:
                page.page.get_by_text(kind, exact=True).click()
            download = waiting.value
            assert download.suggested_filename == f"mesh.{kind.lower()}"
            path = live.saved.with_name(download.suggested_filename.replace("mesh", "page"))
            download.save_as(path)
            mesh = trimesh.load(path, force="mesh")
            assert mesh.area == pytest.approx(saved.area, rel=1e-4)

        page.page.get_by_role("button", name="Reset").click()
        page.page.get_by_role("button", name="Forget it").click()
        page.wait_for(lambda: frames_on(panel) == 0, "the reset")
        page.wait_for(lambda: surface_pixels(page) < before / 5, "an empty scene")
        # And the next scan is seen like the first.
        scan(live.ros, live.rig, views(), start_s=300, finish=False)
        page.wait_for(lambda: surface_pixels(page) > 75, "the next scan")
        page.page.get_by_role("button", name="Finish").click()
        page.wait_for(lambda: state.inner_text() == "turn closed", "the end")

        assert not page.strangers((live.url, live.url.replace("http", "ws")))
        assert not page.errors


@pytest.mark.slow
def test_who_comes_late_sees_the_whole_and_can_go_back(live):
    scan(live.ros, live.rig, views(), finish=False)
    with visit(live.url, scale=0.5) as page:
        seen = []

        def shown():
            seen.append(surface_pixels(page))
            return seen[-1]

        panel = page.page.locator("#scan-panel")

        # A busy machine may lose the viewer a few of the 18: nothing waits for it.
        page.wait_for(lambda: frames_on(panel) > 12, "most frames")
        page.wait_for(lambda: shown() > 250, "the surface")
        slider = page.page.get_by_role("slider").first
        slider.focus()
        for _ in range(12):
            slider.press("ArrowLeft")
        # Less than the most that was seen, whenever that was.
        page.wait_for(lambda: shown() < 0.75 * max(seen), "the past")
        past = seen[-1]
        slider.press("End")
        page.wait_for(lambda: shown() > 1.1 * past, "now")


def status_of(url, **headers):
    """The answer to a request, without its redirections."""
    parts = re.fullmatch(r"http://([^/]+)(/.*)", url)
    connection = http.client.HTTPConnection(parts[1], timeout=120)
    with closing(connection):
        connection.request("GET", parts[2], headers=headers)
        answer = connection.getresponse()
        with answer:
            return answer.status, dict(answer.getheaders())


_UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
}


@pytest.mark.slow
def test_a_page_for_others_asks_for_its_token(ros):
    url = start_viewer(ros, "-p", "host:=0.0.0.0")
    plain, _, token = url.partition("?token=")
    assert len(token) > 20
    assert status_of(plain)[0] == 401
    assert status_of(plain, **_UPGRADE)[0] == 401
    status, headers = status_of(url)
    assert (status, headers["Location"]) == (303, "/")
    cookie = headers["Set-Cookie"].split(";")[0]
    assert status_of(plain, Cookie=cookie)[0] == 200
    assert status_of(plain, Cookie=cookie, **_UPGRADE)[0] == 101
    assert status_of(plain, Cookie=cookie, Origin="http://evil.example", **_UPGRADE)[0] == 403
    with visit(url) as page:
        page.page.get_by_role("button", name="Pause").wait_for()


def test_a_page_for_this_host_is_for_this_host(ros):
    url = start_viewer(ros)
    assert url.startswith("http://127.0.0.1:")
    assert status_of(url)[0] == 200
    assert status_of(url, Host="evil.example")[0] == 403
    assert status_of(url, Origin="http://evil.example", **_UPGRADE)[0] == 403
    assert status_of(url + "..%2f..%2fsetup.py")[0] == 404


@pytest.mark.parametrize(
    ("parameter", "words"),
    [("host:=no.such.host.invalid", "host"), ("port:=70000", "port"), ("page_rate:=0.0", "page")],
)
def test_a_viewer_that_cannot_serve_says_why(ros, parameter, words):
    child = ros.process("viewer", "-p", parameter)
    out, _ = child.communicate(timeout=120)
    assert child.returncode == 2
    (line,) = [line for line in out.splitlines() if line.startswith("error:")]
    assert words in line
    assert "Traceback" not in out
