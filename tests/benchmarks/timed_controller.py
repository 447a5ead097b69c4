"""velocity_controller as it is, with its control loop measured; a process of its own.

``python -m tests.benchmarks.timed_controller [ARGUMENTS]`` takes the node's arguments. A line on
standard input is answered by one of JSON on standard output: what has happened since the last one
(see ``Watch``). It ends with Ctrl-C.
"""

import sys
import time
from collections.abc import Callable

from onebot_control import control_loop, velocity_controller
from onebot_control.control_loop import Pacer
from onebot_control.driven_robot import DrivenRobot
from tests.benchmarks.watch import Watch


def install(watch: Watch) -> None:
    """Have ``watch`` record when cycles begin and when wheel velocities are set."""

    class TimedPacer(Pacer):
        """Records how late each cycle begins."""

        def next(self, wait: Callable[[float], object]) -> None:
            """Wait for the next cycle."""
            super().next(wait)
            watch.woke(time.monotonic() - self.due, self.lag)

    accept, turn = DrivenRobot.accept, DrivenRobot.turn

    def timed_accept(
        robot: DrivenRobot, linear: float, angular: float, age: float | None = None
    ) -> str | None:
        refused = accept(robot, linear, angular, age)
        if refused is None:
            watch.commanded(linear)
        return refused

    def timed_turn(robot: DrivenRobot) -> None:
        watch.told_wheels(robot.controller.odometry.linear)
        turn(robot)

    setattr(control_loop, "Pacer", TimedPacer)  # noqa: B010 - the loop makes its own
    DrivenRobot.accept = timed_accept  # type: ignore
    DrivenRobot.turn = timed_turn  # type: ignore


if __name__ == "__main__":
    watch = Watch()
    install(watch)
    watch.answer_orders()
    sys.exit(velocity_controller.main())
