"""docs/LIBRARY.md names what the packages offer, and its ten lines are those of the example."""

import ast
import importlib
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "LIBRARY.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| `(occ_recon_ros[\w.]*)` \| (.*) \|$", PAGE, re.MULTILINE)


def test_the_public_names_are_those_of_the_packages():
    assert len(ROWS) > 5
    for module, cell in ROWS:
        names = re.findall(r"`(\w+)`", cell)
        there = importlib.import_module(module)
        assert names == sorted(names), module
        assert all(hasattr(there, name) for name in names), module
        assert set(names) == set(getattr(there, "__all__", names)), module


def test_every_package_of_the_library_is_on_the_page():
    with_names = {
        ".".join(path.relative_to(ROOT).parent.parts)
        for path in (ROOT / "occ_recon_ros").rglob("__init__.py")
        if "__all__" in path.read_text(encoding="utf-8")
    }
    for_ros = {"occ_recon_ros.cli", "occ_recon_ros.nodes", "occ_recon_ros.viewer"}
    assert with_names - for_ros == {module for module, _ in ROWS if module in with_names}


def test_the_lines_of_the_page_are_those_of_the_example():
    example = (ROOT / "examples" / "without_ros.py").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    shown = [ast.unparse(line) for line in ast.parse(block).body][:-2]
    (rebuild,) = (n for n in ast.parse(example).body if getattr(n, "name", "") == "rebuild")
    assert shown == [ast.unparse(line) for line in rebuild.body[1:-1]]
