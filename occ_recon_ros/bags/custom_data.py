"""What others than rosbag2 add to the metadata of a bag.

rosbag2 has a place for it, ``custom_data``: text by a key. It stands in metadata.yaml, and in the
copy of that which a bare .mcap or .db3 file holds. Ours are JSON objects.
"""

import json
import sqlite3
from pathlib import Path
from typing import Any

import yaml
from mcap.reader import make_reader


def custom_data(path: Path, key: str) -> Any:
    """What a bag has under a key of ours.

    Raises:
        Exception: of many kinds, whatever a parser of somebody's metadata stumbles over.
    """
    return json.loads(_all(path)[key])


def _all(path: Path) -> Any:
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
