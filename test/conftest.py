"""Shared fixtures. ROS reads these variables when it is imported, so they come first."""

from __future__ import annotations

import os

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ.setdefault("HOME", "/tmp")

from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real sequences beside the checkout; missing is an error only in CI."""
    folder = CHECKOUT.parent / "shared" / "data"
    if not folder.is_dir():
        message = f"the recorded sequences are not at {folder}"
        if os.environ.get("CI") == "true":
            raise FileNotFoundError(message)
        pytest.skip(message)
    return folder
