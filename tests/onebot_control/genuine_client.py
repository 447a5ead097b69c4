"""What a client that has the genuine control_msgs sees of joint_trajectory_controller.

``test_genuine_client.py`` has pytest run this file in a process whose control_msgs is the one that
``genuine_control_msgs.py`` built; the robot of arm_support.py runs in another process,
which lacks it. Time is simulated: whatever is computed from stamps is exact on any machine.
"""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import control_msgs
import control_msgs.action
import control_msgs.msg
import control_msgs.srv
import pytest
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectoryPoint

from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.ros.wire.messages import time_message
from tests.onebot_control.arm_support import (
    MANAGER,
    SUCCEEDED,
    SUCCESS,
    WireArm,
    answered,
    duration,
    ending,
    flags,
    goal,
    point,
)
from tests.onebot_description.test_interfaces import HASHES
from tests.ros_support import Peer
from tests.support import wait_for

FollowJointTrajectory = control_msgs.action.FollowJointTrajectory
ParallelGripperCommand = control_msgs.action.ParallelGripperCommand
GripperCommand = control_msgs.action.GripperCommand
JointTolerance = control_msgs.msg.JointTolerance
ControllerState = control_msgs.msg.JointTrajectoryControllerState

CONTROLLER, JOINTS = "/arm_controller", ["shoulder"]  # 0.5 rad/s, within 2 rad
END = 0.4  # rad of the usual goal
LONG, FAR = 1000.0, 1.9  # s and rad of a goal that no test waits for


class Arm(WireArm):
    """The robot's arm, what it publishes, and its gripper."""

    def __init__(self, peer: Peer) -> None:
        super().__init__(peer, CONTROLLER)
        self.states = peer.hear(ControllerState, f"{CONTROLLER}/controller_state")
        self.joints = peer.hear(JointState, "/joint_states")
        self.gripper = ActionClient(
            peer.node, ParallelGripperCommand, "/gripper_controller/gripper_cmd"
        )
        wait_for(self.gripper.server_is_ready, "the gripper")

    @property
    def position(self) -> float:
        """Where the joint was last, rad."""
        state = self.joints[-1]
        return float(state.position[list(state.name).index("shoulder")])

    def reset(self) -> None:
        """Put all joints back, and forget what was before."""
        assert self.peer.call(Trigger, f"{MANAGER}/reset").success
        wait_for(lambda: self.position == 0.0, "the start")
        for heard in (self.states, self.joints, self.feedback):
            heard.clear()

    def before_again(self) -> None:
        self.reset()

    def query(self, stamp: int) -> Any:
        """The answer of ~/query_state about a time, ns."""
        kind, name = control_msgs.srv.QueryTrajectoryState, f"{CONTROLLER}/query_state"
        return self.peer.call(kind, name, time=time_message(stamp))


@pytest.fixture(scope="module")
def peer() -> Iterator[Peer]:
    """A node in the robot's domain."""
    with Peer(int(os.environ["ROS_DOMAIN_ID"])) as peer:
        yield peer


@pytest.fixture(scope="module")
def whole_arm(peer: Peer) -> Arm:
    """The client."""
    return Arm(peer)


@pytest.fixture
def arm(whole_arm: Arm) -> Arm:
    """The client, whose arm is at 0 rad and moves to nowhere."""
    whole_arm.reset()
    return whole_arm


def turning(time: float, to: float = END, **fields: Any) -> Any:
    """A goal: a cubic from rest to rest, if the arm is at rest."""
    return goal(point(time, to), joints=JOINTS, **fields)


# Types ------------------------------------------------------------------------------------------


def test_the_types_are_the_generated_ones(arm: Arm) -> None:
    """Those of this file and of arm_support.py, and none of them is made of a definition."""
    folder = Path(os.environ["GENUINE_CONTROL_MSGS"])
    assert Path(control_msgs.__file__).is_relative_to(folder)
    names = [name for name in HASHES if name.startswith("control_msgs/")]
    assert len(names) > 5
    for name in names:
        _, kind, short = name.split("/")
        assert load_interface(name) is getattr(getattr(control_msgs, kind), short)
    library = "libcontrol_msgs__rosidl_typesupport_fastrtps_c.so"
    assert str(folder / "lib" / library) in Path("/proc/self/maps").read_text()


# The arm ----------------------------------------------------------------------------------------


def test_a_goal_succeeds_with_feedback_and_states(arm: Arm) -> None:
    """With every field that the node fills; it reads every field of the goal."""
    component = control_msgs.msg.JointComponentTolerance(joint_name="shoulder", component=3)
    request = turning(
        2.0,
        path_tolerance=[JointTolerance(name="shoulder", position=0.01)],
        goal_tolerance=[JointTolerance(name="shoulder", position=0.001)],
        component_path_tolerance=[component],
        component_goal_tolerance=[component, component],
        goal_time_tolerance=duration(1.5),
    )
    request.multi_dof_trajectory.joint_names = ["ignored"]
    assert ending(arm.send(request)) == SUCCESS
    wait_for(lambda: arm.position == pytest.approx(END, abs=1e-6), "the end position")
    feedback = [each for each in arm.feedback if each.desired.velocities[0]]
    states = [state for state in arm.states if state.reference.velocities[0]]
    for heard in (feedback, states):
        assert len(heard) > 5
        stamps = [nanoseconds(each.header.stamp) for each in heard]
        assert stamps == sorted(stamps) and 0 < stamps[0] < stamps[-1]
    for each in feedback:
        check_motion(each, each.desired, each.actual)
        others = each.multi_dof_desired, each.multi_dof_actual, each.multi_dof_error
        assert others == (MultiDOFJointTrajectoryPoint(),) * 3
    for state in states:
        check_motion(state, state.reference, state.feedback)
        assert state.output.positions[0] == pytest.approx(state.reference.positions[0], abs=0.01)
        assert state.multi_dof_output == MultiDOFJointTrajectoryPoint()
        assert state.speed_scaling_factor == 1.0


def check_motion(message: Any, desired: Any, actual: Any) -> None:
    """The desired motion is the goal's cubic, and the error is that of the joint's position."""
    time = nanoseconds(desired.time_from_start) * 1e-9 / 2.0
    assert desired.positions[0] == pytest.approx(END * (3.0 - 2.0 * time) * time**2, abs=1e-8)
    assert nanoseconds(actual.time_from_start) * 1e-9 / 2.0 == pytest.approx(time, abs=1e-6)
    [error] = message.error.positions
    assert error == pytest.approx(desired.positions[0] - actual.positions[0], abs=1e-12)
    assert abs(error) < 0.02
    assert (list(message.joint_names), list(message.multi_dof_joint_names)) == (JOINTS, [])


def test_the_state_at_other_times_is_the_splines(arm: Arm) -> None:
    arm.send(turning(LONG, FAR))
    state = wait_for(lambda: arm.states[-1].reference.velocities[0] and arm.states[-1], "a motion")
    begin = nanoseconds(state.header.stamp) - nanoseconds(state.reference.time_from_start)
    answer = arm.query(begin + round(LONG / 2.0 * 1e9))
    assert (answer.success, answer.message, list(answer.name)) == (True, "", JOINTS)
    motion = [*answer.position, *answer.velocity, *answer.acceleration]
    assert motion == pytest.approx([FAR / 2.0, 1.5 * FAR / LONG, 0.0], abs=1e-9)
    late = arm.query(begin + round((LONG + 0.1) * 1e9))
    assert not late.success and "later than the current trajectory end time" in late.message
    assert list(late.name) == list(late.position) == []


# The gripper ------------------------------------------------------------------------------------


def test_the_gripper_closes(arm: Arm) -> None:
    """The result has the state of its joint, and so has the feedback; two positions are no goal."""
    feedback: list[Any] = []

    def grip(*positions: float) -> Any:
        request = ParallelGripperCommand.Goal(command=JointState(position=positions))
        return answered(
            arm.peer,
            lambda: arm.gripper.send_goal_async(
                request, lambda each: feedback.append(each.feedback.state)
            ),
            "the goal to be answered",
        )

    assert not grip(0.01, 0.02).accepted
    handle = grip(0.0)
    assert handle.accepted
    ended = answered(arm.peer, handle.get_result_async, "the goal to end")
    assert flags(ended) == (SUCCEEDED, True, False)
    assert feedback
    for state in (*feedback, ended.result.state):
        assert list(state.name) == ["finger"]
        assert -1e-6 <= state.position[0] <= 0.05
        assert len(state.velocity) == len(state.effort) == 1
    assert ended.result.state.position[0] < 0.01


def test_a_gripper_of_the_older_kind_moves(arm: Arm) -> None:
    """Its messages have one position and one effort; an impossible effort is refused."""
    client = ActionClient(arm.peer.node, GripperCommand, "/older_gripper/gripper_cmd")
    wait_for(client.server_is_ready, "the gripper")
    feedback: list[Any] = []

    def grip(effort: float) -> Any:
        goal = GripperCommand.Goal()
        goal.command.position, goal.command.max_effort = 0.3, effort
        return answered(
            arm.peer,
            lambda: client.send_goal_async(goal, lambda each: feedback.append(each.feedback)),
            "the goal to be answered",
        )

    assert not grip(-1.0).accepted
    handle = grip(15.0)
    assert handle.accepted
    ended = answered(arm.peer, handle.get_result_async, "the goal to end")
    assert flags(ended) == (SUCCEEDED, True, False)
    assert ended.result.position == pytest.approx(0.3, abs=0.01)
    for state in (*feedback, ended.result):
        assert -1e-6 <= state.position <= 0.3 and abs(state.effort) <= 20.0
