"""The differential-drive controller: commands in, wheel velocities and odometry out. No ROS here.

Example:
    >>> from onebot_control.drive.diff_drive import DiffDriveController, WheelStates
    >>> from onebot_control.drive.odometry import DiffDriveKinematics
    >>> from onebot_control.drive.parameters import ControlConfig
    >>> kinematics = DiffDriveKinematics(separation=0.4, left_radius=0.1, right_radius=0.1)
    >>> controller = DiffDriveController(ControlConfig.from_parameters({}), kinematics)
    >>> controller.accept(linear=0.2, angular=0.0)
    >>> wheels = controller.update(WheelStates(0.0, 0.0, 0.0, 0.0), dt=0.01)
    >>> wheels.left, wheels.right  # rad/s
    (2.0, 2.0)
"""

import math
from collections import deque
from typing import NamedTuple

from onebot_control.drive.odometry import DiffDriveKinematics, Odometry
from onebot_control.drive.parameters import ControlConfig
from onebot_control.drive.speed_limiter import SpeedLimiter
from onebot_description.geometry.poses import clamp, total

_ROUNDING = 1e-9  # s; greatest rounding error of a sum of periods
_FASTEST = 1e6  # m/s or rad/s; faster commands are clamped, so that all results are finite


class WheelStates(NamedTuple):
    """Measured positions and velocities of the wheels: the mean of each side."""

    left_position: float  # rad
    right_position: float
    left_velocity: float  # rad/s
    right_velocity: float


class WheelCommand(NamedTuple):
    """Wheel velocities, and the limited command from which they follow."""

    left: float  # velocity of the left wheels, rad/s
    right: float  # velocity of the right wheels, rad/s
    linear: float  # the limited command, m/s
    angular: float  # the limited command, rad/s


class DiffDriveController:
    """Turns velocity commands into wheel velocities, as diff_drive_controller does.

    It holds the last command until that times out, limits it, and updates the odometry. It reads no
    clock, so no jump of a clock can disturb it: commands age by the durations passed to ``update``,
    ``wait`` and ``stalled``.

    Attributes:
        odometry: the robot's pose and twist by its wheels, in the time of the cycles.
        pace: time of the cycles divided by the time that passed, averaged over
            velocity_rolling_window_size cycles: 1, or less if cycles were late. A velocity times
            the pace is the change of position per change of stamp.
    """

    def __init__(self, config: ControlConfig, kinematics: DiffDriveKinematics) -> None:
        """Start at rest, with odometry at zero and no command."""
        window = config.velocity_rolling_window_size
        self.odometry = Odometry(kinematics, window)
        # Pairs: seconds of a cycle, and seconds that passed (as many, or more).
        self._passed: deque[tuple[float, float]] = deque(maxlen=window)
        self.pace = 1.0
        self._stalled = 0.0
        self._config = config
        self.configure(config, kinematics)
        self.halt()

    def configure(self, config: ControlConfig, kinematics: DiffDriveKinematics) -> None:
        """Apply changed parameters; pose, command and speed stay as they are."""
        feedback = self._config.open_loop, self._config.position_feedback
        self._config = config
        if (config.open_loop, config.position_feedback) != feedback:
            # The wheels have moved since they were last used as feedback.
            self.odometry.rereference_wheels()
        self._linear_limiter = SpeedLimiter(config.linear)
        self._angular_limiter = SpeedLimiter(config.angular)
        self.odometry.kinematics = kinematics
        window = config.velocity_rolling_window_size
        self.odometry.set_window(window)
        self._passed = deque(self._passed, window)
        self.odometry.noise = config.left_wheel_noise**2, config.right_wheel_noise**2

    def accept(self, linear: float, angular: float, age: float | None = None) -> str | None:
        """Command a velocity, unless it is not finite or too old.

        Args:
            linear: forward, m/s; clamped to +-1e6.
            angular: velocity of turning to the left, rad/s; clamped to +-1e6.
            age: seconds since the command was given. None (unknown) and negative ages (the sender's
                clock is ahead, or ours was set back) count as 0.

        Returns:
            Why the command is ignored; None if it is accepted.
        """
        if not (math.isfinite(linear) and math.isfinite(angular)):
            return f"not finite: linear.x {linear}, angular.z {angular}"
        timeout = self._config.cmd_vel_timeout
        age = max(0.0, age or 0.0)
        if timeout and age >= timeout:
            return f"{age:.3f} s old, and cmd_vel_timeout is {timeout:g} s"
        self._reference = (
            clamp(linear, -_FASTEST, _FASTEST),
            clamp(angular, -_FASTEST, _FASTEST),
        )
        self._age = age
        self._fresh = True
        return None

    def update(self, wheels: WheelStates, dt: float) -> WheelCommand:
        """Run one control cycle, ``dt`` seconds after the last one; return the command."""
        self.observe(wheels, dt)
        return self.decide(dt)

    def observe(self, wheels: WheelStates, dt: float) -> None:
        """Update the odometry with the wheels' state, ``dt`` seconds after the last call."""
        if self._config.open_loop:
            return
        if self._config.position_feedback:
            left, right = wheels.left_position, wheels.right_position
            self.odometry.update_from_positions(left, right, dt)
        else:
            left, right = wheels.left_velocity, wheels.right_velocity
            self.odometry.update_from_velocities(left, right, dt)

    def decide(self, dt: float) -> WheelCommand:
        """Return the wheel velocities for the next ``dt`` seconds: the command within limits."""
        # A command's first cycle comes less than dt after it, so do not age it yet.
        self._age += 0.0 if self._fresh else dt
        self._fresh = False
        self._pass(dt + self._stalled, dt)
        self._stalled = 0.0
        linear, angular = self._limited(dt)
        if self._config.open_loop:
            self.odometry.update_open_loop(linear, angular, dt)
        left, right = self.odometry.kinematics.wheel_velocities(linear, angular)
        return WheelCommand(left, right, linear, angular)

    def wait(self, seconds: float) -> None:
        """Age the command by ``seconds`` without a control cycle, as in a pause."""
        self._age += seconds
        self._pass(seconds, 0.0)

    def stalled(self, seconds: float) -> None:
        """Age the command by ``seconds`` in which this process did not run."""
        self._age += seconds
        self._stalled += seconds

    def halt(self) -> None:
        """Stop the wheels at once; the next command starts from rest."""
        self._reference = (0.0, 0.0)
        self._last = self._before_last = (0.0, 0.0)
        self._age = 0.0
        self._fresh = True

    @property
    def timed_out(self) -> bool:
        """Whether the last command is older than cmd_vel_timeout."""
        timeout = self._config.cmd_vel_timeout
        return bool(timeout) and self._age > timeout + _ROUNDING

    def _pass(self, seconds: float, cycle: float) -> None:
        """Record that ``seconds`` passed, of which ``cycle`` seconds were a control cycle."""
        self._passed.append((cycle, seconds))
        if self.pace < 1.0 or cycle < seconds:
            cycles, durations = zip(*self._passed, strict=True)
            self.pace = total(cycles) / total(durations)

    def _limited(self, dt: float) -> tuple[float, float]:
        # A timed-out command becomes a zero reference, ramped down by the limiter.
        linear, angular = (0.0, 0.0) if self.timed_out else self._reference
        limited = (
            self._linear_limiter.limit(linear, self._last[0], self._before_last[0], dt),
            self._angular_limiter.limit(angular, self._last[1], self._before_last[1], dt),
        )
        self._before_last, self._last = self._last, limited
        return limited
