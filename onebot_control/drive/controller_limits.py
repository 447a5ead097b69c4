"""The limits of a controller of a drive, read from its parameters.

They are named as in diff_drive_controller and mecanum_drive_controller; the set of parameters shows
what the drive can do.
"""

import dataclasses
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import inf, tan
from typing import Any

from onebot_control.drive.speed_limiter import SpeedLimits
from onebot_description.parameters.reader import ConfigError, read

_AXES = "linear.x", "angular.z", "linear.y"  # the order of Velocity
_NAMES = tuple(field.name for field in dataclasses.fields(SpeedLimits))
_OMNI = {"robot_radius", "wheel_names"}  # parameters of omni_wheel_drive_controller
_STEERING = {"steering_joints_names", "steering_joint_name"}  # a steered drive has one of them
_LENGTHS = "wheelbase", "minimum_turning_radius"  # lengths of a steered drive, m
_STEERING_LIMIT = 0.5  # rad; assumed if the minimum radius is not known
PREFIXES = *_AXES, *_OMNI, *_STEERING, *_LENGTHS
"""The parameters of a controller that are read here, or the prefixes of their names."""
NAMES = frozenset(f"{axis}.{name}" for axis in _AXES for name in _NAMES).union(PREFIXES[3:])
"""The parameters of a controller that are read here."""


@dataclass(frozen=True)
class ControllerLimits:
    """The limits in a controller's parameters."""

    node: str  # full name
    linear: SpeedLimits = SpeedLimits()
    angular: SpeedLimits = SpeedLimits()
    lateral: SpeedLimits | None = None  # None: it does not drive sideways
    minimum_radius: float = 0.0  # minimum turning radius, m; 0: it turns on the spot

    @classmethod
    def from_parameters(cls, node: str, values: Mapping[str, Any]) -> "ControllerLimits | None":
        """Return the controller with these parameters; None if they do not belong to one.

        An impossible limit, for example with the wrong sign, is ignored.

        Args:
            node: the node's full name.
            values: its parameters by name.
        """
        limits = [_speed_limits(axis, values) for axis in _AXES]
        strafes = "linear.y.max_velocity" in values or values.keys() >= _OMNI
        radius = _minimum_radius(values)
        if not (strafes or radius or any("max_velocity" in axis for axis in limits)):
            return None
        linear, angular, lateral = (SpeedLimits(**axis) for axis in limits)
        return cls(node, linear, angular, lateral if strafes else None, 0.0 if strafes else radius)


def _speed_limits(axis: str, values: Mapping[str, Any]) -> dict[str, Any]:
    limits = {}
    for name in _NAMES:
        with suppress(KeyError, ConfigError):  # not given, or impossible
            value = values[f"{axis}.{name}"]
            read(SpeedLimits, {name: value})
            limits[name] = value
    return limits


def _minimum_radius(values: Mapping[str, Any]) -> float:
    """Return the minimum radius of a steered drive, m; 0 for any other drive."""
    if values.keys().isdisjoint(_STEERING):
        return 0.0
    wheelbase, radius = (_length(values.get(name)) for name in _LENGTHS)
    return radius or wheelbase / tan(_STEERING_LIMIT)


def _length(value: Any) -> float:
    return value if isinstance(value, int | float) and 0.0 < value < inf else 0.0
