"""The limits of commands: an operator's choice, within what the robot's controllers allow.

A controller's limits are its parameters, named like those of diff_drive_controller. If several
controllers subscribe to one topic, the strictest limits apply, since each gets every command.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import isnan
from typing import Any, NamedTuple

from onebot_bringup.steering.protocol import SetLimits, Velocity
from onebot_control.drive.speed_limiter import SpeedLimiter, SpeedLimits
from onebot_description.parameters.reader import ConfigError, read

# Limits if none of the robot is known: brisk indoors, and far from what a typing error commands.
UNKNOWN = Velocity(2.0, 4.0)
DEFAULT = Velocity(1.0, 2.0)  # initial limits in that case
_NONE = Velocity()
AXES = "linear.x", "angular.z"
_NAMES = tuple(field.name for field in dataclasses.fields(SpeedLimits))
NAMES = frozenset(f"{axis}.{name}" for axis in AXES for name in _NAMES)
"""The parameters of a controller that are read here."""


@dataclass(frozen=True)
class Controller:
    """The limits in a controller's parameters."""

    node: str  # full name
    linear: SpeedLimits = SpeedLimits()
    angular: SpeedLimits = SpeedLimits()

    @classmethod
    def from_parameters(cls, node: str, values: Mapping[str, Any]) -> "Controller | None":
        """Return the controller with these parameters; None if they are not a controller's.

        An impossible limit, such as one of the wrong sign, is ignored.

        Args:
            node: the node's full name.
            values: its parameters by name.
        """
        linear, angular = (_speed_limits(axis, values) for axis in AXES)
        if "max_velocity" not in linear and "max_velocity" not in angular:
            return None
        return cls(node, SpeedLimits(**linear), SpeedLimits(**angular))


def _speed_limits(axis: str, values: Mapping[str, Any]) -> dict[str, Any]:
    limits = {}
    for name in _NAMES:
        with suppress(KeyError, ConfigError):  # not given, or impossible
            value = values[f"{axis}.{name}"]
            read(SpeedLimits, {name: value})
            limits[name] = value
    return limits


@dataclass(frozen=True)
class Bound:
    """The limits of the linear or the angular speed, m/s or rad/s."""

    most: float  # forward, or to the left
    reverse: float  # backward, or to the right
    initial: float  # the limit until an operator chooses another
    # The controller's full name, or the name of the page's parameter; "" if no limit is known.
    source: str = ""


class CommandRange(NamedTuple):
    """The range of allowed commands."""

    most: Velocity  # forward, and to the left
    reverse: Velocity  # backward, and to the right; positive

    def within(self, other: "CommandRange") -> "CommandRange":
        """Return the commands in both ranges."""
        return CommandRange(self.most.at_most(other.most), self.reverse.at_most(other.reverse))

    def clamp(self, command: Velocity) -> Velocity:
        """Return the fastest command in the range along the same arc."""
        return command.clamped(Velocity(-self.reverse.linear, -self.reverse.angular), self.most)


@dataclass(frozen=True)
class Limits:
    """The limits of commands: the robot's, and those that an operator chose."""

    linear: Bound
    angular: Bound
    chosen: SetLimits = SetLimits()  # an operator's choice

    @property
    def in_force(self) -> Velocity:
        """The current limits of commands, forward and to the left."""
        return Velocity(
            _in_force(self.linear, self.chosen.linear), _in_force(self.angular, self.chosen.angular)
        )

    @property
    def range(self) -> CommandRange:
        """The commands within the limits."""
        most = self.in_force
        return CommandRange(most, most.at_most(Velocity(self.linear.reverse, self.angular.reverse)))


def _in_force(bound: Bound, chosen: float | None) -> float:
    return min(bound.initial if chosen is None else chosen, bound.most)


def limits_of(controllers: Sequence[Controller], fixed: Velocity = _NONE) -> Limits:
    """Return the strictest limits of all ``controllers`` and of the page's parameters.

    Args:
        controllers: the controllers on the command topic.
        fixed: the page's parameters, 0 for none.
    """
    linear = _bound({c.node: c.linear for c in controllers}, "max_linear", fixed.linear)
    angular = _bound({c.node: c.angular for c in controllers}, "max_angular", fixed.angular)
    return Limits(
        linear or Bound(UNKNOWN.linear, UNKNOWN.linear, DEFAULT.linear),
        angular or Bound(UNKNOWN.angular, UNKNOWN.angular, DEFAULT.angular),
    )


def _bound(controllers: Mapping[str, SpeedLimits], parameter: str, fixed: float) -> Bound | None:
    speeds = {node: speed for node, speed in controllers.items() if not isnan(speed.max_velocity)}
    limits = [(speed.max_velocity, node) for node, speed in speeds.items()]
    if fixed:
        limits.append((fixed, parameter))
    if not limits:
        return None
    most, source = min(limits)
    reverse = [-speed.min_velocity for speed in speeds.values() if not isnan(speed.min_velocity)]
    return Bound(most, min([most, *reverse]), most, source)


@dataclass(frozen=True)
class Braking:
    """How the robot brakes when it is commanded to stop; None if not limited."""

    deceleration: float | None  # m/s2
    jerk: float | None  # m/s3


def braking_of(controllers: Iterable[Controller]) -> Braking | None:
    """Return the braking of the controller that brakes last; None without a controller."""
    limiters = [SpeedLimiter(controller.linear) for controller in controllers]
    if not limiters:
        return None
    return Braking(
        _least(limiter.deceleration for limiter in limiters),
        _least(limiter.braking_jerk for limiter in limiters),
    )


def _least(values: Iterable[float]) -> float | None:
    return min((value for value in values if not isnan(value)), default=None)
