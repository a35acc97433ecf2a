"""What a user did wrong, as opposed to what we did wrong."""


class UserError(Exception):
    """Bad arguments or bad input. The message is one line: what is wrong and what to do."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))


class SettingsError(ValueError):
    """A parameter that cannot be used, said in one line."""
