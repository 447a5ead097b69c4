"""What a client that has the genuine control_msgs sees of joint_trajectory_controller.

``test_genuine_client.py`` has pytest run this file in a process whose control_msgs is the one that
``genuine_control_msgs.py`` built; the robot of test_other_controllers.py runs in another process,
which lacks it. Time is simulated: whatever is computed from stamps is exact on any machine.
"""

import math
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
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectoryPoint

from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.ros.wire.messages import time_message
from tests.onebot_control.arm_support import (
    ABORTED,
    CANCELED,
    MANAGER,
    SUCCEEDED,
    SUCCESS,
    Ending,
    WireArm,
    duration,
    ending,
    goal,
    point,
    trajectory,
)
from tests.onebot_control.test_other_controllers import answered, flags
from tests.onebot_description.test_interfaces import OWN, described
from tests.ros_support import LATCHED, Peer
from tests.support import wait_for

FollowJointTrajectory = control_msgs.action.FollowJointTrajectory
ParallelGripperCommand = control_msgs.action.ParallelGripperCommand
JointTolerance = control_msgs.msg.JointTolerance
ControllerState = control_msgs.msg.JointTrajectoryControllerState

CONTROLLER, JOINTS = "/arm_controller", ["shoulder"]  # 0.5 rad/s, within 2 rad
END = 0.4  # rad of the usual goal
LONG, FAR = 1000.0, 1.9  # s and rad of a goal that no test waits for


class Arm(WireArm):
    """The robot's arm, what it publishes, and its gripper."""

    def __init__(self, peer: Peer) -> None:
        super().__init__(peer, CONTROLLER)
        self.peer = peer
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


def straight(time: float, to: float, **fields: Any) -> Any:
    """A goal: an even motion."""
    return goal(point(time, to, velocities=[]), joints=JOINTS, **fields)


def tolerance(position: float) -> Any:
    """A tolerance of the joint, rad."""
    return JointTolerance(name="shoulder", position=position)


def cubic(time: float, duration: float, end: float) -> tuple[float, float, float]:
    """Position, velocity and acceleration ``time`` after the begin of a cubic from 0 rad."""
    s = time / duration
    return (
        end * (3.0 * s**2 - 2.0 * s**3),
        end * (6.0 * s - 6.0 * s**2) / duration,
        end * (6.0 - 12.0 * s) / duration**2,
    )


def seconds(passed: Any) -> float:
    """A duration in s."""
    return nanoseconds(passed) * 1e-9


def values(point: Any) -> tuple[float, float, float]:
    """Position, velocity and acceleration of a point of one joint."""
    [position], [velocity], [acceleration] = point.positions, point.velocities, point.accelerations
    return position, velocity, acceleration


# Types ------------------------------------------------------------------------------------------


def test_the_types_are_the_generated_ones(arm: Arm) -> None:
    """Those of this file and of arm_support.py, and none of them is made of a definition."""
    folder = Path(os.environ["GENUINE_CONTROL_MSGS"])
    assert Path(control_msgs.__file__).is_relative_to(folder)
    names = [name for name in OWN if name.startswith("control_msgs/")]
    assert len(names) > 5
    for name in names:
        _, kind, short = name.split("/")
        assert load_interface(name) is getattr(getattr(control_msgs, kind), short)
    library = "libcontrol_msgs__rosidl_typesupport_fastrtps_c.so"
    assert str(folder / "lib" / library) in Path("/proc/self/maps").read_text()


def test_the_hashes_on_the_wire_are_those_of_the_generated_types(arm: Arm) -> None:
    """The node announces them with its publishers and subscriptions."""
    node, action = arm.peer.node, f"{CONTROLLER}/follow_joint_trajectory"
    for ends, topic, kind in (
        (node.get_publishers_info_by_topic, f"{CONTROLLER}/controller_state", ControllerState),
        (
            node.get_publishers_info_by_topic,
            f"{action}/_action/feedback",
            FollowJointTrajectory.Impl.FeedbackMessage,
        ),
        (
            node.get_subscriptions_info_by_topic,
            f"{CONTROLLER}/speed_scaling_input",
            control_msgs.msg.SpeedScalingFactor,
        ),
    ):
        [end] = [end for end in ends(topic) if end.node_name != node.get_name()]
        assert str(end.topic_type_hash) == f"RIHS01_{described(kind)['hash']}"


# The arm ----------------------------------------------------------------------------------------


def test_a_goal_succeeds_with_feedback_and_states(arm: Arm) -> None:
    """With every field that the node fills; it reads every field of the goal."""
    component = control_msgs.msg.JointComponentTolerance(joint_name="shoulder", component=3)
    request = turning(
        2.0,
        path_tolerance=[tolerance(0.01)],
        goal_tolerance=[tolerance(0.001)],
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
        check_points(each, each.desired, each.actual)
        check_others(each, each.multi_dof_desired, each.multi_dof_actual)
    for state in states:
        check_points(state, state.reference, state.feedback)
        check_others(state, state.multi_dof_reference, state.multi_dof_feedback)
        following = cubic(min(2.0, seconds(state.reference.time_from_start) + 0.01), 2.0, END)
        assert state.output.positions[0] == pytest.approx(following[0], abs=1e-8)
        assert state.multi_dof_output == MultiDOFJointTrajectoryPoint()
        assert state.speed_scaling_factor == 1.0


def check_points(message: Any, desired: Any, actual: Any) -> None:
    """The desired motion is the goal's, the joint's is close to it, and the error is right."""
    time = seconds(desired.time_from_start)
    assert values(desired) == pytest.approx(cubic(time, 2.0, END), abs=1e-8)
    assert seconds(actual.time_from_start) == pytest.approx(time, abs=1e-6)
    [position], [velocity] = actual.positions, actual.velocities
    assert (position, velocity) == pytest.approx(values(desired)[:2], abs=0.02)
    [error] = message.error.positions
    assert error == pytest.approx(desired.positions[0] - position, abs=1e-12)


def check_others(message: Any, *points: Any) -> None:
    """The names are the arm's, and what is of joints with several axes is empty."""
    assert list(message.joint_names) == JOINTS
    assert list(message.multi_dof_joint_names) == []
    for each in (*points, message.multi_dof_error):
        assert each == MultiDOFJointTrajectoryPoint()


@pytest.mark.parametrize(
    "request_",
    [
        goal(point(1.0, END), joints=["elbow"]),
        goal(point(1.0, math.nan), joints=JOINTS),
        goal(point(1.0, END, velocities=[math.inf]), joints=JOINTS),
        goal(point(1.0, 2.1), joints=JOINTS),
        goal(joints=JOINTS),
    ],
    ids=["unknown joint", "NaN", "infinite velocity", "beyond the limit", "no point"],
)
def test_a_goal_is_rejected(arm: Arm, request_: Any) -> None:
    assert not arm.ask(request_).accepted


def test_a_cancelled_goal_holds(arm: Arm) -> None:
    handle = arm.ask(straight(LONG, FAR))
    assert handle.accepted
    result = handle.get_result_async()
    wait_for(lambda: arm.position > 0.001, "the start")
    cancelled = handle.cancel_goal_async()
    answer = wait_for(lambda: cancelled.done() and cancelled.result(), "the answer to cancelling")
    assert answer.return_code == answer.ERROR_NONE
    assert [each.goal_id for each in answer.goals_canceling] == [handle.goal_id]
    assert ending(result) == (CANCELED, 0, "")
    held = arm.position
    count = len(arm.joints)
    wait_for(lambda: len(arm.joints) > count + 100, "joint states of a second")
    assert arm.position == pytest.approx(held, abs=1e-6)  # in that second it moved 0.0019 rad


@pytest.mark.parametrize(
    ("fields", "code", "text"),
    [
        (
            {"path_tolerance": [tolerance(0.05)]},
            FollowJointTrajectory.Result.PATH_TOLERANCE_VIOLATED,
            "Aborted due to path tolerance violation",
        ),
        (
            {"goal_tolerance": [tolerance(0.01)], "goal_time_tolerance": duration(0.1)},
            FollowJointTrajectory.Result.GOAL_TOLERANCE_VIOLATED,
            "Aborted due to goal_time_tolerance exceeding by ",
        ),
        ({"goal_tolerance": [tolerance(0.01)]}, FollowJointTrajectory.Result.SUCCESSFUL, "Goal "),
    ],
    ids=["path", "goal", "in time"],
)
def test_a_goal_beyond_its_tolerance_is_aborted(
    arm: Arm, fields: dict[str, Any], code: int, text: str
) -> None:
    """Twice as fast as the motor: 0.1 rad behind at the end, and 0.05 rad a tenth second later."""
    ended = ending(arm.send(straight(0.2, 0.2, **fields)))
    assert (ended.status, ended.code) == (ABORTED if code else SUCCEEDED, code)
    assert ended.text.startswith(text)


def test_a_goal_is_aborted_by_the_next(arm: Arm) -> None:
    first = arm.send(straight(LONG, FAR))
    second = arm.send(turning(1.0))
    text = "Current goal preempted by new incoming action."
    assert ending(first) == Ending(ABORTED, FollowJointTrajectory.Result.INVALID_GOAL, text)
    assert ending(second) == SUCCESS


def test_the_state_at_other_times_is_the_splines(arm: Arm) -> None:
    arm.send(turning(LONG, FAR))
    state = wait_for(lambda: arm.states[-1].reference.velocities[0] and arm.states[-1], "a motion")
    begin = nanoseconds(state.header.stamp) - nanoseconds(state.reference.time_from_start)
    for time in (0.1, LONG / 3.0, LONG - 0.1):
        answer = arm.query(begin + round(time * 1e9))
        assert (answer.success, answer.message, list(answer.name)) == (True, "", JOINTS)
        [position], [velocity], [acceleration] = (
            answer.position,
            answer.velocity,
            answer.acceleration,
        )
        expected = cubic(time, LONG, FAR)
        assert (position, velocity, acceleration) == pytest.approx(expected, abs=1e-9)
    late = arm.query(begin + round((LONG + 0.1) * 1e9))
    assert not late.success and "later than the current trajectory end time" in late.message
    assert list(late.name) == list(late.position) == []


def test_a_trajectory_of_the_topic_is_followed(arm: Arm) -> None:
    topic = arm.peer.publisher(JointTrajectory, f"{CONTROLLER}/joint_trajectory")

    def moving() -> bool:
        # Best effort: what is published before the node has discovered the publisher is lost.
        topic.publish(trajectory(point(1.0, END), joints=JOINTS))
        return bool(arm.states[-1].reference.velocities[0])

    wait_for(moving, "the start")
    wait_for(lambda: arm.position == pytest.approx(END, abs=1e-6), "the end")
    assert not arm.feedback
    arm.peer.destroy(arm.peer.node.destroy_publisher, topic)


def test_the_speed_is_scaled(arm: Arm) -> None:
    """A trajectory of 1 s takes two; the factor is latched."""
    topic, kind = f"{CONTROLLER}/speed_scaling_input", control_msgs.msg.SpeedScalingFactor
    factor = arm.peer.publisher(kind, topic, LATCHED)

    def scale(by: float) -> None:
        factor.publish(kind(factor=by))
        wait_for(lambda: arm.states[-1].speed_scaling_factor == by, f"the factor {by:g}")

    scale(0.5)
    assert ending(arm.send(turning(1.0))) == SUCCESS
    scale(1.0)
    last = arm.feedback[-1]
    desired, actual = seconds(last.desired.time_from_start), seconds(last.actual.time_from_start)
    assert actual == pytest.approx(2.0 * desired, abs=1e-6)
    arm.peer.destroy(arm.peer.node.destroy_publisher, factor)


# The gripper ------------------------------------------------------------------------------------


def test_the_gripper_closes(arm: Arm) -> None:
    """The result has the state of its joint, and so has the feedback; two positions are no goal."""
    feedback: list[Any] = []

    def grip(*positions: float) -> Any:
        request = ParallelGripperCommand.Goal(command=JointState(position=positions))
        return answered(
            lambda: arm.gripper.send_goal_async(
                request, lambda each: feedback.append(each.feedback.state)
            ),
            "the goal to be answered",
        )

    assert not grip(0.01, 0.02).accepted
    handle = grip(0.0)
    assert handle.accepted
    ended = answered(handle.get_result_async, "the goal to end")
    assert flags(ended) == (SUCCEEDED, True, False)
    assert feedback
    for state in (*feedback, ended.result.state):
        assert list(state.name) == ["finger"]
        assert -1e-6 <= state.position[0] <= 0.05
        assert len(state.velocity) == len(state.effort) == 1
    assert ended.result.state.position[0] < 0.01
