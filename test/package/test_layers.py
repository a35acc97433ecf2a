"""Imports point one way: cli -> {nodes, report, evaluation, bags} -> {msg_adapters, streams} ->
{imaging, surface, poses, scene} -> geometry."""

import ast
import re
import subprocess
import sys
from functools import cache
from importlib.metadata import files, requires
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[2]

METHOD = {"geometry", "imaging", "surface", "poses", "scene"}
SHARED = {"errors", "resources"}  # single files that any room above the method may use
BASE = METHOD | {"msg_adapters", "streams"} | SHARED

# What each part may import of ours, beside itself.
BELOW = {
    "geometry": set(),
    "imaging": {"geometry"},
    "surface": {"geometry"},
    "poses": {"geometry", "imaging"},
    "scene": {"geometry"},
    "streams": METHOD | SHARED,
    "msg_adapters": METHOD,
    "viewer": METHOD | {"streams"},
    "nodes": BASE | {"viewer"},
    "bags": BASE,
    "evaluation": BASE | {"bags"},
    "report": BASE | {"bags", "evaluation"},
    "cli": BASE | {"nodes", "bags", "evaluation", "report"},
}
WITHOUT_ROS = {*METHOD, "streams", "viewer", "bags", "evaluation", "report"}
ROS = {"ament_index_python", "builtin_interfaces", "launch", "launch_ros", "rcl_interfaces"}
ROS |= {"rclpy", "std_srvs"}


def folder(part: str) -> Path:
    return ROOT / part if part == "msg_adapters" else ROOT / "occ_recon_ros" / part


@cache
def imports(path: Path) -> set[str]:
    """Absolute dotted names that a source file imports, at whatever depth of the code."""
    package = ".".join(path.relative_to(ROOT).parent.parts)
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package.rsplit(".", node.level - 1)[0] if node.level else ""
            module = ".".join(filter(None, (base, node.module)))
            names |= {f"{module}.{alias.name}" for alias in node.names}
    return names


# Rooms that the command alone uses.
COMMAND = {"cli", "bags", "evaluation", "report"}
# The closed surface and the page, which need what comes with the command.
COMMAND_ALONE = frozenset({"covering.py", "hull.py", "page.py", "server.py"})


def imports_of(part: str, without: frozenset[str] = frozenset()) -> set[str]:
    paths = [path for path in folder(part).rglob("*.py") if path.name not in without]
    return set().union(*map(imports, paths))


def part_of(name: str) -> str | None:
    """The part of ours that an imported name lies in, None for other people's."""
    words = name.split(".")
    if words[0] == "occ_recon_ros":
        return words[1] if len(words) > 1 else "occ_recon_ros"
    return "msg_adapters" if words[0] == "msg_adapters" else None


def is_ros(name: str) -> bool:
    top = name.split(".")[0]
    return top in ROS or top.endswith("_msgs")


@pytest.mark.parametrize("part", BELOW)
def test_a_part_imports_only_parts_below_it(part: str) -> None:
    ours = {part_of(name) for name in imports_of(part)} - {None, part}
    assert ours <= BELOW[part]


@pytest.mark.parametrize("part", sorted(WITHOUT_ROS))
def test_only_nodes_adapters_and_command_know_ros(part: str) -> None:
    assert not {name for name in imports_of(part) if is_ros(name)}


def test_geometry_needs_numpy_scipy_and_numba_alone() -> None:
    others = {name.split(".")[0] for name in imports_of("geometry") if not part_of(name)}
    assert others - set(sys.stdlib_module_names) <= {"numpy", "scipy", "numba"}


def test_package_xml_names_every_ros_package_in_use() -> None:
    names = set().union(imports(ROOT / "launch/turntable.launch.py"), *map(imports_of, BELOW))
    used = {name.split(".")[0] for name in names if is_ros(name)}
    depends = ElementTree.parse(ROOT / "package.xml").iterfind("exec_depend")
    assert used <= {depend.text for depend in depends}


@cache
def modules(requirement: str) -> set[str]:
    """Top-level modules that a requirement installs, such as cv2 for opencv-python-headless."""
    installed = files(re.match(r"[\w.-]+", requirement)[0]) or []
    return {path.parts[0].removesuffix(".py") for path in installed}


def undeclared(
    parts: set[str], requirements: list[str], without: frozenset[str] = frozenset()
) -> set[str]:
    """Top-level modules that parts import and that no requirement installs."""
    names = set().union(*(imports_of(part, without) for part in parts))
    used = {name.split(".")[0] for name in names if not is_ros(name)}
    used -= {*sys.stdlib_module_names, "occ_recon_ros", "msg_adapters"}
    return used.difference(*map(modules, requirements))


def requirements(extra: str = "") -> list[str]:
    """What setup.py asks for: always, or for an extra alone."""
    lines = requires("occ_recon_ros") or []
    if extra:
        return [line for line in lines if re.search(rf"extra == .{extra}.", line)]
    return [line for line in lines if "extra ==" not in line]


def test_the_nodes_need_no_more_than_the_plain_install() -> None:
    assert not undeclared({*BELOW} - COMMAND, requirements(), COMMAND_ALONE)


def test_the_nodes_load_nothing_of_the_closed_surface_and_nothing_slow() -> None:
    """Which would be half a second of every start."""
    nodes = ("contour_tracker", "reconstructor", "mesher", "virtual_turntable", "viewer")
    code = "".join(f"import occ_recon_ros.nodes.{name}\n" for name in nodes)
    late = {"skimage", "typer", "rich", "rosbags", "viser", "numba", "trimesh", "scipy.optimize"}
    code += f"import sys; print(*{late} & {{*sys.modules}})"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == []


def test_the_command_needs_no_more_than_its_extra() -> None:
    assert not undeclared({*BELOW}, requirements() + requirements("cli"))


def test_no_library_is_asked_for_in_vain() -> None:
    lines = [line for line in requirements() if not line.startswith("ros-")]
    used = {name.split(".")[0] for part in BELOW for name in imports_of(part)}
    used.add("embreex")  # by trimesh.ray.ray_pyembree
    unused = [line for line in lines + requirements("cli") if not modules(line) & used]
    assert not unused


def test_geometry_is_imported_without_what_takes_long() -> None:
    code = (
        "import sys, occ_recon_ros.geometry; print(*sorted({m.split('.')[0] for m in sys.modules}))"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numba", "scipy", "cv2", "trimesh", "rclpy"} & {*told.stdout.split()}


def test_no_two_test_files_have_one_name() -> None:
    """pytest takes the second for the first."""
    names = [path.name for path in (ROOT / "test").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))
