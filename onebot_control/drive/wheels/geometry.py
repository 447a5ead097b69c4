"""The driven wheels of a robot, and their separation and radius, from its description."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from onebot_control.drive.wheels.finding import RunningGear
from onebot_control.drive.wheels.rolling_shapes import Tyre
from onebot_description.arrays import Floats
from onebot_description.elements.urdf import Description
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.model.rigid_bodies import Body
from onebot_description.parameters.reader import ConfigError, Problem

_SAME = 1e-6  # m; lengths that differ by less count as equal
_STEPS = 200  # fixed-point iterations; four equal loads need one
_MIN_LOAD = 0.01  # minimum load of a wheel, as a fraction of the mean load


class WheelGeometry(NamedTuple):
    """Wheel separation and radius of a differential drive, for its odometry."""

    separation: float  # distance between left and right wheels, m; effective for skid steer
    radius: float  # radius of all driven wheels, m

    def __str__(self) -> str:
        return f"wheels {self.separation:g} m apart, of radius {self.radius:g} m"


class Wheels:
    """The driven wheels of a robot, read from its description once; none if it stands.

    Attributes:
        description: the robot.
        gear: the parts that it may roll on.
        groups: names of the driven joints, grouped if they turn as one wheel.
        steering: names of the steering joints.
        free: names of the joints of wheels that roll freely, besides casters.
        rollers: for driven wheels with rollers, the direction of the axle of the roller at the
            ground, rad to the left of the wheel's forward direction, by the wheel's joint.
        skids: whether the wheels slide sideways in turns.
    """

    free: Sequence[str] = ()
    rollers: Mapping[str, float] = MappingProxyType({})
    skids = False

    def __init__(
        self,
        description: Description,
        groups: Sequence[Sequence[str]] = (),
        steering: Sequence[str] = (),
    ) -> None:
        """Read the rotating joints; subclasses may set the wheels later.

        Args:
            description: the robot.
            groups: names of the driven joints, grouped if they turn as one wheel.
            steering: names of the steering joints.
        """
        self.groups, self.steering = groups, steering
        self.description, self.gear = description, RunningGear.of(description)
        self.axles, self.tyres, self.rigid = self.gear.axles, self.gear.tyres, self.gear.rigid

    def middle(self, name: str) -> Floats:
        """Return the center of the wheel on a joint, (3,), m, in the root link's frame."""
        return self.axles[name].middle(self.tyres.tyre(name))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the driven joints, in the order of their groups."""
        return tuple([name for group in self.groups for name in group])

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all joints that the drive moves."""
        return (*self.names, *self.steering)

    @cached_property
    def directions(self) -> Mapping[str, float]:
        """1 for each driven joint whose positive velocity drives forward, otherwise -1."""
        return {name: self.axles[name].direction for name in self.names}

    @cached_property
    def robot(self) -> Body:
        """The robot as one rigid body in the frame of its root link, with all joints at 0."""
        body = Body(self.description.root_link)
        for link in self.description.links:
            body.add(link, self.gear.places[link.name])
        return body

    @cached_property
    def radius(self) -> float:
        """The radius of the driven wheels, m.

        Raises:
            OneBotError: a wheel has no round shape, or the radii differ.
        """
        radii = {name: self.tyre(name).radius for name in self.names}
        if max(radii.values()) - min(radii.values()) > _SAME:
            listed = ", ".join(f"{name} {radius:g} m" for name, radius in radii.items())
            raise OneBotError(
                f'robot "{self.description.robot_name}" has wheels of different radii ({listed}): '
                "set wheel_radius, and left_wheel_radius_multiplier and "
                "right_wheel_radius_multiplier of a differential drive"
            )
        return next(iter(radii.values()))

    def check_names(self, **parameters: Sequence[str]) -> None:
        """Check that all names in ``parameters`` are rotating joints."""
        problems = [
            Problem(
                parameter,
                f'robot "{self.description.robot_name}" has no rotating joint "{name}"'
                f"{did_you_mean(name, list(self.axles), 'it has')}",
            )
            for parameter, names in parameters.items()
            for name in names
            if name not in self.axles
        ]
        if problems:
            raise ConfigError(problems)

    def check_across(self) -> None:
        """Check that each driven wheel turns about a lateral axis.

        Raises:
            OneBotError: it does not.
        """
        for name in self.names:
            axle = self.axles[name]
            if not axle.across:
                direction = " ".join(f"{value:g}" for value in np.round(axle.axis, 3) + 0.0)
                raise OneBotError(
                    f'robot "{self.description.robot_name}", joint "{name}": its axis points to '
                    f"({direction}) in the frame of {self.description.root_link}; a wheel's axis "
                    "must point to the left, (0 1 0), or to the right, (0 -1 0)"
                )

    def tyre(self, name: str) -> Tyre:
        """Return the round shape that the wheel of a joint rolls on.

        Raises:
            OneBotError: there is none.
        """
        if (tyre := self.tyres.tyre(name)) is not None:
            return tyre
        raise OneBotError(
            f'robot "{self.description.robot_name}", joint "{name}": link '
            f'"{self.axles[name].joint.child}" has no sphere, cylinder or round mesh that defines '
            "the wheel's radius; set wheel_radius (m)"
        )


class SideWheels(Wheels):
    """The driven wheels of a differential drive, on two sides.

    Attributes:
        left: names of the driven joints on the left.
        right: names of the driven joints on the right.
    """

    def __init__(
        self, description: Description, left: Sequence[str] = (), right: Sequence[str] = ()
    ) -> None:
        """Use the named wheels, or find the wheels if none are named.

        Args:
            description: the robot.
            left: names of the driven joints on the left.
            right: names of the driven joints on the right.

        Raises:
            OneBotError: a named joint is missing or its axis is not lateral, or no wheels are
                found.
        """
        super().__init__(description)
        if left or right:
            self.check_names(left_wheel_names=left, right_wheel_names=right)
            self.left, self.right = tuple(left), tuple(right)
        else:
            self.left, self.right = self.gear.sides()
        self.groups = self.left, self.right
        self.skids = len(self.names) > 2
        self.check_across()

    def geometry(self, separation: float = 0.0, radius: float = 0.0) -> WheelGeometry:
        """Return the drive's geometry; an argument of 0 is read from the description.

        Args:
            separation: distance between left and right wheels, m.
            radius: radius of the wheels, m.

        Raises:
            OneBotError: the description does not define it.
        """
        return WheelGeometry(separation or self.separation, radius or self.radius)

    @cached_property
    def separation(self) -> float:
        """The distance between the wheels of the two sides, m.

        It is measured across the driving direction; if the wheels are in line with it, it is the
        whole distance, as in diff_drive_controller. With several wheels on a side it is the
        effective separation; see ``skid_separation``.

        Raises:
            OneBotError: the left wheels are not left of the right ones.
        """
        lefts, rights = (
            np.array([self.middle(name) for name in names]) for names in (self.left, self.right)
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


def skid_separation(across: float, along: Floats, center: float) -> float:
    """Return the effective separation of a skid-steer drive, for an equivalent two-wheel drive.

    Wheels one behind the other cannot turn the robot without sliding sideways. Friction opposes the
    whole sliding motion, so the wheels also slide forward and backward, and turn the robot less.
    The robot turns about the point at which neither forces nor moments of this (isotropic Coulomb)
    friction accelerate it, which is found by fixed-point iteration. For four equally loaded wheels,
    the closed form is across * (1 + (L / across)^2), with the wheelbase L.

    Args:
        across: distance between the two sides, m.
        along: (N,) positions of all wheels along the robot, m.
        center: position of the center of mass along the robot, m.
    """
    along, center = along - along.mean(), center - float(along.mean())
    spread = float(np.mean(along**2))
    if spread <= _SAME**2:
        return across
    loads = np.maximum(1.0 + along * center / spread, _MIN_LOAD)
    turning, slip = 0.0, across  # x of the point; slip at a wheel for 1 rad/s, m/s (any start)
    for _ in range(_STEPS):
        sideways = along - turning
        weights = loads / np.hypot(slip, sideways)
        slip = 2.0 / across * float(np.average(sideways**2, weights=weights))
        turning = float(np.average(along, weights=weights))
    return across + 2.0 * slip
