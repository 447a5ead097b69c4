"""Who drives: of several pages, the last one to take hold; and nobody who does not say so."""

from dataclasses import dataclass

from onebot_bringup.steering.protocol import Velocity

DEAD_MAN = 0.25  # s without a word from the driver until the robot is stopped
GRIP = 1.0  # s without a word until the driver has to let go and take hold again
ZEROS = 3  # commands of zero that follow the last one, in case one gets lost


@dataclass
class _Page:
    holding: bool = False  # it has taken hold and not let go, whether it drives or not


class Arbiter:
    """Turns what pages say into commands. Pure: the time is always handed in, in seconds.

    A page that lost the wheel, for whatever reason, has to let go before it can take hold again.

    Attributes:
        driver: the page that drives; None if none does.
        limits: the most that is commanded.
        lapses: how often a driver fell silent while it held the wheel.
        stops: how often the stop button was pressed.
        moving: the robot is being told to move, if only at a speed of zero.
    """

    def __init__(self, limits: Velocity) -> None:
        """Start without pages."""
        self.limits = limits
        self.driver: str | None = None
        self.lapses = 0
        self.stops = 0
        self.moving = False
        self._pages: dict[str, _Page] = {}
        self._wanted = Velocity()
        self._heard = 0.0
        self._zeros = 0

    @property
    def pages(self) -> int:
        """How many there are."""
        return len(self._pages)

    @property
    def command(self) -> Velocity:
        """What the robot is told now."""
        return self._wanted.clamped(self.limits) if self.moving else Velocity()

    @property
    def busy(self) -> bool:
        """There is something left to publish."""
        return self.moving or self._zeros > 0

    def join(self, page: str) -> None:
        """A page was opened."""
        self._pages[page] = _Page()

    def leave(self, page: str) -> None:
        """A page was closed, or its connection lost."""
        self._drop(page)
        self._pages.pop(page, None)

    def drive(self, page: str, velocity: Velocity, now: float) -> None:
        """A page holds something; the first time after letting go, it takes the wheel."""
        known = self._pages[page]
        if not known.holding:
            known.holding = True
            if self.driver is not None:
                self._halt()  # nothing of the last driver's is left over
            self.driver = page
        if self.driver == page:
            self._wanted, self._heard, self.moving, self._zeros = velocity, now, True, ZEROS

    def release(self, page: str) -> None:
        """A page let go."""
        self._drop(page)
        self._pages[page].holding = False

    def stop(self) -> None:
        """Stop, whoever drives; also when nobody does."""
        self.stops += 1
        self.driver = None
        self._halt()
        self._zeros = ZEROS

    def refuse(self, page: str) -> None:
        """A page said what it must not: it loses the wheel."""
        self._drop(page)
        self._pages[page].holding = True

    def watch(self, now: float) -> None:
        """Stop the robot when its driver has fallen silent."""
        silence = now - self._heard
        if self.moving and silence > DEAD_MAN:
            self._halt()
            self.lapses += 1
        if self.driver is not None and silence > GRIP:
            self.driver = None

    def take(self) -> Velocity | None:
        """Return the command to publish now; None if there is nothing to say."""
        if self.moving:
            return self.command
        if self._zeros > 0:
            self._zeros -= 1
            return Velocity()
        return None

    def _drop(self, page: str) -> None:
        if self.driver == page:
            self.driver = None
            self._halt()

    def _halt(self) -> None:
        self._wanted, self.moving = Velocity(), False
