"""Several robots in one process of velocity_controller, on real DDS."""

from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_control.control_support import urdf
from tests.onebot_control.node_support import MODULE, Driver, driving, twist
from tests.ros_support import NodeProcess, Peer, ros_args
from tests.support import lines_of_ours, wait_for

# b drives against a, c turns elsewhere.
PLACES = {"a": (0.0, 0.0), "b": (-0.8, 0.0), "c": (0.0, 3.0)}


def robots(**values: dict[str, Any]) -> list[str]:
    """The arguments of each robot, with further parameters of one."""
    words = []
    for name, (x, y) in PLACES.items():
        words += ["--robot", "-r", f"__ns:=/{name}"]
        for key, value in {"x": x, "y": y, **values.get(name, {})}.items():
            words += ["-p", f"{key}:={value}"]
    return words


@pytest.mark.slow
def test_robots_of_one_world(peer: Peer, tmp_path: Path) -> None:
    """Each has topics, frames and services of its own; collisions, clock and pace are shared.

    A pace that is not reached is reported.
    """
    common = ros_args(use_sim_time=True, cmd_vel_timeout=2.0, world_frame_id="world")
    arguments = *robots(c={"publish_rate": 100.0}), *common
    with driving(tmp_path, urdf(), *arguments) as node:
        topics = {
            name: {
                topic: peer.hear(kind, f"/{name}/{topic}", 1000)
                for topic, kind in {
                    "joint_states": JointState,
                    "velocity_controller/odom": Odometry,
                    "velocity_controller/ground_truth": Odometry,
                }.items()
            }
            for name in PLACES
        }
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        tf, static = peer.hear(TFMessage, "/tf", 1000), peer.hear(TFMessage, "/tf_static", latched)
        clock = peer.hear(Clock, "/clock")

        def pose(name: str, what: str = "ground_truth") -> Any:
            return topics[name][f"velocity_controller/{what}"][-1].pose.pose

        wait_for(lambda: all(all(each.values()) for each in topics.values()), "all topics")
        frames = {(f"{name}/odom", f"{name}/base_link") for name in PLACES}
        wait_for(lambda: {(t.header.frame_id, t.child_frame_id) for m in tf for t in m.transforms}
            == frames, "the transforms")  # fmt: skip
        origins = {("world", f"{name}/odom") for name in PLACES}
        wait_for(lambda: {(t.header.frame_id, t.child_frame_id) for m in static
            for t in m.transforms} == origins, "the odometry frames' places")  # fmt: skip
        wait_for(lambda: clock, "the clock")
        assert peer.node.count_publishers("/clock") == 1
        for name, (x, y) in PLACES.items():
            assert (pose(name).position.x, pose(name).position.y) == pytest.approx((x, y), abs=1e-3)

        driver = Driver(peer, twist(0.3), "/b/velocity_controller")
        Driver(peer, twist(0.0, 1.0), "/c/velocity_controller")
        wait_for(lambda: pose("b", "odom").position.x > 0.9, "b to drive, as its wheels have it")
        assert pose("b").position.x == pytest.approx(-0.12, abs=0.02)  # a is in its way
        assert pose("a").position.x == pytest.approx(0.0, abs=0.02)
        wait_for(lambda: pose("c", "odom").orientation.z > 0.3, "c to turn")
        assert pose("c").position.x == pytest.approx(0.0, abs=0.05)

        driver.stop()
        assert peer.call(Trigger, "/b/velocity_controller/reset").success
        wait_for(lambda: pose("b").position.x < -0.75, "b at its start")
        assert peer.call(SetBool, "/a/velocity_controller/pause", data=True).success
        assert peer.call(Trigger, "/b/velocity_controller/step").success
        assert peer.call(SetBool, "/c/velocity_controller/pause", data=False).success
        assert peer.set_parameters("/b/velocity_controller", real_time_factor=2.0)[0].successful
        service = "/c/velocity_controller/get_parameters"
        answer = peer.call(GetParameters, service, names=["real_time_factor"])
        assert answer.values[0].double_value == 2.0
        assert "driving 3 robots in one world" in node.output

        # No computer is as fast as that.
        assert peer.set_parameters("/a/velocity_controller", real_time_factor=1e6)[0].successful
        wait_for(lambda: "slow motion: real-time factor" in node.output, "the log")
        diagnostics = peer.hear(DiagnosticArray, "/diagnostics")
        [status] = wait_for(lambda: diagnostics, "diagnostics")[0].status
        assert status.level == DiagnosticStatus.WARN
        assert status.name == "a/velocity_controller: real-time factor"
        values = {each.key: float(each.value) for each in status.values}
        assert 0.0 < values["real_time_factor"] < 9e5 and values["missed control cycles"] > 100.0


@pytest.mark.slow
def test_what_is_the_worlds_must_be_the_same(ros_domain: int, tmp_path: Path) -> None:
    model = tmp_path / "bot.urdf"
    model.write_text(urdf())
    words = robots(c={"update_rate": 50})
    with NodeProcess(MODULE, str(model), *words, *ros_args(), check=False) as node:
        wait_for(lambda: node.process.poll() == 1, "the end")
        assert lines_of_ours(node.output) == [
            "error: /c/velocity_controller: update_rate: 50.0, but 100.0 of "
            "/a/velocity_controller; it is the same for all robots of a world"
        ]
