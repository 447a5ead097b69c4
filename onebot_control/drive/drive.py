"""Turns commands into wheel velocities, steering and odometry, for every drive. No ROS here.

``Drive`` is the same class for all drives: it holds the last command until it times out, limits
each of its axes, and integrates the odometry with its covariance. Drives differ in

- its parameters, a ``DriveParameters``: they find its wheels (``wheels``), determine its lengths
  (``geometry``) and convert these to its kinematics (``kinematics``);
- its wheels, a ``Wheels``: groups of joints that turn as one wheel and are driven by velocity
  (``groups``), and joints that steer and are driven by position (``steering``);
- its kinematics, a ``Kinematics``.

Each drive is a file, such as ``diff_drive.py``, and a row of ``drive_kinds.DRIVES``.

Example:
    >>> from onebot_control.drive.drive import Drive
    >>> from onebot_control.drive_kinds import ControlConfig
    >>> from onebot_description.description import load_description
    >>> description = load_description("package://onebot_description/urdf/onebot.urdf.xacro")
    >>> config = ControlConfig.from_parameters({})
    >>> wheels = config.wheels(description)
    >>> drive = Drive(wheels, wheels.names, config)
    >>> drive.accept(linear=0.2, angular=0.0)
    >>> drive.decide(dt=0.01).linear
    0.2
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from onebot_control.drive.drift_check import DriftCheck
from onebot_control.drive.kinematics import DriveCommand
from onebot_control.drive.odometry import Odometry, PoseCovariance
from onebot_control.drive.parameters import DriveParameters
from onebot_control.drive.speed_limiter import SpeedLimiter
from onebot_description.geometry.poses import PlanarPose, PlanarVelocity, Triple, clamp

if TYPE_CHECKING:
    from onebot_control.drive.wheels.geometry import Wheels

_AXES = ("linear.x", "linear.y", "angular.z")  # the order of PlanarVelocity
_REST = (0.0, 0.0, 0.0)
_ROUNDING = 1e-9  # s; maximum rounding error of a sum of periods
_FASTEST = 1e6  # m/s or rad/s; faster commands are clamped, so that all results are finite


class DriveState(NamedTuple):
    """The state of a drive in one control cycle.

    Velocities are per second of the clock of the stamps.
    """

    odometry: PlanarPose  # pose from the wheels, in the odometry frame
    covariance: PoseCovariance  # covariance of this pose
    twist: PlanarVelocity  # velocity from the wheels
    command: DriveCommand
    origin: PlanarPose  # the odometry frame in the world, as long as the wheels do not slip


class Drive:
    """Turns velocity commands into wheel velocities, like the drives of ros2_control.

    It reads no clock, so clock jumps cannot disturb it: commands age by the durations passed to
    ``decide`` and ``wait``.

    Attributes:
        wheels: the driven wheels.
        config: the current parameters.
        geometry: the drive's lengths, before multipliers; each drive has its own type.
        odometry: the robot's pose and twist from its wheels, in the time of the cycles.
        command: the current command.
        origin: the odometry frame in the world, as long as the wheels do not slip.
        drift: compares the odometry with the true pose.
        notice: message about the last command that the drive could not follow; "" if none.
    """

    def __init__(
        self, wheels: "Wheels", joints: Sequence[str], config: DriveParameters[Any]
    ) -> None:
        """Start at rest, with odometry at zero and no command.

        Args:
            wheels: the driven wheels.
            joints: names of the joints whose states are passed to ``observe``, in that order.
            config: the parameters.

        Raises:
            OneBotError: see ``DriveParameters.fitted``.
        """
        self.wheels, self.config = wheels, config
        # For each wheel, indices in ``joints`` and directions of the joints that turn as one.
        self._groups = [
            [(joints.index(name), wheels.directions[name]) for name in names]
            for names in wheels.groups
        ]
        # The index of each steering joint, and 1 if positive positions steer to the left.
        self._steering_indices = [
            (joints.index(name), math.copysign(1.0, wheels.axles[name].axis[2]))
            for name in wheels.steering
        ]
        self._steering: Sequence[float] = (0.0,) * len(wheels.steering)
        self.command = DriveCommand(0.0, 0.0, 0.0, (), self._steering)
        _, kinematics = config.fitted(wheels)
        self.odometry = Odometry(kinematics, config.velocity_rolling_window_size)
        self.origin = PlanarPose()
        self.drift, self.notice = DriftCheck(skids=wheels.skids), ""
        self.configure(config)
        self.halt()

    def configure(self, config: DriveParameters[Any]) -> None:
        """Apply changed parameters; pose, command and speed stay as they are.

        Raises:
            OneBotError: see ``DriveParameters.fitted``; nothing has changed.
        """
        self.geometry, self.odometry.kinematics = config.fitted(self.wheels)
        feedback = self.config.open_loop, self.config.position_feedback
        self.config = config
        if (config.open_loop, config.position_feedback) != feedback:
            # The wheels have moved since they were last used as feedback.
            self.odometry.rereference_wheels()
        limits, self._timeout = config.limits, config.timeout  # s
        self._limiters = [(_AXES.index(axis), SpeedLimiter(limits[axis])) for axis in limits]
        self.odometry.set_window(config.velocity_rolling_window_size)
        self.odometry.noise = config.noise(len(self.odometry.kinematics.shares))

    def check(self, config: DriveParameters[Any]) -> None:
        """Raise the OneBotError that ``configure`` would raise."""
        config.fitted(self.wheels)

    @property
    def window(self) -> int:
        """Number of cycles over which velocities are averaged."""
        return self.config.velocity_rolling_window_size

    def accept(
        self, linear: float, angular: float, age: float | None = None, *, lateral: float = 0.0
    ) -> str | None:
        """Command a velocity, unless it is not finite or too old.

        Args:
            linear: forward, m/s; clamped to +-1e6.
            angular: turning to the left, rad/s; clamped to +-1e6.
            age: seconds since the command was given. None (unknown) and negative ages (the sender's
                clock is ahead, or ours was set back) count as 0.
            lateral: to the left, m/s; clamped to +-1e6; ignored if the drive cannot move sideways.

        Returns:
            Why the command is ignored; None if it is accepted.
        """
        if not (math.isfinite(linear) and math.isfinite(lateral) and math.isfinite(angular)):
            return f"not finite: linear.x {linear}, linear.y {lateral}, angular.z {angular}"
        age = max(0.0, age or 0.0)
        if self._timeout and age >= self._timeout:
            return f"{age:.3f} s old, but cmd_vel_timeout is {self._timeout:g} s"
        if lateral and not self.moves_sideways:
            self.notice = "linear.y is ignored: the drive does not move sideways"
        elif fault := self.odometry.kinematics.fault((linear, lateral, angular)):
            self.notice = fault
        x, y, turn = (clamp(v, -_FASTEST, _FASTEST) for v in (linear, lateral, angular))
        self._reference = x, y, turn
        self._age, self._fresh = age, True
        return None

    def observe(self, positions: Sequence[float], velocities: Sequence[float], dt: float) -> None:
        """Update the odometry with the joints' state, ``dt`` seconds after the last call."""
        steering_before, steering = self._steering, self._steering
        if self._steering_indices:
            self._steering = [sign * positions[index] for index, sign in self._steering_indices]
            steering = [
                (last + now) / 2.0
                for last, now in zip(steering_before, self._steering, strict=True)
            ]
        if self.config.open_loop:
            return
        if self.config.position_feedback:
            turned = [_mean(group, positions) for group in self._groups]
            self.odometry.update_from_positions(turned, dt, steering)
        else:
            turned = [_mean(group, velocities) for group in self._groups]
            self.odometry.update_from_velocities(turned, dt, steering)

    def decide(self, dt: float) -> DriveCommand:
        """Update ``command`` for the next ``dt`` seconds, and return it."""
        # A command's first cycle comes less than dt after it, so do not age it yet.
        self._age += 0.0 if self._fresh else dt
        self._fresh = False
        twist = self._limited(dt)
        kinematics = self.odometry.kinematics
        command = kinematics.command(twist, self._steering, dt)
        self.command = kinematics.limited(command, self.command, dt)
        if self.config.open_loop:
            self.odometry.update_open_loop(PlanarVelocity(*self.command[:3]), dt)
        return self.command

    @property
    def velocities(self) -> list[float]:
        """The velocity of each joint of ``wheels.names`` for the current command, rad/s."""
        pairs = zip(self._groups, self.command.wheels, strict=True)
        return [direction * speed for group, speed in pairs for _, direction in group]

    @property
    def steering(self) -> list[float]:
        """The position of each joint of ``wheels.steering`` for the current command, rad."""
        pairs = zip(self._steering_indices, self.command.steering, strict=True)
        return [sign * position for (_, sign), position in pairs]

    def wait(self, seconds: float) -> None:
        """Age the command by ``seconds`` without a control cycle, as in a pause or a stall."""
        self._age += seconds

    def halt(self) -> None:
        """Stop the wheels immediately; the next command starts from rest."""
        self._reference = self._last = self._before_last = _REST
        self._age, self._fresh = 0.0, True
        still = (0.0,) * len(self._groups)
        self.command = DriveCommand(0.0, 0.0, 0.0, still, self.command.steering)

    @property
    def moves_sideways(self) -> bool:
        """Whether it has the axis linear.y."""
        return "linear.y" in self.config.limits

    @property
    def timed_out(self) -> bool:
        """Whether the last command is older than the timeout."""
        return bool(self._timeout) and self._age > self._timeout + _ROUNDING

    def place(self, pose: PlanarPose, truth: PlanarPose) -> None:
        """Set the odometry's pose, with zero covariance, for a robot that is at ``truth``."""
        self.odometry.set_pose(*pose)
        self.origin = truth.compose(pose.inverse())
        self.drift.restart()

    def moved(self) -> None:
        """Stop, and continue from the current pose, after a teleport."""
        self.halt()
        self.odometry.forget_wheels()
        self.drift.restart()

    def continue_from(self, other: "Drive | None") -> None:
        """Take over the odometry of the drive that this one replaces; None if there was none."""
        if other is None:
            return
        self.odometry.set_pose(*other.odometry.pose, other.odometry.covariance)
        self.origin = other.origin

    def state(self, pace: float) -> DriveState:
        """Return the current state; ``pace`` is simulated seconds per second of the clock."""
        odometry, twist = self.odometry, self.odometry.twist
        if pace != 1.0:
            twist = PlanarVelocity(*[component * pace for component in twist])
        return DriveState(odometry.pose, odometry.covariance, twist, self.command, self.origin)

    def _limited(self, dt: float) -> Triple:
        # A timed-out command becomes a zero reference, ramped down by the limiters.
        target = _REST if self.timed_out else self._reference
        last, before_last, speeds = self._last, self._before_last, [0.0, 0.0, 0.0]
        for axis, limiter in self._limiters:
            speeds[axis] = limiter.limit(target[axis], last[axis], before_last[axis], dt)
        self._before_last, self._last = last, (speeds[0], speeds[1], speeds[2])
        return self._last


class NoDrive:
    """Replaces the ``Drive`` of a robot with a fixed base, and does nothing."""

    velocities: Sequence[float] = ()
    steering: Sequence[float] = ()
    window = 10

    def _do_nothing(self, *_: object, **__: object) -> Any:
        return None

    accept = observe = decide = wait = state = _do_nothing
    place = moved = continue_from = check = configure = _do_nothing


def _mean(group: Sequence[tuple[int, float]], values: Sequence[float]) -> float:
    """Return the mean forward position, rad, or velocity, rad/s, of joints that turn as one."""
    mean = 0.0
    for index, direction in group:
        mean += direction * values[index]
    return mean / len(group)
