"""Settings of a simulated world's physics."""

import math
from dataclasses import dataclass, replace

from onebot_description.errors import OneBotError


@dataclass(frozen=True)
class Settings:
    """Settings of the simulation; the defaults were determined by measurements."""

    # Physics steps per simulated second. A control period has to be a whole number of them, which
    # PyBullet's default of 240 is not at 100 Hz; ``fitted`` makes it one for any control rate.
    # 400 take twice as long. OneBot is as accurate with both; the odometry of tall robots with
    # arms (Stretch) is within 0.04 % of the truth, with 400 within 0.02 %.
    rate: float = 200.0
    # Of the constraint solver in each step. It never stops early, so that a robot at rest drifts by
    # nanometres instead of millimetres.
    iterations: int = 200
    gravity: float = 9.81  # m/s^2, downwards
    # Of the ground, and of links without <contact><lateral_friction> in the URDF; the friction of a
    # contact is the product of both.
    friction: float = 1.0
    # Maximum of simulated seconds for the robot to come to rest before it starts.
    settling: float = 2.0

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            OneBotError: a value is not finite, or not above zero.
        """
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0):
                raise OneBotError(f"simulation: {name} must be above 0 and finite, not {value}")
        if int(self.iterations) != self.iterations:
            raise OneBotError(f"simulation: iterations must be an integer, not {self.iterations}")

    def fitted(self, cycles: float) -> "Settings":
        """Return these settings for ``cycles`` control periods a second.

        Their rate is the least multiple of ``cycles`` that is no lower than this one.
        """
        return replace(self, rate=cycles * math.ceil(self.rate / cycles * (1.0 - 1e-9)))

    def steps(self, duration: float) -> int:
        """Return the number of physics steps in ``duration`` (s).

        Raises:
            ValueError: it is not a whole number of steps, or zero.
        """
        exact = duration * self.rate
        count = round(exact) if math.isfinite(exact) else 0
        if count < 1 or abs(exact - count) > 1e-6:
            raise ValueError(
                f"duration must be a whole number of physics steps of 1/{self.rate:g} s, "
                f"not {duration} s"
            )
        return count
