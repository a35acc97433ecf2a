"""Calibrations and boards as YAML files that people may write too."""

from pathlib import Path
from typing import Any

import yaml

_OPENCV_HEAD = "%YAML:1.0"  # of cv2.FileStorage; YAML itself has a blank there


class _Loader(yaml.SafeLoader):
    """Takes OpenCV's matrices for the mappings they are: rows, cols, dt, data."""


_Loader.add_constructor(
    "tag:yaml.org,2002:opencv-matrix",
    lambda loader, node: loader.construct_mapping(node, deep=True),
)


def read_yaml(path: Path, what: str, maker: str) -> Any:
    """The content of a file, of OpenCV's FileStorage too.

    Args:
        path: the file.
        what: it is, in words.
        maker: arguments of ``occ-recon`` that make one.

    Raises:
        ValueError: not there, or not YAML; with the path in the message.
    """
    try:
        text = path.read_text(encoding="utf-8")
        return yaml.load(text.removeprefix(_OPENCV_HEAD), _Loader)
    except FileNotFoundError:
        raise ValueError(f"{what} {path} does not exist: 'occ-recon {maker}' makes one") from None
    except UnicodeDecodeError:
        raise ValueError(f"{what} {path} is no text: give a YAML file") from None
    except (OSError, yaml.YAMLError) as error:
        words = " ".join(str(error).split())
        raise ValueError(f"{what} {path} cannot be read: {words}") from None
