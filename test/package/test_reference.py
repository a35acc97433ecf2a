"""What docs/ holds of written and drawn things is what their programs make."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("program", "made"), [("reference.py", "REFERENCE.md"), ("window.py", "window.svg")]
)
def test_it_is_up_to_date(program: str, made: str) -> None:
    run = subprocess.run(
        [sys.executable, str(ROOT / "docs" / program)],
        check=True,
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    found = (ROOT / "docs" / made).read_text(encoding="utf-8")
    assert found == run.stdout, "run `make docs`"
