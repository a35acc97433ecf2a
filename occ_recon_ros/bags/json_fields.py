"""Values of a JSON file of a stranger, each checked as it is taken out."""

import json
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from occ_recon_ros.errors import UserError

NO_FRAMES = "'frames' must be a list with at least one frame"


def load_json(path: Path, may_be_empty: bool = False) -> Mapping[str, Any]:
    """The object that a file holds, with its list ``frames``, or that list alone.

    Args:
        path: of the file.
        may_be_empty: take a list without frames too.

    Raises:
        UserError: not there, not UTF-8, not JSON, no object, or no frames in it.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))  # Windows begins with a BOM
    except UnicodeDecodeError:
        raise UserError(f"{path} is not UTF-8: save it again as that") from None
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error}") from None
    except json.JSONDecodeError as error:
        raise UserError(
            f"{path} is not JSON: {error.msg} at line {error.lineno} column {error.colno}"
        ) from None
    except (ValueError, RecursionError):
        raise UserError(
            f"{path} cannot be read as JSON: it holds a number of thousands of digits, or lists "
            "nested thousands deep"
        ) from None
    if isinstance(content, list):
        content = {"frames": content}
    if not isinstance(content, dict):
        raise UserError(f"{path} must hold an object with 'frames', not {json.dumps(content):.40}")
    frames = content.get("frames")
    if not isinstance(frames, list) or not (frames or may_be_empty):
        raise UserError(f"{path}: {NO_FRAMES}")
    for i, entry in enumerate(frames):
        if not isinstance(entry, dict):
            raise UserError(f"{path}: frames[{i}] must be an object, not {entry!r:.40}")
    return content


def value(entry: Mapping[str, Any], key: str, where: str) -> Any:
    """What is not null.

    Raises:
        UserError: it is, or is not there.
    """
    if entry.get(key) is None:
        raise UserError(f"{where} has no '{key}'")
    return entry[key]


def file_name(entry: Mapping[str, Any], key: str, where: str) -> str:
    """A text that is not empty, and that a file can have as its name.

    Raises:
        UserError: it is something else, or not there.
    """
    name = value(entry, key, where)
    if not isinstance(name, str) or not name or "\0" in name or name != _as_utf8(name):
        raise UserError(f"{where}.{key} must be the name of a file, not {name!r:.40}")
    return name


def _as_utf8(text: str) -> str:
    """Without the halves of letters that JSON can escape."""
    return text.encode(errors="ignore").decode()


def number(entry: Mapping[str, Any], key: str, where: str, default: float | None = None) -> float:
    """A finite number, or the text of one.

    Raises:
        UserError: it is something else, or not there and without a default.
    """
    found = entry.get(key, default)
    if isinstance(found, str):
        with suppress(ValueError):
            found = float(found)
    if found is None or isinstance(found, bool) or not isinstance(found, (int, float)):
        raise UserError(f"{where}: '{key}' must be a number, not {found!r:.40}")
    if not abs(found) <= sys.float_info.max:  # a whole number of JSON may be larger
        raise UserError(f"{where}: '{key}' is not finite")
    return float(found)


def pixels(entry: Mapping[str, Any], key: str, where: str) -> int:
    """A whole number above 0.

    Raises:
        UserError: it is something else, or not there.
    """
    found = value(entry, key, where)
    if isinstance(found, bool) or not isinstance(found, int) or found <= 0:
        raise UserError(f"{where}.{key} must be a whole number of pixels, not {found!r:.40}")
    return found


def array(
    entry: Mapping[str, Any], key: str, shape: tuple[int, ...] | None, where: str
) -> NDArray[np.float64]:
    """Finite numbers of a shape, or a list of any length where that is None; lists that hold but
    one number or one list, as of rows and columns of a matrix, count as what they hold, and
    numbers in a row as a matrix, row by row.

    Raises:
        UserError: it is something else, or not there.
    """
    found = value(entry, key, where)
    expected = "a list of numbers" if shape is None else "x".join(map(str, shape)) + " numbers"
    try:
        numbers = np.asarray(found)
        if numbers.dtype.kind == "U":  # the text of them
            numbers = numbers.astype(np.float64)
        if numbers.dtype.kind not in "iuf":
            raise ValueError("not numbers")
        numbers = numbers.astype(np.float64)
    except (TypeError, ValueError):
        raise UserError(f"{where}.{key} must be {expected}") from None
    wanted = shape if shape is not None else (numbers.size,)
    held = [[n for n in of if n != 1] for of in (numbers.shape, wanted)]
    if numbers.ndim == 0 or (held[0] != held[1] and numbers.shape != (np.prod(wanted),)):
        got = "x".join(map(str, numbers.shape)) or "one number"
        raise UserError(f"{where}.{key} must be {expected}, not {got}")
    if not np.isfinite(numbers).all():
        raise UserError(f"{where}.{key} is not finite (NaN or infinity)")
    return numbers.reshape(wanted)
