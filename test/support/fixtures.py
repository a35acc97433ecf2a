"""A small, good folder of images for the command to import, and the command itself."""

import fcntl
import json
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from recordings import Recorded, read_all, write_folder

from occ_recon_ros.cli import main, progress
from occ_recon_ros.geometry import RimReconstructor
from occ_recon_ros.scene import TurntableSettings, make_object, turntable_cameras
from occ_recon_ros.surface.closing import ClosingSettings, close_surface

Command = Callable[..., tuple[int, str, str]]

COARSE = "--set=mesher.body_cells=48"
PLAIN = (COARSE, "--segment=single", "--no-refine")
"""Without the first passes over the images, half of the time of a replay this small."""


@pytest.fixture
def command(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Command:
    """Runs occ-recon in this process: exit code, stdout and stderr, without the lines on work that
    a busy machine makes long."""
    monkeypatch.setattr(progress, "FIRST_S", np.inf)

    def run(*arguments: object) -> tuple[int, str, str]:
        capfd.readouterr()
        code = main([str(argument) for argument in arguments])
        return code, *capfd.readouterr()

    return run


@pytest.fixture
def replay(command: Command) -> Command:
    """Runs occ-recon replay of a bag into a folder, with a coarse body (a finer one takes longer
    than all the rest) and without first passes over the images."""
    return lambda bag, out, *arguments: command("replay", bag, "--out", out, *PLAIN, *arguments)


@dataclass
class Folder:
    """An image folder that a test may spoil before it is imported."""

    path: Path
    content: dict[str, Any] = field(default_factory=dict)

    def save(self) -> None:
        (self.path / "cameras.json").write_text(json.dumps(self.content))

    def image(self, frame: int) -> Path:
        return self.path / self.content["frames"][frame]["file"]

    def mask(self, frame: int) -> Path:
        return self.path / self.content["frames"][frame]["mask"]


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    """Three views of 64 x 48 pixels with masks: colour PNG, grey JPEG, 16-bit PNG."""
    rng = np.random.default_rng(5)
    path = tmp_path / "folder"
    (path / "m").mkdir(parents=True)
    frames = []
    grey = cv2.GaussianBlur(rng.integers(0, 255, (48, 64), np.uint8), (0, 0), 2)
    pictures = {
        "0.png": np.dstack([grey, grey // 2, 255 - grey]),
        "1.jpg": grey,
        "2.png": grey.astype(np.uint16) * 200,
    }
    for i, (name, pixels) in enumerate(pictures.items()):
        assert cv2.imwrite(str(path / name), pixels)
        mask = np.zeros((48, 64), np.uint8)
        mask[10:30, 20 : 40 + i] = 255
        assert cv2.imwrite(str(path / f"m/{i}.png"), mask)
        angle = 0.2 * i
        c, s = np.cos(angle), np.sin(angle)
        frames.append(
            {
                "file": name,
                "mask": f"m/{i}.png",
                "width": 64,
                "height": 48,
                "K": [[80.0, 0, 31.5], [0, 82, 23.5], [0, 0, 1]],
                "D": [0.1, -0.02, 0.001, 0.002],
                "R": [[c, s, 0], [0, 0, -1], [-s, c, 0]],
                "t": [10.0 * i, -20, 500],
                "note": "keys that are not ours are passed over",
            }
        )
    folder = Folder(path, {"unit_in_metres": 0.001, "frames": frames})
    folder.save()
    return folder


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """A folder that the first worker of a session to ask for it fills, for all of them."""
    base = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent
    folder, unfinished = base / name, base / f"{name}.part"
    with (base / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            shutil.rmtree(unfinished, ignore_errors=True)
            unfinished.mkdir()
            make(unfinished)
            unfinished.rename(folder)
    return folder


def compile_loops(folder: Path) -> None:
    """Run every compiled loop once: rims of a ball, and its closed body."""
    size = {"width": 160, "height": 120, "focal_px": 200.0}
    cameras = turntable_cameras(TurntableSettings(frames=12, step=np.pi / 6, **size))
    ball, reconstructor = make_object("sphere"), RimReconstructor()
    contours = [ball.exact_contours(camera, stamp_ns=k + 1) for k, camera in enumerate(cameras)]
    rims = [rim for view in contours for rim in reconstructor.add(view)] + reconstructor.finish()
    newest = {rim.stamp_ns: rim for rim in rims}
    close_surface(contours, list(newest.values()), ClosingSettings(cells=16))


def _record(folder: Path) -> None:
    write_folder(folder / "images")
    assert main(["import", str(folder / "images"), str(folder / "scan.mcap")]) == 0


@pytest.fixture(scope="session")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A vase in a full turn, as ``write_folder`` has it; the images are beside it."""
    return made_once(tmp_path_factory, "scan", _record) / "scan.mcap"


@pytest.fixture(scope="session")
def messages(bag: Path) -> list[Recorded]:
    """What the bag holds."""
    return read_all(bag)


@pytest.fixture(scope="session")
def expected(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The rims of the undisturbed replay."""

    def play(folder: Path) -> None:
        assert main(["replay", str(bag), "--out", str(folder / "out"), *PLAIN]) == 0

    rims = (made_once(tmp_path_factory, "expected", play) / "out" / "rims.ply").read_bytes()
    assert int(re.search(rb"element vertex (\d+)", rims).group(1)) > 1000  # type: ignore[union-attr]
    return rims
