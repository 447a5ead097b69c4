"""The node velocity_controller, in a process of its own, on real DDS."""

import os
import signal
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_control.control_support import urdf
from tests.onebot_control.node_support import MODULE, NODE, Driver, speed, twist, x
from tests.ros_support import LATCHED, NodeProcess, Peer, ros_args
from tests.support import wait_for

CHANGED = "now using the changed robot description"


@pytest.fixture
def model(tmp_path: Path) -> str:
    path = tmp_path / "bot.urdf"
    path.write_text(urdf())
    return str(path)


def seconds(message: Any) -> float:
    return float(message.header.stamp.sec + message.header.stamp.nanosec * 1e-9)


def gaps(messages: Sequence[Any]) -> list[float]:
    """The times between successive messages, s."""
    return [round(seconds(after) - seconds(before), 4) for before, after in pairwise(messages)]


def test_publishes_from_the_start(peer: Peer, model: str) -> None:
    """Without any command there are joint states, odometry and transforms, on the system's time."""
    joints = peer.hear(JointState, "/joint_states")
    odom = peer.hear(Odometry, f"{NODE}/odom")
    tf = peer.hear(TFMessage, "/tf")
    static = peer.hear(TFMessage, "/tf_static", LATCHED)
    with NodeProcess(MODULE, model, *ros_args(world_frame_id="world")):
        wait_for(lambda: joints and tf and static and 0.02 in gaps(odom), "messages")
    assert joints[-1].name == ["left_wheel_joint", "right_wheel_joint"]
    assert (x(odom[-1]), speed(odom[-1])) == pytest.approx((0.0, 0.0), abs=1e-4)
    assert odom[-1].pose.covariance[35] < 1e-6 < odom[-1].twist.covariance[0]  # it has not moved
    now = peer.node.get_clock().now().nanoseconds * 1e-9
    assert abs(seconds(joints[-1]) - now) < 30.0
    assert not peer.node.count_publishers("/clock")
    assert [m.transforms[0].child_frame_id for m in (tf[-1], static[-1])] == ["base_link", "odom"]


def test_both_kinds_of_command_are_heard(peer: Peer, model: str) -> None:
    """After a Twist, a TwistStamped of another publisher is followed, also with stamp 0.

    One that is a minute old is refused, and a warning says why.
    """
    limited = peer.hear(TwistStamped, f"{NODE}/cmd_vel_out")
    with NodeProcess(MODULE, model) as node:
        driver = Driver(peer, twist(0.1))
        wait_for(lambda: limited[-1].twist.linear.x == 0.1, "the Twist")
        driver.leave()
        wait_for(lambda: limited[-1].twist.linear.x == 0.0, "the brakes")
        driver = Driver(peer, TwistStamped(twist=twist(0.3)))
        wait_for(lambda: limited[-1].twist.linear.x == 0.3, "the TwistStamped")
        late = TwistStamped(twist=twist(0.2))
        late.header.stamp.sec = int(time.time()) - 60
        driver.message = late
        wait_for(lambda: limited[-1].twist.linear.x == 0.0, "the brakes")
        wait_for(lambda: "s old, but cmd_vel_timeout is 0.5 s" in node.output, "the warning")
        assert node.output.count("has stamp 0") == 1


def test_a_stopped_process_does_not_drive_on(peer: Peer, model: str) -> None:
    """SIGSTOP, and no commands any more: after SIGCONT it brakes at once, whatever was queued.

    Stamps half a minute ahead are what is queued when the system clock is set back meanwhile.
    """
    message = TwistStamped(twist=twist(0.3))
    message.header.stamp.sec = int(time.time()) + 30
    limited = peer.hear(TwistStamped, f"{NODE}/cmd_vel_out", 1000)
    with NodeProcess(MODULE, model) as node:
        driver = Driver(peer, message)
        wait_for(lambda: limited[-1].twist.linear.x == 0.3, "0.3 m/s")
        os.kill(node.process.pid, signal.SIGSTOP)
        stopped, sent = time.monotonic(), driver.sent
        wait_for(lambda: driver.sent >= sent + 10, "commands that queue up")
        driver.stop()
        wait_for(lambda: time.monotonic() > stopped + 1.5, "more than cmd_vel_timeout")
        resumed = time.time()
        os.kill(node.process.pid, signal.SIGCONT)
        wait_for(lambda: limited[-1].twist.linear.x == 0.0, "rest")
        wait_for(
            lambda: "it was sent before this process woke from a stop" in node.output,
            "the queued commands",
        )
        count = len(limited)
        wait_for(lambda: len(limited) > count + 10, "cycles at rest")
        speeds = [m.twist.linear.x for m in limited if seconds(m) >= resumed]
        assert speeds[0] < 0.3 and speeds == sorted(speeds, reverse=True) and speeds[-1] == 0.0


def test_a_command_of_before_the_process_woke_does_not_drive(peer: Peer, model: str) -> None:
    """However short the stop, and however long a command holds; what is sent afterwards drives.

    Neither the first message of a publisher nor those that follow a stream.
    """
    limited = peer.hear(TwistStamped, f"{NODE}/cmd_vel_out", 1000)
    with NodeProcess(MODULE, model, *ros_args(cmd_vel_timeout=0.0)) as node:
        commands = peer.publisher(Twist, f"{NODE}/cmd_vel")
        wait_for(lambda: limited, "the node")
        for _ in range(2):
            at_rest = len(limited)
            os.kill(node.process.pid, signal.SIGSTOP)
            os.waitid(os.P_PID, node.process.pid, os.WSTOPPED)  # its threads run on until then
            stopped = time.monotonic()
            commands.publish(twist(0.3))
            wait_for(lambda: time.monotonic() > stopped + 0.1, "the stop")  # noqa: B023
            os.kill(node.process.pid, signal.SIGCONT)
            count = len(limited)
            wait_for(lambda: len(limited) > count + 50, "cycles")  # noqa: B023
            assert not any(m.twist.linear.x for m in limited[at_rest:])
            commands.publish(twist(0.2))
            wait_for(lambda: limited[-1].twist.linear.x == 0.2, "a command of afterwards")
            os.kill(node.process.pid, signal.SIGSTOP)
            os.kill(node.process.pid, signal.SIGCONT)
            wait_for(lambda: limited[-1].twist.linear.x == 0.0, "rest")


def test_simulated_time(peer: Peer, model: str) -> None:
    """Ten times as fast: /clock runs, all stamps are on it, and there are no gaps.

    A second simulation, be it in a namespace, has the same /clock: both warn of each other.
    """
    clock = peer.hear(Clock, "/clock", 1000)
    joints = peer.hear(JointState, "/joint_states", 1000)
    with NodeProcess(MODULE, model, *ros_args(real_time_factor=10.0)) as one:
        wait_for(lambda: len(clock) > 300 and len(joints) > 300, "messages")
        for factor in (1e-4, 1.0):  # a cycle in 100 s delays no other parameter
            assert all(r.successful for r in peer.set_parameters(NODE, real_time_factor=factor))
        words = [*ros_args(use_sim_time=True), "-r", "__ns:=/other"]
        with NodeProcess(MODULE, model, *words) as other:
            names = f"/other/velocity_controller, {NODE}"
            warning = f"/clock has several publishers, {names}: time jumps between two simulations"
            for node in (one, other):
                wait_for(lambda n=node: warning in n.output, "the warning")
                assert "domain_id:=" in node.output
    steps = [round(gap / 0.01, 6) for gap in gaps(joints[:300])]
    # Of a thousand messages a second, DDS loses some to a reader that has no processor time.
    assert steps.count(1.0) > 100 and all(step.is_integer() for step in steps), steps
    assert seconds(joints[0]) < 60.0


def test_description_from_the_topic_also_changed(peer: Peer) -> None:
    """It waits for one that it can drive, and changes to another one where the robot stands."""
    joints = peer.hear(JointState, "/joint_states")
    publisher = peer.node.create_publisher(String, "robot_description", LATCHED)
    with NodeProcess(MODULE, *ros_args()) as node:
        wait_for(lambda: "waiting for the robot description" in node.output, "the hint")
        foreign = urdf().replace("continuous", "fixed")
        assert foreign != urdf()
        publisher.publish(String(data=foreign))
        waiting = "not applied, still waiting for one:"
        wait_for(lambda: waiting in node.output, "the first refusal")
        assert 'robot "bot" cannot be driven: its joints include no wheel' in node.output
        publisher.publish(String(data=urdf()))
        wait_for(lambda: joints, "joint states")
        publisher.publish(String(data=urdf(name="other")))
        wait_for(lambda: CHANGED in node.output, "the new robot")
        count = len(joints)
        wait_for(lambda: len(joints) > count + 10, "more joint states")


def test_ends_at_once_and_cleanly(ros_domain: int, model: str) -> None:
    """SIGTERM ends it with code 0, as Ctrl-C does, and nothing but log lines was printed.

    Two of them warn of a limit without effect, and of an older name.
    """
    names = "min_jerk", "min_acceleration"
    limits = [text for name in names for text in ("-p", f"linear.x.{name}:=-1.0")]
    with NodeProcess(MODULE, model, "--ros-args", *limits) as node:
        wait_for(lambda: "driving robot" in node.output, "the start")
        assert "linear.x.min_jerk: limits nothing without linear.x.max_jerk" in node.output
        assert "linear.x.min_acceleration: an older name of linear.x.max_dece" in node.output
        os.kill(node.process.pid, signal.SIGTERM)
        assert node.wait() == 0
        assert "pybullet" not in node.output
