"""Saying the same thing only so often."""

import math
import time
from collections.abc import Callable


class Throttled:
    """Passes on what it is told, but what is of one kind only so often."""

    def __init__(self, say: Callable[[str], object], every: float = 5.0) -> None:
        """Pass on to ``say``, such as a logger's ``warning``, at most once in ``every`` seconds."""
        self._say, self._every = say, every
        self._said: dict[str, float] = {}

    def __call__(self, kind: str, text: str, *, every: float | None = None) -> None:
        """Say ``text``, unless something of its kind was said just before.

        Args:
            kind: what counts as the same thing.
            text: what to say.
            every: seconds, in place of the constructor's; infinite to say it once.
        """
        now = time.monotonic()
        wait = self._every if every is None else every
        if now - self._said.get(kind, -math.inf) >= wait:
            self._said[kind] = now
            self._say(text)
