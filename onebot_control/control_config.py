"""velocity_controller's parameters, checked, as plain values."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from onebot_control.control_parameters import (
    AXES,
    BROADCASTER,
    DEFAULTS,
    REMEDIES,
    ROS_PARAMETERS,
    ROS_PREFIXES,
)
from onebot_control.kinematics import DiffDriveKinematics
from onebot_control.speed_limiter import NAMES as LIMITS
from onebot_control.speed_limiter import SpeedLimits
from onebot_description.joints.problems import ConfigError, Problem
from onebot_description.joints.readers import Reader
from onebot_description.text import did_you_mean

if TYPE_CHECKING:
    from onebot_control.geometry import WheelGeometry

COMMAND_TYPES = ("auto", "Twist", "TwistStamped")
INTERFACES = ("position", "velocity", "effort")
_MOST_HERTZ = 10_000.0


@dataclass(frozen=True)
class BroadcasterConfig:
    """joint_state_broadcaster's parameters.

    Attributes:
        joints: to publish, in that order; empty for all.
        interfaces: of "position", "velocity" and "effort"; the others are NaN; empty for all.
        extra_joints: published as well, at 0.
        frame_id: of the message's header.
    """

    joints: tuple[str, ...] = ()
    interfaces: tuple[str, ...] = ()
    extra_joints: tuple[str, ...] = ()
    frame_id: str = "base_link"


@dataclass(frozen=True)
class ControlConfig:
    """All parameters; those of diff_drive_controller are described in its documentation.

    Attributes:
        wheel_separation: m; 0 to read it from the URDF.
        wheel_radius: m; 0 to read it from the URDF.
        linear: limits of linear.x, m and s.
        angular: limits of angular.z, rad and s.
        cmd_vel_type: one of COMMAND_TYPES.
        update_rate: control cycles a second (controller_manager's).
        real_time_factor: simulated seconds a second; 0 is as fast as possible.
        world_frame_id: frame of the ground truth; empty to give it in the odometry's.
    """

    left_wheel_names: tuple[str, ...]
    right_wheel_names: tuple[str, ...]
    wheel_separation: float
    wheel_radius: float
    wheel_separation_multiplier: float
    left_wheel_radius_multiplier: float
    right_wheel_radius_multiplier: float
    tf_frame_prefix_enable: bool
    tf_frame_prefix: str
    odom_frame_id: str
    base_frame_id: str
    pose_covariance_diagonal: tuple[float, ...]
    twist_covariance_diagonal: tuple[float, ...]
    open_loop: bool
    position_feedback: bool
    enable_odom_tf: bool
    cmd_vel_timeout: float
    publish_limited_velocity: bool
    velocity_rolling_window_size: int
    publish_rate: float
    cmd_vel_type: str
    linear: SpeedLimits
    angular: SpeedLimits
    x: float
    y: float
    yaw: float
    update_rate: float
    real_time_factor: float
    world_frame_id: str
    broadcaster: BroadcasterConfig

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "ControlConfig":
        """Check parameters: dotted name to value, as ROS has them.

        Raises:
            ConfigError: with every problem, each naming the parameter and what would be right.
        """
        reader = _Reader(values)
        problems = unknown_parameters(values)
        config = _read(cls, reader)
        problems += reader.problems
        if problems:
            raise ConfigError(problems)
        return config

    def kinematics(self, geometry: "WheelGeometry") -> DiffDriveKinematics:
        """Return the drive's geometry, scaled by the multipliers."""
        return DiffDriveKinematics(
            geometry.separation * self.wheel_separation_multiplier,
            geometry.radius * self.left_wheel_radius_multiplier,
            geometry.radius * self.right_wheel_radius_multiplier,
        )


def unknown_parameters(names: Mapping[str, Any]) -> list[Problem]:
    """Return a problem for each name that is no parameter of velocity_controller."""
    known = {*DEFAULTS, *ROS_PARAMETERS}
    return [
        Problem(name, _remedy(name))
        for name in names
        if name not in known and not name.startswith(ROS_PREFIXES)
    ]


def _remedy(name: str) -> str:
    if name in REMEDIES:
        return f"no longer a parameter; {REMEDIES[name]}"
    return f"unknown parameter{did_you_mean(name, DEFAULTS, 'alike')}"


def _read(cls: type[ControlConfig], r: "_Reader") -> ControlConfig:
    return cls(
        *r.wheels(),
        wheel_separation=r.at_least_0("wheel_separation"),
        wheel_radius=r.at_least_0("wheel_radius"),
        wheel_separation_multiplier=r.above_0("wheel_separation_multiplier"),
        left_wheel_radius_multiplier=r.above_0("left_wheel_radius_multiplier"),
        right_wheel_radius_multiplier=r.above_0("right_wheel_radius_multiplier"),
        tf_frame_prefix_enable=r.yes("tf_frame_prefix_enable"),
        tf_frame_prefix=r.text("tf_frame_prefix"),
        odom_frame_id=r.name("odom_frame_id"),
        base_frame_id=r.name("base_frame_id"),
        pose_covariance_diagonal=r.diagonal("pose_covariance_diagonal"),
        twist_covariance_diagonal=r.diagonal("twist_covariance_diagonal"),
        open_loop=r.yes("open_loop"),
        position_feedback=r.yes("position_feedback"),
        enable_odom_tf=r.yes("enable_odom_tf"),
        cmd_vel_timeout=r.at_least_0("cmd_vel_timeout"),
        publish_limited_velocity=r.yes("publish_limited_velocity"),
        velocity_rolling_window_size=r.count("velocity_rolling_window_size"),
        publish_rate=r.rate("publish_rate"),
        cmd_vel_type=r.choice("cmd_vel_type", COMMAND_TYPES, "auto"),
        linear=r.limits(AXES[0]),
        angular=r.limits(AXES[1]),
        x=r.number("x", 0.0),
        y=r.number("y", 0.0),
        yaw=r.number("yaw", 0.0),
        update_rate=r.rate("update_rate"),
        real_time_factor=r.at_least_0("real_time_factor"),
        world_frame_id=r.text("world_frame_id", DEFAULTS["world_frame_id"]),
        broadcaster=r.broadcaster(),
    )


class _Reader(Reader):
    """Reads what several parameters have in common; defaults are those of the table."""

    def yes(self, key: str) -> bool:
        return self.flag(key, DEFAULTS[key])

    def name(self, key: str) -> str:
        value = self.text(key, DEFAULTS[key])
        if not value:
            self.complain(key, f'is empty; write the name of a frame, such as "{DEFAULTS[key]}"')
        return value

    def at_least_0(self, key: str) -> float:
        value = self.number(key, DEFAULTS[key])
        if value < 0.0:
            what = "; 0.0 reads it from the URDF" if key.startswith("wheel_") else ""
            self.complain(key, f"{value:g} is below 0; write 0.0 or more{what}")
        return value

    def above_0(self, key: str) -> float:
        value = self.number(key, DEFAULTS[key])
        if value <= 0.0:
            self.complain(key, f"{value:g} is not above 0; write such as {DEFAULTS[key]}")
        return value

    def rate(self, key: str) -> float:
        value = self.number(key, float(DEFAULTS[key]))
        if not 0.0 < value <= _MOST_HERTZ:
            self.complain(key, f"{value:g} Hz; write a rate above 0 and up to {_MOST_HERTZ:g}")
        return value

    def count(self, key: str) -> int:
        value = self.values.get(key, DEFAULTS[key])
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            self.complain(key, f"{value!r}; write a whole number, 1 or more")
            return int(DEFAULTS[key])
        return value

    def diagonal(self, key: str) -> tuple[float, ...]:
        before = len(self.problems)
        values = self.numbers(key) if key in self.values else tuple(DEFAULTS[key])
        if len(self.problems) == before:
            if len(values) != 6:
                order = "x, y, z, roll, pitch, yaw"
                self.complain(key, f"{len(values)} numbers; write 6, the variances of {order}")
            elif min(values) < 0.0:
                self.complain(key, f"{min(values):g} is below 0, but a variance is a square")
        return values

    def limits(self, axis: str) -> SpeedLimits:
        limits = SpeedLimits(**{name: self._limit(f"{axis}.{name}") for name in LIMITS})
        for name, text in limits.problems():
            self.complain(f"{axis}.{name}", text)
        return limits

    def _limit(self, key: str) -> float:
        value = self.values.get(key, math.nan)
        if isinstance(value, float) and math.isnan(value):
            return value
        return self.number(key, 1.0)

    def wheels(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        before = len(self.problems)
        left, right = (self._unique(f"{side}_wheel_names") for side in ("left", "right"))
        if len(self.problems) == before:
            for side, names in (("left", left), ("right", right)):
                if not names:
                    example = f"[{side}_wheel_joint]"
                    self.complain(f"{side}_wheel_names", f"is empty; name joints: {example}")
            if left and right and len(left) != len(right):
                text = f"{len(right)} wheels, but left_wheel_names has {len(left)}"
                self.complain("right_wheel_names", f"{text}; name as many")
            for name in sorted(set(left) & set(right)):
                self.complain("right_wheel_names", f'"{name}" is in left_wheel_names too')
        return left, right

    def broadcaster(self) -> BroadcasterConfig:
        joints, interfaces, extra = (
            self._unique(f"{BROADCASTER}.{name}")
            for name in ("joints", "interfaces", "extra_joints")
        )
        for name in interfaces:
            if name not in INTERFACES:
                known = did_you_mean(name, INTERFACES)
                self.complain(f"{BROADCASTER}.interfaces", f'no "{name}"{known}')
        frame = self.text(f"{BROADCASTER}.frame_id", DEFAULTS[f"{BROADCASTER}.frame_id"])
        return BroadcasterConfig(joints, interfaces, extra, frame)

    def _unique(self, key: str) -> tuple[str, ...]:
        names: Sequence[str] = self.texts(key)
        for name in sorted({name for name in names if names.count(name) > 1}):
            self.complain(key, f'"{name}" is there twice')
        return tuple(names)
