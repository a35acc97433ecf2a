"""docs/REFERENCE.md is what the nodes say of themselves."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_reference_is_up_to_date() -> None:
    run = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "reference.py")],
        check=True,
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    found = (ROOT / "docs" / "REFERENCE.md").read_text(encoding="utf-8")
    assert found == run.stdout, "run `make docs`"
