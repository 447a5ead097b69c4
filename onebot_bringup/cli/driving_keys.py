"""What each key of ``onebot teleop`` means, and how long a key counts as held. Pure.

A terminal tells when a key is pressed and, after a delay, that it is repeated; never that it is
let go. So the first press counts for as long as the delay may be, and as soon as repeats come, a
gap of a few of them means that the key was let go.
"""

from dataclasses import dataclass

# Key: forward, left, up, turn to the left; each -1, 0 or 1. As in teleop_twist_keyboard, whose
# reverse curves turn the way a car's steering wheel would be held.
_MOVES: dict[str, tuple[int, int, int, int]] = {
    "i": (1, 0, 0, 0),
    "o": (1, 0, 0, -1),
    "j": (0, 0, 0, 1),
    "l": (0, 0, 0, -1),
    "u": (1, 0, 0, 1),
    ",": (-1, 0, 0, 0),
    ".": (-1, 0, 0, 1),
    "m": (-1, 0, 0, -1),
    "O": (1, -1, 0, 0),
    "I": (1, 0, 0, 0),
    "J": (0, 1, 0, 0),
    "L": (0, -1, 0, 0),
    "U": (1, 1, 0, 0),
    "<": (-1, 0, 0, 0),
    ">": (-1, -1, 0, 0),
    "M": (-1, 1, 0, 0),
    "t": (0, 0, 1, 0),
    "b": (0, 0, -1, 0),
    "up": (1, 0, 0, 0),
    "down": (-1, 0, 0, 0),
    "left": (0, 0, 0, 1),
    "right": (0, 0, 0, -1),
}
# Key: factor on the speed, factor on the turning speed.
_SPEEDS: dict[str, tuple[float, float]] = {
    "q": (1.1, 1.1),
    "z": (0.9, 0.9),
    "w": (1.1, 1.0),
    "x": (0.9, 1.0),
    "e": (1.0, 1.1),
    "c": (1.0, 0.9),
}
_SHORTEST_HOLD = 0.2  # s; over a network repeats come in bursts
_REPEATS_MISSED = 4

HELP = """\
Reading from the keyboard and publishing {kind} on {topic}
---------------------------
Moving around, while a key is held:
   u    i    o
   j    k    l
   m    ,    .

Sideways (for robots that can), with Shift:
   U    I    O
   J    K    L
   M    <    >

t : up (+z)
b : down (-z)

anything else : stop

q/z : increase/decrease max speeds by 10%
w/x : increase/decrease only linear speed by 10%
e/c : increase/decrease only angular speed by 10%

CTRL-C or Esc to quit
"""


@dataclass(frozen=True)
class Velocity:
    """What to publish.

    Attributes:
        x: forward, m/s.
        y: to the left, m/s.
        z: up, m/s.
        turn: to the left, rad/s.
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    turn: float = 0.0


class Driver:
    """Turns keys into velocities over time.

    Attributes:
        speed: m/s while a key is held.
        turn: rad/s while a key is held.
    """

    def __init__(self, speed: float, turn: float, hold: float) -> None:
        """Start at rest.

        Args:
            speed: m/s.
            turn: rad/s.
            hold: seconds that one press counts for, until repeats come; longer than the delay of
                the keyboard's repetition.
        """
        self.speed, self.turn = speed, turn
        self._hold = hold
        self._key: str | None = None
        self._pressed = 0.0  # when the key last came
        self._until = 0.0  # when it counts as let go

    def press(self, key: str, now: float) -> None:
        """Note that a key came at ``now`` (seconds)."""
        if key in _SPEEDS:
            self.speed *= _SPEEDS[key][0]
            self.turn *= _SPEEDS[key][1]
        elif key not in _MOVES:
            self._key = None
        else:
            repeated = key == self._key and now < self._until
            interval = now - self._pressed
            self._key, self._pressed = key, now
            self._until = now + (self._hold_after(interval) if repeated else self._hold)

    def _hold_after(self, interval: float) -> float:
        """How long a repeat counts. The first repeat, after the long delay, counts like it."""
        return min(self._hold, max(_SHORTEST_HOLD, _REPEATS_MISSED * interval))

    def moving(self, now: float) -> bool:
        """Say if a key is held that moves the robot."""
        if self._key is not None and now >= self._until:
            self._key = None
        return self._key is not None

    def velocity(self, now: float) -> Velocity:
        """Return what to publish at ``now``: zero when no key is held."""
        if not self.moving(now) or self._key is None:
            return Velocity()
        x, y, z, turn = _MOVES[self._key]
        return Velocity(x * self.speed, y * self.speed, z * self.speed, turn * self.turn)

    def status(self) -> str:
        """Return the speeds as teleop_twist_keyboard shows them."""
        return f"currently:\tspeed {self.speed:.3g}\tturn {self.turn:.3g} "
