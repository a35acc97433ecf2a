"""The command, a small image folder and a recorded scan."""

from fixtures import bag, command, expected, folder, messages

__all__ = ["bag", "command", "expected", "folder", "messages"]
