"""Detects that odometry and ground truth of a simulated robot drift apart, and suggests causes."""

import math
from collections.abc import Callable

from onebot_description.geometry.poses import PlanarPose

_DISTANCE = 1.0  # m or rad over which the two are compared
_MAX_ERROR = 0.1  # fraction of the distance by which they may differ
# The same for turns of skid-steer robots: their effective separation is an estimate for slow turns.
_MAX_SKIDDING = 0.3
_STILL = 1e-4  # m or rad per update; a robot that moves less counts as stationary
_SETTLING = 5  # updates after a push until the robot has stopped skidding

_SLIP = (
    "the wheels slip, which a limit of acceleration prevents ({}.max_acceleration); another part "
    "of the robot touches the ground; "
)
_WAY = _SLIP.format("linear.x") + "or wheel_radius is wrong"
_TURN = (
    "other wheels on the ground do not turn with the robot, as in a car; "
    + _SLIP.format("angular.z")
    + "or wheel_separation is wrong"
)


class DriftCheck:
    """Compares odometry with ground truth over a meter or a radian at a time.

    Attributes:
        warning: the warning to log; "" as long as they agree.
    """

    def __init__(self, *, skids: bool) -> None:
        """Start without poses; ``skids`` allows for skidding in turns."""
        self.warning = ""
        self._max_turn_error = _MAX_SKIDDING if skids else _MAX_ERROR
        self.restart()

    def restart(self) -> None:
        """Start a new comparison with the next poses, because one of them jumps."""
        self._last: tuple[PlanarPose, PlanarPose] | None = None
        self._wait = 0  # updates without a push before the comparison starts

    def update(
        self, odometry: PlanarPose, truth: PlanarPose, obstructed: Callable[[], bool]
    ) -> None:
        """Compare the motion since the last call; call it several times a second.

        Args:
            odometry: pose from the wheels, in any fixed frame.
            truth: true pose, in any fixed frame.
            obstructed: returns whether something holds the robot back, so that it may slip.
        """
        if self.warning:
            return
        if self._last is None:
            if obstructed():
                self._wait = _SETTLING
            elif self._wait:
                self._wait -= 1
            else:
                self._last, self._way, self._turn = (odometry, truth), (0.0, 0.0), (0.0, 0.0)
                self._driven = self._turned = 0.0
            return
        (way, turn), (true_way, true_turn) = map(_step, self._last, (odometry, truth))
        if max(map(abs, (way, turn, true_way, true_turn))) < _STILL:
            return
        if obstructed():
            self._last, self._wait = None, _SETTLING
            return
        self._last = odometry, truth
        self._way = self._way[0] + way, self._way[1] + true_way
        self._turn = self._turn[0] + turn, self._turn[1] + true_turn
        self._driven, self._turned = self._driven + abs(way), self._turned + abs(turn)
        if max(self._driven, self._turned) >= _DISTANCE:
            self._compare()
            self.restart()

    def _compare(self) -> None:
        for what, unit, reasons, limit, total, (wheels, true) in (
            ("drove", "m", _WAY, _MAX_ERROR, self._driven, self._way),
            ("turned", "rad", _TURN, self._max_turn_error, self._turned, self._turn),
        ):
            if abs(wheels - true) > limit * max(total, _DISTANCE):
                self.warning = (
                    f"odometry and ground truth drift apart: by its wheels, the robot {what} "
                    f"{wheels:.2f} {unit}, actually {true:.2f} {unit}. Likely reasons: {reasons}"
                )
                return


def _step(before: PlanarPose, now: PlanarPose) -> tuple[float, float]:
    """Return how far a pose has moved forward, m, and turned, rad."""
    step = before.inverse().compose(now)
    return step.x, math.remainder(step.yaw, 2.0 * math.pi)
