"""The node velocity_controller in a process or in step, for tests of what is on its topics."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_control.nodes.lockstep import Lockstep
from onebot_control.simulation import Simulation
from tests.ros_support import NodeProcess, Peer

RosSimulation = Callable[..., Lockstep[Simulation]]  # the plugin's fixture ros_simulation
MODULE = "onebot_control.velocity_controller"
NODE = "/velocity_controller"


def driving(folder: Path, urdf: str, *arguments: str) -> NodeProcess:
    """The node with a robot of this text, which is written to a file."""
    file = folder / "bot.urdf"
    file.write_text(urdf)
    return NodeProcess(MODULE, str(file), *arguments)


class Stepped:
    """Robots in step with a client: what is published has been received as soon as it returns."""

    def __init__(self, ros: Lockstep[Simulation], client: Node | None = None) -> None:
        self.ros, self.simulation = ros, ros.simulation
        self.client = client or Node("client")
        ros.add(self.client)

    def hear(self, kind: Any, topic: str, qos: Any = 1000) -> list[Any]:
        """Subscribe; the list returned grows as messages come."""
        heard: list[Any] = []
        self.client.create_subscription(kind, topic, heard.append, qos)
        self.ros.add()  # waits until it is connected
        return heard

    def publish(self, topic: str, *messages: Any, apart: float = 0.0) -> None:
        """Publish messages, and simulate so many seconds after each."""
        publisher = self.client.create_publisher(type(messages[0]), topic, 10)
        self.ros.add()
        for message in messages:
            publisher.publish(message)
            self.ros.add()
            self.simulation.run(apart)
        self.client.destroy_publisher(publisher)

    def drive(self, message: Any, seconds: float, node: str = NODE) -> None:
        """Publish a command 50 times a second."""
        self.publish(f"{node}/cmd_vel", *[message] * round(50.0 * seconds), apart=0.02)

    def call(self, kind: Any, name: str, **request: Any) -> Any:
        """The answer of a service."""
        client = self.client.create_client(kind, name)
        assert client.wait_for_service(10.0), name
        future = client.call_async(kind.Request(**request))
        self.ros.add()
        self.simulation.run(until=future.done, timeout=5.0)
        self.client.destroy_client(client)
        return future.result()

    def set_parameters(self, node: str, **values: Any) -> list[Any]:
        """Set parameters of a node; the results."""
        parameters = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        return list(
            self.call(SetParameters, f"{node}/set_parameters", parameters=parameters).results
        )


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
        self._peer.run(self._peer.node.destroy_publisher, self._publisher)


def twist(linear: float, angular: float = 0.0) -> Twist:
    message = Twist()
    message.linear.x, message.angular.z = linear, angular
    return message


def x(message: Odometry) -> float:
    return float(message.pose.pose.position.x)


def speed(message: Odometry) -> float:
    return float(message.twist.twist.linear.x)
