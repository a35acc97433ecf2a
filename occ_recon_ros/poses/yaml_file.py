"""Calibrations and boards as YAML files that people may write too."""

from pathlib import Path
from typing import Any

import yaml


def read_yaml(path: Path, what: str, maker: str) -> Any:
    """The content of a file.

    Args:
        path: the file.
        what: it is, in words.
        maker: arguments of ``occ-recon`` that make one.

    Raises:
        ValueError: not there, or not YAML; with the path in the message.
    """
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(f"{what} {path} does not exist: 'occ-recon {maker}' makes one") from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        words = " ".join(str(error).split())
        raise ValueError(f"{what} {path} cannot be read: {words}") from None
