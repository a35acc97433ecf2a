"""Tables on the screen, each figure with its limit beside it."""

from typing import Any

Row = dict[str, Any]


def show(title: str, rows: list[Row]) -> list[Row]:
    """Print a table and hand it on. Rows may lack columns of the first."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    text = [[_cell(row.get(name, "")) for name in names] for row in rows]
    wide = [max(map(len, column)) for column in zip(names, *text, strict=True)]
    print(f"\n{title}")
    for line in (names, *text):
        print("  ".join(word.rjust(w) for word, w in zip(line, wide, strict=True)), flush=True)
    return rows


def within(value: float, most: float) -> Row:
    """Two columns: the limit, and whether it is kept."""
    return {"limit": f"<= {most:g}", "": "pass" if value <= most else "SHORT"}


def reaches(value: float, least: float) -> Row:
    """Two columns: the limit, and whether it is reached."""
    return {"limit": f">= {least:g}", "": "pass" if value >= least else "SHORT"}


def between(value: float, low: float, high: float) -> Row:
    """Two columns: the limits, and whether they are kept."""
    return {"limits": f"{low:g}-{high:g}", " ": "pass" if low <= value <= high else "SHORT"}


def _cell(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
