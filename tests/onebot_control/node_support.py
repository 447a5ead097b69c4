"""The node velocity_controller in a process, for tests of what is on its topics."""

from pathlib import Path
from typing import Any

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry

from tests.ros_support import NodeProcess, Peer

MODULE = "onebot_control.velocity_controller"
NODE = "/velocity_controller"


def driving(folder: Path, urdf: str, *arguments: str) -> NodeProcess:
    """The node with a robot of this text, which is written to a file."""
    file = folder / "bot.urdf"
    file.write_text(urdf)
    return NodeProcess(MODULE, str(file), *arguments)


class Driver:
    """Publishes a command at 50 Hz until told otherwise; stops as the test ends."""

    def __init__(self, peer: Peer, message: Any, node: str = NODE) -> None:
        self._publisher = peer.publisher(type(message), f"{node}/cmd_vel")
        self._peer, self.message = peer, message
        self.sent = 0
        self._timer = peer.node.create_timer(0.02, self._publish)

    def _publish(self) -> None:
        self._publisher.publish(self.message)
        self.sent += 1

    def stop(self) -> None:
        self._timer.cancel()

    def leave(self) -> None:
        """Stop, and be no publisher of the topic any more."""
        self.stop()
        self._peer.destroy(self._peer.node.destroy_publisher, self._publisher)


def twist(linear: float, angular: float = 0.0) -> Twist:
    message = Twist()
    message.linear.x, message.angular.z = linear, angular
    return message


def x(message: Odometry) -> float:
    return float(message.pose.pose.position.x)


def speed(message: Odometry) -> float:
    return float(message.twist.twist.linear.x)
