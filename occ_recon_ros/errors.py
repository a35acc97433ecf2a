"""What a user did wrong, as opposed to what we did wrong."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class UserError(Exception):
    """Bad arguments or bad input. The message is one line: what is wrong and what to do."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))


@contextmanager
def wrong_in(what: object) -> Iterator[None]:
    """A ValueError of the block is what is wrong with some input of the user, which is named."""
    try:
        yield
    except ValueError as error:
        raise UserError(f"{what}: {error}") from None


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """An OSError of the block is why a path of the user cannot be written."""
    try:
        yield
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}") from None


class SettingsError(ValueError):
    """A parameter that cannot be used, said in one line."""
