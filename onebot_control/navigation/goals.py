"""Goals that drive the robot, one at a time. No ROS here."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from onebot_control.navigation.navigator import Failure, Navigator
from onebot_description.geometry.poses import PlanarPose

_PASSED = 0.5  # m from an intermediate pose at which the next one becomes the target
_MONITORED = 0.1  # s between two feedback messages


@dataclass
class Goal:
    """A goal that drives the robot.

    Attributes:
        poses: target poses in the map; empty for a motion.
        motion: starts a motion, if there are no poses.
        stops: whether the robot stops at each pose and skips missed ones; else only at the last.
        stops_on_failure: whether the goal ends at the first missed pose.
        loops: number of further repetitions.
        lasts: time to wait, s; 0 for a goal that drives.
        index: index of the next pose.
        missed: index and failure of poses that were not reached.
        client: its sender; ``client.feed(goal, navigator)`` receives the progress, and
            ``client.ended(goal, reason, failure)`` the result; None for a goal of the topic.
        handle: the client's handle of the goal.
        began: start time of the navigator, s.
    """

    poses: Sequence[PlanarPose] = ()
    motion: Callable[[Navigator], None] | None = None
    stops: bool = False
    stops_on_failure: bool = False
    loops: int = 0
    lasts: float = 0.0
    index: int = 0
    missed: list[tuple[int, Failure]] = field(default_factory=list)
    client: Any = None
    handle: Any = None
    began: float = 0.0

    def next(self, navigator: Navigator) -> bool:
        """Start driving to the next pose, or the motion; return whether there is one."""
        if self.poses and self.index >= len(self.poses) and self.loops > 0:
            self.loops, self.index = self.loops - 1, 0
        if self.index < len(self.poses):
            navigator.go_to(*self.poses[self.index])
            return True
        if self.motion is not None:
            self.motion(navigator)
            self.motion = None
            return True
        return False

    def passes(self, navigator: Navigator) -> bool:
        """Return whether the robot passes an intermediate pose."""
        if self.stops or self.index >= len(self.poses) - 1:
            return False
        x, y, _ = self.poses[self.index]
        return math.hypot(x - navigator.pose.x, y - navigator.pose.y) < _PASSED


class Goals:
    """Starts goals, monitors them, and reports their results to their clients."""

    def __init__(
        self, navigator: Callable[[], Navigator], prepare: Callable[[], None], logger: Any
    ) -> None:
        """Start without a goal.

        Args:
            navigator: returns the navigator; raises OneBotError while there is none.
            prepare: called before a goal drives the robot; raises OneBotError if it cannot.
            logger: has the methods ``info`` and ``warning``.
        """
        self._navigator, self._prepare, self._logger = navigator, prepare, logger
        self._goal: Goal | None = None
        self._fed = -math.inf

    @property
    def active(self) -> bool:
        """Whether a goal is active."""
        return self._goal is not None

    def start(self, goal: Goal) -> None:
        """Start a goal, which replaces any other.

        Raises:
            OneBotError: it cannot start now.
            ValueError: a number of a motion is out of range.
        """
        self._prepare()
        navigator = self._navigator()
        self._end("another goal has come")
        goal.began = navigator.time
        goal.next(navigator)
        self._goal = goal
        places = [f" to {x:.2f}, {y:.2f} m, {yaw:.2f} rad" for x, y, yaw in goal.poses[-1:]]
        self._logger.info(f"a goal begins{''.join(places)}")

    def cancel(self, reason: str, client: Any = None) -> None:
        """Cancel the goal, if there is one; with ``client`` only if that client sent it."""
        if self._goal is not None and client in (None, self._goal.client):
            self._end(reason)

    def step(self) -> None:
        """Check the progress of the goal; call this after each update of the navigator."""
        goal = self._goal
        if goal is None:
            return
        navigator = self._navigator()
        if goal.lasts:
            if navigator.time - goal.began >= goal.lasts:
                self._end("")
        elif goal.passes(navigator):
            goal.index += 1
            goal.next(navigator)
        elif not navigator.navigating:
            self._leg_ended(goal, navigator)
        if self._goal is goal and goal.client is not None:
            if not 0.0 <= navigator.time - self._fed < _MONITORED:
                self._fed = navigator.time
                goal.client.feed(goal, navigator)

    def _leg_ended(self, goal: Goal, navigator: Navigator) -> None:
        failure = navigator.failure
        if failure is not None and goal.stops:
            self._logger.info(f"pose {goal.index} was not reached: {navigator.reason}")
            goal.missed.append((goal.index, failure))
        goal.index += 1
        skips = failure is not None and goal.stops and not goal.stops_on_failure
        if not skips and navigator.status != "arrived":
            self._end(navigator.reason, failure)
        elif not goal.next(navigator):
            self._end("")

    def _end(self, reason: str, failure: Failure | None = None) -> None:
        """End the goal, as reached if ``reason`` is empty."""
        goal, self._goal = self._goal, None
        if goal is None:
            return
        self._navigator().cancel(reason)
        if reason:
            self._logger.warning(f"the goal has ended: {reason}")
        else:
            self._logger.info("the goal is reached")
        if goal.client is not None:
            goal.client.ended(goal, reason, failure)
