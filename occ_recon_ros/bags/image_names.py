"""The names of the files that the images of a bag came from, in its metadata.

rosbag2 has a place for what others add, ``custom_data``: text by a key. Ours is a JSON object of
the names by the stamps of the images, in nanoseconds. It stands in metadata.yaml, and in the copy
of that which a bare .mcap or .db3 file holds.
"""

import json
import sqlite3
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from mcap.reader import make_reader

KEY = "occ_recon_image_names"


def names_text(names: Mapping[int, str]) -> str:
    """Names by stamp as they are kept."""
    return json.dumps({str(stamp): name for stamp, name in names.items()})


def read_names(path: Path) -> dict[int, str]:
    """Names by the stamps of images (ns) of a bag, in their order; none where it has none, or its
    metadata cannot be read."""
    try:
        names = json.loads(_custom_data(path)[KEY])
        return {int(stamp): str(name) for stamp, name in names.items()}
    except Exception:  # of many kinds: whatever a parser of somebody's metadata stumbles over
        return {}


def _custom_data(path: Path) -> Any:
    if path.is_dir():
        content = yaml.safe_load((path / "metadata.yaml").read_text(encoding="utf-8"))
        return content["rosbag2_bagfile_information"]["custom_data"]
    return yaml.safe_load(_of_db3(path) if path.suffix == ".db3" else _of_mcap(path))["custom_data"]


def _of_mcap(path: Path) -> str:
    with path.open("rb") as stream:
        found = [m.metadata for m in make_reader(stream).iter_metadata() if m.name == "rosbag2"]
    return found[-1]["serialized_metadata"]


def _of_db3(path: Path) -> str:
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?immutable=1", uri=True)
    try:
        row = connection.execute("SELECT metadata FROM metadata ORDER BY id DESC").fetchone()
        return str(row[0])
    finally:
        connection.close()
