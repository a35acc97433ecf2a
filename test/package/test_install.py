"""A plain install carries everything: code, configuration, launch files, executables, marker."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from occ_recon_ros.resources import config_file

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ["occ_recon_ros", "msg_adapters", "config", "launch", "resource"]
EXECUTABLES = ["contour_tracker", "reconstructor", "mesher", "virtual_turntable", "occ-recon"]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where pip put the package, without its dependencies and out of reach of the checkout."""
    source = tmp_path_factory.mktemp("source") / "occ_recon_ros"
    source.mkdir()
    for name in SOURCES:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for path in (*ROOT.glob("*.*"), ROOT / "LICENSE"):
        if path.is_file():
            shutil.copy(path, source)
    target = tmp_path_factory.mktemp("target")
    command = [sys.executable, "-m", "pip", "install", "-qq", "--no-deps", "--no-index"]
    command += ["--no-build-isolation", "--no-compile", "--target", str(target), str(source)]
    subprocess.run(command, check=True, capture_output=True)
    return target


@pytest.mark.parametrize("name", EXECUTABLES)
def test_executable_is_installed(installed: Path, name: str) -> None:
    assert os.access(installed / "bin" / name, os.X_OK)


@pytest.mark.parametrize("folder", ["config", "launch"])
def test_share_holds_the_whole_folder(installed: Path, folder: str) -> None:
    share = installed / "share" / "occ_recon_ros" / folder
    expected = {path.name for path in (ROOT / folder).iterdir() if path.is_file()}
    assert expected
    assert {path.name for path in share.iterdir() if path.is_file()} == expected


def test_ament_finds_the_package(installed: Path) -> None:
    index = installed / "share/ament_index/resource_index/packages"
    assert (index / "occ_recon_ros").is_file()
    assert (installed / "share/occ_recon_ros/package.xml").is_file()


def test_config_is_found_without_the_checkout(installed: Path) -> None:
    code = "from occ_recon_ros.resources import config_file; print(config_file('rig.yaml'))"
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    run = subprocess.run(
        [sys.executable, "-c", code],
        check=True,
        capture_output=True,
        text=True,
        cwd=installed,
        env=environment,
    )
    found = Path(run.stdout.strip())
    assert found.is_relative_to(installed)
    assert found.read_bytes() == (ROOT / "config/rig.yaml").read_bytes()


def test_config_is_found_in_the_checkout() -> None:
    assert config_file("fastdds.xml").read_bytes() == (ROOT / "config/fastdds.xml").read_bytes()


def test_a_missing_config_file_is_named() -> None:
    with pytest.raises(FileNotFoundError, match=r"no_such\.yaml"):
        config_file("no_such.yaml")


def test_setup_py_and_package_xml_name_one_version(installed: Path) -> None:
    (info,) = installed.glob("occ_recon_ros-*.dist-info")
    version = ElementTree.parse(ROOT / "package.xml").findtext("version")
    assert info.name == f"occ_recon_ros-{version}.dist-info"
