"""joint_trajectory_controller's topics, action and services, in step with a simulation."""

import faulthandler
import math
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from geometry_msgs.msg import Twist, Vector3
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rcl_interfaces.srv import GetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import Bool
from trajectory_msgs.msg import JointTrajectoryPoint

from onebot_control import Simulation
from onebot_control.nodes.lockstep import Lockstep
from onebot_description.description import parse_description
from onebot_description.ros.domains import used_domain
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.ros.wire.messages import time_message
from tests.any_message import messages
from tests.onebot_control.arm_models import joint, link
from tests.onebot_control.arm_support import (
    ABORTED,
    CANCELED,
    CONTROLLER,
    JOINT,
    MANAGER,
    MRM,
    SUCCEEDED,
    SUCCESS,
    UNKNOWN,
    ArmClient,
    Ending,
    JointTolerance,
    SteppedArm,
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


@pytest.fixture(scope="module")
def started() -> Iterator[SteppedArm]:
    """MRM and its client, for all tests that need no other robot."""
    with used_domain() as domain, Simulation(MRM) as simulation, simulation.ros(domain) as ros:
        yield SteppedArm(ros)


@pytest.fixture
def arm(started: SteppedArm) -> SteppedArm:
    """The same, at 0 rad and at rest."""
    started.reset()
    return started


@pytest.fixture
def watched_arm(arm: SteppedArm) -> Iterator[SteppedArm]:
    """The same, whose client keeps the controller's states."""
    states = arm.client.watch()
    arm.ros.add()  # waits until it is connected
    yield arm
    arm.client.destroy_subscription(states)


def turned(to: float = 0.3) -> Any:
    """A goal that MRM reaches in time, in 1 s and at 0.45 rad/s at most."""
    return goal(point(1.0, to))


def begun(arm: SteppedArm) -> float:
    """When the trajectory began, s: the first cycle with an acceleration."""
    return seconds(next(each for each in arm.client.states if each.reference.accelerations[0]))


# Other nodes, before those that all tests share -------------------------------------------------


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


def mobile_manipulator(ros_simulation: Callable[..., Lockstep]) -> SteppedArm:
    """An arm of one joint on two wheels."""
    parts = [wheel("left", SEPARATION / 2), wheel("right", -SEPARATION / 2), CASTER]
    turret = link("arm", 0.2, "0.05 0 0") + joint("arm_joint", "base_link", "arm", axis="0 0 1")
    ros = ros_simulation(parse_description(urdf(*parts, turret)))
    return SteppedArm(ros, ArmClient(manager="/velocity_controller"))


def test_the_joints_of_a_robot_that_drives_have_their_own_lock(
    ros_simulation: Callable[..., Lockstep],
) -> None:
    """What locks the wheels locks them, too; what unlocks one of the two unlocks no other."""
    arm = mobile_manipulator(ros_simulation)
    wheels = arm.client.lock
    joints = arm.client.create_publisher(Bool, f"{MANAGER}/cmd_vel_lock", 10)
    twists = arm.client.create_publisher(Twist, "/velocity_controller/cmd_vel", 10)
    arm.ros.add()  # waits until they are connected
    simulation, target = arm.simulation, goal(point(0.5, 0.5), joints=["arm_joint"])

    def set_lock(publisher: Any, locked: bool) -> None:
        publisher.publish(Bool(data=locked))
        simulation.run(0.05)

    def drives() -> bool:
        start = simulation.robot.odometry.x
        twists.publish(Twist(linear=Vector3(x=0.2)))
        simulation.run(1.5)  # until it stands again
        return simulation.robot.odometry.x > start + 0.01

    def moves() -> bool:
        handle = arm.awaited(arm.client.ask(target))
        if handle.accepted:
            assert arm.ending(handle) == SUCCESS
        return bool(handle.accepted)

    # As Stop on a page locks, and as nodes do that know only the lock of the wheels.
    for locks in ((wheels, joints), (wheels,)):
        for lock in locks:
            set_lock(lock, True)
        assert not drives() and not moves()
        set_lock(joints, False)
        assert moves() and not drives()
        for lock in locks:
            set_lock(lock, True)
        set_lock(wheels, False)
        assert drives() and moves() == (joints not in locks)
    set_lock(joints, False)
    assert moves()


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
    """Nothing moves, and the log says why; test_trajectory_goal.py has all the reasons."""
    arm.simulation.run(3.0)
    past = goal(point(1.0, 0.0))
    past.trajectory.header.stamp = time_message(LONG_AGO)
    for text, request in (
        ("points[0].positions: base_link__link_01: 3.2 is above", goal(point(1.0, 3.2))),
        ('joint_names: "elbow" is not a joint', goal(point(1.0, 0.0), joints=["elbow"])),
        ("effort is given, but only positions are", goal(point(1.0, 0.0, effort=[1.0]))),
        ("header.stamp: the trajectory ended ", past),
    ):
        arm.refuse(request)
        assert f"goal rejected: {text}" in capfd.readouterr().err
    arm.simulation.run(0.5)
    assert arm.position == 0.0 and not arm.simulation.robot.moving


def test_many_reasons_are_counted(arm: SteppedArm, capfd: pytest.CaptureFixture[str]) -> None:
    arm.refuse(goal(*(point(1.0 + number, NAN) for number in range(21))))
    said = capfd.readouterr().err
    assert said.count("nan is not finite") == 5 and "and 16 more" in said


def test_all_goals_are_cancelled_at_once(arm: SteppedArm) -> None:
    """Also if one of them was preempted just then, and waits to be sent that."""
    first, second = arm.send(turned()), arm.send(turned(-0.3))
    cancel = load_interface("action_msgs/srv/CancelGoal")
    arm.call(cancel, f"{CONTROLLER}/follow_joint_trajectory/_action/cancel_goal")
    assert arm.ending(first) == PREEMPTED
    assert arm.ending(second) == (CANCELED, 0, "")
    arm.simulation.run(0.1)
    assert not arm.simulation.robot.moving


def test_tolerances_that_are_wrong_are_reported(
    arm: SteppedArm, capfd: pytest.CaptureFixture[str]
) -> None:
    """The goal is followed with the default ones, as joint_trajectory_controller does."""
    wrong = [JointTolerance(name="elbow", position=0.01), JointTolerance(name=JOINT, position=-3.0)]
    assert arm.ending(arm.send(goal(point(0.2, 0.05), path_tolerance=wrong))) == SUCCESS
    log = capfd.readouterr().err
    assert 'path_tolerance: "elbow" is not a joint of the controller' in log
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


# Topics and services ----------------------------------------------------------------------------


def test_a_wrong_trajectory_of_the_topic_is_ignored(
    arm: SteppedArm, capfd: pytest.CaptureFixture[str]
) -> None:
    """So is one that is damaged. The motion goes on, and the log does not fill."""
    cut = serialize_message(trajectory(point(1.0, 5.0)))[:40]
    arm.client.topic.publish(trajectory(point(1.0, 0.3)))
    for _ in range(100):
        arm.client.topic.publish(trajectory(point(1.0, 5.0)))
        arm.client.topic.publish(cut)
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
    assert "~/speed_scaling_input is ignored: a speed scaling must be 0 to 1000, not -0.1" in log
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
    scaling.publish(kind(factor=1.0))
    arm.simulation.run(0.1)
    arm.client.destroy_publisher(scaling)


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
            assert arm.set_parameter(CONTROLLER, "constraints.goal_time", 0.1).successful
        assert arm.set_parameter(CONTROLLER, name, value).successful
        arm.reset()
        assert arm.ending(arm.send(fast)).code == code, (name, value)
    assert arm.set_parameter(CONTROLLER, "constraints.goal_time", 0.0).successful


def test_a_wrong_parameter_is_refused(arm: SteppedArm) -> None:
    """With the reason; its value stays."""
    own = f"constraints.{JOINT}.goal"
    for name, value, text in (
        (own, -1.0, "constraints.base_link__link_01.goal out of range Min: 0.0"),
        ("constraints.elbow.goal", 0.1, "constraints.elbow.goal: no such parameter"),
        ("joints", ["elbow"], "Trying to set a read-only parameter: joints."),
    ):
        before = arm.call(GetParameters, f"{CONTROLLER}/get_parameters", names=[name]).values
        result = arm.set_parameter(CONTROLLER, name, value)
        assert not result.successful, name
        assert text in result.reason
        after = arm.call(GetParameters, f"{CONTROLLER}/get_parameters", names=[name]).values
        assert after == before


# What is random ---------------------------------------------------------------------------------


def test_random_goals_do_no_harm(arm: SteppedArm) -> None:
    """By the topic and by the action; each that is accepted ends, at the latest by the next."""
    handles: list[Any] = []

    @settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(
        st.lists(st.floats(-3.14, 3.14), min_size=1, max_size=4),
        st.lists(messages(JointTrajectoryPoint), max_size=1),
        st.lists(messages(JointTolerance, (JOINT, "elbow")), max_size=2),
    )
    def attempt(positions: list[float], anything: list[Any], tolerances: list[Any]) -> None:
        points = [point(0.5 * row, at) for row, at in enumerate(positions, 1)]
        request = goal(*points, *anything, path_tolerance=tolerances, goal_tolerance=tolerances)
        arm.client.topic.publish(request.trajectory)
        handle = arm.awaited(arm.client.ask(request))
        arm.simulation.run(0.05)
        assert abs(arm.position) < 3.1401
        handles.extend([handle] * handle.accepted)

    attempt()
    assert len(handles) > 3
    last = arm.send(turned())
    assert {arm.ending(each).status for each in handles} <= {SUCCEEDED, ABORTED}
    arm.ending(last)
