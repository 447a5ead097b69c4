"""How the order to stop is pressed harder with time."""

import time
from dataclasses import dataclass

TERMINATE, KILL, GIVE_UP = 1, 2, 3  # stages; 0 is SIGINT
# A wrapper such as `uv run` passes a Ctrl-C on that the terminal has already delivered.
_SAME_KEYSTROKE = 0.3  # seconds


@dataclass(frozen=True)
class Grace:
    """When to use which signal, in seconds after the order to stop; all is over within 5 s.

    Attributes:
        terminate: SIGTERM to what did not heed SIGINT.
        kill: SIGKILL to what did not heed SIGTERM either.
        give_up: leave even if the system has not removed them yet.
    """

    terminate: float = 2.5
    kill: float = 4.0
    give_up: float = 4.6


class Stopping:
    """The order to stop, once it was given.

    Attributes:
        stage: how hard it has been pressed so far.
    """

    def __init__(self, grace: Grace) -> None:
        """It has not been given yet."""
        self.stage = 0
        self._grace = grace
        self._since: float | None = None

    def __bool__(self) -> bool:
        """Whether it was given."""
        return self._since is not None

    def order(self) -> None:
        """Give it."""
        self._since = time.monotonic()

    def is_repeated(self) -> bool:
        """Return whether a signal that comes now is another order, and not the same keystroke."""
        return self._waited() > _SAME_KEYSTROKE

    def press(self, stage: int) -> bool:
        """Go to ``stage``; return False if it has got as far already."""
        if stage <= self.stage:
            return False
        self.stage = stage
        return True

    def due(self) -> list[int]:
        """Return the stages that are due by the clock, whether reached or not."""
        grace, waited = self._grace, self._waited()
        moments = {TERMINATE: grace.terminate, KILL: grace.kill, GIVE_UP: grace.give_up}
        return [stage for stage, moment in moments.items() if waited > moment]

    def _waited(self) -> float:
        return 0.0 if self._since is None else time.monotonic() - self._since
