"""The wheels of drives that move sideways, too: mecanum and omni wheels, with rollers."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from onebot_control.conventions import CORNERS
from onebot_control.drive.wheels.geometry import Wheels
from onebot_description.arrays import Floats
from onebot_description.elements.urdf import Description
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import Triple

_SLANT = math.pi / 4.0  # rad; slant of rollers, unless the description says otherwise


def _row(middle: Floats, forward: float, roller: float) -> Triple:
    """Return the path of a wheel for each motion of the body; see ``HolonomicKinematics``.

    The wheel grips in the direction of the roller's axle, in which the contact point moves with the
    velocity of the wheel's rim.

    Args:
        middle: center of the wheel, (3,), m.
        forward: the wheel's direction of travel, rad to the left of the robot's.
        roller: direction of the roller's axle, rad to the left of the wheel's direction.
    """
    x, y = math.cos(forward + roller), math.sin(forward + roller)
    grip = math.cos(roller)
    return x / grip, y / grip, float(middle[0] * y - middle[1] * x) / grip


class MecanumWheels(Wheels):
    """The wheels of a mecanum drive: front left, front right, rear right, rear left.

    Attributes:
        corners: the joints of the wheels at each of these corners.
        rows: how the wheels turn for each motion of the body; see ``HolonomicKinematics``.
    """

    def __init__(self, description: Description, names: Sequence[str] = ()) -> None:
        """Use the named wheels, or find the wheels if none are named.

        Args:
            description: the robot.
            names: joints of the wheels, one for each corner in that order.

        Raises:
            OneBotError: a named joint is missing or its axis is not lateral, or no wheels are
                found.
        """
        super().__init__(description)
        plugin = description.drive_plugin
        if names:
            self.check_names(wheel_names=names)
            corners = [[name] for name in names]
        elif plugin and plugin.kind == "mecanum" and all(map(plugin.joints.get, CORNERS)):
            corners = [list(plugin.joints[corner]) for corner in CORNERS]
        else:
            corners = self._corners(*self.gear.sides(rollers=True))
        self.corners = corners
        self.groups = [[name] for corner in corners for name in corner]
        self.check_across()
        signs = (-1.0, 1.0, -1.0, 1.0)
        self.rollers = {
            name: self._slant(name, sign * _SLANT)
            for corner, sign in zip(corners, signs, strict=True)
            for name in corner
        }
        self.rows = [_row(self.middle(name), 0.0, self.rollers[name]) for name in self.names]

    def _corners(self, left: Sequence[str], right: Sequence[str]) -> list[list[str]]:
        """Return the wheels at each corner."""
        places = {name: float(self.middle(name)[0]) for name in (*left, *right)}
        between = float(np.mean([*places.values()]))
        front, rear = (
            {name for name, x in places.items() if (x > between) == ahead}
            for ahead in (True, False)
        )
        corners = [
            [name for name in side if name in end]
            for side, end in ((left, front), (right, front), (right, rear), (left, rear))
        ]
        if not all(corners):
            raise OneBotError(
                f'robot "{self.description.robot_name}" cannot be driven: a mecanum drive has '
                f"wheels at four corners, but this robot has {', '.join(places)}"
            )
        return corners

    def _slant(self, name: str, usual: float) -> float:
        """Return the direction of a wheel's roller from the description, or else ``usual``."""
        first, rollers = self.axles[name].joint.child, self.description.rollers
        written = (angle for link, angle in rollers.items() if self.rigid[link][0] == first)
        return next(written, usual)


class OmniWheels(Wheels):
    """Omni wheels, whose rollers turn across the wheel; anticlockwise from forward.

    Attributes:
        rows: how the wheels turn for each motion of the body; see ``HolonomicKinematics``.
    """

    def __init__(self, description: Description, names: Sequence[str] = ()) -> None:
        """Use the named wheels, or find the wheels if none are named.

        Args:
            description: the robot.
            names: joints of the wheels.

        Raises:
            OneBotError: a named joint is missing, or its axis is not level, or no wheels are found.
        """
        super().__init__(description)
        self.check_names(wheel_names=names)
        for name in names:
            if not self.axles[name].level:
                raise OneBotError(
                    f'robot "{description.robot_name}", joint "{name}": the axis of a wheel must '
                    "be level"
                )
        found_names = [wheel.name for wheel in self.gear.omni]
        self._middles = {name: self.middle(name) for name in names or found_names}
        if not self._middles:
            reason = "it has no three omni wheels on the ground; name its wheels in wheel_names"
            raise OneBotError(f'robot "{description.robot_name}" cannot be driven: {reason}')
        names = names or sorted(self._middles, key=self._direction)
        self.groups = [[name] for name in names]
        self.rollers = dict.fromkeys(names, 0.0)
        self.rows = [_row(self.middle(name), self._forward(name), 0.0) for name in names]

    @cached_property
    def directions(self) -> Mapping[str, float]:
        """1 if a joint's axis points outward, as in omni_wheel_drive_controller, otherwise -1."""
        return {
            name: 1.0 if float(self.axles[name].axis @ self._outward(name)) >= 0.0 else -1.0
            for name in self.names
        }

    @cached_property
    def _center(self) -> Floats:
        center: Floats = np.mean([*self._middles.values()], axis=0)
        return center

    def _outward(self, name: str) -> Floats:
        outward: Floats = self._middles[name] - self._center
        return outward

    def _direction(self, name: str) -> float:
        """Return the direction of a wheel from the center, 0 (forward) to 2 pi, anticlockwise."""
        x, y, _ = self._outward(name)
        return round(math.atan2(y, x), 6) % math.tau

    def _forward(self, name: str) -> float:
        """Return the driving direction of a wheel, across its axis, rad left of forward."""
        x, y, _ = self.directions[name] * self.axles[name].axis
        return math.atan2(y, x) - math.pi / 2.0
