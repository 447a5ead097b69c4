"""How late a robot follows its commands, and where it is when the next command takes effect.

Networks, drivers and old odometry delay what a planner sees of its own commands. The delay is the
one with which the last commands, within the robot's acceleration limits, explain its velocities
best. The commands that are still under way then predict the state that the next one meets.
"""

from collections import deque

import numpy as np

from onebot_control.navigation.footprint import Vehicle
from onebot_description.arrays import Floats
from onebot_description.geometry.poses import PlanarPose, Triple

_MAX_DELAY = 0.3  # s
_KEPT = 0.98  # share of the errors that the next period keeps


class Latency:
    """Estimates the delay of one robot's commands.

    Attributes:
        periods: the delay in periods of the planner, at least 0.
    """

    def __init__(self, vehicle: Vehicle, period: float) -> None:
        """Start without a delay; ``period`` is the time between two commands, s."""
        linear, angular = vehicle.acceleration, vehicle.turning_acceleration
        self._period, self._steps = period, np.array((linear, linear, angular)) * period
        count = 1 + round(_MAX_DELAY / period)
        self._commands = deque([np.zeros(3)] * count, count)  # the latest one first
        self._errors, self._last = np.zeros(count), np.zeros(3)
        self.periods = 0

    def measure(self, speed: Triple) -> None:
        """Compare the velocity, one period after the last command, with what explains it."""
        explained = self._reached(self._last, np.array(self._commands))
        self._last = np.array(speed)
        errors = np.abs(explained - self._last) / self._steps
        self._errors = _KEPT * self._errors + errors.sum(axis=1)
        self.periods = int(self._errors.argmin())

    def _reached(self, speed: Floats, command: Floats) -> Floats:
        """Return the velocity one period after a command."""
        return speed + np.clip(command - speed, -self._steps, self._steps)

    def remember(self, command: Triple) -> Triple:
        """Return the command, which is sent now."""
        self._commands.appendleft(np.array(command))
        return command

    def ahead(self, pose: PlanarPose, speed: Triple) -> tuple[PlanarPose, Triple]:
        """Return the robot's pose and velocity when the next command takes effect."""
        for command in list(self._commands)[: self.periods][::-1]:
            last, speed = speed, tuple(self._reached(np.array(speed), command).tolist())
            x, y, turn = (np.add(last, speed) * (0.5 * self._period)).tolist()
            half = PlanarPose(yaw=turn / 2.0)
            pose = pose.compose(half).compose(PlanarPose(x, y)).compose(half)
        return pose, speed
