"""The differential-drive controller: commands in, wheel velocities and odometry out. No ROS here.

controller = DiffDriveController(config, config.kinematics(geometry))
controller.accept(linear=0.2, angular=0.0)
wheels = controller.update(WheelStates(0.0, 0.0, 0.0, 0.0), dt=0.01)
"""

import math
from collections import deque
from typing import NamedTuple

from onebot_control.drive.odometry import DiffDriveKinematics, Odometry
from onebot_control.drive.speed_limiter import SpeedLimiter, clamp
from onebot_control.parameters import ControlConfig

_ROUNDING = 1e-9  # s that a sum of periods may be off
_FASTEST = 1e6  # m/s or rad/s; what follows from a faster command need not be finite


class WheelStates(NamedTuple):
    """Positions and velocities of the wheels: each side's mean."""

    left_position: float  # rad
    right_position: float
    left_velocity: float  # rad/s
    right_velocity: float


class DriveCommand(NamedTuple):
    """The wheels' velocities, and the command that they follow from."""

    left: float  # velocity of the left wheels, rad/s
    right: float  # velocity of the right wheels, rad/s
    linear: float  # the limited command, m/s
    angular: float  # the limited command, rad/s


class DiffDriveController:
    """Holds the last command, lets it age, limits it, and updates the odometry.

    It uses durations only, no clock, so no clock can disturb it. Commands age by the durations
    given to ``update``, ``wait`` and ``stalled``.

    Attributes:
        odometry: the robot's pose and twist by its wheels, in the time of the cycles.
        pace: seconds of cycles in a second of the durations, over velocity_rolling_window_size of
            them. Times it, a velocity is the change of a position by the change of its stamp.
    """

    def __init__(self, config: ControlConfig, kinematics: DiffDriveKinematics) -> None:
        window = config.velocity_rolling_window_size
        self.odometry = Odometry(kinematics, window)
        # Seconds of cycles, and the seconds that passed: as many, or more.
        self._passed: deque[tuple[float, float]] = deque(maxlen=window)
        self.pace = 1.0
        self._stalled = 0.0
        self._config = config
        self.configure(config, kinematics)
        self.halt()

    def configure(self, config: ControlConfig, kinematics: DiffDriveKinematics) -> None:
        """Apply other parameters; pose, command and speed stay as they are."""
        feedback = self._config.open_loop, self._config.position_feedback
        self._config = config
        if (config.open_loop, config.position_feedback) != feedback:
            # Where they were last used as feedback, the wheels are no longer.
            self.odometry.rereference_wheels()
        self._linear_limiter = SpeedLimiter(config.linear)
        self._angular_limiter = SpeedLimiter(config.angular)
        self.odometry.kinematics = kinematics
        window = config.velocity_rolling_window_size
        self.odometry.set_window(window)
        self._passed = deque(self._passed, window)
        self.odometry.noise = config.left_wheel_noise**2, config.right_wheel_noise**2

    def accept(self, linear: float, angular: float, age: float | None = None) -> str | None:
        """Command a velocity.

        Args:
            linear: m/s, forward; above 1e6, it counts as that.
            angular: rad/s, to the left; likewise.
            age: seconds since it was given; None if it is not known. Neither is it below 0, by a
                clock that is ahead of ours or ours set back. Then it is taken as new.

        Returns:
            Why it is ignored; None if it is accepted.
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

    def update(self, wheels: WheelStates, dt: float) -> DriveCommand:
        """Do one control cycle, ``dt`` seconds after the last one."""
        self.observe(wheels, dt)
        return self.decide(dt)

    def observe(self, wheels: WheelStates, dt: float) -> None:
        """Update the odometry by the wheels, ``dt`` seconds after the last time."""
        if self._config.open_loop:
            return
        if self._config.position_feedback:
            left, right = wheels.left_position, wheels.right_position
            self.odometry.update_from_positions(left, right, dt)
        else:
            left, right = wheels.left_velocity, wheels.right_velocity
            self.odometry.update_from_velocities(left, right, dt)

    def decide(self, dt: float) -> DriveCommand:
        """Return the velocities for the next ``dt`` seconds, by the command and its limits."""
        # A command's first cycle comes less than dt after it, so do not age it yet.
        self._age += 0.0 if self._fresh else dt
        self._fresh = False
        self._pass(dt + self._stalled, dt)
        self._stalled = 0.0
        linear, angular = self._limited(dt)
        if self._config.open_loop:
            self.odometry.update_open_loop(linear, angular, dt)
        left, right = self.odometry.kinematics.wheel_velocities(linear, angular)
        return DriveCommand(left, right, linear, angular)

    def wait(self, seconds: float) -> None:
        """Let the command age by ``seconds`` in which there was no cycle."""
        self._age += seconds
        self._pass(seconds, 0.0)

    def stalled(self, seconds: float) -> None:
        """As ``wait``, because this process did not run."""
        self._age += seconds
        self._stalled += seconds

    def halt(self) -> None:
        """Forget command and speed: the wheels stop, and the next command starts from rest."""
        self._reference = (0.0, 0.0)
        self._last = self._before_last = (0.0, 0.0)
        self._age = 0.0
        self._fresh = True

    @property
    def timed_out(self) -> bool:
        """Whether the last command has outlived cmd_vel_timeout."""
        timeout = self._config.cmd_vel_timeout
        return bool(timeout) and self._age > timeout + _ROUNDING

    def _pass(self, seconds: float, cycle: float) -> None:
        """Let ``seconds`` pass, which a cycle has ``cycle`` of."""
        self._passed.append((cycle, seconds))
        if self.pace < 1.0 or cycle < seconds:
            cycles, durations = zip(*self._passed, strict=True)
            self.pace = sum(cycles) / sum(durations)

    def _limited(self, dt: float) -> tuple[float, float]:
        # A timed-out command becomes a zero reference, ramped down by the limiter.
        linear, angular = (0.0, 0.0) if self.timed_out else self._reference
        limited = (
            self._linear_limiter.limit(linear, self._last[0], self._before_last[0], dt),
            self._angular_limiter.limit(angular, self._last[1], self._before_last[1], dt),
        )
        self._before_last, self._last = self._last, limited
        return limited
