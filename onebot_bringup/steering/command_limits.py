"""The limits of commands: an operator's choice, within what the robot's controllers allow.

If several controllers subscribe to one topic, the strictest limits apply, since each gets every
command.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from typing import NamedTuple

from onebot_bringup.steering.protocol import SetLimits, Velocity
from onebot_control.drive.controller_limits import ControllerLimits
from onebot_control.drive.speed_limiter import SpeedLimiter, SpeedLimits
from onebot_description.geometry.poses import clamp

# Limits if the robot's are unknown: brisk indoors, and far below what a typing error commands.
UNKNOWN = Velocity(2.0, 4.0, 2.0)
DEFAULT = Velocity(1.0, 2.0, 1.0)  # initial limits in that case
_NONE = Velocity()


@dataclass(frozen=True)
class Bound:
    """The limits of the speed along an axis, m/s or rad/s; zero if the drive does not have it."""

    forward: float  # speed forward, or to the left
    reverse: float  # speed backward, or to the right
    initial: float  # the limit until an operator chooses another
    # The controller's full name, or the name of the page's parameter; "" if no limit is known.
    source: str = ""


class CommandRange(NamedTuple):
    """The range of allowed commands."""

    forward: Velocity  # speeds forward and to the left
    reverse: Velocity  # speeds backward and to the right; positive
    minimum_radius: float = 0.0  # turning radius, m

    def within(self, other: "CommandRange") -> "CommandRange":
        """Return the commands in both ranges."""
        return CommandRange(
            self.forward.at_most(other.forward),
            self.reverse.at_most(other.reverse),
            max(self.minimum_radius, other.minimum_radius),
        )

    def clamp(self, command: Velocity) -> Velocity:
        """Return the fastest command in the range along the same arc, or the tightest possible."""
        if self.minimum_radius:
            turn = abs(command.linear) / self.minimum_radius
            command = command._replace(angular=clamp(command.angular, -turn, turn))
        return command.clamped(Velocity(*(-speed for speed in self.reverse)), self.forward)


@dataclass(frozen=True)
class Limits:
    """The limits of commands: the robot's, and those that an operator chose."""

    linear: Bound
    angular: Bound
    lateral: Bound = Bound(0.0, 0.0, 0.0)
    minimum_radius: float = 0.0  # turning radius, m; 0: the robot turns on the spot
    chosen: SetLimits = SetLimits()  # an operator's choice

    @property
    def bounds(self) -> Mapping[str, Bound]:
        """The robot's limits by the names of the axes, in the order of ``Velocity``."""
        return {axis: getattr(self, axis) for axis in Velocity._fields}

    @property
    def in_force(self) -> Velocity:
        """The current limits of commands, forward and to the left."""
        bounds = self.bounds.items()
        return Velocity(*(_in_force(bound, getattr(self.chosen, axis)) for axis, bound in bounds))

    @property
    def range(self) -> CommandRange:
        """The commands within the limits."""
        forward, reverse = self.in_force, Velocity(*(b.reverse for b in self.bounds.values()))
        return CommandRange(forward, forward.at_most(reverse), self.minimum_radius)


def _in_force(bound: Bound, chosen: float | None) -> float:
    return min(bound.initial if chosen is None else chosen, bound.forward)


def limits_of(controllers: Sequence[ControllerLimits], fixed: Velocity = _NONE) -> Limits:
    """Return the strictest limits of all ``controllers`` and of the page's parameters.

    Args:
        controllers: the controllers on the command topic.
        fixed: the page's parameters, 0 for none; ``max_linear`` is a limit sideways, too.
    """
    lateral = {c.node: c.lateral for c in controllers if c.lateral is not None}
    return Limits(
        _bound("linear", {c.node: c.linear for c in controllers}, "max_linear", fixed),
        _bound("angular", {c.node: c.angular for c in controllers}, "max_angular", fixed),
        _bound("lateral", lateral, "max_linear", fixed) if lateral else Limits.lateral,
        max((c.minimum_radius for c in controllers), default=0.0),
    )


def _bound(
    axis: str, controllers: Mapping[str, SpeedLimits], parameter: str, fixed: Velocity
) -> Bound:
    speeds = {node: speed for node, speed in controllers.items() if not isnan(speed.max_velocity)}
    limits = [(speed.max_velocity, node) for node, speed in speeds.items()]
    if forward := getattr(fixed, axis):
        limits.append((forward, parameter))
    if not limits:
        unknown = getattr(UNKNOWN, axis)
        return Bound(unknown, unknown, getattr(DEFAULT, axis))
    forward, source = min(limits)
    reverse = [-speed.min_velocity for speed in speeds.values() if not isnan(speed.min_velocity)]
    return Bound(forward, min([forward, *reverse]), forward, source)


def braking_of(limits: Iterable[SpeedLimits | None]) -> dict[str, float | None] | None:
    """Return the braking along an axis of the controller that brakes last.

    Args:
        limits: each controller's limits of that axis; None: it does not have the axis.

    Returns:
        The ``deceleration`` in m/s2 and the ``jerk`` in m/s3, None if not limited; None if no
        controller has the axis.
    """
    limiters = [SpeedLimiter(speed_limits) for speed_limits in limits if speed_limits is not None]
    if not limiters:
        return None
    return {
        "deceleration": _least(limiter.deceleration for limiter in limiters),
        "jerk": _least(limiter.braking_jerk for limiter in limiters),
    }


def _least(values: Iterable[float]) -> float | None:
    return min((value for value in values if not isnan(value)), default=None)
