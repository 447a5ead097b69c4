"""Who publishes a parent of odom: the simulation's truth, or another node that localizes."""

import time
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import TransformStamped
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message

from onebot_control import Simulation
from onebot_control.nodes.foreign_localizer import FramesTransform, Localizer, TransformsOf
from onebot_description.description import parse_description
from onebot_description.ros.wire.cdr import NS_PER_S
from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_control.control_support import robot, urdf
from tests.onebot_control.node_support import NODE, driving
from tests.onebot_control.test_scene import WALL
from tests.ros_support import LATCHED, Peer, ros_args
from tests.support import wait_for

EVERY = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def transform(parent: str, child: str, x: float = 0.0, stamp: int = 0) -> Any:
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NS_PER_S)
    message.transform.translation.x = x
    return message


def tf(*transforms: Any) -> bytes:
    return bytes(serialize_message(TFMessage(transforms=list(transforms))))


TRUTH = FramesTransform("world", "odom", 7, ((1.5, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))


@pytest.mark.parametrize(
    ("message", "parent"),
    [
        (tf(transform("map", "odom")), "map"),
        (tf(transform("/map", "/odom")), "map"),
        (tf(transform("a", "b"), transform("map_2", "odom")), "map_2"),
        (tf(transform("odom", "base_link")), ""),
        (tf(transform("map", "r1/odom"), transform("map", "odom_2")), ""),
        (tf(transform("world", "odom", 1.5, stamp=7)), ""),
        (tf(transform("world", "odom", 1.5, stamp=8)), "world"),
        (tf(transform("world", "odom", 1.6, stamp=7)), "world"),
        (tf(transform("map", "odom"))[:-20], ""),
    ],
    ids=lambda value: value if isinstance(value, str) else "message",
)
def test_the_parent_of_odom_in_a_message(message: bytes, parent: str) -> None:
    """By whole names, with a slash in front as tf had it; what is published here is no other's."""
    localizer = Localizer("odom")
    for found in TransformsOf(["odom", "r2/odom"]).find(message):
        localizer.receive(found, [TRUTH], 1)
    assert localizer.parent == parent


def test_names_of_all_lengths_are_found() -> None:
    """CDR pads what is before the child's name with up to three bytes."""
    names = ["o" * length for length in range(1, 9)]
    for parent in ("m" * count for count in range(1, 9)):
        for name in names:
            [found] = TransformsOf(names).find(tf(transform(parent, name, 2.0, stamp=5)))
            pose = (2.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
            assert found == FramesTransform(parent, name, 5, pose)


def test_a_localizer_that_is_gone_is_forgotten() -> None:
    """Only after ten seconds without it, and if one of the nodes that were there is gone."""
    localizer, seconds = Localizer("odom"), 100.0

    def after(more: float, *nodes: str) -> str:
        nonlocal seconds
        seconds += more
        localizer.expire({*nodes}, int(seconds * NS_PER_S))
        return localizer.parent

    [found] = TransformsOf(["odom"]).find(tf(transform("map", "odom")))
    localizer.receive(found, [], int(seconds * NS_PER_S))
    assert after(1.0, "/state", "/amcl") == "map"
    assert after(60.0, "/state", "/amcl") == "map", "it is silent while the robot stands"
    assert after(5.0, "/amcl") == "map" and after(1.0, "/state", "/amcl") == "map", "a restart"
    assert after(9.0, "/state") == "map"
    assert after(2.0, "/state") == ""


WORLD = f'<robot name="w"><link name="world"/>{WALL}</robot>'


def parents(messages: list[Any], child: str = "odom") -> set[str]:
    return {
        each.header.frame_id
        for message in messages
        for each in message.transforms
        if each.child_frame_id == child
    }


def new(messages: list[Any], child: str, count: int = 20) -> set[str]:
    """The parents of odom while a frame comes so many times more."""
    start = len(messages)

    def enough() -> bool:
        rest = messages[start:]
        return sum(e.child_frame_id == child for m in rest for e in m.transforms) >= count

    wait_for(enough, f"transforms of {child}")
    return parents(messages[start:])


def test_the_truth_gives_way_to_a_localizer_and_resumes(peer: Peer, tmp_path: Path) -> None:
    """It stops, with one line, when map -> odom comes, and is there again ten seconds after it.

    It stops, too, for a localizer that has its very frames, and is static: published once.
    """
    world = tmp_path / "world.urdf"
    world.write_text(WORLD)
    arguments = ros_args(world=str(world), x=-0.5, world_frame_id="world")
    with driving(tmp_path, urdf(), *arguments) as node:
        received = peer.hear(TFMessage, "/tf", 1000)
        wait_for(lambda: "world" in parents(received), "the truth")
        with Peer(peer.context.get_domain_id(), "amcl") as localizer:
            publisher = localizer.publisher(TFMessage, "/tf", 10)
            stamp = time.time_ns()

            def yielded() -> bool:
                publisher.publish(TFMessage(transforms=[transform("map", "odom", stamp=stamp)]))
                return "another node publishes map -> odom on TF, so world -> odom" in node.output

            wait_for(yielded, "the controller to stop its own")
            wait_for(lambda: "world" not in new(received, "base_link"), "its end on TF")
            assert node.output.count("another node publishes") == 1
        (result,) = peer.set_parameters(NODE, world_frame_id="")
        assert not result.successful and "the frames of a world need a parent" in result.reason
        text = "nobody publishes map -> odom any more"
        wait_for(lambda: text in node.output, "the truth again")
        wait_for(lambda: new(received, "base_link") == {"world"}, "the truth on TF")
        with Peer(peer.context.get_domain_id(), "fixed") as localizer:
            publisher = localizer.publisher(TFMessage, "/tf_static", LATCHED, subscribers=0)
            publisher.publish(TFMessage(transforms=[transform("world", "odom", 9.0)]))
            text = "another node publishes world -> odom on TF"
            wait_for(lambda: text in node.output, "the controller to stop its own")
            wait_for(lambda: not new(received, "base_link"), "its end on TF")


@pytest.mark.usefixtures("ros_domain")
def test_the_truth_off_tf() -> None:
    """A parameter takes it off at the start or later; boxes and walls stay where they are."""
    values = {"ground_truth_tf": False, "world_frame_id": "map"}
    world = parse_description(WORLD)
    with (
        Simulation(robot(), world=world, x=-0.5, parameters=values) as simulation,
        simulation.ros() as ros,
    ):
        node, static, received = Node("listener"), list[Any](), list[Any]()
        node.create_subscription(TFMessage, "/tf_static", static.append, EVERY)
        node.create_subscription(TFMessage, "/tf", received.append, 1000)
        client = node.create_client(SetParameters, f"{NODE}/set_parameters")
        ros.add(node)
        simulation.run(1.0)
        assert parents(received, "base_link") == {"odom"} and not parents(received)
        assert parents(static, "wall") == {"world"} and parents(static, "world") == {"map"}
        parameter = Parameter("ground_truth_tf", value=True).to_parameter_msg()
        assert client.wait_for_service(10.0)
        changed = client.call_async(SetParameters.Request(parameters=[parameter]))
        simulation.run(until=lambda: "map" in parents(received), timeout=5.0)
        assert changed.result().results[0].successful


def test_without_a_world_the_static_truth_is_withdrawn(peer: Peer, tmp_path: Path) -> None:
    """Those who come later do not receive it; changes without effect are refused."""
    with driving(tmp_path, urdf()) as node:
        static = peer.hear(TFMessage, "/tf_static", EVERY)
        wait_for(lambda: peer.parameter(NODE, "world_frame_id") == "", "the node")
        (result,) = peer.set_parameters(NODE, ground_truth_tf=False)
        assert result.successful
        (result,) = peer.set_parameters(NODE, ground_truth_tf=True)
        assert not result.successful and "set world_frame_id first" in result.reason
        (result,) = peer.set_parameters(NODE, world_frame_id="world")
        assert result.successful and not parents(static)
        (result,) = peer.set_parameters(NODE, ground_truth_tf=True)
        wait_for(lambda: parents(static) == {"world"}, "the truth")
        with Peer(peer.context.get_domain_id(), "slam") as localizer:
            publisher = localizer.publisher(TFMessage, "/tf", 10, subscribers=0)

            def withdrawn() -> bool:
                publisher.publish(TFMessage(transforms=[transform("map", "odom")]))
                return not static[-1].transforms

            wait_for(withdrawn, "an empty message")
            late = localizer.hear(TFMessage, "/tf_static", EVERY)
            wait_for(lambda: late, "the last message")
            assert not parents(late)
            for value, reason in ((False, ""), (True, "another node publishes map -> odom")):
                (result,) = peer.set_parameters(NODE, ground_truth_tf=value)
                assert result.successful is not bool(reason) and reason in result.reason
        assert "another node publishes map -> odom" in node.output
