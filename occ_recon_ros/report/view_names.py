"""Views by the images that they came from."""

from collections.abc import Mapping
from typing import Any


def view_words(k: int, source: Mapping[str, Any]) -> str:
    """A view, from 0, and the name of its image where a scan of photographs knows it.

    Args:
        k: its number.
        source: what report.json says of the source.
    """
    names = source.get("turn", source.get("board", {})).get("names", ())
    return f"view {k} ({names[k]})" if k < len(names) else f"view {k}"
