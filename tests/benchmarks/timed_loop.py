"""A control loop whose cycles are timed; a process of its own.

``python -m tests.benchmarks.timed_loop FILE controller [ARGUMENTS]`` is velocity_controller as it
is. ``... FILE sleep`` is the least that a loop can be: a thread that sleeps to a grid, beside an
rclpy node that takes commands. At its end FILE gets three doubles for each cycle: the monotonic
time when it was due, by how much it began late, and how much time was left out before it (s).
"""

import sys
import threading
import time
from array import array
from collections.abc import Callable
from pathlib import Path

from geometry_msgs.msg import Twist
from rclpy.node import Node

from onebot_control import velocity_controller
from onebot_control.runtime import control_loop
from onebot_control.runtime.pacing import Pacer, wake_exactly
from onebot_description.ros.run_node import run_node

_PERIOD = 0.01  # s, as the controller's
_TOPIC = "/velocity_controller/cmd_vel"

times = array("d")


class TimedPacer(Pacer):
    """Records how late each cycle begins; it costs about a microsecond a cycle."""

    def next(self, wait: Callable[[], object]) -> None:
        """Wait for the next cycle."""
        super().next(wait)
        # What was left out was due that much earlier.
        times.extend((self.due, time.monotonic() - self.due + self.lag, self.lag))


class Sleeper(Node):
    """A node whose thread wakes up a hundred times a second."""

    def __init__(self) -> None:
        super().__init__("sleeper")
        self._ended = False
        self.create_subscription(Twist, _TOPIC, lambda message: None, 10)
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        wake_exactly()  # as the controller does
        pacer = TimedPacer(_PERIOD, 1.0)
        while not self._ended:
            pacer.next(lambda: time.sleep(pacer.left))

    def destroy_node(self) -> None:
        """End the thread, and the node."""
        self._ended = True
        super().destroy_node()


def main(loop: str) -> int:
    """Run a loop until Ctrl-C; return the exit code."""
    if loop == "sleep":
        sys.setswitchinterval(0.0005)  # as the controller does
        return run_node(Sleeper, [])
    setattr(control_loop, "Pacer", TimedPacer)  # noqa: B010 - the loop makes its own
    return velocity_controller.main()


if __name__ == "__main__":
    file, loop = sys.argv[1:3]
    del sys.argv[1:3]
    code = main(loop)
    Path(file).write_bytes(times.tobytes())
    sys.exit(code)
