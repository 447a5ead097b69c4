"""The wheels that drive a robot, and their separation and radius, read from its description."""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_control.drive.wheels.finding import DriveWheels, axles, find_wheels, link_places
from onebot_control.drive.wheels.tyres import Tyres
from onebot_control.physics.bodies import Body, link_poses
from onebot_description.description.description import Description
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.ros.parameters.reader import ConfigError, Problem

Floats = NDArray[np.float64]

_SAME = 1e-6  # m by which lengths may differ and still count as the same
_STEPS = 200  # fixed-point iterations; four equal loads need one
_LEAST_LOAD = 0.01  # a wheel has at least this share of the mean load


class WheelGeometry(NamedTuple):
    """What a differential drive's odometry rests on."""

    separation: float  # distance between left and right wheels, m; of skid steer the effective one
    radius: float  # all the wheels', m


class Wheels:
    """The wheels that drive a robot: read from the description once, for all who need them.

    Attributes:
        left: the driven joints on the left.
        right: those on the right.
        rigid: the first link of each link's rigid body, and the link's pose (4, 4) in its frame.
        axles: the joints that turn, by name.
        directions: of each driven joint 1 if a positive velocity drives forward, -1 if backward.
    """

    def __init__(
        self, description: Description, left: Sequence[str] = (), right: Sequence[str] = ()
    ) -> None:
        """Take the wheels that are named, or where none are find them.

        Raises:
            OneBotError: one is missing or turns about another axis, or none are found.
        """
        self.description, self.rigid = description, link_poses(description)
        self.tyres = Tyres(description, self.rigid)
        self._places = link_places(description)
        self.axles = axles(description, self._places)
        if left or right:
            self._check_names(left_wheel_names=left, right_wheel_names=right)
            chosen = DriveWheels(tuple(left), tuple(right))
        else:
            chosen = find_wheels(description, self.axles, self.tyres)
        self.left, self.right = chosen
        for name in self.names:
            self._check_axle(name)
        self.directions = {name: self.axles[name].direction for name in self.names}

    @property
    def names(self) -> tuple[str, ...]:
        """The driven joints, those on the left first."""
        return (*self.left, *self.right)

    def geometry(self, separation: float = 0.0, radius: float = 0.0) -> WheelGeometry:
        """Return the drive's geometry: what is given, and the description's where that is 0.

        Raises:
            OneBotError: the description does not define it.
        """
        return WheelGeometry(separation or self.separation, radius or self.radius)

    @cached_property
    def robot(self) -> Body:
        """The robot as one rigid body in the frame of its root link, all joints at 0."""
        body = Body(self.description.root_link)
        for link in self.description.links:
            body.add(link, self._places[link.name])
        return body

    @cached_property
    def separation(self) -> float:
        """The distance between the wheels of the two sides, m.

        Across the driving direction; of wheels that stand in one line with it, the whole distance,
        as diff_drive_controller has taken it. Of several wheels a side, the effective one; see
        ``skid_separation``.

        Raises:
            OneBotError: left is not left of right.
        """
        lefts, rights = (
            np.array([self.axles[name].middle(self.tyres.of(name)) for name in names])
            for names in (self.left, self.right)
        )
        left, right = lefts.mean(axis=0), rights.mean(axis=0)
        across, apart = float(left[1] - right[1]), float(np.linalg.norm(left - right))
        if abs(across) <= _SAME < apart:
            return apart
        if across <= 0.0:
            raise OneBotError(
                f'robot "{self.description.robot_name}": the left wheels '
                f"({', '.join(self.left)}) are at y = {left[1]:g} m, not left of the right ones "
                f"({', '.join(self.right)}) at y = {right[1]:g} m; swap left_wheel_names and "
                "right_wheel_names"
            )
        if len(self.left) == 1:
            return across
        along = np.concatenate([lefts, rights])[:, 0]
        return skid_separation(across, along, float(self.robot.center[0]))

    @cached_property
    def radius(self) -> float:
        """The one radius, m, of the round shapes that the wheels roll on.

        Raises:
            OneBotError: a link has no such shape, or they differ.
        """
        radii = {name: self._radius(name) for name in self.names}
        if max(radii.values()) - min(radii.values()) > _SAME:
            listed = ", ".join(f"{name} {radius:g} m" for name, radius in radii.items())
            raise OneBotError(
                f'robot "{self.description.robot_name}" has wheels of several radii ({listed}): '
                "set wheel_radius, and left_wheel_radius_multiplier and "
                "right_wheel_radius_multiplier"
            )
        return next(iter(radii.values()))

    def _check_names(self, **sides: Sequence[str]) -> None:
        """Check that each name is a joint that turns; ``sides`` are the parameters' names."""
        problems = [
            Problem(
                parameter,
                f'robot "{self.description.robot_name}" has no joint "{name}" that turns'
                f"{did_you_mean(name, list(self.axles), 'it has')}",
            )
            for parameter, names in sides.items()
            for name in names
            if name not in self.axles
        ]
        if problems:
            raise ConfigError(problems)

    def _check_axle(self, name: str) -> None:
        axle = self.axles[name]
        if axle.across:
            return
        direction = " ".join(f"{value:g}" for value in np.round(axle.axis, 3) + 0.0)
        raise OneBotError(
            f'robot "{self.description.robot_name}", joint "{name}": its axis points to '
            f"({direction}) "
            f"in the frame of {self.description.root_link}; that of a wheel must point to the "
            "left, (0 1 0), or to the right, (0 -1 0)"
        )

    def _radius(self, name: str) -> float:
        if (tyre := self.tyres.of(name)) is not None:
            return tyre.radius
        raise OneBotError(
            f'robot "{self.description.robot_name}", joint "{name}": link '
            f'"{self.axles[name].joint.child}" has no one sphere, cylinder or round mesh to read '
            "the wheel's radius from; set wheel_radius (m)"
        )


def skid_separation(across: float, along: Floats, center: float) -> float:
    """Return the separation of two wheels that would turn a robot as these do.

    Wheels one behind the other cannot turn the robot without sliding sideways. The friction that
    this takes opposes the whole sliding, so that the wheels slide forward and backward, too, and
    turn the robot less. The robot turns about the point at which neither the forces nor the moments
    of the friction, the same in all directions and in proportion to the load, accelerate it. For
    four wheels with the centre of mass in the middle that gives across * (1 + (L / across)^2), L
    being the wheelbase.

    Args:
        across: distance of the two sides, m.
        along: (N,) positions of all wheels along the robot, m.
        center: position of the centre of mass along the robot, m.
    """
    along, center = along - along.mean(), center - float(along.mean())
    spread = float(np.mean(along**2))
    if spread <= _SAME**2:
        return across
    loads = np.maximum(1.0 + along * center / spread, _LEAST_LOAD)
    turning, slip = 0.0, 2.0 * spread / across  # x of the point; m/s at a wheel for 1 rad/s
    for _ in range(_STEPS):
        sideways = along - turning
        weights = loads / np.hypot(slip, sideways)
        slip = 2.0 / across * float(np.average(sideways**2, weights=weights))
        turning = float(np.average(along, weights=weights))
    return across + 2.0 * slip
