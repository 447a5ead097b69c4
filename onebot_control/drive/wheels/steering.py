"""The wheels of drives that steer: bicycles, cars and tricycles."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from onebot_control.drive.wheels.geometry import Wheels
from onebot_description.arrays import Floats
from onebot_description.elements.urdf import Description, DrivePlugin
from onebot_description.errors import OneBotError

STEERING_SPEED = 3.0
"""The maximum speed of a steering joint, rad/s, typical of model cars. Without a limit, or with
100 rad/s, it would jump, and its reaction would turn the robot."""
_QUARTER = math.pi / 2.0  # rad
# Maximum angle of the inner wheel of a car, rad, if its joint is continuous. Near a quarter turn,
# the steered wheels and the driven wheels would contradict each other.
_FARTHEST = math.pi / 3.0
_AHEAD = 1e-3  # m; minimum distance of the steered wheels in front of the others


class SteeredGeometry(NamedTuple):
    """The lengths of a drive that steers its front wheels.

    Bicycle: both tracks are zero. Tricycle with two driven wheels: the steering track is zero. Car
    (Ackermann steering): none is zero. Tricycle with a driven steered wheel: ``front_driven``.
    """

    wheelbase: float  # distance between the axles, m
    radius: float  # radius of the driven wheels, m
    traction_track: float = 0.0  # distance between the driven wheels, m; 0: single wheel
    steering_track: float = 0.0  # distance between the steered wheels, m; 0: single wheel
    limit: float = _QUARTER  # maximum steering angle, rad
    front_driven: bool = False  # the steered wheel is driven, and the only driven wheel
    axle: float = 0.0  # x of the rear axle in the base's frame, m
    speed: float = STEERING_SPEED  # maximum speed of the steering joints, rad/s

    @property
    def minimum_radius(self) -> float:
        """The minimum radius of a curve, m, at the middle of the rear axle."""
        return self.wheelbase / math.tan(self.limit) if self.limit < _QUARTER else 0.0

    def turning(self, speed: float, angle: float) -> float:
        """Return the angular velocity to the left, rad/s, at a speed, m/s, and a steering angle.

        The angle, rad to the left, is that of a virtual wheel in the middle of the front axle, at
        most a quarter turn.
        """
        return speed * math.tan(angle) / self.wheelbase

    def wheel_angle(self, angle: float, offset: float) -> float:
        """Return the angle, rad, of a wheel ``offset`` m to the right of one at another angle."""
        if not offset:
            return angle
        side, ahead = self.wheelbase * math.sin(angle), self.wheelbase * math.cos(angle)
        return math.atan2(side, ahead + offset * math.sin(angle))

    def __str__(self) -> str:
        text = f"wheelbase {self.wheelbase:g} m, wheels of radius {self.radius:g} m"
        return f"{text}, minimum turning radius {self.minimum_radius:.3g} m"


def _of(plugin: DrivePlugin, *roles: str) -> list[str]:
    """Return the joints that a plugin names for these roles."""
    return [name for role in roles for name in plugin.joints.get(role, ())]


class SteeredWheels(Wheels):
    """The wheels of a drive that steers its front wheels; those on the right come first."""

    def __init__(
        self,
        description: Description,
        traction: Sequence[str] = (),
        steering: Sequence[str] = (),
        *,
        front_driven: bool = False,
    ) -> None:
        """Use the named joints, or find them if none are named.

        Args:
            description: the robot.
            traction: joints of the driven wheels.
            steering: steering joints.
            front_driven: whether the steered wheel is driven if no joints are named.

        Raises:
            OneBotError: a named joint is missing or its axis is not lateral or vertical, no such
                wheels are found, or rear wheels are steered.
        """
        super().__init__(description)
        steered = self.gear.steered
        if (plugin := description.drive_plugin) and plugin.kind == "ackermann":
            wheels = _of(plugin, "left", "right")
            traction = traction or [name for name in wheels if name not in steered] or wheels
            steering = steering or _of(plugin, "left_steering", "right_steering")
        self.check_names(traction_joints_names=traction, steering_joints_names=steering)
        self.steering = self._rightmost(steering or dict.fromkeys(steered.values()))
        rear = [wheel.name for wheel in self.gear.on_ground if wheel.name not in steered]
        driven = list(steered) if front_driven or self.gear.front_driven else rear
        names = self._rightmost(traction or driven)
        self.groups = [[name] for name in names]
        self.free = [name for name in (*rear, *steered) if name not in names]
        self.check_across()
        self._check_counts()
        self._place_axles(rear)

    def _place_axles(self, rear: Sequence[str]) -> None:
        """Find the axles; ``rear`` are the joints of the wheels that are not steered."""
        swivels = [self.gear.swivel(name) for name in self.names]
        self._front_driven = any(joint and joint.name in self.steering for joint in swivels)
        free = [name for name in rear if name not in self.names]
        behind = free if self._front_driven and free else self.names
        self._rear = np.mean([self.middle(name) for name in behind], axis=0)
        self._front = np.mean([self._pivot(name) for name in self.steering], axis=0)
        if self._front[0] < self._rear[0] + _AHEAD:
            self._refuse(
                f"its steered wheels ({', '.join(self.steering)}) are not in front of the others; "
                "vehicles that steer their rear wheels are not simulated"
            )

    def geometry(
        self, radius: float, wheelbase: float, traction_track: float, steering_track: float
    ) -> SteeredGeometry:
        """Return the drive's geometry; an argument of 0 is read from the description, m.

        Raises:
            OneBotError: the description does not define it.
        """
        wheelbase = wheelbase or float(self._front[0] - self._rear[0])
        traction = traction_track or self._track([self.middle(name) for name in self.names])
        pivots = [self._pivot(name) for name in self.steering]
        steering = steering_track or self._track(pivots)
        ranges = [self.axles[name].joint for name in self.steering]
        unlimited = _FARTHEST if len(pivots) > 1 else _QUARTER
        max_angle = min(
            unlimited if joint.kind == "continuous" else min(-joint.range[0], joint.range[1])
            for joint in ranges
        )
        if max_angle <= 0.0:
            self._refuse(f"{', '.join(self.steering)} cannot turn to both sides")
        geometry = SteeredGeometry(
            wheelbase=wheelbase,
            radius=radius or self.radius,
            traction_track=traction if len(self.names) > 1 else 0.0,
            steering_track=steering if len(self.steering) > 1 else 0.0,
            front_driven=self._front_driven,
            axle=float(self._rear[0]),
            speed=min([STEERING_SPEED, *(joint.velocity for joint in ranges if joint.velocity)]),
        )
        # The joint of the inner wheel reaches its limit first.
        limit = geometry.wheel_angle(max_angle, geometry.steering_track / 2.0)
        plugin = self.description.drive_plugin
        return geometry._replace(
            limit=min(_QUARTER, limit, plugin.steering_limit if plugin else _QUARTER)
        )

    def _rightmost(self, names: Sequence[str] | dict[str, None]) -> list[str]:
        return sorted(names, key=lambda name: float(self._pivot(name)[1]))

    def _pivot(self, name: str) -> Floats:
        position: Floats = self.axles[name].pose[:3, 3]
        return position

    @staticmethod
    def _track(places: Sequence[Floats]) -> float:
        return float(places[-1][1] - places[0][1])

    def _check_counts(self) -> None:
        for what, names in (("driven wheels", self.names), ("steering joints", self.steering)):
            if len(names) not in (1, 2):
                listed = ", ".join(names) or "none"
                self._refuse(f"it must have one or two {what} at the front or rear, not {listed}")
        for name in self.steering:
            if abs(self.axles[name].axis[2]) < 1.0 - 1e-3:
                self._refuse(f'joint "{name}" steers, so its axis must be vertical')

    def _refuse(self, reason: str) -> None:
        raise OneBotError(
            f'robot "{self.description.robot_name}" cannot be driven as a car: {reason}'
        )
