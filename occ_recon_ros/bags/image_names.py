"""The names of the files that the images of a bag came from, in its metadata, by the stamps of the
images in nanoseconds."""

import json
from collections.abc import Mapping
from pathlib import Path

from .custom_data import custom_data

KEY = "occ_recon_image_names"


def names_text(names: Mapping[int, str]) -> str:
    """Names by stamp as they are kept."""
    return json.dumps({str(stamp): name for stamp, name in names.items()})


def read_names(path: Path) -> dict[int, str]:
    """Names by the stamps of images (ns) of a bag, in their order; none where it has none, or its
    metadata cannot be read."""
    try:
        return {int(stamp): str(name) for stamp, name in custom_data(path, KEY).items()}
    except Exception:  # of many kinds: whatever a parser of somebody's metadata stumbles over
        return {}
