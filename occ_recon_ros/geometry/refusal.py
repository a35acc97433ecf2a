"""Input that is refused, by name."""


class Refusal(ValueError):
    """Input that cannot be used.

    Attributes:
        reason: short snake_case name under which it is counted.
    """

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason
