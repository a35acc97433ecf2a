"""What whoever found the masks of a bag thinks of them, in its metadata: how they were found, how
far they are to be believed, doubts and remarks in words, and views that were left out, by number.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from .custom_data import custom_data

KEY = "occ_recon_masks"


def told_text(told: Mapping[str, Any]) -> str:
    """As it is kept; what else is known of them is not."""
    return json.dumps({name: told[name] for name in _READ if name in told})


def read_told(path: Path) -> dict[str, Any]:
    """``way``, ``belief`` (0 to 1), ``warnings``, ``notes`` and ``bad_views``, those of them that
    were told; none where none were, or the metadata of the bag cannot be read."""
    try:
        told = custom_data(path, KEY)
        return {name: read(told[name]) for name, read in _READ.items() if name in told}
    except Exception:  # of many kinds: whatever a parser of somebody's metadata stumbles over
        return {}


_READ: dict[str, Callable[[Any], Any]] = {
    "belief": float,
    "warnings": lambda words: [str(sentence) for sentence in words],
    "notes": lambda words: [str(sentence) for sentence in words],
    "bad_views": lambda views: {int(k): str(why) for k, why in views.items()},
}
