"""The real-time factor that a control loop reaches, and when to log that it has fallen."""

from collections.abc import Callable
from dataclasses import dataclass

_SECOND = 1.0
# Shares of the wanted factor: a second below the first one is logged, and that the pace is back
# when all seconds for as long as _STEADY have reached the second one.
_SLOW, _BACK = 0.9, 0.95
_STEADY = 5.0  # s


@dataclass
class Pace:
    """How fast simulated time passed over some seconds."""

    seconds: float = 0.0  # real ones
    simulated: float = 0.0  # s
    cycles: int = 0  # control cycles done
    missed: int = 0  # control cycles left out

    @property
    def factor(self) -> float:
        """Simulated seconds a second."""
        return self.simulated / self.seconds

    def add(self, seconds: float, simulated: float, missed: int) -> None:
        """Add a control cycle."""
        self.seconds += seconds
        self.simulated += simulated
        self.cycles += 1
        self.missed += missed

    def __str__(self) -> str:
        all_cycles = self.cycles + self.missed
        return (
            f"real-time factor {self.factor:.2g} in the last {self.seconds:.0f} s, "
            f"{self.missed} of {all_cycles} control cycles missed"
        )


class PaceMeter:
    """Measures the pace of a control loop.

    Attributes:
        wanted: simulated seconds a second; 0 is as fast as possible.
    """

    def __init__(
        self,
        measured: Callable[[Pace, bool], None] = lambda pace, is_slow: None,
        log: Callable[[str, bool], None] = lambda text, is_slow: None,
    ) -> None:
        """Begin to measure; ``set`` has to follow.

        Args:
            measured: called about each second with the pace in it, and whether that is slow.
            log: called with a line for the log, and whether the pace is slow: once when it falls,
                and once when it is back.
        """
        self._measured, self._log = measured, log
        self._is_slow = False

    def set(self, due: float, wanted: float) -> None:
        """Measure anew, from the cycle due at ``due`` (monotonic, s) on."""
        self._due, self.wanted = due, wanted
        self._second, self._steady = Pace(), Pace()

    def skip(self, due: float) -> None:
        """Leave out the time until ``due``: simulated time was stopped on purpose."""
        self._due = due

    def cycle(self, due: float, simulated: float, missed: int) -> None:
        """Count a cycle of ``simulated`` s, after which ``missed`` ones were left out.

        ``due`` is when the next one is.
        """
        seconds, self._due = due - self._due, due
        self._second.add(seconds, simulated, missed)
        self._steady.add(seconds, simulated, missed)
        if self._second.seconds >= _SECOND:
            self._report()

    def _report(self) -> None:
        pace, self._second = self._second, Pace()
        is_slow = pace.factor < _SLOW * self.wanted
        self._measured(pace, is_slow)
        if pace.factor < _BACK * self.wanted:
            self._steady = Pace()
        if is_slow and not self._is_slow:
            self._is_slow = True
            self._log(f"slow motion: {pace}", True)
        elif self._is_slow and self._steady.seconds >= _STEADY:
            self._is_slow = False
            self._log(f"the pace is back: {self._steady}", False)
