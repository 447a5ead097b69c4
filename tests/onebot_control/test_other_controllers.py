"""Arms and grippers by control files: forwarded positions and the action of a gripper, on topics.

The joints are a shoulder, which follows trajectories, a pan and a tilt, to which positions are
forwarded, and a finger of 20 N. There is a box of a world on the finger's way, if there is one.
"""

import math
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64MultiArray
from std_srvs.srv import Trigger

from onebot_control import simulation as simulation_module
from onebot_control.control_files import read_joint_controllers
from onebot_control.joint_controllers import JOINT_CONTROLLERS
from onebot_control.nodes import controller_node
from onebot_control.nodes.joint_controller_nodes import controller_nodes
from onebot_control.nodes.lockstep import Lockstep
from onebot_control.simulation import Simulation
from onebot_description.description import Description, parse_description
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import load_interface
from tests.onebot_control.arm_support import (
    ABORTED,
    CANCELED,
    SUCCEEDED,
    SUCCESS,
    Ending,
    FollowJointTrajectory,
    goal,
    point,
)
from tests.ros_support import NodeProcess, Peer, refusals
from tests.support import wait_for

MODULE = "onebot_control.joint_trajectory_controller"
ParallelGripperCommand = load_interface("control_msgs/action/ParallelGripperCommand")
OPEN, FAST = 0.05, 0.1  # m and m/s of the finger
EFFORT = 20.0  # N


def _joint(name: str, kind: str, parent: str, xyz: str, axis: str, limit: str) -> str:
    """A joint, and a link of 0.2 kg that it moves."""
    return f"""
  <link name="{name}_link">
    <inertial><mass value="0.2"/>
      <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.02 0.02 0.02"/></geometry></collision>
  </link>
  <joint name="{name}" type="{kind}">
    <parent link="{parent}"/><child link="{name}_link"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>
    <limit {limit}/>
  </joint>"""


_TURNS = 'effort="20" velocity="0.5" lower="-2" upper="2"'
ROBOT = f"""<robot name="arm">
  <link name="world"/>
  {_joint("shoulder", "revolute", "world", "0 0 1", "0 0 1", _TURNS)}
  {_joint("pan", "revolute", "world", "0 1 1", "0 0 1", _TURNS)}
  {_joint("tilt", "revolute", "pan_link", "0 0 0.1", "0 1 0", _TURNS)}
  {
    _joint(
        "finger",
        "prismatic",
        "world",
        "1 0 1",
        "0 1 0",
        f'effort="{EFFORT}" velocity="{FAST}" lower="0" upper="{OPEN}"',
    )
}
</robot>"""
# The finger, 2 cm wide, meets it at 0.02 m.
BOX = """<robot name="box">
  <link name="world"/>
  <link name="box"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <joint name="place" type="fixed">
    <parent link="world"/><child link="box"/><origin xyz="1 -0.04 1"/>
  </joint>
</robot>"""
CONTROL = """\
controller_manager:
  ros__parameters:
    initial_positions.finger: 0.05
    arm_controller: {type: joint_trajectory_controller/JointTrajectoryController}
    gripper_controller: {type: parallel_gripper_action_controller/GripperActionController}
    head_controller: {type: forward_command_controller/ForwardCommandController}
arm_controller:
  ros__parameters:
    joints: [shoulder]
gripper_controller:
  ros__parameters:
    joint: finger
head_controller:
  ros__parameters:
    joints: [tilt, pan]
    interface_name: position
"""


class Client(Node):
    """Moves the arm, the gripper and the head."""

    def __init__(self) -> None:
        super().__init__("client")
        self.arm = ActionClient(
            self, FollowJointTrajectory, "arm_controller/follow_joint_trajectory"
        )
        self.gripper = ActionClient(self, ParallelGripperCommand, "gripper_controller/gripper_cmd")
        self.commands = self.create_publisher(Float64MultiArray, "head_controller/commands", 10)
        self.lock = self.create_publisher(Bool, "controller_manager/cmd_vel_lock", 10)
        self.feedback: list[Any] = []

    def grip(self, *positions: float) -> Any:
        """Send a goal to the gripper; the future of its handle."""
        command = JointState(name=["finger"], position=positions)
        return self.gripper.send_goal_async(
            ParallelGripperCommand.Goal(command=command),
            lambda each: self.feedback.append(each.feedback),
        )


class Stepped:
    """The robot in step with its client: simulated time passes while it waits."""

    def __init__(self, ros: Lockstep[Simulation]) -> None:
        self.ros, self.simulation, self.client = ros, ros.simulation, Client()
        ros.add(self.client)
        for action in (self.client.arm, self.client.gripper):
            assert action.wait_for_server(10.0)

    def awaited(self, future: Any, timeout: float = 5.0) -> Any:
        self.simulation.run(until=future.done, timeout=timeout)
        return future.result()

    def grip(self, position: float) -> Any:
        """The handle of an accepted goal of the gripper."""
        handle = self.awaited(self.client.grip(position))
        assert handle.accepted
        return handle

    def gripped(self, position: float) -> Any:
        """How a goal of the gripper ends: its status, and its result."""
        return self.awaited(self.grip(position).get_result_async())

    def command(self, *positions: float, seconds: float = 0.05) -> None:
        """Command the head, tilt and pan, and let some time pass."""
        self.client.commands.publish(Float64MultiArray(data=positions))
        self.simulation.run(seconds)

    def call(self, kind: Any, name: str, **request: Any) -> Any:
        """The answer of a service."""
        client = self.client.create_client(kind, name)
        assert client.wait_for_service(10.0)
        return self.awaited(client.call_async(kind.Request(**request)))

    def set_parameter(self, controller: str, name: str, value: Any) -> Any:
        """Set a parameter of a controller; the result."""
        parameters = [Parameter(name, value=value).to_parameter_msg()]
        [result] = self.call(
            SetParameters, f"{controller}/set_parameters", parameters=parameters
        ).results
        return result

    def set_lock(self, locked: bool) -> None:
        """Lock the robot, or unlock it."""
        self.client.lock.publish(Bool(data=locked))
        self.simulation.run(0.02)

    def position(self, joint: str) -> float:
        return self.simulation.robot.joints[joint].position

    def velocity(self, joint: str) -> float:
        return self.simulation.robot.joints[joint].velocity

    @property
    def head(self) -> tuple[float, float]:
        """Tilt and pan, rad."""
        return self.position("tilt"), self.position("pan")


@pytest.fixture
def start(
    ros_simulation: Callable[..., Lockstep[Simulation]],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> Callable[..., Stepped]:
    """Start the robot with the controllers of a control file."""
    member = simulation_module._member

    def started(control: str = CONTROL, world: str = "") -> Stepped:
        file = tmp_path / "control.yaml"
        file.write_text(control)
        controllers = read_joint_controllers([file], "/").controllers
        monkeypatch.setattr(
            simulation_module,
            "_member",
            lambda *arguments: member(*arguments)._replace(controllers=controllers),
        )
        scene: Description | str = parse_description(world, "box.urdf") if world else ""
        start = {"initial_positions.finger": OPEN}
        return Stepped(ros_simulation(parse_description(ROBOT), world=scene, parameters=start))

    return started


def flags(ended: Any) -> tuple[int, bool, bool]:
    """How a goal of the gripper ended: status, reached, stalled."""
    return ended.status, ended.result.reached_goal, ended.result.stalled


def logged(capfd: pytest.CaptureFixture[str], node: str) -> list[tuple[str, str]]:
    """Severity and text of what a node has logged since this was last asked."""
    return re.findall(rf"\[(\w+)\] \[[\d.]+\] \[{node}\]: (.*)", capfd.readouterr().err)


def test_each_kind_of_controller_has_its_interface() -> None:
    assert set(controller_nodes()) == set(JOINT_CONTROLLERS.values())


# The gripper ------------------------------------------------------------------------------------


def test_an_arm_and_its_gripper_move_at_once(start: Callable[..., Stepped]) -> None:
    """By two controllers of one file; each leaves the joints of the others alone."""
    robot = start()
    arm = robot.awaited(
        robot.client.arm.send_goal_async(goal(point(2.0, 0.5), joints=["shoulder"]))
    )
    gripper = robot.grip(0.01)
    ended = robot.awaited(gripper.get_result_async())
    assert flags(ended) == (SUCCEEDED, True, False)
    assert 0.0 < robot.position("shoulder") < 0.5
    answer = robot.awaited(arm.get_result_async())
    ending = Ending(answer.status, answer.result.error_code, answer.result.error_string)
    assert ending == SUCCESS
    assert robot.position("shoulder") == pytest.approx(0.5, abs=1e-9)
    assert robot.position("finger") == pytest.approx(0.01, abs=1e-6)
    assert robot.head == (0.0, 0.0)


def test_a_gripper_closes_on_nothing(start: Callable[..., Stepped]) -> None:
    """At its motor's limit; feedback and result have the state, and it goes on to the goal."""
    robot = start()
    ended = robot.gripped(0.0)
    assert flags(ended) == (SUCCEEDED, True, False)
    state = ended.result.state
    assert list(state.name) == ["finger"]
    assert 0.009 - 1e-9 <= state.position[0] < 0.01  # of the first cycle within the tolerance
    assert state.velocity[0] == pytest.approx(-FAST, rel=1e-3)
    assert abs(state.effort[0]) < 1.0
    feedback = [each.state for each in robot.client.feedback]
    stamps = [nanoseconds(each.header.stamp) for each in feedback]
    assert [b - a for a, b in zip(stamps, stamps[1:], strict=False)] == (
        [50_000_000] * (len(stamps) - 1)
    )
    assert len(feedback) == pytest.approx(8, abs=1)  # 0.4 s at 20 Hz
    for each, stamp in zip(feedback, stamps, strict=True):
        until_end = (nanoseconds(state.header.stamp) - stamp) * 1e-9
        assert list(each.name) == ["finger"]
        assert each.position[0] == pytest.approx(state.position[0] + FAST * until_end, abs=1e-4)
        assert len(each.velocity) == len(each.effort) == 1
    robot.simulation.run(0.2)
    assert robot.position("finger") == pytest.approx(0.0, abs=1e-6)


def test_a_gripper_stalls_at_a_box(
    start: Callable[..., Stepped], capfd: pytest.CaptureFixture[str]
) -> None:
    """It presses on with all its effort, whether that is allowed or not."""
    robot = start(world=BOX)
    begin = robot.simulation.time
    aborted = robot.gripped(0.0)
    assert flags(aborted) == (ABORTED, False, True)
    assert robot.simulation.time - begin == pytest.approx(0.3 + 1.0, abs=0.08)
    state = aborted.result.state
    assert state.position[0] == pytest.approx(0.02, abs=1e-3)
    assert state.velocity[0] == pytest.approx(0.0, abs=1e-3)
    assert state.effort[0] == pytest.approx(-EFFORT, rel=0.01)
    assert robot.set_parameter("gripper_controller", "allow_stalling", True).successful
    assert flags(robot.gripped(0.0)) == (SUCCEEDED, False, True)
    robot.simulation.run(0.2)
    assert robot.simulation.robot.joints["finger"].effort == pytest.approx(-EFFORT, rel=0.01)
    [(first, stalled), (second, allowed)] = logged(capfd, "gripper_controller")
    assert (first, second) == ("WARN", "INFO")
    for text in (stalled, allowed):
        pattern = r"Stalled on the way to the goal: finger: position 0\.0\d+, goal 0"
        assert re.fullmatch(pattern, text), text


def test_goals_of_a_gripper_are_refused(
    start: Callable[..., Stepped], capfd: pytest.CaptureFixture[str]
) -> None:
    """With the reason in the log; the goal that is active goes on."""
    robot = start()
    active = robot.grip(0.0)
    for positions, reason in (
        ((), "0 given, for 1 joints"),
        ((0.01, 0.02), "2 given, for 1 joints"),
        ((0.06,), "finger: 0.06 is above the joint's limit 0.05"),
        ((-0.01,), "finger: -0.01 is below the joint's limit 0"),
        ((math.nan,), "finger: nan is not finite"),
    ):
        assert not robot.awaited(robot.client.grip(*positions)).accepted
        text = f"goal rejected: command.position: {reason}"
        assert logged(capfd, "gripper_controller") == [("ERROR", text)]
    assert flags(robot.awaited(active.get_result_async())) == (SUCCEEDED, True, False)


def test_a_gripper_is_cancelled_and_preempted(start: Callable[..., Stepped]) -> None:
    robot = start()
    first = robot.grip(0.0)
    robot.simulation.run(0.1)
    second = robot.grip(0.05)
    assert flags(robot.awaited(first.get_result_async())) == (ABORTED, False, False)
    assert flags(robot.awaited(second.get_result_async())) == (SUCCEEDED, True, False)
    third = robot.grip(0.0)
    robot.simulation.run(0.2)
    canceling = robot.awaited(third.cancel_goal_async())
    assert len(canceling.goals_canceling) == 1
    held = robot.position("finger")
    ended = robot.awaited(third.get_result_async())
    assert flags(ended) == (CANCELED, False, False)
    assert ended.result.state.position[0] == pytest.approx(held, abs=FAST * 0.011)
    robot.simulation.run(0.5)
    assert 0.0 < held < OPEN
    assert robot.position("finger") == pytest.approx(held, abs=FAST * 0.011)


def test_a_locked_gripper_refuses_goals(
    start: Callable[..., Stepped], capfd: pytest.CaptureFixture[str]
) -> None:
    """The goal that is active is aborted, and the finger stays where it is."""
    robot = start()
    handle = robot.grip(0.0)
    robot.simulation.run(0.1)
    robot.set_lock(True)
    assert flags(robot.awaited(handle.get_result_async())) == (ABORTED, False, False)
    held = robot.position("finger")
    assert 0.03 < held < OPEN
    logged(capfd, "gripper_controller")
    assert not robot.awaited(robot.client.grip(0.0)).accepted
    [(severity, text)] = logged(capfd, "gripper_controller")
    assert severity == "ERROR" and text.startswith("goal rejected: the robot is locked until")
    robot.simulation.run(0.3)
    assert robot.position("finger") == pytest.approx(held, abs=1e-6)
    robot.set_lock(False)
    assert flags(robot.gripped(0.0)) == (SUCCEEDED, True, False)


def test_parameters_of_a_gripper(start: Callable[..., Stepped]) -> None:
    """They apply to the goal that is active, or are refused with the reason."""
    robot = start(world=BOX)
    refused = robot.set_parameter("gripper_controller", "goal_tolerance", "big")
    text = 'goal_tolerance: "big" is a string; write a number from 0'
    assert (refused.successful, refused.reason) == (False, text)
    refused = robot.set_parameter("gripper_controller", "goal_tolerence", 1.0)
    assert 'goal_tolerence: no such parameter (did you mean "goal_tolerance"?' in refused.reason
    assert not robot.set_parameter("gripper_controller", "joint", "pan").successful
    handle = robot.grip(0.0)
    robot.simulation.run(0.5)
    assert robot.set_parameter("gripper_controller", "goal_tolerance", 0.03).successful
    assert flags(robot.awaited(handle.get_result_async())) == (SUCCEEDED, True, False)


# Forwarded positions ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "control",
    [
        CONTROL,
        CONTROL.replace(
            "forward_command_controller/ForwardCommandController",
            "position_controllers/JointGroupPositionController",
        ).replace("    interface_name: position\n", ""),
    ],
    ids=["forward", "position"],
)
def test_positions_are_forwarded(start: Callable[..., Stepped], control: str) -> None:
    """A jump is a run at the motors' limit; the order is that of the parameter joints."""
    robot = start(control)
    robot.simulation.run(0.2)
    assert robot.head == (0.0, 0.0)
    robot.client.commands.publish(Float64MultiArray(data=[0.25, -0.5]))
    robot.simulation.run(until=lambda: robot.velocity("pan") != 0.0)
    begin = robot.simulation.time - robot.simulation.period
    robot.simulation.run(0.3)
    since = robot.simulation.time - begin
    assert robot.velocity("pan") == pytest.approx(-0.5, rel=1e-3)
    assert robot.velocity("tilt") == pytest.approx(0.5, rel=1e-3)
    assert robot.head == pytest.approx((0.5 * since, -0.5 * since), abs=1e-3)
    robot.simulation.run(until=lambda: robot.velocity("pan") > -1e-6)
    assert robot.simulation.time - begin == pytest.approx(1.0, abs=0.03)
    robot.simulation.run(0.1)
    assert robot.head == pytest.approx((0.25, -0.5), abs=1e-6)
    assert robot.position("shoulder") == 0.0


def test_commands_that_are_ignored(
    start: Callable[..., Stepped],
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The last one stays commanded, and the log has the reason."""
    monkeypatch.setattr(controller_node, "_IGNORED_EVERY", 0.0)
    robot = start()
    robot.command(0.2, 0.2, seconds=0.5)
    for severity, positions, reason in (
        ("ERROR", (0.5,), "data: 1 given, for 2 joints"),
        ("ERROR", (0.5, 0.5, 0.5), "data: 3 given, for 2 joints"),
        ("ERROR", (), "data: 0 given, for 2 joints"),
        ("ERROR", (0.0, 2.5), "data: pan: 2.5 is above the joint's limit 2"),
        ("WARN", (math.nan, 0.0), "data: tilt: nan is not finite"),
        ("WARN", (0.0, math.inf), "data: pan: inf is not finite"),
    ):
        robot.command(*positions)
        expected = (severity, f"~/commands is ignored: {reason}")
        assert logged(capfd, "head_controller") == [expected]
        assert robot.head == pytest.approx((0.2, 0.2), abs=1e-6)
    robot.command(0.3, 0.3, seconds=0.3)
    assert robot.head == pytest.approx((0.3, 0.3), abs=1e-6)


def test_a_locked_head_stays_where_it_is(
    start: Callable[..., Stepped],
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It ignores commands, with one line in the log, and does not move on when it is unlocked."""
    monkeypatch.setattr(controller_node, "_IGNORED_EVERY", 60.0)
    robot = start()
    robot.command(1.0, 1.0, seconds=0.3)
    robot.set_lock(True)
    held = robot.head
    assert held == pytest.approx((0.15, 0.15), abs=0.02)
    for _ in range(6):
        robot.command(-1.0, -1.0)
    [(severity, text)] = logged(capfd, "head_controller")
    assert severity == "ERROR"
    assert text.startswith("~/commands is ignored: the robot is locked until false is published")
    robot.set_lock(False)
    robot.simulation.run(0.3)
    assert robot.head == pytest.approx(held, abs=1e-6)
    robot.command(0.0, 0.0, seconds=0.5)
    assert robot.head == pytest.approx((0.0, 0.0), abs=1e-6)


def test_reset(start: Callable[..., Stepped]) -> None:
    """All joints are at the start again, and stay there; the gripper's goal is aborted."""
    robot = start()
    robot.command(1.0, 1.0, seconds=0.5)
    handle = robot.grip(0.0)
    robot.simulation.run(0.1)
    assert robot.call(Trigger, "controller_manager/reset").success
    assert flags(robot.awaited(handle.get_result_async())) == (ABORTED, False, False)
    robot.simulation.run(0.5)
    assert robot.head == pytest.approx((0.0, 0.0), abs=1e-9)
    assert robot.position("finger") == pytest.approx(OPEN, abs=1e-9)


# Control files ----------------------------------------------------------------------------------


@pytest.fixture
def robot_file(tmp_path: Path) -> Path:
    """The URDF."""
    file = tmp_path / "arm.urdf"
    file.write_text(ROBOT)
    return file


def answered(ask: Callable[[], Any], what: str) -> Any:
    """The answer to a request, which is sent again where it is lost; see ``Peer.call``."""
    start, futures = time.monotonic(), list[Any]()

    def answer() -> Any:
        if time.monotonic() >= start + 10.0 * len(futures):
            futures.append(ask())
        return next((future.result() for future in futures if future.done()), None)

    return wait_for(answer, what)


def test_the_node_has_the_controllers_of_its_file(
    ros_domain: int, robot_file: Path, tmp_path: Path
) -> None:
    """In real time, and what the command line has overrides the defaults."""
    control = tmp_path / "control.yaml"
    control.write_text(CONTROL)
    arguments = ["--params-file", str(control), "-p", "gripper_controller:goal_tolerance:=0.02"]
    with (
        NodeProcess(MODULE, str(robot_file), "--ros-args", *arguments) as process,
        Peer(ros_domain) as peer,
    ):
        states = peer.hear(JointState, "joint_states")
        commands = peer.publisher(Float64MultiArray, "head_controller/commands")
        gripper = ActionClient(peer.node, ParallelGripperCommand, "gripper_controller/gripper_cmd")
        assert gripper.wait_for_server(20.0)
        request = ParallelGripperCommand.Goal(command=JointState(position=[0.0]))
        handle = answered(lambda: gripper.send_goal_async(request), "the goal to be answered")
        assert handle.accepted
        ended = answered(handle.get_result_async, "the goal to end")
        assert flags(ended) == (SUCCEEDED, True, False)
        assert 0.018 <= ended.result.state.position[0] < 0.02

        def arrived() -> bool:
            # Best effort: what is published before the node has discovered the publisher is lost.
            commands.publish(Float64MultiArray(data=[0.2, -0.2]))
            positions = dict(zip(states[-1].name, states[-1].position, strict=True))
            return positions == pytest.approx(at_rest, abs=1e-6)

        at_rest = {"shoulder": 0.0, "pan": -0.2, "tilt": 0.2, "finger": 0.0}
        wait_for(arrived, "the joints to arrive")
        assert peer.parameter("/gripper_controller", "goal_tolerance") == 0.02
        assert peer.parameter("/head_controller", "joints") == ["tilt", "pan"]
        assert process.interrupt() == 0


def test_control_files_that_are_refused(robot_file: Path, tmp_path: Path) -> None:
    """With the file, the line and the controller; see test_control_files.py for more."""
    twice = "is a joint of arm_controller, too; each has one controller"
    wrong = [
        (
            ("joints: [tilt, pan]", "joints: [tilt, shoulder]"),
            f'15: head_controller.joints: "shoulder" {twice}',
        ),
        (
            ("joint: finger", "joint: shoulder"),
            f'12: gripper_controller.joint: "shoulder" {twice}',
        ),
        (
            ("joints: [shoulder]", "joints: [shoulder]\n    constraints.sholder.goal: 0.1"),
            "10: arm_controller.constraints.sholder: no joint of the controller (did you mean "
            '"shoulder"? known: shoulder)',
        ),
    ]
    lines, texts = [], []
    for number, ((old, new), text) in enumerate(wrong):
        assert CONTROL.count(old) == 1
        file = tmp_path / f"control{number}.yaml"
        file.write_text(CONTROL.replace(old, new))
        lines.append([str(robot_file), "--ros-args", "--params-file", str(file)])
        texts.append(f"{file}:{text}")
    outputs = refusals(MODULE, lines)
    for output, text in zip(outputs, texts, strict=True):
        assert output.splitlines()[-1] == f"error: {text}"
