"""Arms and grippers by control files: forwarded positions and the action of a gripper, on topics.

The robot is that of arm_support.py. There is a box of a world on the finger's way, if there is one.
"""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64MultiArray

from onebot_control import robot_setup
from onebot_control.control_files import ControlFiles
from onebot_control.joint_controllers import JOINT_CONTROLLERS
from onebot_control.nodes import controller_node
from onebot_control.nodes.joint_controller_nodes import controller_interfaces
from onebot_control.nodes.lockstep import Lockstep
from onebot_control.prepared_robot import Member
from onebot_control.simulation import Simulation
from onebot_description.description import Description
from onebot_description.ros.domains import used_domain
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import load_interface
from tests.onebot_control.arm_models import arm, box, joint, link
from tests.onebot_control.arm_support import (
    ABORTED,
    CONTROL,
    EFFORT,
    FAST,
    MODULE,
    OPEN,
    ROBOT,
    SUCCEEDED,
    SUCCESS,
    ArmClient,
    SteppedArm,
    answered,
    flags,
    goal,
    point,
)
from tests.ros_support import NodeProcess, Peer
from tests.support import wait_for

ParallelGripperCommand = load_interface("control_msgs/action/ParallelGripperCommand")
GripperCommand = load_interface("control_msgs/action/GripperCommand")
# The finger, 2 cm wide, meets it at 0.02 m.
BOX = arm(
    link("box", shape=box("0.1 0.1 0.1")), joint("place", "world", "box", "fixed", xyz="1 -0.04 1")
)


class Client(ArmClient):
    """Moves the arm, the gripper and the head."""

    def __init__(self, gripper: Any = ParallelGripperCommand) -> None:
        super().__init__("/arm_controller")
        self.gripper = ActionClient(self, gripper, "gripper_controller/gripper_cmd")
        self.commands = self.create_publisher(Float64MultiArray, "head_controller/commands", 10)

    def grip(self, *positions: float, **limits: list[float]) -> Any:
        """Send a goal to the gripper; the future of its handle."""
        command = JointState(name=["finger"], position=positions, **limits)
        return self.gripper.send_goal_async(
            ParallelGripperCommand.Goal(command=command),
            lambda each: self.feedback.append(each.feedback),
        )


class Stepped(SteppedArm):
    """The robot in step with its client."""

    client: Client

    def __init__(self, ros: Lockstep[Simulation], gripper: Any) -> None:
        super().__init__(ros, Client(gripper))
        assert self.client.gripper.wait_for_server(10.0)

    def grip(self, position: float, **limits: list[float]) -> Any:
        """The handle of an accepted goal of the gripper."""
        handle = self.awaited(self.client.grip(position, **limits))
        assert handle.accepted
        return handle

    def gripped(self, position: float, **limits: list[float]) -> Any:
        """How a goal of the gripper ends: its status, and its result."""
        return self.awaited(self.grip(position, **limits).get_result_async())

    def command(self, *positions: float, seconds: float = 0.05) -> None:
        """Command the head, tilt and pan, and let some time pass."""
        self.client.commands.publish(Float64MultiArray(data=positions))
        self.simulation.run(seconds)

    def set_lock(self, locked: bool) -> None:
        """Lock the robot, or unlock it."""
        self.client.lock.publish(Bool(data=locked))
        self.simulation.run(0.02)

    def state(self, joint: str) -> Any:
        """Position, velocity and effort of a joint."""
        return self.simulation.robot.joints[joint]

    @property
    def head(self) -> tuple[float, float]:
        """Tilt and pan, rad."""
        return self.state("tilt").position, self.state("pan").position


@contextmanager
def started(
    folder: Path,
    world: Description | str = "",
    control: str = CONTROL,
    gripper: Any = ParallelGripperCommand,
) -> Iterator[Stepped]:
    """The robot with the controllers of the control file; all that they ignore is logged."""
    file = folder / "control.yaml"
    file.write_text(control)
    controllers = ControlFiles([file], "/").joint_controllers().controllers
    start = {"initial_positions.finger": OPEN}
    with pytest.MonkeyPatch.context() as patch, used_domain() as domain:
        patch.setattr(controller_node, "_IGNORED_EVERY", 0.0)
        patch.setattr(
            robot_setup,
            "Member",
            lambda *arguments: Member(*arguments, controllers=controllers),
        )
        with Simulation(ROBOT, world=world, parameters=start) as simulation:
            with simulation.ros(domain) as ros:
                yield Stepped(ros, gripper)


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stepped]:
    """The robot, for all tests that need no world."""
    with started(tmp_path_factory.mktemp("control")) as robot:
        yield robot


@pytest.fixture
def robot(shared: Stepped) -> Stepped:
    """The same, its joints at the start."""
    shared.reset()
    return shared


def logged(capfd: pytest.CaptureFixture[str], node: str) -> list[tuple[str, str]]:
    """Severity and text of what a node has logged since this was last asked."""
    return re.findall(rf"\[(\w+)\] \[[\d.]+\] \[{node}\]: (.*)", capfd.readouterr().err)


def test_each_kind_of_controller_has_its_interface() -> None:
    assert set(controller_interfaces()) == set(JOINT_CONTROLLERS.values())


def test_a_gripper_stalls_at_a_box(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """It presses on with all its effort, whether that is allowed or not."""
    with started(tmp_path, BOX) as robot:
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
        assert robot.state("finger").effort == pytest.approx(-EFFORT, rel=0.01)
        [(first, stalled), (second, allowed)] = logged(capfd, "gripper_controller")
        assert (first, second) == ("WARN", "INFO")
        for text in (stalled, allowed):
            pattern = r"Stalled on the way to the goal: finger: position 0\.0\d+, goal 0"
            assert re.fullmatch(pattern, text), text


def test_a_gripper_presses_as_told(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """With the goal's effort, or the parameter's, or its motor's; likewise with velocities."""
    control = CONTROL.replace(
        "    joint: finger\n", "    joint: finger\n    allow_stalling: true\n"
    )
    with started(tmp_path, BOX, control) as robot:

        def pressed(**limits: list[float]) -> float:
            assert flags(robot.gripped(0.0, **limits)) == (SUCCEEDED, False, True)
            return float(robot.state("finger").effort)

        assert pressed(effort=[5.0]) == pytest.approx(-5.0, rel=0.01)
        assert pressed() == pytest.approx(-EFFORT, rel=0.01)
        assert robot.set_parameter("gripper_controller", "max_effort", 8.0).successful
        assert pressed() == pytest.approx(-8.0, rel=0.01)
        assert pressed(effort=[1e6]) == pytest.approx(-EFFORT, rel=0.01)
        robot.client.feedback.clear()
        robot.gripped(OPEN, velocity=[0.02])
        speeds = [each.state.velocity[0] for each in robot.client.feedback]
        assert max(speeds) == pytest.approx(0.02, rel=1e-3)
        robot.client.feedback.clear()
        assert robot.set_parameter("gripper_controller", "max_velocity", 0.05).successful
        pressed()
        speeds = [each.state.velocity[0] for each in robot.client.feedback]
        assert min(speeds) == pytest.approx(-0.05, rel=1e-3)
        capfd.readouterr()
        for limits in ({"effort": [-1.0]}, {"velocity": [math.nan]}):
            assert not robot.awaited(robot.client.grip(0.0, **limits)).accepted
        texts = [text for _, text in logged(capfd, "gripper_controller")]
        assert texts == [
            "goal rejected: command.effort: -1 is not a number from 0 to 1e+60",
            "goal rejected: command.velocity: nan is not a number from 0 to 1e+60",
        ]


def test_a_gripper_of_the_older_kind(tmp_path: Path) -> None:
    """Its action is control_msgs/action/GripperCommand, with one effort."""
    older = "position_controllers/GripperActionController"
    control = CONTROL.replace("parallel_gripper_action_controller/GripperActionController", older)
    with started(tmp_path, BOX, control, GripperCommand) as robot:
        feedback: list[Any] = []

        def gripped(position: float, effort: float) -> Any:
            goal = GripperCommand.Goal()
            goal.command.position, goal.command.max_effort = position, effort
            handle = robot.awaited(
                robot.client.gripper.send_goal_async(
                    goal, lambda each: feedback.append(each.feedback)
                )
            )
            return robot.awaited(handle.get_result_async()) if handle.accepted else None

        assert gripped(math.nan, 0.0) is None and gripped(0.0, -1.0) is None
        ended = gripped(0.04, 0.0)
        assert flags(ended) == (SUCCEEDED, True, False)
        assert ended.result.position == pytest.approx(0.05, abs=0.01)
        feedback.clear()
        ended = gripped(0.0, 6.0)
        assert flags(ended) == (ABORTED, False, True)
        assert ended.result.position == pytest.approx(0.02, abs=1e-3)
        assert ended.result.effort == pytest.approx(-6.0, rel=0.01)
        assert len(feedback) > 10 and not any(each.stalled for each in feedback[:-1])
        assert feedback[-1].position == pytest.approx(0.02, abs=1e-3)


@pytest.mark.parametrize(
    "interfaces",
    [["position"], ["position", "velocity", "acceleration"]],
)
def test_the_state_has_the_arrays_of_its_interfaces(interfaces: list[str], tmp_path: Path) -> None:
    """As in ros2_controllers' state_topic_consistency, and so has the action's feedback."""
    listed = f"joints: [shoulder]\n    state_interfaces: [{', '.join(interfaces)}]"
    with started(tmp_path, control=CONTROL.replace("joints: [shoulder]", listed)) as robot:
        robot.client.watch()
        robot.ros.add()
        ending = robot.ending(robot.send(goal(point(0.5, 0.1), joints=["shoulder"])))
        assert ending == SUCCESS
        states, feedback = robot.client.states, robot.client.feedback
    measured = [1 if name in interfaces else 0 for name in ("position", "velocity", "acceleration")]
    pairs = [(state.feedback, state.error) for state in states]
    pairs += [(each.actual, each.error) for each in feedback]
    for actual, error in pairs:
        for each in (actual, error):
            fields = each.positions, each.velocities, each.accelerations
            assert [*map(len, fields)] == measured and not each.effort
        assert not any([*error.velocities, *error.accelerations])
    for state in states:
        each = state.reference
        assert [*map(len, (each.positions, each.velocities, each.accelerations))] == [1, 1, 1]
        assert len(state.output.positions) == 1
        assert not [*state.output.velocities, *state.output.accelerations, *state.output.effort]
    if "acceleration" in interfaces:
        for before, state in zip(states, states[1:], strict=False):
            change = state.feedback.velocities[0] - before.feedback.velocities[0]
            assert state.feedback.accelerations[0] == pytest.approx(change / 0.01, abs=1e-9)
        assert max(state.feedback.accelerations[0] for state in states) > 0.5


# The gripper ------------------------------------------------------------------------------------


def test_a_gripper_closes_on_nothing(robot: Stepped) -> None:
    """At its motor's limit; feedback and result have the state, and it goes on to the goal."""
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
    assert robot.state("finger").position == pytest.approx(0.0, abs=1e-6)


# Forwarded positions ----------------------------------------------------------------------------


def test_a_locked_head_stays_where_it_is(robot: Stepped, capfd: pytest.CaptureFixture[str]) -> None:
    """It ignores commands, as test_forwarding.py's wrong ones, and unlocked it does not move on."""
    robot.command(1.0, 1.0, seconds=0.3)
    robot.set_lock(True)
    held = robot.head
    assert held == pytest.approx((0.15, 0.15), abs=0.02)
    robot.command(-1.0, -1.0)
    [(severity, text)] = logged(capfd, "head_controller")
    assert severity == "ERROR"
    assert text.startswith("~/commands is ignored: the robot is locked until false is published")
    robot.set_lock(False)
    robot.simulation.run(0.3)
    assert robot.head == pytest.approx(held, abs=1e-6)
    robot.command(0.0, 0.0, seconds=0.5)
    assert robot.head == pytest.approx((0.0, 0.0), abs=1e-6)


def test_the_node_has_the_controllers_of_its_file(peer: Peer, tmp_path: Path) -> None:
    """In real time; what the command line has overrides the defaults."""
    robot, control = tmp_path / "arm.urdf", tmp_path / "control.yaml"
    robot.write_text(ROBOT.urdf)
    control.write_text(CONTROL)
    arguments = ["--params-file", str(control), "-p", "gripper_controller:goal_tolerance:=0.02"]
    with NodeProcess(MODULE, str(robot), "--ros-args", *arguments) as process:
        states = peer.hear(JointState, "joint_states")
        commands = peer.publisher(Float64MultiArray, "head_controller/commands")
        gripper = ActionClient(peer.node, ParallelGripperCommand, "gripper_controller/gripper_cmd")
        assert gripper.wait_for_server(20.0)
        request = ParallelGripperCommand.Goal(command=JointState(position=[0.0]))
        send = partial(gripper.send_goal_async, request)
        handle = answered(peer, send, "the goal to be answered")
        assert handle.accepted
        ended = answered(peer, handle.get_result_async, "the goal to end")
        assert flags(ended) == (SUCCEEDED, True, False)
        assert 0.018 <= ended.result.state.position[0] < 0.02

        def arrived() -> bool:
            # Best effort: what is published before the node has discovered the publisher is lost.
            commands.publish(Float64MultiArray(data=[0.2, -0.2]))
            positions = dict(zip(states[-1].name, states[-1].position, strict=True))
            return positions == pytest.approx(at_rest, abs=1e-6)

        at_rest = {"shoulder": 0.0, "pan": -0.2, "tilt": 0.2, "finger": 0.0}
        wait_for(arrived, "the joints to arrive")
        assert process.interrupt() == 0
