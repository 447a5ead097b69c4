"""The process of joint_trajectory_controller, on real DDS."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64MultiArray, String
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory

from onebot_description.ros.wire.cdr import nanoseconds
from tests.onebot_control.arm_models import arm, joint, link
from tests.onebot_control.arm_support import (
    ABORTED,
    CONTROLLER,
    MANAGER,
    MODULE,
    SUCCESS,
    ControllerState,
    WireArm,
    ending,
    goal,
    point,
    trajectory,
)
from tests.ros_support import LATCHED, NodeProcess, Peer, refusals, ros_args
from tests.support import starved, stopped, wait_for

SHOULDER = ["shoulder"]
STOPS_WITHIN = 5.0  # s


def body(name: str) -> str:
    """A link of 1 kg."""
    shape = '<visual><geometry><box size="0.1 0.1 0.2"/></geometry></visual>'
    return link(name, 1.0, "0.05 0 0", 0.01, shape)


TURNS = 'effort="50" velocity="2" lower="-3" upper="3"'
SLIDES = 'effort="50" velocity="0.5" lower="0" upper="0.5"'
UPPER = body("upper") + joint("shoulder", "world", "upper", axis="0 0 1", limits=TURNS)
JAW = body("jaw") + joint("finger", "upper", "jaw", "prismatic", "1 0 0", limits=SLIDES)
ARM = arm(UPPER, JAW).urdf
BOTH = ["shoulder", "finger"]


@pytest.fixture
def model(tmp_path: Path) -> str:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    return str(path)


def positions(messages: list[JointState]) -> Mapping[str, float]:
    """The joints' last positions."""
    return dict(zip(messages[-1].name, messages[-1].position, strict=True))


CLIENT = """
import sys, time
import rclpy
from rclpy.action import ActionClient
from tests.onebot_control.arm_support import CONTROLLER, FollowJointTrajectory, goal, point

rclpy.init()
node = rclpy.create_node("short_lived")
client = ActionClient(node, FollowJointTrajectory, f"{CONTROLLER}/follow_joint_trajectory")
assert client.wait_for_server(60.0)
future = client.send_goal_async(
    goal(point(2.0, 1.0, 0.0), joints=["shoulder", "finger"]),
    lambda message: print("moving", flush=True),
)
rclpy.spin_until_future_complete(node, future)
assert future.result().accepted
result = future.result().get_result_async()
rclpy.spin_until_future_complete(node, result)
"""


def test_a_client_that_is_killed_a_pause_and_an_interrupt(peer: Peer, model: str) -> None:
    """The goal of one that was killed is followed to its end; then the next one moves the arm.

    Paused, the arm stands still, and a lock ends the goal at once; the process
    ends in mid-goal.
    """
    joints = peer.hear(JointState, "/joint_states", 1000)

    def shoulder() -> float:
        return positions(joints)["shoulder"]

    with NodeProcess(MODULE, model) as node:
        wait_for(lambda: joints, "joint states")
        assert sorted(joints[0].name) == sorted(BOTH)
        killed = subprocess.Popen(
            [sys.executable, "-u", "-c", CLIENT], stdout=subprocess.PIPE, text=True
        )
        assert killed.stdout is not None and killed.stdout.readline() == "moving\n"
        killed.send_signal(signal.SIGKILL)
        killed.wait()
        killed.stdout.close()
        assert shoulder() < 0.9
        wait_for(lambda: "Goal successfully reached!" in node.output, "the end of its goal")
        wait_for(lambda: shoulder() > 0.999, "its end position")
        client = WireArm(peer)
        result = client.send(goal(point(30.0, 0.0, 0.1), joints=BOTH))
        wait_for(lambda: shoulder() < 0.99, "the start")
        assert peer.call(SetBool, f"{MANAGER}/pause", data=True).success
        paused = time.time_ns()
        wait_for(lambda: nanoseconds(joints[-1].header.stamp) > paused, "what is received late")
        count, at = len(joints), shoulder()
        wait_for(lambda: len(joints) > count + 50, "joint states of half a second")
        assert shoulder() == at > 0.1 and not result.done()
        lock = peer.publisher(Bool, f"{MANAGER}/cmd_vel_lock", 10)
        lock.publish(Bool(data=True))
        assert ending(result)[0] == ABORTED, "of a goal that the lock ends while it is paused"
        lock.publish(Bool(data=False))
        wait_for(lambda: "unlocked" in node.output, "the lock to be open")
        assert peer.call(SetBool, f"{MANAGER}/pause", data=False).success
        assert ending(client.send(goal(point(1.0, 0.0, 0.1), joints=BOTH))) == SUCCESS
        assert client.feedback and client.feedback[0].joint_names == BOTH
        end = pytest.approx({"shoulder": 0.0, "finger": 0.1}, abs=1e-6)
        wait_for(lambda: positions(joints) == end, "the end position")
        client.send(goal(point(20.0, -1.0, 0.0), joints=BOTH))
        wait_for(lambda: shoulder() < -0.001, "the next start")
        start = time.monotonic()
        assert node.interrupt() == 0
        assert time.monotonic() - start < STOPS_WITHIN
        assert "[ERROR]" not in node.output


def test_of_a_stream_the_last_trajectory_is_followed(peer: Peer, model: str) -> None:
    """A stream with more messages than there are cycles does not fall behind."""
    states = peer.hear(ControllerState, f"{CONTROLLER}/controller_state", 100)
    with NodeProcess(MODULE, model, *ros_args(update_rate=5.0)):
        wait_for(lambda: states, "the controller")
        stream = peer.publisher(JointTrajectory, f"{CONTROLLER}/joint_trajectory", 10)

        def heard() -> bool:
            # Best effort: what is published before the node has discovered the publisher is lost.
            stream.publish(trajectory(point(0.01, -0.01, 0.0), joints=BOTH))
            return bool(states[-1].reference.positions[0] == pytest.approx(-0.01, abs=1e-6))

        wait_for(heard, "the publisher to be heard")
        states.clear()
        for number in range(1, 9):
            stream.publish(trajectory(point(0.01, 0.01 * number, 0.0), joints=BOTH))
        end = pytest.approx(0.08, abs=1e-6)
        wait_for(lambda: states[-1].reference.positions[0] == end, "the end position")
        times = [nanoseconds(state.reference.time_from_start) for state in states]
        assert times.count(0) < 5, "each cycle began one of them"


def test_a_description_that_changes_in_mid_goal(peer: Peer) -> None:
    """Another shape lets the goal go on, other joints abort it; without any it is refused."""
    topic = peer.node.create_publisher(String, "/robot_description", LATCHED)
    topic.publish(String(data=ARM))
    joints = peer.hear(JointState, "/joint_states", 1000)
    with NodeProcess(MODULE) as node:
        client = WireArm(peer)
        result = client.send(goal(point(2.0, 1.0, 0.2), joints=BOTH))
        wait_for(lambda: positions(joints)["shoulder"] > 0.1, "the start")
        topic.publish(String(data=ARM.replace("0.1 0.1 0.2", "0.1 0.1 0.3")))
        wait_for(lambda: "using the changed robot description" in node.output, "the change")
        assert ending(result) == SUCCESS
        wait_for(lambda: positions(joints)["shoulder"] == pytest.approx(1.0, abs=1e-6), "the end")

        # What is set while it runs holds for other joints, too.
        assert peer.set_parameters(CONTROLLER, **{"constraints.goal_time": 5.0})[0].successful
        result = client.send(goal(point(200.0, 0.0, 0.0), joints=BOTH))
        wait_for(lambda: positions(joints)["shoulder"] < 0.9999, "the next start")
        topic.publish(String(data=arm(UPPER).urdf))
        text = "Current goal cancelled: the robot description has other joints."
        assert ending(result) == (ABORTED, -1, text)
        wait_for(lambda: list(joints[-1].name) == SHOULDER, "the other joints")
        assert 0.5 < positions(joints)["shoulder"] < 1.0
        assert ending(client.send(goal(point(0.5, 0.2), joints=SHOULDER))) == SUCCESS

        result = client.send(goal(point(1.0, 0.0), joints=SHOULDER))
        topic.publish(String(data=arm().urdf))
        wait_for(lambda: "would have no joint to move" in node.output, "the refusal")
        assert ending(result) == SUCCESS


SLOW_JAW = body("jaw") + joint(
    "finger", "upper", "jaw", "prismatic", "1 0 0", limits=SLIDES.replace('"0.5" lo', '"0.05" lo')
)
MIXED = """
controller_manager:
  ros__parameters:
    joint_trajectory_controller:
      type: joint_trajectory_controller/JointTrajectoryController
    finger_controller: {type: forward_command_controller/ForwardCommandController}
joint_trajectory_controller: {ros__parameters: {joints: [shoulder]}}
finger_controller: {ros__parameters: {joints: [finger]}}
"""


@pytest.mark.parametrize("halted", [stopped, starved])
def test_nothing_moves_a_joint_that_was_commanded_before_the_process_woke(
    peer: Peer, tmp_path: Path, halted: Callable[[int], AbstractContextManager[None]]
) -> None:
    """Neither a goal, a trajectory or positions, nor those that wait meanwhile; later ones do."""
    model, file = tmp_path / "arm.urdf", tmp_path / "control.yaml"
    model.write_text(arm(UPPER, SLOW_JAW).urdf)
    file.write_text(MIXED)
    states = peer.hear(JointState, "/joint_states", 10000)
    with NodeProcess(MODULE, str(model), "--ros-args", "--params-file", str(file)) as node:
        topic = peer.publisher(JointTrajectory, f"{CONTROLLER}/joint_trajectory")
        finger = peer.publisher(Float64MultiArray, "/finger_controller/commands")
        client = WireArm(peer)

        def halt(to: float) -> None:
            """Halt the process while both joints move, and see them stand afterwards."""
            target, start = Float64MultiArray(data=[to]), positions(states)
            wait_for(
                lambda: finger.publish(target) or all(_moved(states, start, 0.02)), "both to move"
            )
            with halted(node.process.pid):
                topic.publish(trajectory(point(4.0, -2.0), joints=SHOULDER))
                finger.publish(Float64MultiArray(data=[0.25]))
                time.sleep(0.2)  # it may be as short as it likes
                woken = time.time_ns()

            def afterwards() -> list[JointState]:
                return [each for each in states if nanoseconds(each.header.stamp) >= woken]

            wait_for(lambda: len(afterwards()) > 100, "cycles of a second")
            assert not any(_moved(states, positions(afterwards()[:1]), 0.02))

        result = client.send(goal(point(10.0, 2.0), joints=SHOULDER))
        halt(to=0.5)
        text = "Current goal cancelled: the controller was stopped meanwhile, or had no processor"
        assert ending(result) == (ABORTED, -1, f"{text} time.")
        assert ending(client.send(goal(point(1.0, 0.0), joints=SHOULDER))) == SUCCESS
        topic.publish(trajectory(point(10.0, 2.0), joints=SHOULDER))
        halt(to=0.0)


def _moved(states: list[JointState], start: Mapping[str, float], least: float) -> list[bool]:
    """Which joints have moved by more than so much, rad or m."""
    return [abs(at - start[name]) > least for name, at in positions(states).items()]


def test_what_is_given_wrongly_is_one_error(model: str, tmp_path: Path) -> None:
    """It names the file and the line, the controller and its parameter, and what to write."""
    file, node = tmp_path / "control.yaml", CONTROLLER.removeprefix("/")
    file.write_text(MIXED.replace("joints: [finger]", "joints: [finger, fingr]"))
    outputs = refusals(
        MODULE,
        [
            [model, "--ros-args", "--params-file", str(file)],
            [model, "--ros-args", "-p", f"{node}:constraints.goal_time:=-1.0"],
        ],
    )
    text = 'finger_controller.joints: joint "fingr" does not move (did you mean "finger"?'
    assert outputs[0].startswith(f"error: {file}:8: {text}")
    text = "constraints.goal_time: -1 is below 0; write a number"
    assert outputs[1].startswith(f"error: {node}.{text}")
