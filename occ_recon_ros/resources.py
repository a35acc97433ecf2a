"""Files that come with the package: where config/ is, however it was installed."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def config_file(name: str) -> Path:
    """Absolute path of a file of config/, such as "rig.yaml" or "fastdds.xml".

    An installed package carries the folder as occ_recon_ros/config. An editable install
    maps no such folder, so the one of the checkout serves there.

    Raises:
        FileNotFoundError: there is no such file; the message says where it was looked for.
    """
    folders = (_PACKAGE / "config", _PACKAGE.parent / "config")
    for folder in folders:
        if (folder / name).is_file():
            return folder / name
    raise FileNotFoundError(f"no configuration file '{name}' in {folders[0]} or {folders[1]}")
