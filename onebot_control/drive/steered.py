"""Drives that steer front wheels: bicycles, cars and tricycles, with their standard parameters."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from onebot_control.drive.kinematics import DriveCommand, Kinematics, Share, check_lengths
from onebot_control.drive.parameters import (
    AlikeWheelsParameters,
    ReferenceParameters,
    read_from_urdf,
)
from onebot_control.drive.speed_limiter import SpeedLimiter, SpeedLimits
from onebot_description.geometry.poses import Triple, clamp, total
from onebot_description.parameters.reader import Problem, group, ignored, parameter

if TYPE_CHECKING:
    from onebot_control.drive.wheels.finding import RunningGear
    from onebot_control.drive.wheels.steering import SteeredGeometry, SteeredWheels
    from onebot_description.description import Description

_ACROSS = 1e-9  # cosine of the angle from which a steered wheel counts as standing across
# A wheel this close to the center of rotation, as a share of the radius, carries no information
# about the robot's speed.
_PIVOT = 1e-3
# Steering errors at which the wheels begin to slow down, and slow down no further, rad, as in
# steering_controllers_library.
_FAR, _FARTHEST = math.pi / 6.0, 1.5608
_QUARTER = math.pi / 2.0
_ROUNDED = 1e-3  # rad; a limit this close to a quarter turn, such as 1.57, counts as one
_ROUNDING = 1e-6  # relative, of a radius
_UNLIMITED = SpeedLimits()


class SteeredKinematics(Kinematics):
    """Converts between wheel and body motion of a robot that steers its front wheels.

    The body's frame has x forward and y to the left (REP-103); the rear axle does not move
    sideways. Of two wheels, the right one comes first. The steering angle is that of a virtual
    wheel in the middle of the front axle, rad to the left.
    """

    def __init__(
        self,
        geometry: "SteeredGeometry",
        *,
        waits: bool = False,
        traction: SpeedLimits = _UNLIMITED,
    ) -> None:
        """Set the lengths.

        Args:
            geometry: the lengths.
            waits: whether the wheels wait for the steering
                (reduce_wheel_speed_until_steering_reached).
            traction: limits of the driven wheels, rad/s.

        Raises:
            ValueError: a length is not finite, too short, or for another drive.
        """
        self.wheelbase, self.radius, *tracks = geometry[:4]
        self.limit, self.front_driven, self.axle, self.speed = geometry[4:]
        # For each wheel of an axle, how far it is to the right of the middle, m.
        self._traction_offsets, self._steering_offsets = map(_offsets, tracks)
        self._geometry, self._waits, self._traction = geometry, waits, SpeedLimiter(traction)
        check_lengths(self, "wheelbase", "radius")
        if self.front_driven and any(tracks):
            raise ValueError("only a single wheel can be both steered and driven")
        # Heading errors are like those of wheels on two sides, as far apart as the axles.
        self.shares = Share(0.5, 0.0, -self.wheelbase), Share(0.5, 0.0, self.wheelbase)

    def command(
        self, twist: Triple, steering: Sequence[float] = (), dt: float = math.inf
    ) -> DriveCommand:
        """Return the joint commands for a twist.

        The robot drives as fast as commanded, and turns as far as it can; only a driven front wheel
        that can be steered by 90 degrees turns it on the spot. The wheels of an axle stay
        consistent while the steering moves.
        """
        linear, _, angular = twist
        target = self.steering_angle(linear, angular)
        actual = self.middle_angle(steering) if steering else target
        reached = self._reached(actual, target, dt)
        speed, angle = self._speed(linear, angular, target) / self.radius, (actual + reached) / 2.0
        if self._waits:
            missing = abs(target - actual)
            if missing >= _FAR:
                speed *= math.cos(min(missing, _FARTHEST)) / math.cos(_FAR)
        if self.front_driven:
            linear, _, turn = self.body_motion([speed], [angle])
        else:
            turn = linear * math.tan(angle) / self.wheelbase if linear else 0.0
        wheels = [speed * share for share in self._traction_shares(angle)]
        steered = self._steering_positions(reached)
        return DriveCommand(linear, -self.axle * turn, turn, wheels, steered)

    def limited(self, command: DriveCommand, before: DriveCommand, dt: float) -> DriveCommand:
        if not self.front_driven:
            return command
        [speed], [last] = command.wheels, before.wheels
        speed = self._traction.limit(speed, last, last, dt)
        motion = self.body_motion([speed], command.steering)
        return DriveCommand(*motion, [speed], command.steering)

    def _reached(self, actual: float, wanted: float, dt: float) -> float:
        """Return the steering angle after ``dt``, s, such that no wheel is steered too fast."""
        ends = (self._steering_positions(angle) for angle in (actual, wanted))
        change = max(abs(end - start) for start, end in zip(*ends, strict=True))
        share = self.speed * dt / change if change else 1.0
        return wanted if share >= 1.0 else actual + (wanted - actual) * share

    def fault(self, twist: Triple) -> str:
        linear, _, angular = twist
        radius = self.wheelbase / math.tan(self.limit)
        turns = self.limit >= _QUARTER and (self.front_driven or linear)
        if turns or abs(linear) >= abs(angular) * radius * (1.0 - _ROUNDING):
            return ""
        return (
            f"it turns less than commanded: the steering allows curves of {radius:.3g} m radius "
            "or more, and no turn on the spot"
        )

    def body_motion(self, turned: Sequence[float], steering: Sequence[float] = ()) -> Triple:
        angle = self.middle_angle(steering)
        if self.front_driven:
            path = turned[0] * self.radius
            way, turn = path * math.cos(angle), path * math.sin(angle) / self.wheelbase
        else:
            ways = [
                wheel * self.radius / share
                for wheel, share in zip(turned, self._traction_shares(angle), strict=True)
                if abs(share) > _PIVOT
            ]
            way = total(ways) / len(ways)
            turn = math.tan(angle) * way / self.wheelbase
        return way, -self.axle * turn, turn

    def paths(self, motion: Triple) -> tuple[float, float]:
        return motion[0], motion[0]

    def steering_angle(self, linear: float, angular: float) -> float:
        """Return the steering angle, rad, for a body twist, clipped to the limit.

        Args:
            linear: forward, m/s.
            angular: turning to the left, rad/s.
        """
        across = angular * self.wheelbase
        if not across:
            return 0.0
        angle = math.atan(across / linear) if linear else math.copysign(_QUARTER, across)
        return clamp(angle, -self.limit, self.limit)

    def middle_angle(self, steering: Sequence[float]) -> float:
        """Return the steering angle, rad, for positions of the steered wheels, rad."""
        pairs = zip(steering, self._steering_offsets, strict=True)
        angles = [self._geometry.wheel_angle(position, -offset) for position, offset in pairs]
        return total(angles) / len(angles)

    def _speed(self, linear: float, angular: float, angle: float) -> float:
        """Return the speed of a driven wheel in the middle of its axle, m/s."""
        if not self.front_driven:
            return linear
        cos = math.cos(angle)
        return linear / cos if cos > _ACROSS else abs(angular) * self.wheelbase

    def _traction_shares(self, angle: float) -> list[float]:
        """Return the speed of each driven wheel, as a share of the speed of their middle."""
        return [
            1.0 + math.tan(angle) * offset / self.wheelbase if offset else 1.0
            for offset in self._traction_offsets
        ]

    def _steering_positions(self, angle: float) -> list[float]:
        return [self._geometry.wheel_angle(angle, offset) for offset in self._steering_offsets]


def _offsets(track: float) -> tuple[float, ...]:
    return (track / 2.0, -track / 2.0) if track else (0.0,)


@dataclass(frozen=True)
class SteeredParameters(AlikeWheelsParameters["SteeredGeometry"]):
    """The parameters of all drives with steered front wheels."""

    steers: ClassVar[bool] = True

    wheelbase: float = read_from_urdf("distance between the axles")
    steering_limit: float = parameter(
        0.0,
        "maximum steering angle, rad; 0: the joints' limits",
        at_least=0.0,
        at_most=_QUARTER,
    )
    minimum_turning_radius: float = parameter(
        0.0, "minimum radius of a curve, m, set by the node; changes have no effect"
    )

    def _lengths(
        self,
        wheels: "SteeredWheels",
        radius: float,
        tracks: tuple[float, float] = (0.0, 0.0),
        max_angle: float = _QUARTER,
    ) -> "SteeredGeometry":
        """Return the geometry of ``wheels``; lengths of 0 are read from the URDF.

        Args:
            wheels: the wheels.
            radius: radius of the driven wheels, m.
            tracks: distances of the driven and of the steered wheels, m.
            max_angle: maximum steering angle, rad.
        """
        geometry = wheels.geometry(radius, self.wheelbase, *tracks)
        limit = self.steering_limit or min(geometry.limit, max_angle)
        return geometry._replace(limit=_QUARTER if limit > _QUARTER - _ROUNDED else limit)


def _joints(what: str) -> Any:
    description = f"joints of {what}; empty: found in the URDF"
    return parameter((), description, unique=True, read_only=True)


_SAME = "the states are those of the same joints"


@dataclass(frozen=True)
class SteeringControllerParameters(SteeredParameters, ReferenceParameters["SteeredGeometry"]):
    """The parameters of the ackermann, bicycle and tricycle_steering_controller."""

    traction_joints_names: tuple[str, ...] = _joints("the driven wheels")
    steering_joints_names: tuple[str, ...] = _joints("the steering")
    rear_wheels_names: tuple[str, ...] = _joints("the driven wheels (older name)")
    front_wheels_names: tuple[str, ...] = _joints("the steering (older name)")
    front_steering: bool = parameter(True, "the front wheels are steered; must be true")
    traction_joints_state_names: tuple[str, ...] = ignored((), _SAME)
    steering_joints_state_names: tuple[str, ...] = ignored((), _SAME)
    rear_wheels_state_names: tuple[str, ...] = ignored((), _SAME)
    front_wheels_state_names: tuple[str, ...] = ignored((), _SAME)
    traction_wheels_radius: float = read_from_urdf("radius of the driven wheels")
    traction_wheel_radius: float = read_from_urdf("the same for a bicycle")
    rear_wheels_radius: float = read_from_urdf("the same (older name)")
    rear_wheel_radius: float = read_from_urdf("the same (older name)")
    front_wheels_radius: float = ignored(0.0, "the front wheels are not driven")
    front_wheel_radius: float = ignored(0.0, "the front wheels are not driven")
    traction_track_width: float = read_from_urdf("distance between the driven wheels")
    rear_wheel_track: float = read_from_urdf("the same (older name)")
    wheel_track: float = read_from_urdf("the same (older name)")
    steering_track_width: float = read_from_urdf("distance between the steered wheels")
    front_wheel_track: float = read_from_urdf("the same (older name)")
    reduce_wheel_speed_until_steering_reached: bool = parameter(
        False, "the wheels slow down while the steering is more than 30 degrees off"
    )

    def check(self) -> Iterator[Problem]:
        """Report rear wheels that are steered."""
        if not self.front_steering:
            text = "vehicles that steer their rear wheels are not simulated; write true"
            yield Problem("front_steering", text)

    @classmethod
    def is_found(cls, gear: "RunningGear") -> bool:
        return bool(gear.steered) and not gear.front_driven

    def wheels(self, description: "Description") -> "SteeredWheels":
        from onebot_control.drive.wheels.steering import SteeredWheels  # imports numpy

        return SteeredWheels(
            description,
            self.traction_joints_names or self.rear_wheels_names,
            self.steering_joints_names or self.front_wheels_names,
        )

    def geometry(self, wheels: "SteeredWheels") -> "SteeredGeometry":
        radius = self.traction_wheels_radius or self.rear_wheels_radius
        radius = radius or self.traction_wheel_radius or self.rear_wheel_radius
        traction = self.traction_track_width or self.rear_wheel_track or self.wheel_track
        steering = self.steering_track_width or self.front_wheel_track
        return self._lengths(wheels, radius, (traction, steering))

    def kinematics(self, geometry: "SteeredGeometry") -> SteeredKinematics:
        return SteeredKinematics(geometry, waits=self.reduce_wheel_speed_until_steering_reached)


def _unused(reason: str) -> Any:
    return ignored(math.nan, reason, nan="not given")


_NO_MINIMUM = "a minimum would keep the wheel from standing still"
_NO_JERK = "the jerk of the wheel is not limited"
_NO_ACCELERATION = "the steering has no limit of acceleration"


@dataclass(frozen=True)
class SteeringLimits:
    """tricycle_controller's parameters ``steering.*``."""

    min_position: float = parameter(
        0.0, "limit to the right, rad; 0: the joint's limit", at_most=0.0
    )
    max_position: float = parameter(
        0.0, "limit to the left, rad; 0: the joint's limit", at_least=0.0
    )
    max_velocity: float = parameter(0.0, "maximum speed, rad/s; 0: the joint's limit", at_least=0.0)
    min_velocity: float = _unused(_NO_MINIMUM)
    max_acceleration: float = _unused(_NO_ACCELERATION)
    min_acceleration: float = _unused(_NO_ACCELERATION)


def _maximum(what: str) -> Any:
    text = f"maximum {what} of the driven wheel"
    return parameter(math.nan, text, at_least=0.0, nan="no limit")


@dataclass(frozen=True)
class TractionLimits:
    """tricycle_controller's parameters ``traction.*``, forward and in reverse."""

    max_velocity: float = _maximum("speed, rad/s,")
    max_acceleration: float = _maximum("acceleration, rad/s2,")
    max_deceleration: float = _maximum("deceleration, rad/s2,")
    min_velocity: float = _unused(_NO_MINIMUM)
    min_acceleration: float = _unused(_NO_MINIMUM)
    min_deceleration: float = _unused(_NO_MINIMUM)
    max_jerk: float = _unused(_NO_JERK)
    min_jerk: float = _unused(_NO_JERK)

    @property
    def speed_limits(self) -> SpeedLimits:
        """The same limits as SpeedLimits."""
        return SpeedLimits(
            max_velocity=self.max_velocity,
            max_acceleration=self.max_acceleration,
            max_deceleration=-self.max_deceleration,
            max_deceleration_reverse=self.max_deceleration,
        )


@dataclass(frozen=True)
class TricycleParameters(SteeredParameters):
    """tricycle_controller's parameters, for a tricycle with a driven steered wheel."""

    traction_joint_name: str = parameter(
        "", "joint of the driven wheel; empty: found in the URDF", read_only=True
    )
    steering_joint_name: str = parameter(
        "", "joint that steers it; empty: found in the URDF", read_only=True
    )
    wheel_radius: float = read_from_urdf("radius of the driven wheel")
    cmd_vel_timeout: float = parameter(
        500, "time without a command until the robot brakes, ms; 0: it never does", at_least=0.0
    )
    traction: TractionLimits = group(TractionLimits)
    steering: SteeringLimits = group(SteeringLimits)
    odom_only_twist: bool = ignored(False, "the odometry also has its pose")
    publish_ackermann_command: bool = ignored(False, "~/cmd_vel_out has the limited command")

    @property
    def timeout(self) -> float:
        return self.cmd_vel_timeout / 1000.0

    @classmethod
    def is_found(cls, gear: "RunningGear") -> bool:
        return bool(gear.steered) and gear.front_driven

    def wheels(self, description: "Description") -> "SteeredWheels":
        from onebot_control.drive.wheels.steering import SteeredWheels  # imports numpy

        traction, steering = self.traction_joint_name, self.steering_joint_name
        names = [[name] if name else [] for name in (traction, steering)]
        return SteeredWheels(description, *names, front_driven=True)

    def geometry(self, wheels: "SteeredWheels") -> "SteeredGeometry":
        limits = self.steering
        max_angle = min(-limits.min_position or _QUARTER, limits.max_position or _QUARTER)
        geometry = self._lengths(wheels, self.wheel_radius, max_angle=max_angle)
        speed = limits.max_velocity or math.inf
        return geometry._replace(speed=min(geometry.speed, speed))

    def kinematics(self, geometry: "SteeredGeometry") -> SteeredKinematics:
        traction = self.traction.speed_limits
        return SteeredKinematics(geometry, waits=geometry.front_driven, traction=traction)
