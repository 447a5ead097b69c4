"""A world in the node velocity_controller, on real DDS: what is published of it, and commands."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from std_srvs.srv import Trigger

from onebot_description.description import load_description
from onebot_description.geometry.poses import Transform, compose
from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_control.control_support import urdf
from tests.onebot_control.node_support import NODE, Driver, driving, twist, x
from tests.onebot_control.test_scene import BOX, WALL
from tests.ros_support import LATCHED, Peer, ros_args
from tests.support import PATIENCE, wait_for


def values(pose: Any, position: str = "translation", rotation: str = "rotation") -> Transform:
    p, q = getattr(pose, position), getattr(pose, rotation)
    return (p.x, p.y, p.z), (q.x, q.y, q.z, q.w)


def by_child(messages: list[TFMessage]) -> Mapping[str, Any]:
    """The last transform of each frame."""
    return {each.child_frame_id: each for message in messages[-20:] for each in message.transforms}


@pytest.mark.slow
def test_a_robot_in_a_world(peer: Peer, tmp_path: Path) -> None:
    """It pushes the box to the wall: TF has both where they are, while the odometry goes on."""
    world = tmp_path / "world.urdf"
    far = WALL.replace("0.65 0 0.2", "1.5 0 0.2")
    world.write_text(
        f'<robot name="w"><link name="floor"/>{far}{BOX}</robot>'.replace('"world"', '"floor"')
    )
    arguments = ros_args(world=str(world), use_sim_time=True, cmd_vel_timeout=5.0, x=-0.5)
    every = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    with driving(tmp_path, urdf(), *arguments) as node:
        described = peer.hear(String, "/world_description", LATCHED)
        tf, static = peer.hear(TFMessage, "/tf", 1000), peer.hear(TFMessage, "/tf_static", every)
        odom, truth = (
            peer.hear(Odometry, f"{NODE}/{name}", 1000) for name in ("odom", "ground_truth")
        )
        wait_for(lambda: described and static and odom and truth, "all topics")
        assert described[0].data == load_description(world).urdf
        still = {each.child_frame_id: each for each in static[0].transforms}
        assert {name: each.header.frame_id for name, each in still.items()} == {
            "floor": "world",
            "wall": "floor",
        }
        assert values(still["wall"].transform)[0] == (1.5, 0.0, 0.2)
        assert (truth[-1].header.frame_id, truth[-1].pose.pose.position.x) == (
            "world",
            pytest.approx(-0.5),
        )
        wait_for(lambda: {"box", "odom", "base_link"} <= set(by_child(tf)), "all frames")
        assert by_child(tf)["box"].header.frame_id == "world"
        (refused,) = peer.set_parameters(NODE, world_frame_id="map")
        assert not refused.successful and 'are in "world"; restart the node' in refused.reason
        (refused,) = peer.set_parameters(NODE, odom_frame_id="wall")
        assert '"wall" is a link of the world' in refused.reason
        driver = Driver(peer, twist(0.6))

        def slipped() -> bool:
            real = {str(each.header.stamp): x(each) for each in truth[-50:]}
            ways = [(x(each) - 0.5, real.get(str(each.header.stamp))) for each in odom[-50:]]
            return any(at is not None and wheels > at + 0.3 for wheels, at in ways)

        wait_for(slipped, "the wheels to slip", 3 * PATIENCE)
        wait_for(lambda: abs(values(by_child(tf)["box"].transform)[0][0] - 1.3) < 0.07, "the box")

        def same_moment() -> tuple[Any, Mapping[str, Transform]] | None:
            """The truth, and the frames of the same cycle; of a slow peer messages are lost."""
            for at in reversed(truth[-50:]):
                of = [t for m in tf for t in m.transforms if t.header.stamp == at.header.stamp]
                found = {each.child_frame_id: values(each.transform) for each in of}
                if {"odom", "base_link"} <= set(found):
                    return at, found
            return None

        at, frames = wait_for(same_moment, "the transforms of the truth")
        place, turn = compose(frames["odom"], frames["base_link"])
        true = values(at.pose.pose, "position", "orientation")
        assert place == pytest.approx(true[0], abs=1e-9)
        assert abs(sum(map(math.prod, zip(turn, true[1], strict=True)))) == pytest.approx(1.0)
        driver.stop()
        teleport = PoseStamped()
        teleport.pose.position.x, teleport.pose.orientation.w = 1.5, 1.0
        peer.publisher(PoseStamped, f"{NODE}/teleport").publish(teleport)
        wait_for(lambda: "~/teleport is ignored: x 1.5 m" in node.output, "the refusal")
        assert peer.call(Trigger, f"{NODE}/reset").success
        wait_for(
            lambda: (
                values(by_child(tf)["box"].transform)[0] == pytest.approx((0.5, 0, 0.1), abs=0.01)
            ),
            "the box to be back",
        )
