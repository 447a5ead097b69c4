"""A participant of the benchmark of discovery: a robot's node, or the operator's that sees all.

``python -m tests.benchmarks.participant robot NAMESPACE`` or ``... operator COUNT``. It starts ROS
when a line comes on standard input, and prints one: a robot when its node is there, the operator
when it has discovered the robots. It publishes nothing, for all traffic to be discovery's.
"""

import sys

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import JointState

from onebot_description.node import run_node
from onebot_description.wire.tf_message import TFMessage

_POLL = 0.02  # s


def make_robot(namespace: str) -> Node:
    """Return a node with the topics of a robot's controller."""
    node = rclpy.create_node("robot", namespace=namespace)
    node.create_publisher(Odometry, "odom", 10)
    node.create_publisher(JointState, "joint_states", 10)
    node.create_publisher(TFMessage, "/tf", 100)
    node.create_subscription(Twist, "cmd_vel", lambda _: None, 10)
    print("up", flush=True)
    return node


def make_operator(count: int) -> Node:
    """Return a node that subscribes to /tf, and prints when it has discovered all robots."""
    node = rclpy.create_node("operator")
    node.create_subscription(TFMessage, "/tf", lambda _: None, 100)

    def poll() -> None:
        names = [name for name in node.get_node_names() if name == "robot"]
        if len(names) == node.count_publishers("/tf") == count:
            timer.cancel()
            print("all", flush=True)

    timer = node.create_timer(_POLL, poll)
    return node


def main(role: str, what: str) -> int:
    """Run until Ctrl-C."""
    print("ready", flush=True)
    sys.stdin.readline()
    operator = role == "operator"
    make = (lambda: make_operator(int(what))) if operator else (lambda: make_robot(what))
    return run_node(make, [role], events=True, whole_graph=operator)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
