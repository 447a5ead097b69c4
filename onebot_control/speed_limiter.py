"""Limits of velocity, acceleration and jerk, as ros2_control's diff_drive_controller has them."""

import math
from dataclasses import dataclass

_UNSET = math.nan


@dataclass(frozen=True)
class SpeedLimits:
    """Limits of one direction of motion; NaN is "not given". Units: m or rad, and seconds.

    A stage whose ``max_...`` is not given does nothing. A minimum not given is minus the maximum;
    a deceleration not given is the acceleration of the same sign.

    Attributes:
        min_velocity: <= 0.
        max_velocity: >= 0.
        max_deceleration: <= 0; slows down forward motion.
        max_acceleration: >= 0; speeds up forward motion.
        max_deceleration_reverse: >= 0; slows down backward motion.
        max_acceleration_reverse: <= 0; speeds up backward motion.
        min_jerk: <= 0.
        max_jerk: >= 0.
    """

    min_velocity: float = _UNSET
    max_velocity: float = _UNSET
    max_deceleration: float = _UNSET
    max_acceleration: float = _UNSET
    max_deceleration_reverse: float = _UNSET
    max_acceleration_reverse: float = _UNSET
    min_jerk: float = _UNSET
    max_jerk: float = _UNSET

    def problems(self) -> list[tuple[str, str]]:
        """Return what is wrong, as (name of the limit, what would be right)."""
        found = [
            (name, f"{value} is below 0; write 0.0 or more, or .nan for no limit")
            for name in POSITIVE
            if (value := getattr(self, name)) < 0.0
        ]
        found += [
            (name, f"{value} is above 0; write 0.0 or less, or .nan for {unset}")
            for name, unset in NEGATIVE.items()
            if (value := getattr(self, name)) > 0.0
        ]
        return found


POSITIVE = ("max_velocity", "max_acceleration", "max_deceleration_reverse", "max_jerk")
NEGATIVE = {
    "min_velocity": "minus max_velocity",
    "max_deceleration": "max_acceleration_reverse",
    "max_acceleration_reverse": "minus max_acceleration",
    "min_jerk": "minus max_jerk",
}
NAMES = (*POSITIVE, *NEGATIVE)


class SpeedLimiter:
    """Keeps commands of one direction of motion within limits."""

    def __init__(self, limits: SpeedLimits) -> None:
        """Work out what was not given.

        Raises:
            ValueError: a limit has the wrong sign.
        """
        if problems := limits.problems():
            raise ValueError("; ".join(f"{name}: {text}" for name, text in problems))
        speed_up = limits.max_acceleration
        speed_up_reverse = _given(limits.max_acceleration_reverse, -speed_up)
        slow_down = _given(limits.max_deceleration, speed_up_reverse)
        slow_down_reverse = _given(limits.max_deceleration_reverse, speed_up)
        self._forward = (slow_down, speed_up)
        self._backward = (speed_up_reverse, slow_down_reverse)
        self._from_rest = (speed_up_reverse, speed_up)
        self._velocity = (_given(limits.min_velocity, -limits.max_velocity), limits.max_velocity)
        self._jerk = (_given(limits.min_jerk, -limits.max_jerk), limits.max_jerk)
        self._limits_acceleration = not math.isnan(speed_up)
        self._limits_velocity = not math.isnan(limits.max_velocity)
        self._limits_jerk = not math.isnan(limits.max_jerk)

    def limit(self, command: float, last: float, before_last: float, dt: float) -> float:
        """Return the nearest command that is within the limits.

        Args:
            command: what is wanted, m/s or rad/s.
            last: the last limited command (never a measurement).
            before_last: the limited command before it.
            dt: seconds between two commands.
        """
        if self._limits_jerk:
            command = self._limit_jerk(command, last, before_last, dt)
        if self._limits_acceleration:
            lower, upper = self._acceleration(last)
            command = last + _clamp(command - last, lower * dt, upper * dt)
        if self._limits_velocity:
            command = _clamp(command, *self._velocity)
        return command

    def _limit_jerk(self, command: float, last: float, before_last: float, dt: float) -> float:
        change, last_change = command - last, last - before_last
        # Only where it speeds up the change: a jerk towards rest must never lengthen it.
        if (change - last_change) * change <= 0.0:
            return command
        lower, upper = self._jerk
        return last + last_change + _clamp(change - last_change, lower * dt * dt, upper * dt * dt)

    def _acceleration(self, last: float) -> tuple[float, float]:
        if last > 0.0:
            return self._forward
        return self._backward if last < 0.0 else self._from_rest


def _given(value: float, otherwise: float) -> float:
    return otherwise if math.isnan(value) else value


def _clamp(value: float, lower: float, upper: float) -> float:
    return min(max(value, lower), upper)
