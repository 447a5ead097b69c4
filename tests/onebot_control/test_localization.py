"""Who publishes a parent of odom: the simulation's truth, or another node that localizes."""

from typing import Any

import pytest
from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile

from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_control.control_support import robot
from tests.onebot_control.node_support import NODE, RosSimulation, Stepped
from tests.onebot_control.test_scene import WALL, scene

EVERY = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def tf(*frames: tuple[str, str], x: float = 0.0) -> TFMessage:
    """Transforms of (parent, child)."""
    transforms = []
    for parent, child in frames:
        transform = TransformStamped(child_frame_id=child)
        transform.header.frame_id, transform.transform.translation.x = parent, x
        transforms.append(transform)
    return TFMessage(transforms=transforms)


def parents(messages: list[Any], child: str = "odom") -> set[str]:
    return {
        each.header.frame_id
        for message in messages
        for each in message.transforms
        if each.child_frame_id == child
    }


def simulated(make: RosSimulation, **values: Any) -> Stepped:
    return Stepped(make(robot(), world=scene(WALL), x=-0.5, parameters=values))


def test_the_truth_gives_way_to_a_localizer(
    ros_simulation: RosSimulation, capfd: pytest.CaptureFixture[str]
) -> None:
    """It stops, with one line, when map -> odom comes, and the parameter brings it back.

    Frames count by their whole names, with a slash in front as tf had it.
    """
    robots = simulated(ros_simulation, world_frame_id="world")
    received = robots.hear(TFMessage, "/tf")
    others = tf(("odom", "lidar"), ("map", "r1/odom"), ("map", "odom_2"), ("map", "ODOM"))
    robots.publish("/tf", others, apart=1.0)
    assert "world" in parents(received)
    robots.publish("/tf", *[tf(("a", "b"), ("/map", "/odom"))] * 3, apart=0.5)
    text = "another node publishes map -> odom on TF, so world -> odom is no longer published"
    assert capfd.readouterr().err.count(text) == 1
    received.clear()
    robots.simulation.run(5.0)
    assert parents(received, "base_link") == {"odom"} and not parents(received)
    for value in (False, True):
        (result,) = robots.set_parameters(NODE, ground_truth_tf=value)
        assert result.successful
    robots.simulation.run(1.0)
    assert parents(received) == {"world"}
    (result,) = robots.set_parameters(NODE, world_frame_id="")
    assert not result.successful and "a world needs a parent frame" in result.reason


def test_a_static_localizer_with_the_frames_of_the_truth(ros_simulation: RosSimulation) -> None:
    """It counts, and again when the truth is back: others than our own are told by the pose."""
    robots = simulated(ros_simulation)
    received = robots.hear(TFMessage, "/tf")
    static = robots.client.create_publisher(TFMessage, "/tf_static", EVERY)
    static.publish(tf(("world", "odom"), x=9.0))
    for value in (False, True):
        robots.simulation.run(0.5)  # a poll subscribes, and the next one takes the transform
        received.clear()
        robots.simulation.run(1.0)
        assert parents(received, "base_link") and not parents(received)
        robots.set_parameters(NODE, ground_truth_tf=value)


def test_the_truth_off_tf(ros_simulation: RosSimulation) -> None:
    """A parameter takes it off at the start or later; boxes and walls stay where they are."""
    robots = simulated(ros_simulation, ground_truth_tf=False, world_frame_id="map")
    static = robots.hear(TFMessage, "/tf_static", EVERY)
    received = robots.hear(TFMessage, "/tf")
    robots.simulation.run(1.0)
    assert parents(received, "base_link") == {"odom"} and not parents(received)
    assert parents(static, "wall") == {"world"} and parents(static, "world") == {"map"}
    robots.set_parameters(NODE, ground_truth_tf=True)
    robots.simulation.run(1.0)
    assert parents(received) == {"map"}


def test_without_a_world_the_static_truth_is_withdrawn(ros_simulation: RosSimulation) -> None:
    """Those who come later do not receive it; changes without effect are refused."""
    robots = Stepped(ros_simulation(robot(), parameters={"world_frame_id": ""}))
    static = robots.hear(TFMessage, "/tf_static", EVERY)
    for value, reason in ((False, ""), (True, "set world_frame_id first")):
        (result,) = robots.set_parameters(NODE, ground_truth_tf=value)
        assert result.successful is not bool(reason) and reason in result.reason
    robots.set_parameters(NODE, world_frame_id="world")
    assert not parents(static)
    robots.set_parameters(NODE, ground_truth_tf=True)
    robots.simulation.run(1.0)
    assert parents(static) == {"world"}
    robots.publish("/tf", tf(("map", "odom")), tf(("map", "odom")), apart=0.5)
    assert not static[-1].transforms
    late = robots.hear(TFMessage, "/tf_static", EVERY)
    assert late and not parents(late)
