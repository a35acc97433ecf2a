"""The files of scans: a folder a scan, in one place and nowhere else."""

from pathlib import Path

from ..errors import SettingsError
from ..surface import write_whole


def check_name(name: str) -> str:
    """A name that is a folder in another and never anything else; "" for one by the clock.

    Raises:
        ValueError: it could lead elsewhere.
    """
    if name in (".", "..") or any(c in name for c in "/\\\0") or len(name.encode()) > 200:
        raise ValueError(f"scan_name: must be a plain name without a path, got {name!r}")
    return name


class ScanFiles:
    """Writes the surfaces of scans.

    Args:
        folder: that holds a folder a scan; ~ is the home folder. It is made when needed.
        suffix: format of the surfaces, as ``SUFFIXES`` has them.

    Raises:
        SettingsError: it is not a folder.
    """

    def __init__(self, folder: str, suffix: str) -> None:
        self.folder = Path(folder).expanduser().absolute()
        self.suffix = suffix
        self._own: set[Path] = set()
        if not folder or (self.folder.exists() and not self.folder.is_dir()):
            raise SettingsError(
                f"output_dir: {self.folder if folder else repr(folder)} is no folder"
            )

    def taken(self, scan_id: str) -> bool:
        """Whether a scan of that name has files."""
        return (self.folder / scan_id).exists()

    def path(self, scan_id: str, name: str) -> Path:
        """Where a surface of a scan is, or goes."""
        return self.folder / check_name(scan_id) / f"{name}{self.suffix}"

    def write(self, scan_id: str, name: str, data: bytes) -> Path:
        """Write a surface, whole or not at all. One that is there takes its place if this scan
        has written it, else it is kept as NAME.previous.

        Raises:
            OSError: it cannot be written; names the file or folder.
        """
        path = self.path(scan_id, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        if path not in self._own and path.exists():
            path.replace(path.with_name(f"{name}.previous{self.suffix}"))
        write_whole(path, data, overwrite=True)
        self._own.add(path)
        return path

    def new_scan(self) -> None:
        """What is there is of another scan now."""
        self._own.clear()
