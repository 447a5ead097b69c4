"""The floor of a control loop: a thread that sleeps to a grid, beside an rclpy node.

``python -m tests.benchmarks.sleeping_thread TOPIC`` takes the last Twist at each wake-up. It
answers as timed_controller.py does.
"""

import sys
import threading
import time

from geometry_msgs.msg import Twist
from rclpy.node import Node

from onebot_control.control_loop import wake_exactly
from onebot_description.node import run_node
from tests.benchmarks.watch import Watch

_PERIOD = 0.01  # s, as the controller's


class Sleeper(Node):
    """A node whose thread wakes up a hundred times a second."""

    def __init__(self, topic: str, watch: Watch) -> None:
        super().__init__("sleeper")
        self._watch = watch
        self._ended = False
        self.create_subscription(Twist, topic, self._take, 10)
        threading.Thread(target=self._run, daemon=True).start()

    def _take(self, message: Twist) -> None:
        self._watch.commanded(message.linear.x)

    def _run(self) -> None:
        wake_exactly()  # as the controller does
        due = time.monotonic()
        while not self._ended:
            due += _PERIOD
            time.sleep(max(0.0, due - time.monotonic()))
            now = time.monotonic()
            self._watch.woke(now - due)
            self._watch.told_wheels()
            if now - due >= _PERIOD:
                due = now

    def destroy_node(self) -> None:
        """End the thread, and the node."""
        self._ended = True
        super().destroy_node()


if __name__ == "__main__":
    watch = Watch()
    watch.answer_orders()
    topic = sys.argv[1]
    # As the controller does.
    sys.setswitchinterval(0.0005)
    sys.exit(run_node(lambda: Sleeper(topic, watch), [], events=True))
