"""Detects that odometry and ground truth of a simulated robot drift apart, and suggests causes."""

import math
from collections.abc import Sequence
from operator import add

from onebot_description.geometry.poses import PlanarPose

_DISTANCE = 1.0  # m or rad over which the two are compared
_MAX_ERROR = 0.1  # fraction of the distance by which they may differ
# The same for turns of skid-steer robots: their effective separation is an estimate for slow turns.
_MAX_SKIDDING = 0.3
_SETTLING = 5  # updates after a push until the robot has stopped skidding
_REASONS = (
    "the wheels slip, which a limit of acceleration prevents ({}.max_acceleration); another part "
    "of the robot touches the ground; {} is wrong"
)
_AS_IN_A_CAR = "; or other wheels on the ground do not turn with the robot, as in a car"
_KINDS = (
    ("drove", "m", _REASONS.format("linear.x", "or wheel_radius")),
    ("turned", "rad", _REASONS.format("angular.z", "wheel_separation") + _AS_IN_A_CAR),
)


class DriftCheck:
    """Compares odometry with ground truth over a meter or a radian at a time.

    Attributes:
        warning: the warning to log; "" as long as they agree.
    """

    def __init__(self, *, skids: bool) -> None:
        """Start without poses; ``skids`` allows for skidding in turns."""
        self.warning = ""
        self._max_errors = _MAX_ERROR, _MAX_SKIDDING if skids else _MAX_ERROR
        self._wait = 0  # updates without a push until the comparison starts
        self.restart()

    def restart(self) -> None:
        """Start a new comparison with the next poses, because one of them jumps."""
        self._last: tuple[PlanarPose, PlanarPose] | None = None
        # Way, m, and turn, rad: by the wheels, true ones, and by the wheels in any direction.
        self._sums: Sequence[float] = (0.0,) * 6

    def update(self, odometry: PlanarPose, truth: PlanarPose, *, obstructed: bool) -> None:
        """Compare the motion since the last call; call it several times a second.

        Args:
            odometry: pose from the wheels, in any fixed frame.
            truth: true pose, in any fixed frame.
            obstructed: whether something holds the robot back, so that it may slip.
        """
        self._wait = _SETTLING if obstructed else self._wait - 1
        if self._wait >= 0:
            self.restart()
            return
        before, self._last = self._last, (odometry, truth)
        if before is None:
            return
        wheels, true = map(_motion, before, self._last)
        self._sums = [*map(add, self._sums, (*wheels, *true, *map(abs, wheels)))]
        if max(self._sums[4:]) >= _DISTANCE:
            self.warning = self.warning or self._compared()
            self.restart()

    def _compared(self) -> str:
        for index, (what, unit, reasons) in enumerate(_KINDS):
            wheels, true, path = self._sums[index::2]
            if abs(wheels - true) > self._max_errors[index] * max(path, _DISTANCE):
                return (
                    f"odometry and ground truth drift apart: by its wheels, the robot {what} "
                    f"{wheels:.2f} {unit}, actually {true:.2f} {unit}. Likely reasons: {reasons}"
                )
        return ""


def _motion(before: PlanarPose, now: PlanarPose) -> tuple[float, float]:
    """Return how far a pose has moved forward, m, and turned, rad."""
    step = before.inverse().compose(now)
    return step.x, math.remainder(step.yaw, 2.0 * math.pi)
