"""``onebot trajectory``, beside a joint_trajectory_controller in a process of its own."""

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from onebot_bringup.cli import session
from onebot_bringup.cli.running_controllers import controller_of, running_controllers
from onebot_bringup.cli.session import Session
from onebot_description.errors import OneBotError
from onebot_description.ros.domains import used_domain
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import load_interface
from tests.onebot_bringup.cli_support import onebot, output_of, running
from tests.onebot_bringup.test_completion import completed
from tests.ros_support import LATCHED, NodeProcess, Peer
from tests.support import wait_for

MODULE = "onebot_control.joint_trajectory_controller"
STATE = load_interface("control_msgs/msg/JointTrajectoryControllerState")
NAME = "/joint_trajectory_controller"
MOVES = "controller:=NAME: /left/arm moves elbow, left; /right/arm moves elbow, right"
_LINK = """
  <link name="{child}">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="{name}" type="{kind}">
    <parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>
    <limit {limits} effort="1000" velocity="10"/>
  </joint>"""
_RANGE = 'lower="-2" upper="2.5"'
URDF = f"""<robot name="arm"><link name="world"/>
  {_LINK.format(name="shoulder", kind="revolute", parent="world", child="upper", limits=_RANGE)}
  {_LINK.format(name="wrist", kind="continuous", parent="upper", child="hand", limits="")}
</robot>"""


class Arm(NamedTuple):
    """A controller that runs, and the messages of its ~/controller_state."""

    process: NodeProcess
    states: list[Any]
    peer: Peer

    def positions(self) -> dict[str, float]:
        """Where the joints are, measured from now on: what is received may be late."""
        now = time.time_ns()
        wait_for(
            lambda: self.states and nanoseconds(self.states[-1].header.stamp) >= now,
            "the controller's state",
        )
        state = self.states[-1]
        return dict(zip(state.joint_names, state.feedback.positions, strict=True))


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Arm]:
    """A controller and its description, in a domain that the tests of this file share."""
    file = tmp_path_factory.mktemp("arm") / "arm.urdf"
    file.write_text(URDF)
    with used_domain() as domain, Peer(domain) as peer, NodeProcess(MODULE, str(file)) as process:
        peer.node.create_publisher(String, "/robot_description", LATCHED).publish(String(data=URDF))
        arm = Arm(process, peer.hear(STATE, f"{NAME}/controller_state"), peer)
        arm.positions()
        yield arm


def test_a_goal_is_reached(arm: Arm) -> None:
    """Progress, the result and its error; the other joint stays where it is."""
    output_of("trajectory", "wrist=0.25", "shoulder=0", "time:=0.3")
    done = onebot("trajectory", "shoulder=-0.5", "time:=0.5", "tolerance:=0.01")
    assert done.returncode == 0, done.stderr
    first, *_, result, error = done.stdout.splitlines()
    assert first == "0.0 of 0.5 s: shoulder 0.000"
    assert result == "SUCCESSFUL: Goal successfully reached!"
    assert error.startswith("largest error: ")
    assert arm.positions() == pytest.approx({"shoulder": -0.5, "wrist": 0.25}, abs=0.01)


def test_without_a_joint_it_lists(arm: Arm) -> None:
    heading, columns, shoulder, wrist = output_of("trajectory").splitlines()
    assert heading == NAME and columns.split() == ["joint", "position", "limits"]
    at = arm.positions()
    assert shoulder.split() == ["shoulder", f"{at['shoulder']:.3f}", "-2", "…", "2.5", "rad"]
    assert wrist.split()[::2] == ["wrist", "endless"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["shoulder=9"], f"REJECTED by {NAME}\nerror: goal rejected: points[0].positions: "),
        (["wrist=1", "controller:=/arm"], f"no /arm found (controllers: {NAME}); "),
        # The joint cannot be that fast, because of its limit of velocity, 10 rad/s.
        (
            ["shoulder=2", "time:=0.01", "tolerance:=1e-4"],
            "ABORTED (-5): Aborted due to goal_time_tolerance",
        ),
        (["shoulder=-1.5", "wrist=0", "time:=0.1"], "shoulder was "),
    ],
)
def test_a_goal_that_fails(arm: Arm, words: list[str], message: str) -> None:
    """With the reason, which of a rejected goal only the controller's log has."""
    done = onebot("trajectory", *words)
    assert done.returncode == 1 and f"error: {message}" in done.stderr, done.stderr
    assert "SUCCESSFUL" not in done.stdout


def test_a_goal_whose_motion_was_replaced_fails(arm: Arm, tmp_path: Path) -> None:
    """By the topic, as the steering page's sliders do; it says so."""
    topic = arm.peer.publisher(JointTrajectory, f"{NAME}/joint_trajectory")
    at = arm.positions()
    hold = JointTrajectoryPoint(positions=at.values())
    hold.time_from_start.nanosec = 300_000_000
    message = JointTrajectory(joint_names=list(at), points=[hold])
    begin = at["shoulder"]
    away = begin + (1.0 if begin < 0.0 else -1.0)  # within the limits, wherever it is
    with running(tmp_path, "trajectory", f"shoulder={away}", "time:=60") as command:
        wait_for(lambda: abs(arm.positions()["shoulder"] - begin) > 0.01, "the joint to move")
        wait_for(lambda: topic.publish(message) or command.process.poll() is not None, "the end")
        assert command.process.returncode == 1 and "SUCCESSFUL" not in command.out
        assert "error: ABORTED (-1): Current goal preempted by another traj" in command.err


def test_ctrl_c_cancels(arm: Arm, tmp_path: Path) -> None:
    """The joint stops short, and stays there."""
    start = arm.positions()["shoulder"]
    with running(tmp_path, "trajectory", "shoulder=2.4", "time:=20") as command:
        wait_for(lambda: arm.positions()["shoulder"] > start + 0.01, "the joint to move")
        assert command.interrupt() == 130
        assert command.out.endswith("CANCELED: the joints hold where they are\n")
        assert "Traceback" not in command.err
    stopped = arm.positions()["shoulder"]
    assert start < stopped < 2.0
    wait_for(lambda: arm.states[-1].reference.velocities[0] == 0.0, "the joint to hold")
    assert arm.positions()["shoulder"] == pytest.approx(stopped, abs=0.01)


def test_completion(arm: Arm) -> None:
    lines = {
        "onebot trajectory shou": {"shoulder="},
        "onebot trajectory shoulder=1 controller:=/": {f"controller:={NAME}"},
    }
    assert completed(lines) == lines


def test_the_controller_ends_meanwhile(peer: Peer, tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(URDF)
    states = peer.hear(STATE, f"{NAME}/controller_state")
    with NodeProcess(MODULE, str(file)) as process:
        wait_for(lambda: states, "the controller")
        with running(tmp_path, "trajectory", "wrist=1", "time:=60") as command:
            command.says("0.0 of 60 s")
            process.interrupt()
            assert command.wait() == 1
            assert f"error: {NAME} does not answer: the joints may still move" in command.err


def test_several_controllers(peer: Peer) -> None:
    """All in the namespace are found, or the one that is named."""
    publish_states(peer, {"/left/arm": ["elbow", "left"], "/right/arm": ["elbow", "right"]})
    for namespace, name, found in (
        ("/", "", ["/left/arm", "/right/arm"]),
        ("/", "right/arm", ["/right/arm"]),
        ("/left", "", ["/left/arm"]),
    ):
        with Session(["-r", f"__ns:={namespace}"]) as found_by:
            controllers = running_controllers(found_by, name)
            assert [controller.name for controller in controllers] == found


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        ("elbow", f"several controllers move all of these joints, choose one by {MOVES}"),
        ("left right", f"no controller moves all of these joints, choose one by {MOVES}"),
        ("lift", 'no joint "lift" (did you mean "left"? joints: elbow, left, right)'),
    ],
)
def test_joints_of_no_single_controller(joints: str, message: str) -> None:
    """A joint of one is moved by that, one of both by the one that is named."""
    controllers = [
        SimpleNamespace(name=f"/{side}/arm", joints=["elbow", side]) for side in ("left", "right")
    ]
    assert controller_of(controllers, ["right"]) is controllers[1]
    with pytest.raises(OneBotError, match=re.escape(message)):
        controller_of(controllers, joints.split())


def publish_states(peer: Peer, joints: Mapping[str, Sequence[str]]) -> None:
    """Publish a state of controllers without an action; of one without joints only the topic."""
    for name, names in joints.items():
        publisher = peer.node.create_publisher(STATE, f"{name}/controller_state", LATCHED)
        if names:
            state = STATE(joint_names=names)
            state.feedback.positions = state.reference.positions = [0.0] * len(names)
            publisher.publish(state)


def test_no_controller(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "_LOOKUP", 0.5)  # none is there that could be discovered late
    done = onebot("trajectory", "elbow=1")
    text = "error: no joint_trajectory_controller found; start one with mrm_bringup sim:=true"
    assert done.returncode == 1 and text in done.stderr


def test_a_controller_that_does_not_work(peer: Peer) -> None:
    publish_states(peer, {"/arm": ["elbow"], "/inactive": []})
    for words, message in {
        "controller:=/arm": "there is no action /arm/follow_joint_trajectory",
        "controller:=/inactive": "no ~/controller_state of /inactive: it is inactive, or",
    }.items():
        done = onebot("trajectory", "elbow=1", *words.split())
        assert done.returncode == 1 and f"error: {message}" in done.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("elbow=fast", '"elbow=fast" is not NAME=NUMBER, such as elbow=0.5'),
        ("elbow=nan", '"elbow=nan" is not NAME=NUMBER'),
        ("elbow", '"elbow" is not NAME=NUMBER'),
        ("elbow=1 time:=0", "time:=0 is not valid; write a number above 0"),
        ("elbow=1 tme:=1", 'no argument "tme" (did you mean "time"?'),
    ],
)
def test_wrong_words(words: str, message: str) -> None:
    """They are reported before anything is discovered."""
    done = onebot("trajectory", *words.split())
    assert done.returncode == 2 and done.stderr.startswith(f"error: {message}")
    assert done.stderr.endswith("see: onebot trajectory --help\n") and "looking" not in done.stderr
