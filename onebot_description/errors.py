"""Errors that a user can cause and can mend: each message is complete in itself."""

from collections.abc import Iterable


class OneBotError(Exception):
    """A user's mistake; ``str(error)`` is the whole message, commands exit with code 1."""


class UsageError(OneBotError):
    """A command was called in a way it does not know; commands exit with code 2."""


class DescriptionError(OneBotError):
    """A robot description that cannot be used.

    Attributes:
        problems: every problem found, each naming file, element and remedy.
    """

    def __init__(self, problems: Iterable[str]) -> None:
        """Join ``problems`` into one message, a line each."""
        self.problems = tuple(problems)
        super().__init__("\n".join(self.problems))
