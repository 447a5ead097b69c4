"""Measures the real-time factor of a control loop, and detects when it falls and recovers."""

from dataclasses import dataclass

_SECOND = 1.0
# Fractions of the wanted factor: slow motion is logged after a second below _SLOW, and its end
# after _STEADY seconds that all reached _BACK.
_SLOW, _BACK = 0.9, 0.95
_STEADY = 5.0  # s


@dataclass
class Pace:
    """The real-time factor and missed cycles over some seconds."""

    seconds: float = 0.0  # real time, s
    simulated: float = 0.0  # simulated time, s
    cycles: int = 0  # number of executed control cycles
    missed: int = 0  # number of missed control cycles

    @property
    def factor(self) -> float:
        """Simulated seconds per real second."""
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
    """Measures the pace of a control loop, and reports it each second.

    Attributes:
        wanted: simulated seconds per real second; 0: as fast as possible.
    """

    _is_slow = False  # last logged state

    def measured(self, pace: Pace, *, is_slow: bool) -> None:
        """Report the pace of about a second; implemented by subclasses."""

    def log(self, text: str, *, is_slow: bool) -> None:
        """Log a line when the pace falls, and when it has recovered; implemented by subclasses."""

    def set(self, due: float, wanted: float) -> None:
        """Start measuring at the cycle due at ``due`` (monotonic, s), for a wanted factor."""
        self._due, self.wanted = due, wanted
        self._second, self._steady = Pace(), Pace()

    def skip(self, due: float) -> None:
        """Ignore the time until ``due`` (monotonic, s), as simulated time was paused."""
        self._due = due

    def cycle(self, due: float, simulated: float, missed: int) -> None:
        """Count a control cycle.

        Args:
            due: time at which the next cycle is due, monotonic, s.
            simulated: simulated duration of the cycle, s.
            missed: number of missed cycles after it.
        """
        seconds, self._due = due - self._due, due
        self._second.add(seconds, simulated, missed)
        self._steady.add(seconds, simulated, missed)
        if self._second.seconds >= _SECOND:
            self._report()

    def _report(self) -> None:
        pace, self._second = self._second, Pace()
        is_slow = pace.factor < _SLOW * self.wanted
        self.measured(pace, is_slow=is_slow)
        if pace.factor < _BACK * self.wanted:
            self._steady = Pace()
        if is_slow and not self._is_slow:
            self._is_slow = True
            self.log(f"slow motion: {pace}", is_slow=True)
        elif self._is_slow and self._steady.seconds >= _STEADY:
            self._is_slow = False
            self.log(f"the pace is back: {self._steady}", is_slow=False)
