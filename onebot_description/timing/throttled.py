"""Logs warnings of a node without repeating them."""

import math
import time
from collections.abc import Callable

from onebot_description.errors import shortened

_LONGEST = 4000  # characters of a text, which may contain parts of a message


Warn = Callable[[str, str], None]
"""Logs a warning, given its kind and its text, like a Throttled."""


class Throttled:
    """Logs texts of one kind at most once every few seconds."""

    def __init__(self, log: Callable[[str], object], every: float = 5.0) -> None:
        """Log with ``log`` at most once every ``every`` seconds.

        ``log`` is a logger's ``warning``. For another severity, pass a lambda: rclpy allows only
        one severity per line of code, and all these texts are logged from the same line.
        """
        self._log, self._every = log, every
        self._logged_at: dict[str, float] = {}

    def __call__(self, kind: str, text: str, *, every: float | None = None) -> None:
        """Log ``text``, unless a text of its kind was logged within ``every`` seconds."""
        now = time.monotonic()
        wait = self._every if every is None else every
        if now - self._logged_at.get(kind, -math.inf) >= wait:
            self._logged_at[kind] = now
            self._log(shortened(text, _LONGEST))

    def once(self, text: str) -> None:
        """Log ``text``, unless it was logged before."""
        self(text, text, every=math.inf)
