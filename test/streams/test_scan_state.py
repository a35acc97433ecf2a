"""The state of a scan, and the end of a turn as the camera centres show it."""

from datetime import datetime

import numpy as np
import pytest

from occ_recon_ros.errors import SettingsError
from occ_recon_ros.streams.scan import Scan, ScanState, TurnWatch
from occ_recon_ros.streams.scan_files import Result, ScanFiles, check_name


def on_circle(angles, tilt=0.3):
    """Camera centres about an axis that is none of the coordinates'."""
    circle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    return circle @ turn.T + [0.1, -0.2, 0.7]


@pytest.mark.parametrize(("frames", "way"), [(8, 1), (8, -1), (36, -1), (360, 1), (1200, -1)])
def test_a_turn_closes_with_its_last_frame_and_not_before(frames, way):
    watch = TurnWatch()
    for k, centre in enumerate(on_circle(way * 2 * np.pi * np.arange(frames) / frames)):
        assert not watch.closed, k
        watch.add(centre)
        # Where centres are thinned out, their step is the coarser one.
        if k < frames - max(1, frames // 300):
            assert not watch.closed, k
        elif watch.closed:
            break
    assert watch.closed
    assert watch.angle == pytest.approx(2 * np.pi)


def test_an_arc_to_and_fro_is_no_turn():
    watch = TurnWatch()
    for centre in on_circle(2.5 * np.sin(np.linspace(0, 10 * np.pi, 1200))):
        watch.add(centre)
    assert not watch.closed
    assert watch.angle == pytest.approx(5.0, abs=0.05)


def test_a_table_that_goes_on_is_past_the_seam_after_twenty_degrees():
    watch, passed = TurnWatch(), []
    for centre in on_circle(np.radians(np.arange(0, 420, 2.0))):
        watch.add(centre)
        passed.append(watch.passed)
    first = 2 * passed.index(True)
    assert 375 < first < 390


HOLED = [*range(0, 120, 10), *range(240, 360, 10)]


def test_a_turn_with_a_hole_ends_where_it_began_and_is_closed_when_the_hole_is():
    watch, ended = TurnWatch(), []
    for degrees in (*HOLED, *range(0, 360, 10)):
        watch.add(on_circle(np.radians([degrees]))[0])
        ended.append((watch.ended, watch.closed))
        if not watch.closed:
            assert watch.angle <= np.radians(359)
    assert ended.index((True, False)) == len(HOLED) - 1
    assert ended[-1] == (True, True)


def test_the_way_to_and_fro_and_photographs_in_no_order_do_not_end_a_turn():
    there = np.arange(0, 140, 10)
    for degrees in ([*there, *there[::-1]], np.random.default_rng(1).permutation(36)[:20] * 10):
        watch = TurnWatch()
        for centre in on_circle(np.radians(degrees)):
            watch.add(centre)
            assert not watch.ended


def new_scan(taken=(), **kwargs):
    states = []
    scan = Scan(
        lambda: states.append(scan.state),
        lambda name: name in taken,
        now=lambda: datetime(2026, 3, 4, 5, 6, 7),
        **kwargs,
    )
    return scan, states


def test_a_scan_goes_through_its_states_and_says_each():
    scan, states = new_scan()
    assert scan.state == ScanState.WAITING
    for centre in on_circle(2 * np.pi * np.arange(12) / 12):
        scan.add_view(centre)
        scan.add_frame(100, 80)
    assert scan.report.scan_id == "scan_20260304_050607"
    assert scan.report.good_share == pytest.approx(0.8)
    assert scan.unsaved
    scan.go(ScanState.FINISHING)
    scan.go(ScanState.SAVED, "there")
    assert not scan.unsaved
    assert scan.report.sentence() == "saved: there"
    scan.add_frame(100, 100)
    assert scan.state == ScanState.SCANNING
    assert scan.unsaved
    scan.clear()
    assert scan.report.values()["state"] == "waiting"
    wanted = ["scanning", "turn_closed", "finishing", "saved", "scanning", "waiting"]
    assert [s.value for s in states] == wanted


def turned(scan, degrees, samples=100, outside=0):
    """Views from there with as many samples, of which so many are contradicted."""
    for angle in degrees:
        scan.add_view(on_circle(np.radians([angle]))[0])
        scan.add_outside(len(scan._outside), outside)
        scan.add_frame(samples, samples - outside)


def test_a_turn_that_was_saved_in_its_middle_goes_on():
    scan, _ = new_scan()
    turned(scan, range(0, 180, 10))
    assert scan.unseen() == "190 degrees were not seen"
    scan.go(ScanState.SAVED)
    turned(scan, range(180, 360, 10))
    assert scan.state == ScanState.TURN_CLOSED
    assert scan.report.values()["angle deg"] == "360.0"
    assert scan.unseen() == ""
    # The next turn is another, of the same scan.
    scan.go(ScanState.SAVED)
    turned(scan, range(0, 180, 10))
    assert scan.state == ScanState.SCANNING
    assert scan.report.values()["angle deg"] == "360.0"


def test_a_turn_with_a_hole_says_what_was_not_seen():
    scan, _ = new_scan()
    turned(scan, HOLED)
    assert (scan.state, scan.turn_ended) == (ScanState.SCANNING, True)
    assert scan.unseen() == "130 degrees were not seen"


def test_a_gap_in_a_closed_turn_is_told_until_another_turn_fills_it():
    scan, _ = new_scan()
    turned(scan, [*range(0, 120, 10), *range(200, 360, 10)])
    assert scan.state == ScanState.TURN_CLOSED
    assert scan.unseen() == "90 degrees were not seen"
    scan.go(ScanState.SAVED)
    turned(scan, range(0, 180, 10))
    assert scan.unseen() == "30 degrees were not seen"
    turned(scan, range(180, 220, 10))
    assert scan.unseen() == ""


def test_what_contradicts_a_saved_scan_is_told_until_it_has_another_name():
    scan, _ = new_scan(taken={"scan_20260304_050607_2"})
    turned(scan, range(0, 360, 10), outside=40)
    scan.go(ScanState.SAVED)
    assert not scan.contradiction()
    turned(scan, range(0, 60, 10), outside=10)
    assert not scan.contradiction()
    turned(scan, range(60, 120, 10), outside=60)
    assert scan.report.reason == scan.contradiction()
    assert "another object?" in scan.report.reason
    scan.rename()
    assert scan.report.scan_id == "scan_20260304_050607_3"
    assert not scan.contradiction()


def test_a_name_in_use_is_not_taken_twice():
    scan, _ = new_scan(taken={"scan_20260304_050607"})
    assert scan.named() == "scan_20260304_050607_2"
    assert new_scan(wish=lambda: "cup")[0].named() == "cup"


@pytest.mark.parametrize("name", ["..", ".", "a/b", "/a", "../a", "a\\b", "a\0b", "x" * 300])
def test_a_name_that_could_lead_elsewhere_is_refused(name, tmp_path):
    with pytest.raises(ValueError, match="plain name"):
        check_name(name)
    with pytest.raises(ValueError, match="plain name"):
        ScanFiles(str(tmp_path), ".ply").write(Result(name), "mesh", b"")


def there(folder):
    """What the files of a folder hold, by their names."""
    return {path.name.removesuffix(".ply"): path.read_bytes() for path in folder.iterdir()}


def test_files_of_a_scan_take_the_place_of_its_own_and_of_no_others(tmp_path):
    files = ScanFiles(str(tmp_path / "new" / "scans"), ".ply")
    first, second = Result("cup"), Result("cup")
    for data in (b"1", b"2"):
        path = files.write(first, "mesh", data)
    assert there(path.parent) == {"mesh": b"2"}
    files.write(second, "mesh", b"3")
    assert there(path.parent) == {"mesh": b"3", "mesh.previous": b"2"}


def test_surfaces_are_kept_together_and_never_with_those_of_another_scan(tmp_path):
    files, folder = ScanFiles(str(tmp_path), ".ply"), tmp_path / "cup"
    first, second, third = (Result("cup") for _ in range(3))
    files.write(first, "mesh", b"1")
    files.write(first, "closed", b"1")
    files.write(second, "mesh", b"2")
    assert there(folder) == {"mesh": b"2", "mesh.previous": b"1", "closed.previous": b"1"}
    files.write(third, "mesh", b"3")
    files.write(third, "closed", b"3")
    assert there(folder) == {"mesh": b"3", "closed": b"3", "mesh.previous": b"2"}
    # The body of the second was made late.
    files.write(second, "closed", b"2")
    assert there(folder) == {
        **{"mesh": b"3", "closed": b"3"},
        **{"mesh.previous": b"2", "closed.previous": b"2"},
    }


def test_what_had_no_room_is_written_to_its_own_scan(tmp_path):
    files, folder = ScanFiles(str(tmp_path), ".ply"), tmp_path / "cup"
    first, second = Result("cup"), Result("cup")
    folder.write_text("in the way")
    for name in ("mesh", "closed"):
        with pytest.raises(OSError, match="cup"):
            files.write_or_owe(first, name, lambda: b"1")
    assert files.owed == 1
    folder.unlink()
    files.write_owed()
    files.write(second, "mesh", b"2")
    files.write_owed()
    assert not files.owed
    wanted = {"mesh": b"2", "mesh.previous": b"1", "closed.previous": b"1"}
    assert there(folder) == wanted


def test_a_folder_that_was_removed_is_made_again_and_one_that_cannot_be_is_named(tmp_path):
    files = ScanFiles(str(tmp_path / "scans"), ".ply")
    cup = Result("cup")
    files.write(cup, "mesh", b"1")
    (tmp_path / "scans" / "cup" / "mesh.ply").unlink()
    (tmp_path / "scans" / "cup").rmdir()
    (tmp_path / "scans").rmdir()
    files.write(cup, "mesh", b"2")
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingsError, match="file is no folder"):
        ScanFiles(str(tmp_path / "file"), ".ply")
    with pytest.raises(OSError, match=r"file"):
        ScanFiles(str(tmp_path / "file" / "scans"), ".ply").write(cup, "mesh", b"")


def test_the_home_folder_may_be_written_short(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert ScanFiles("~/scans", ".stl").path("a", "mesh") == tmp_path / "scans" / "a" / "mesh.stl"


def test_a_doubt_is_of_the_body_that_was_closed_last():
    scan = Scan(lambda: None, lambda name: False)
    scan.add_frame(100, 50)
    for begin in (scan.again, scan.rename, scan.clear, lambda: scan.judged("")):
        scan.judged("view 3")
        assert scan.report.values()["doubt"] == "view 3"
        begin()
        assert scan.report.doubt == ""


def test_what_comes_while_a_scan_is_written_is_not_saved_with_it():
    scan, _ = new_scan()
    scan.add_frame(100, 50)
    scan.write()
    scan.add_frame(100, 50)
    scan.add_outside(2, 60)  # another object
    scan.go(ScanState.SAVED)
    assert scan.unsaved
    assert "another object?" in scan.contradiction()
    scan.go(ScanState.SAVED)
    assert not scan.unsaved
    assert not scan.contradiction()


def test_samples_that_other_views_contradict_are_told_of_a_scan():
    scan, _ = new_scan()
    scan.add_frame(100, 50)
    scan.add_outside(1, 10)
    assert not scan.refuted()
    scan.add_outside(1, 32)  # as where the lens breathes and nobody says so
    assert scan.refuted().startswith("32% of the samples fall outside the outlines of others")
