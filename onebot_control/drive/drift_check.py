"""Detects that odometry and truth of a simulated robot drift apart, and says why that may be."""

import math
from collections.abc import Callable

from onebot_description.geometry.poses import PlanarPose

_STRETCH = 1.0  # m or rad over which the two are compared
_MOST = 0.1  # fraction of a stretch by which they may differ
# The same for turns of skid-steer robots: their effective separation is an estimate for slow turns.
_MOST_SKIDDING = 0.3
_STILL = 1e-4  # m or rad per update; a robot that moves less counts as standing
_SETTLING = 5  # updates after a push until the robot has stopped skidding

_SLIP = (
    "the wheels slip, which a limit of acceleration prevents ({}.max_acceleration); another part "
    "of the robot rests on the ground; "
)
_WAY = _SLIP.format("linear.x") + "or wheel_radius is not that of the wheels"
_TURN = (
    "further wheels on the ground do not turn with the robot, as those of a car; "
    + _SLIP.format("angular.z")
    + "or wheel_separation is not that of the wheels"
)


class DriftCheck:
    """Compares odometry with ground truth over a metre or a radian at a time.

    Attributes:
        warning: the warning to log; "" as long as they agree.
    """

    def __init__(self, *, skids: bool) -> None:
        """Start without poses; ``skids`` allows for the wheels of skid steer in turns."""
        self.warning = ""
        self._most_turn = _MOST_SKIDDING if skids else _MOST
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
            odometry: pose by the wheels, in any fixed frame.
            truth: true pose, in any fixed frame.
            obstructed: returns whether something holds the robot back; then slipping is expected.
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
        if max(self._driven, self._turned) >= _STRETCH:
            self._compare()
            self.restart()

    def _compare(self) -> None:
        for what, unit, reasons, most, total, (wheels, true) in (
            ("drove", "m", _WAY, _MOST, self._driven, self._way),
            ("turned", "rad", _TURN, self._most_turn, self._turned, self._turn),
        ):
            if abs(wheels - true) > most * max(total, _STRETCH):
                self.warning = (
                    f"odometry and truth drift apart: by its wheels the robot {what} "
                    f"{wheels:.2f} {unit}, in truth {true:.2f} {unit}. Likely reasons: {reasons}"
                )
                return


def _step(before: PlanarPose, now: PlanarPose) -> tuple[float, float]:
    """Return how far a pose has moved forward, m, and turned, rad."""
    step = before.inverse().compose(now)
    return step.x, math.remainder(step.yaw, 2.0 * math.pi)
