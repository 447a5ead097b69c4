"""The paths that are driven: what is commanded, for how long."""

import math
from typing import NamedTuple

LINEAR = 0.2  # m/s
ANGULAR = 0.5  # rad/s
_CROSSING = 0.5  # s
_REST = 1.0  # s, long enough for OneBot's limiter to stop


class Segment(NamedTuple):
    """A command held for a while.

    Attributes:
        linear: m/s, forward.
        angular: rad/s, to the left.
        duration: s.
    """

    linear: float
    angular: float
    duration: float

    def cycles(self, period: float) -> int:
        """Control cycles of ``period`` seconds it takes, the last one whole."""
        return math.ceil(self.duration / period - 1e-9)

    def command(self, period: float) -> tuple[float, float]:
        """Linear and angular velocity that cover the same way in whole cycles.

        They are slower by less than a cycle's share. A limiter that brakes as it accelerates does
        not change the way covered: what is missing at one end comes at the other.
        """
        share = self.duration / (self.cycles(period) * period)
        return self.linear * share, self.angular * share


class Path(NamedTuple):
    """Segments driven one after the other, from rest.

    Attributes:
        name: for the table.
        segments: what is commanded.
        turning: a turn on the spot, whose error is one of heading, not of place.
    """

    name: str
    segments: tuple[Segment, ...]
    turning: bool = False


def straight(way: float, speed: float = LINEAR) -> tuple[Segment, ...]:
    """``way`` metres ahead, then rest."""
    return Segment(speed, 0.0, way / speed), Segment(0.0, 0.0, _REST)


def turn(angle: float, speed: float = ANGULAR) -> tuple[Segment, ...]:
    """``angle`` radians to the left on the spot, then rest."""
    return Segment(0.0, speed, angle / speed), Segment(0.0, 0.0, _REST)


def eight(radius: float, speed: float = LINEAR) -> tuple[Segment, ...]:
    """A circle to the left, a little straight on, and a circle to the right without a stop."""
    rate = speed / radius
    once_round = 2.0 * math.pi / rate
    return (
        Segment(speed, rate, once_round),
        # Long enough for the limiter to straighten out; without it the circles would not close.
        Segment(speed, 0.0, _CROSSING),
        Segment(speed, -rate, once_round),
        Segment(0.0, 0.0, _REST),
    )


PATHS = (
    Path("2 m straight at 0.2 m/s", straight(2.0)),
    Path("360° turn at 0.5 rad/s", turn(2.0 * math.pi), turning=True),
    Path("square of 1 m", (*straight(1.0), *turn(math.pi / 2.0)) * 4),
    Path("figure of eight, 2 circles of 1 m", eight(0.5)),
)
