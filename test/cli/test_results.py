"""The folder of results: whole or not at all, and nobody's files are touched unasked."""

import json
from pathlib import Path

import pytest

from occ_recon_ros.cli.replay import BagSource
from occ_recon_ros.cli.results import results_folder
from occ_recon_ros.cli.scan import ScanOptions, run_scan
from occ_recon_ros.errors import UserError


def produce(out: Path, command: str, overwrite: bool = False, pictures: bool = True) -> None:
    with results_folder(out, command, overwrite) as work:
        assert work != out
        (work / "report.json").write_text(json.dumps({"command": command}))
        if pictures:
            (work / "views.png").write_bytes(b"new")


def content(out: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in out.iterdir()}


@pytest.mark.parametrize("name", ["new", "deep/er", "empty"])
def test_a_new_or_empty_folder(tmp_path, name):
    (tmp_path / "empty").mkdir()
    produce(tmp_path / name, "replay")
    assert set(content(tmp_path / name)) == {"report.json", "views.png"}
    assert not list(tmp_path.rglob("*.part"))


def test_only_a_demo_gives_way_and_only_to_a_demo(tmp_path):
    out = tmp_path / "out"
    produce(out, "demo")
    produce(out, "demo", pictures=False)
    assert set(content(out)) == {"report.json"}  # no picture of another run stays
    before = content(out)
    with pytest.raises(UserError, match="--overwrite"):
        produce(out, "replay")
    assert content(out) == before
    produce(out, "replay", overwrite=True)
    before = content(out)
    with pytest.raises(UserError, match="--overwrite"):
        produce(out, "demo")
    assert content(out) == before


def test_files_of_others_stay(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "report.json").write_text("not ours")
    for command in ("demo", "replay"):
        with pytest.raises(UserError, match="not empty"):
            produce(tmp_path, command)
    produce(tmp_path, "replay", overwrite=True)
    assert content(tmp_path)["notes.txt"] == "mine"


def test_a_failure_leaves_nothing_and_keeps_what_there_was(tmp_path):
    out = tmp_path / "out"

    def fail(overwrite: bool) -> None:
        with results_folder(out, "replay", overwrite) as work:
            (work / "mesh.ply").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail(overwrite=False)
    assert list(tmp_path.iterdir()) == []
    produce(out, "replay")
    before = content(out)
    with pytest.raises(KeyboardInterrupt):
        fail(overwrite=True)
    assert content(out) == before
    assert list(tmp_path.iterdir()) == [out]


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "out").write_text("x")
    for out in (tmp_path / "out", tmp_path / "out" / "deeper"):
        with pytest.raises(UserError):
            produce(out, "replay", overwrite=True)


def test_a_full_folder_is_refused_before_minutes_of_work(tmp_path):
    (tmp_path / "letter.txt").write_text("somebody's")
    # That the source is not there would be said first, were it looked at first.
    with pytest.raises(UserError, match="is not empty"):
        run_scan(BagSource(tmp_path / "none.mcap"), ScanOptions(out=tmp_path))
