"""joint_trajectory_controller's topics, action and services, in step with a simulation."""

import faulthandler
import math
import random
import resource
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from geometry_msgs.msg import Twist
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from trajectory_msgs.msg import JointTrajectory

from onebot_control import Simulation
from onebot_control.nodes.lockstep import Lockstep
from onebot_description.description import parse_description
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import load_interface
from tests.onebot_control.arm_support import (
    ABORTED,
    CANCELED,
    CONTROLLER,
    JOINT,
    MRM,
    SUCCEEDED,
    SUCCESS,
    UNKNOWN,
    ArmClient,
    Ending,
    FollowJointTrajectory,
    JointTolerance,
    SteppedArm,
    duration,
    goal,
    point,
    seconds,
    trajectory,
)
from tests.onebot_control.control_support import CASTER, SEPARATION, urdf, wheel
from tests.support import PATIENCE

PREEMPTED = Ending(ABORTED, -1, "Current goal preempted by new incoming action.")
NAN = math.nan
LONG_AGO = 1_000_000_000  # ns; simulated time is beyond the end of what began then
DAMAGED = 300  # messages; a slow test has ten times as many

ARM = """
  <link name="arm">
    <inertial><origin xyz="0.05 0 0"/><mass value="0.2"/>
      <inertia ixx="0.0002" iyy="0.0004" izz="0.0004" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="arm_joint" type="revolute">
    <parent link="base_link"/><child link="arm"/><origin xyz="0 0 0.1"/><axis xyz="0 0 1"/>
    <limit effort="5" velocity="2" lower="-2" upper="2"/>
  </joint>"""
# A bar of 1 kg that is lifted from where it hangs: 4.905 Nm hold it level, its motor has 3 Nm.
WEAK = """<robot name="weak">
  <link name="world"/>
  <link name="bar">
    <inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
      <inertia ixx="0.02" iyy="0.02" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="hinge" type="revolute">
    <parent link="world"/><child link="bar"/><origin xyz="0 0 2"/><axis xyz="0 1 0"/>
    <limit effort="3" velocity="2" lower="-3" upper="3"/>
  </joint>
</robot>"""


@pytest.fixture
def arm(ros_simulation: Callable[..., Lockstep[Simulation]]) -> SteppedArm:
    """MRM and its client."""
    return SteppedArm(ros_simulation(MRM))


@pytest.fixture
def watched_arm(ros_simulation: Callable[..., Lockstep[Simulation]]) -> SteppedArm:
    """The same, whose client keeps the controller's states."""
    ros = ros_simulation(MRM)
    return SteppedArm(ros, ArmClient(states=True))


def turned(to: float = 0.3) -> Any:
    """A goal that MRM reaches in time, in 1 s and at 0.45 rad/s at most."""
    return goal(point(1.0, to))


def begun(arm: SteppedArm) -> float:
    """When the trajectory began, s: the first cycle with an acceleration."""
    return seconds(next(each for each in arm.client.states if each.reference.accelerations[0]))


# Endings ----------------------------------------------------------------------------------------


def test_a_goal_succeeds_with_feedback(watched_arm: SteppedArm) -> None:
    """The cubic from rest to rest, 20 times a second: desired, actual, and the error between."""
    arm = watched_arm
    handle = arm.send(turned())
    start = arm.simulation.time
    assert arm.ending(handle) == SUCCESS
    assert arm.simulation.time - start == pytest.approx(1.0, abs=0.06)
    assert arm.position == pytest.approx(0.3, abs=1e-9)
    feedback, begin = arm.client.feedback, begun(arm)
    assert len(feedback) == pytest.approx(20, abs=1)
    for each in feedback:
        t = seconds(each) - begin
        assert each.joint_names == [JOINT]
        assert each.desired.positions[0] == pytest.approx(0.9 * t**2 - 0.6 * t**3, abs=1e-9)
        assert each.desired.velocities[0] == pytest.approx(1.8 * t * (1.0 - t), abs=1e-9)
        error = each.desired.positions[0] - each.actual.positions[0]
        assert each.error.positions[0] == pytest.approx(error, abs=1e-12)
        assert abs(error) < 1e-9
    assert [seconds(b) - seconds(a) for a, b in zip(feedback, feedback[1:], strict=False)] == (
        pytest.approx([0.05] * (len(feedback) - 1), abs=1e-6)
    )


def test_goals_are_refused_with_the_reason(
    arm: SteppedArm, capfd: pytest.CaptureFixture[str]
) -> None:
    """Nothing moves, and the log says why."""
    level = point(1.0, 0.0)
    refused = {
        "points[0].positions: base_link__link_01: 3.2 is above the joint's limit 3.14": goal(
            point(1.0, 3.2)
        ),
        "points[0].positions: base_link__link_01: nan is not finite": goal(point(1.0, NAN)),
        "points[0].velocities: base_link__link_01: nan is not finite": goal(
            point(1.0, 0.0, velocities=[NAN]), point(2.0, 0.0)
        ),
        "points[0].accelerations: base_link__link_01: inf is not finite": goal(
            point(1.0, 0.0, accelerations=[math.inf])
        ),
        'joint_names: "elbow" is no joint of the controller (known: base_link__link_01)': goal(
            point(1.0, 0.0), joints=["elbow"]
        ),
        'joint_names: "base_link__link_01" is there twice': goal(
            point(1.0, 0.0, 0.0), joints=[JOINT, JOINT]
        ),
        "joint_names is empty": goal(point(1.0), joints=[]),
        "points is empty; cancel a goal to stop it, or send a position to hold": goal(),
        "points[0].positions: 2 given, for 1 joints": goal(point(1.0, 0.0, 0.0, velocities=[])),
        "points[1].time_from_start: 1 s is not after the 1 s of points[0]": goal(level, level),
        "points[0].time_from_start: -1 s is negative": goal(point(-1.0, 0.0)),
        "effort is given, but only positions are commanded": goal(point(1.0, 0.0, effort=[1.0])),
        "points[0].velocities: base_link__link_01: 0.1 is not 0 at the end, and "
        "allow_nonzero_velocity_at_trajectory_end is false": goal(
            point(1.0, 0.0, velocities=[0.1])
        ),
    }
    arm.simulation.run(3.0)
    past = goal(level)
    past.trajectory = trajectory(level, stamp=LONG_AGO)
    refused["header.stamp: the trajectory ended 1."] = past
    for text, request in refused.items():
        arm.refuse(request)
        assert f"goal rejected: {text}" in capfd.readouterr().err
    arm.simulation.run(0.5)
    assert arm.position == 0.0 and not arm.simulation.robot.moving


def test_many_reasons_are_counted(arm: SteppedArm, capfd: pytest.CaptureFixture[str]) -> None:
    """A line for each of the first five, and the number of the others."""
    arm.refuse(goal(*(point(1.0, NAN) for _ in range(4))))
    [line, *others] = capfd.readouterr().err.splitlines()
    assert line.endswith(
        "goal rejected: points[0].positions: base_link__link_01: nan is not finite"
    )
    assert others[-1] == "and 2 more" and len(others) == 5


def test_a_cancelled_goal_holds_where_the_joint_is(arm: SteppedArm) -> None:
    handle = arm.send(turned())
    arm.simulation.run(0.5)
    assert arm.cancel(handle) == 1
    assert arm.ending(handle) == (CANCELED, 0, "")
    arm.simulation.run(0.1)
    held = arm.position
    assert 0.1 < held < 0.2
    arm.simulation.run(0.5)
    assert arm.position == pytest.approx(held, abs=1e-9)
    assert arm.cancel(handle) == 0  # it has ended
    assert arm.ending(arm.send(turned())) == SUCCESS


def test_all_goals_are_cancelled_at_once(arm: SteppedArm) -> None:
    """Also if one of them was preempted just then, and waits to be sent that."""
    first, second = arm.send(turned()), arm.send(turned(-0.3))
    cancel = load_interface("action_msgs/srv/CancelGoal")
    arm.call(cancel, f"{CONTROLLER}/follow_joint_trajectory/_action/cancel_goal")
    assert arm.ending(first) == PREEMPTED
    assert arm.ending(second) == (CANCELED, 0, "")
    arm.simulation.run(0.1)
    assert not arm.simulation.robot.moving


def test_a_goal_that_is_too_fast_is_aborted(
    arm: SteppedArm, capfd: pytest.CaptureFixture[str]
) -> None:
    """0.5 rad/s do not follow 1 rad/s: the error is above its tolerance, the joint is held."""
    tolerance = [JointTolerance(name=JOINT, position=0.05)]
    handle = arm.send(goal(point(0.3, 0.3, velocities=[]), path_tolerance=tolerance))
    assert arm.ending(handle) == (ABORTED, -4, "Aborted due to path tolerance violation")
    log = capfd.readouterr().err
    assert "path tolerance violation: base_link__link_01: position error 0.05" in log
    last = arm.client.feedback[-1]
    error = last.desired.positions[0] - last.actual.positions[0]
    assert last.error.positions[0] == pytest.approx(error, abs=1e-12) and error > 0.01
    assert last.desired.velocities[0] == pytest.approx(1.0)
    assert last.actual.velocities[0] == pytest.approx(0.5, abs=1e-3)
    arm.simulation.run(0.1)
    held = arm.position
    assert held == pytest.approx(0.05, abs=0.02)
    arm.simulation.run(0.5)
    assert arm.position == pytest.approx(held, abs=1e-9)


def test_a_goal_that_is_late_is_aborted(arm: SteppedArm) -> None:
    """0.3 rad takes 0.6 s; 0.2 s after its end, at 0.1 s, the goal is still out of tolerance."""
    tolerance = [JointTolerance(name=JOINT, position=0.01)]
    tolerances = {"goal_tolerance": tolerance, "goal_time_tolerance": duration(0.2)}
    start = arm.simulation.time
    late = arm.ending(arm.send(goal(point(0.1, 0.3), **tolerances)))
    assert late[:2] == (ABORTED, -5)
    assert late.text.startswith("Aborted due to goal_time_tolerance exceeding by 0.2")
    assert arm.simulation.time - start == pytest.approx(0.3, abs=0.1)
    assert 0.1 < arm.position < 0.2
    # With time enough it succeeds.
    tolerances["goal_time_tolerance"] = duration(2.0)
    assert arm.ending(arm.send(goal(point(0.1, 0.3), **tolerances))) == SUCCESS


def test_a_motor_that_is_too_weak_is_noticed(
    ros_simulation: Callable[..., Lockstep[Simulation]],
) -> None:
    """It cannot lift its bar: the effort is at its limit, and the goal is aborted."""
    arm = SteppedArm(ros_simulation(parse_description(WEAK)))
    tolerance = [JointTolerance(name="hinge", position=0.2)]
    handle = arm.send(goal(point(4.0, -1.5), joints=["hinge"], path_tolerance=tolerance))
    greatest = 0.0

    def failed() -> bool:
        nonlocal greatest
        greatest = max(greatest, abs(arm.simulation.robot.joints["hinge"].effort))
        return result.done()

    result = handle.get_result_async()
    arm.simulation.run(until=failed, timeout=10.0)
    assert result.result().result.error_code == -4
    assert greatest == pytest.approx(3.0, rel=1e-6)


def test_another_goal_preempts_the_first(arm: SteppedArm) -> None:
    first = arm.send(turned())
    arm.simulation.run(0.5)
    second = arm.send(turned(-0.1))
    assert arm.ending(first) == PREEMPTED
    assert arm.ending(second) == SUCCESS
    assert arm.position == pytest.approx(-0.1, abs=1e-9)


def test_tolerances_that_are_wrong_are_reported(
    arm: SteppedArm, capfd: pytest.CaptureFixture[str]
) -> None:
    """The goal is followed with the default ones, as joint_trajectory_controller does."""
    wrong = [JointTolerance(name="elbow", position=0.01), JointTolerance(name=JOINT, position=-3.0)]
    assert arm.ending(arm.send(goal(point(0.2, 0.05), path_tolerance=wrong))) == SUCCESS
    log = capfd.readouterr().err
    assert 'path_tolerance: "elbow" is no joint of the controller' in log
    assert "position -3 is neither 0 (the default), nor above 0, nor -1 (none)" in log


def test_results_are_kept_for_ten_seconds(arm: SteppedArm) -> None:
    """Others end after exactly that time: rcl's timer for it must not keep the executor busy."""

    def several() -> list[Any]:
        handles = []
        for _ in range(8):
            handles.append(arm.send(turned()))
            arm.simulation.run(0.04)
        return handles

    faulthandler.dump_traceback_later(PATIENCE, exit=True)
    try:
        start = arm.simulation.time
        first = several()
        assert [arm.ending(each) for each in first] == [PREEMPTED] * 7 + [SUCCESS]
        arm.simulation.run(until=lambda: arm.simulation.time > start + 9.995)
        second = several()
        assert [arm.ending(each) for each in second] == [PREEMPTED] * 7 + [SUCCESS]
        assert {arm.ending(each).status for each in first[:-1]} == {UNKNOWN}
    finally:
        faulthandler.cancel_dump_traceback_later()


def test_a_goal_ends_with_the_nodes(ros_domain: int) -> None:
    """Its motion goes on without ROS; nodes that are put in step again know nothing of it."""
    with Simulation(MRM) as simulation:
        with simulation.ros(ros_domain) as ros:
            SteppedArm(ros).send(turned())
            simulation.run(0.5)
        simulation.run(0.1)
        assert simulation.robot.moving
        with simulation.ros(ros_domain) as ros:
            arm = SteppedArm(ros)
            assert arm.ending(arm.send(turned(-0.1))) == SUCCESS
            assert arm.position == pytest.approx(-0.1, abs=1e-9)


# Topics and services ----------------------------------------------------------------------------


def test_a_trajectory_of_the_topic_replaces_that_of_a_goal(arm: SteppedArm) -> None:
    """The goal stays active, and succeeds at the end of the other trajectory."""
    handle = arm.send(turned())
    arm.simulation.run(0.5)
    arm.client.topic.publish(trajectory(point(1.0, -0.1)))
    result = handle.get_result_async()
    arm.simulation.run(0.9)
    assert not result.done()
    arm.simulation.run(0.3)
    assert result.result().status == SUCCEEDED
    assert arm.position == pytest.approx(-0.1, abs=1e-9)


def test_a_wrong_trajectory_of_the_topic_is_ignored(
    arm: SteppedArm, capfd: pytest.CaptureFixture[str]
) -> None:
    """The motion goes on, and the log does not fill, however often it is sent."""
    arm.client.topic.publish(trajectory(point(1.0, 0.3)))
    for _ in range(100):
        arm.client.topic.publish(trajectory(point(1.0, 5.0)))
        arm.simulation.run(0.01)
    arm.simulation.run(0.1)
    assert arm.position == pytest.approx(0.3, abs=1e-9)
    log = capfd.readouterr().err
    text = "~/joint_trajectory is ignored: points[0].positions: base_link__link_01: 5 is above"
    assert text in log
    assert log.count("is ignored") < 50


def test_the_state_is_published_in_each_cycle(watched_arm: SteppedArm) -> None:
    arm = watched_arm
    arm.simulation.run(0.1)
    states = arm.client.states
    states.clear()
    arm.client.topic.publish(trajectory(point(1.0, 0.3)))
    arm.simulation.run(0.51)
    assert len(states) == 51
    spacing = [seconds(b) - seconds(a) for a, b in zip(states, states[1:], strict=False)]
    assert spacing == pytest.approx([0.01] * 50, abs=1e-6)
    for state, following in zip(states, states[1:], strict=False):
        assert state.joint_names == [JOINT]
        for field, size in (("positions", 1), ("velocities", 1), ("accelerations", 1)):
            assert len(getattr(state.reference, field)) == size
        assert len(state.feedback.positions) == len(state.feedback.velocities) == 1
        error = state.reference.positions[0] - state.feedback.positions[0]
        assert state.error.positions[0] == pytest.approx(error, abs=1e-12)
        # What is commanded is the reference at the end of the cycle.
        if following.reference.positions[0] > 0.0:
            assert state.output.positions == pytest.approx(following.reference.positions, abs=1e-9)
        assert state.speed_scaling_factor == 1.0
        # The first of these states may be of the position that was held.
        passed = seconds(following) - seconds(states[1])
        for state in (following.reference, following.feedback):
            assert nanoseconds(state.time_from_start) * 1e-9 == pytest.approx(passed, abs=1e-6)
    assert states[-1].reference.velocities[0] == pytest.approx(0.45, abs=1e-3)


def test_the_speed_is_scaled(watched_arm: SteppedArm, capfd: pytest.CaptureFixture[str]) -> None:
    """At half the speed, a trajectory takes twice as long; what is impossible is ignored."""
    arm = watched_arm
    kind, topic = load_interface("control_msgs/msg/SpeedScalingFactor"), "speed_scaling_input"
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    scaling = arm.client.create_publisher(kind, f"{CONTROLLER}/{topic}", latched)
    for factor in (0.5, -0.1, NAN):
        scaling.publish(kind(factor=factor))
    arm.simulation.run(0.1)
    log = capfd.readouterr().err
    assert "~/speed_scaling_input is ignored: a speed scaling of -0.1 is impossible" in log
    handle = arm.send(goal(point(1.0, 0.3)))
    arm.client.states.clear()
    assert arm.ending(handle) == SUCCESS
    state = arm.client.states[-1]
    assert state.speed_scaling_factor == 0.5
    reference, measured = (
        nanoseconds(each.time_from_start) * 1e-9 for each in (state.reference, state.feedback)
    )
    assert reference == pytest.approx(1.0, abs=0.1)
    assert measured == pytest.approx(2.0 * reference, abs=0.011)


def test_the_state_at_other_times_can_be_queried(watched_arm: SteppedArm) -> None:
    arm = watched_arm
    fault = arm.query(round(arm.simulation.time * 1e9))
    assert not fault.success and fault.message == (
        "Currently there is no valid trajectory instance."
    )
    arm.client.topic.publish(trajectory(point(1.0, 0.3)))
    arm.simulation.run(0.1)
    begin = begun(arm)
    half = arm.query(round((begin + 0.5) * 1e9))
    assert half.success and half.name == [JOINT]
    assert (half.position[0], half.velocity[0]) == pytest.approx((0.15, 0.45), abs=1e-9)
    assert half.acceleration[0] == pytest.approx(0.0, abs=1e-9)
    early, late = (arm.query(round((begin + time) * 1e9)) for time in (-0.2, 1.1))
    assert (early.success, late.success) == (False, False)
    assert "earlier than the current trajectory start time" in early.message
    assert "later than the current trajectory end time" in late.message
    assert list(late.position) == []


def test_a_reset_puts_the_joint_back(arm: SteppedArm) -> None:
    handle = arm.send(turned())
    arm.simulation.run(0.5)
    arm.reset()
    assert arm.ending(handle) == (ABORTED, -1, "Current goal cancelled by a reset.")
    arm.simulation.run(0.5)
    assert arm.position == pytest.approx(0.0, abs=1e-12)
    assert arm.ending(arm.send(turned())) == SUCCESS


def test_a_locked_arm_holds(arm: SteppedArm, capfd: pytest.CaptureFixture[str]) -> None:
    """Its goal is aborted, others are refused, and unlocked it stays where it is."""
    handle = arm.send(turned())
    arm.simulation.run(0.5)
    arm.client.lock.publish(Bool(data=True))
    assert arm.ending(handle) == (ABORTED, -1, "Current goal cancelled: the robot is locked.")
    held = arm.position
    assert 0.1 < held < 0.2
    capfd.readouterr()
    arm.refuse(turned())
    assert "goal rejected: the robot is locked until false is published on " in (
        capfd.readouterr().err
    )
    arm.client.topic.publish(trajectory(point(0.5, 0.0)))
    arm.simulation.run(0.5)
    assert arm.position == pytest.approx(held, abs=1e-9)
    arm.client.lock.publish(Bool(data=False))
    arm.simulation.run(0.5)
    assert arm.position == pytest.approx(held, abs=1e-9)
    assert arm.ending(arm.send(turned())) == SUCCESS


# Parameters -------------------------------------------------------------------------------------


def set_parameter(arm: SteppedArm, name: str, value: Any) -> Any:
    """The result of setting a parameter of the controller."""
    message = Parameter(name, value=value).to_parameter_msg()
    [result] = arm.call(SetParameters, f"{CONTROLLER}/set_parameters", parameters=[message]).results
    return result


def test_tolerances_are_set_while_it_runs(arm: SteppedArm) -> None:
    """They count from the next goal on; a further one, and 0 again, as well."""
    fast = goal(point(0.2, 0.2, velocities=[]))
    for name, value, code in (
        (f"constraints.{JOINT}.trajectory", 0.05, -4),
        (f"constraints.{JOINT}.trajectory", 0.0, 0),
        (f"constraints.{JOINT}.goal", 0.01, -5),  # 0.1 s later it is still 0.05 rad away
        ("constraints.goal_time", 5, 0),  # an integer is one, too
        (f"constraints.{JOINT}.goal", 0.0, 0),
    ):
        if value == 0.01:
            assert set_parameter(arm, "constraints.goal_time", 0.1).successful
        assert set_parameter(arm, name, value).successful
        arm.reset()
        assert arm.ending(arm.send(fast)).code == code, (name, value)


def test_a_wrong_parameter_is_refused(arm: SteppedArm) -> None:
    """With the reason; its value stays."""
    own = f"constraints.{JOINT}.goal"
    for name, value, text in (
        (own, -1.0, "constraints.base_link__link_01.goal out of range Min: 0.0"),
        (own, "near", f'{own}: "near" is a string; write a number from 0'),
        ("constraints.elbow.goal", 0.1, "constraints.elbow.goal: no such parameter"),
        ("constraints.goal_tim", 0.1, 'no such parameter (did you mean "goal_time"?'),
        ("joints", ["elbow"], "Trying to set a read-only parameter: joints."),
        ("allow_integration_in_goal_trajectories", True, "needs positions, too"),
    ):
        before = arm.call(GetParameters, f"{CONTROLLER}/get_parameters", names=[name]).values
        result = set_parameter(arm, name, value)
        assert not result.successful, name
        assert text in result.reason
        after = arm.call(GetParameters, f"{CONTROLLER}/get_parameters", names=[name]).values
        assert after == before


# A robot that drives and has an arm -------------------------------------------------------------


class Watcher(ArmClient):
    """Drives a robot that has an arm, and keeps its odometry."""

    def __init__(self) -> None:
        super().__init__(manager="/velocity_controller")
        self.commands = self.create_publisher(Twist, "/velocity_controller/cmd_vel", 10)
        self.odometry: list[Odometry] = []
        self.joints: list[JointState] = []
        self.create_subscription(Odometry, "/velocity_controller/odom", self.odometry.append, 100)
        self.create_subscription(JointState, "/joint_states", self.joints.append, 100)
        twist = Twist()
        twist.linear.x, twist.angular.z = 0.3, 0.2
        self.create_timer(0.05, lambda: self.commands.publish(twist))


def driven(domain: int, *, moves: bool) -> Watcher:
    """The client of a robot that has driven for 2 s, in which its arm moved or did not."""
    parts = [wheel("left", SEPARATION / 2), wheel("right", -SEPARATION / 2), CASTER, ARM]
    with Simulation(parse_description(urdf(*parts))) as simulation, simulation.ros(domain) as ros:
        watcher = Watcher()
        arm = SteppedArm(ros, watcher)
        if moves:
            handle = arm.send(goal(point(1.5, 1.5), joints=["arm_joint"]))
            assert arm.ending(handle) == SUCCESS
        simulation.run(until=lambda: simulation.time > 1.995)
        return watcher


def place(message: Odometry) -> tuple[float, float]:
    position = message.pose.pose.position
    return position.x, position.y


def test_a_mobile_manipulator_drives_and_moves(ros_domain: int) -> None:
    """Both controllers side by side: the odometry is that of the robot whose arm stands still."""
    still, moved = driven(ros_domain, moves=False), driven(ros_domain, moves=True)
    for watcher, angle in ((still, 0.0), (moved, 1.5)):
        last = watcher.joints[-1]
        at = dict(zip(last.name, last.position, strict=True))["arm_joint"]
        assert at == pytest.approx(angle, abs=1e-6)
    assert place(still.odometry[-1])[0] > 0.4
    for one, other in zip(still.odometry, moved.odometry, strict=True):
        assert seconds(one) == seconds(other)
        assert math.dist(place(one), place(other)) < 1e-5


# What is damaged, and what is too much ----------------------------------------------------------


class Watched(ArmClient):
    """Keeps the joints' states of MRM, too."""

    def __init__(self) -> None:
        super().__init__()
        self.joints: list[JointState] = []
        self.create_subscription(JointState, "/joint_states", self.joints.append, 100)


@pytest.fixture
def watched(ros_simulation: Callable[..., Lockstep[Simulation]]) -> Iterator[SteppedArm]:
    """MRM, whose joint states are finite, within its limits and there in each cycle."""
    ros = ros_simulation(MRM)
    client = Watched()
    arm = SteppedArm(ros, client)
    first = arm.simulation.time
    client.joints.clear()
    yield arm
    arm.simulation.run(0.02)
    assert len(client.joints) == round((arm.simulation.time - first) * 100)
    values = [each for state in client.joints for each in (*state.position, *state.velocity)]
    assert all(map(math.isfinite, values))
    assert all(abs(state.position[0]) < 3.1401 for state in client.joints)
    arm.reset()
    assert arm.ending(arm.send(turned())) == SUCCESS


def damaged(data: bytes, chance: random.Random) -> bytes:
    """A message that is cut, has a few other bytes, or is nothing but its head."""
    kind = chance.randrange(3)
    if kind == 0:
        return data[: chance.randrange(len(data))]
    if kind == 1:
        changed = bytearray(data)
        for _ in range(chance.randrange(1, 6)):
            changed[chance.randrange(4, len(data))] = chance.randrange(256)
        return bytes(changed)
    return data[:4] + chance.randbytes(chance.randrange(200))


def publish_damaged(arm: SteppedArm, count: int) -> None:
    """Publish damaged trajectories, one a cycle."""
    chance = random.Random(7)
    points = [point(0.5 + time, 0.1 * time) for time in range(3)]
    data = serialize_message(trajectory(*points))
    for _ in range(count):
        arm.client.topic.publish(damaged(data, chance))
        arm.simulation.run(0.01)


def test_damaged_messages_do_no_harm(watched: SteppedArm) -> None:
    publish_damaged(watched, DAMAGED)


@pytest.mark.slow
def test_many_damaged_messages_do_no_harm(watched: SteppedArm) -> None:
    publish_damaged(watched, 10 * DAMAGED)


NUMBERS = st.one_of(
    st.floats(-4.0, 4.0), st.sampled_from([0.0, NAN, math.inf, -math.inf, 1e308, -1e-320])
)
TIMES = st.one_of(st.floats(0.0, 3.0), st.sampled_from([-1.0, 0.0, 1e9, 2147483647.0]))
DAMAGES: dict[str, st.SearchStrategy[Any]] = {
    "positions": st.lists(NUMBERS, max_size=2),
    "velocities": st.lists(NUMBERS, max_size=2),
    "accelerations": st.lists(NUMBERS, max_size=2),
    "effort": st.lists(NUMBERS, max_size=1),
    "time_from_start": TIMES.map(duration),
}


@st.composite
def trajectories(draw: st.DrawFn) -> JointTrajectory:
    """Trajectories that can be followed, of which up to two fields are something else."""
    times = sorted(draw(st.sets(st.integers(1, 300), max_size=4)))
    points = [point(time / 100.0, draw(st.floats(-3.14, 3.14))) for time in times]
    for _ in range(draw(st.integers(0, 2)) if points else 0):
        field = draw(st.sampled_from(sorted(DAMAGES)))
        setattr(draw(st.sampled_from(points)), field, draw(DAMAGES[field]))
    joints = draw(st.sampled_from([[JOINT]] * 20 + [[], [JOINT, JOINT], ["elbow"], ["\x1b[31m"]]))
    stamp = draw(st.sampled_from([0] * 8 + [LONG_AGO, 2**31 * 1_000_000_000 - 1]))
    return trajectory(*points, joints=joints, stamp=stamp)


@st.composite
def tolerances(draw: st.DrawFn) -> Any:
    """Tolerances of a joint that are anything."""
    names = st.sampled_from([JOINT, "elbow", ""])
    return JointTolerance(name=draw(names), position=draw(NUMBERS), velocity=draw(NUMBERS))


def test_random_goals_do_no_harm(watched: SteppedArm) -> None:
    """By the topic and by the action; each that is accepted ends, at the latest by the next."""
    handles = []

    @settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(trajectories(), st.lists(tolerances(), max_size=2), TIMES)
    def attempt(message: JointTrajectory, tolerance: list[Any], late: float) -> None:
        watched.client.topic.publish(message)
        future = watched.client.ask(
            FollowJointTrajectory.Goal(
                trajectory=message,
                path_tolerance=tolerance,
                goal_tolerance=tolerance,
                goal_time_tolerance=duration(late),
            )
        )
        watched.simulation.run(until=future.done, timeout=1.0)
        watched.simulation.run(0.05)
        if future.result().accepted:
            handles.append(future.result())

    attempt()
    assert len(handles) > 5
    last = watched.send(turned())
    assert {watched.ending(each).status for each in handles} <= {SUCCEEDED, ABORTED}
    watched.ending(last)


def test_a_thousand_points_are_followed_in_time(watched: SteppedArm) -> None:
    """A sine of 10 s, with velocities."""
    times = [0.01 * (number + 1) for number in range(1000)]
    points = [
        point(time, 0.2 * math.sin(time), velocities=[0.2 * math.cos(time)]) for time in times[:-1]
    ]
    handle = watched.send(goal(*points, point(10.0, 0.2 * math.sin(10.0))))
    start = watched.simulation.time
    watched.simulation.run(5.0)
    expected = 0.2 * math.sin(watched.simulation.time - start)
    assert watched.position == pytest.approx(expected, abs=3e-3)
    assert watched.ending(handle, 20.0) == SUCCESS


@pytest.mark.slow
def test_a_trajectory_in_each_cycle_takes_no_memory(watched: SteppedArm) -> None:
    """For a simulated minute, of which the first quarter is to get going."""
    used = []
    for cycle in range(6000):
        watched.client.topic.publish(trajectory(point(1.0, 0.5 * math.sin(cycle / 100.0))))
        watched.simulation.run(0.01)
        if cycle % 1500 == 1499:
            used.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)  # kB
    assert used[-1] - used[0] < 5000
