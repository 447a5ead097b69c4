"""Limits of velocity, acceleration and jerk, as in ros2_control's diff_drive_controller."""

import math
from dataclasses import dataclass
from typing import Any

from onebot_description.geometry.poses import clamp
from onebot_description.parameters.reader import parameter

_UNSET = math.nan
_LIMITS = {
    "velocity": ("min_velocity", "max_velocity"),
    "acceleration": (
        *("max_acceleration", "max_deceleration"),
        *("max_acceleration_reverse", "max_deceleration_reverse"),
    ),
    "jerk": ("min_jerk", "max_jerk"),
}


def _positive(description: str) -> Any:
    return parameter(_UNSET, description, at_least=0.0, nan="no limit")


def _negative(description: str, unset: str) -> Any:
    return parameter(_UNSET, description, at_most=0.0, nan=unset)


def _switch(kind: str) -> Any:
    return parameter(True, f"false: no {kind} limit, as in older versions")


@dataclass(frozen=True)
class SpeedLimits:
    """Velocity, acceleration and jerk limits of linear.x or angular.z, in m or rad and s.

    NaN means "not given". A stage without its ``max_...`` does nothing. A missing minimum is minus
    the maximum; a missing deceleration is the acceleration of the same sign.
    """

    min_velocity: float = _negative("maximum reverse velocity, m/s or rad/s", "minus max_velocity")
    max_velocity: float = _positive("maximum forward velocity, m/s or rad/s")
    max_deceleration: float = _negative(
        "deceleration of forward motion, m/s2 or rad/s2", "max_acceleration_reverse"
    )
    max_acceleration: float = _positive("acceleration of forward motion, m/s2 or rad/s2")
    max_deceleration_reverse: float = _positive("deceleration of reverse motion, m/s2 or rad/s2")
    max_acceleration_reverse: float = _negative(
        "acceleration of reverse motion, m/s2 or rad/s2", "minus max_acceleration"
    )
    min_jerk: float = _negative("minimum jerk, m/s3 or rad/s3", "minus max_jerk")
    max_jerk: float = _positive("maximum jerk, m/s3 or rad/s3")

    # Parameters of older versions.
    min_acceleration: float = _negative("older name of max_deceleration", "not given")
    has_velocity_limits: bool = _switch("velocity")
    has_acceleration_limits: bool = _switch("acceleration")
    has_jerk_limits: bool = _switch("jerk")

    def __post_init__(self) -> None:
        """Apply the parameters of older versions to the others."""
        if math.isnan(self.max_deceleration):
            object.__setattr__(self, "max_deceleration", self.min_acceleration)
        for kind, limits in _LIMITS.items():
            if not getattr(self, f"has_{kind}_limits"):
                for limit in limits:
                    object.__setattr__(self, limit, _UNSET)


class SpeedLimiter:
    """Keeps the commands of linear.x or angular.z within limits."""

    def __init__(self, limits: SpeedLimits) -> None:
        """Fill in the limits that are not given."""
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

    @property
    def deceleration(self) -> float:
        """The guaranteed deceleration to rest, the smaller of both directions; NaN if unlimited."""
        if not self._limits_acceleration:
            return math.nan
        return min(-self._forward[0], self._backward[1])

    @property
    def braking_jerk(self) -> float:
        """The jerk with which a deceleration can start in either direction; NaN if unlimited."""
        return min(-self._jerk[0], self._jerk[1]) if self._limits_jerk else math.nan

    def limit(self, command: float, last: float, before_last: float, dt: float) -> float:
        """Return the closest command within the limits.

        Args:
            command: the desired velocity, m/s or rad/s.
            last: the last limited command (never a measurement), m/s or rad/s.
            before_last: the limited command before that, m/s or rad/s.
            dt: seconds between two commands.
        """
        if self._limits_jerk:
            command = self._limit_jerk(command, last, before_last, dt)
        if self._limits_acceleration:
            lower, upper = self._acceleration(last)
            command = last + clamp(command - last, lower * dt, upper * dt)
        if self._limits_velocity:
            command = clamp(command, *self._velocity)
        return command

    def _limit_jerk(self, command: float, last: float, before_last: float, dt: float) -> float:
        change, last_change = command - last, last - before_last
        # Limit jerk only where it makes the change faster; it must never delay coming to rest.
        if (change - last_change) * change <= 0.0:
            return command
        lower, upper = self._jerk
        return last + last_change + clamp(change - last_change, lower * dt * dt, upper * dt * dt)

    def _acceleration(self, last: float) -> tuple[float, float]:
        if last > 0.0:
            return self._forward
        return self._backward if last < 0.0 else self._from_rest


def _given(value: float, otherwise: float) -> float:
    return otherwise if math.isnan(value) else value
