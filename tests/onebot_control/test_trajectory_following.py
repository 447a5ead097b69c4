"""joint_trajectory_controller's own checklist, on an ideal arm."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_control.trajectories.config import JointConstraint, TrajectoryConfig
from onebot_control.trajectories.following import Outcome, TrajectoryFollower
from onebot_control.trajectories.goal import FollowedJoint, TrajectoryGoal
from onebot_control.trajectories.tolerances import TolerancesGiven
from onebot_control.trajectories.trajectory import JointMotion, Waypoint
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import read

PERIOD = 0.01  # s
CYCLE = 10_000_000  # ns
NOW = 1_700_000_000_123_456_789  # ns
NAMES = ("elbow", "wrist")
REST = (0.0, 0.0)
SUCCESS = (0, "Goal successfully reached!", "")
PREEMPTED = "Current goal preempted by new incoming action."
DEACTIVATED = "Current goal cancelled during deactivate transition."
TOLERANT = {"elbow": JointConstraint(0.1, 0.02)}


class Arm:
    """Two joints that are where they are commanded to be, plus ``offset``."""

    def __init__(
        self,
        constraints: Mapping[str, JointConstraint] | None = None,
        *,
        joints: Sequence[FollowedJoint] = tuple(map(FollowedJoint, NAMES)),
        positions: Sequence[float] = (0.0, 0.0),
        **values: Any,
    ) -> None:
        of_joints = {
            f"constraints.{joint}.{name}": value
            for joint, constraint in (constraints or {}).items()
            for name, value in asdict(constraint).items()
        }
        config = read(TrajectoryConfig, {**values, **of_joints})
        self.follower = TrajectoryFollower(joints, config, positions)
        self.offset = 0.0  # rad, of all joints
        self.now = NOW
        self.measured = JointMotion(tuple(positions), REST, ())

    def cycle(self) -> list[Outcome]:
        """Do one control cycle: update, and move as commanded."""
        outcomes = self.follower.update(self.measured, self.now, PERIOD)
        positions = tuple(position + self.offset for position in self.follower.reference(PERIOD))
        moved = zip(positions, self.measured.positions, strict=True)
        velocities = tuple((position - before) / PERIOD for position, before in moved)
        self.measured = JointMotion(positions, velocities, ())
        self.now += CYCLE
        return outcomes

    def cycles(self, count: int) -> list[Outcome]:
        """Do several, which end nothing but in the last one."""
        assert [outcome for _ in range(count - 1) for outcome in self.cycle()] == []
        return self.cycle()

    @property
    def desired(self) -> tuple[float, ...]:
        """The positions of the last update's reference."""
        return self.follower.desired.positions


def goal(*points: Waypoint, joints: tuple[str, ...] = NAMES, stamp: int = 0) -> TrajectoryGoal:
    """A goal of both joints, to be followed at once."""
    return TrajectoryGoal(joints, points, stamp)


def ramp(duration: float = 1.0, to: float = 1.0) -> TrajectoryGoal:
    """A linear motion of both joints."""
    return goal(Waypoint(duration, (to, to)))


def following(cycles: int, name: str | None = None, *constraints: Any, **values: Any) -> Arm:
    """An arm that has followed a ramp for so many cycles."""
    arm = Arm(*constraints, **values)
    arm.follower.start(ramp(), name)
    arm.cycles(cycles)
    return arm


def near(*positions: float) -> Any:
    """Positions within what a hundred additions round."""
    return pytest.approx(positions, abs=1e-12)


# Motion ---------------------------------------------------------------------------------------


def test_it_holds_at_the_start() -> None:
    """Also when the arm is pushed: the position of the start is commanded, not the measured one."""
    arm = Arm(positions=(0.3, -0.4))
    assert arm.follower.reference(0.0) == [0.3, -0.4]
    assert arm.follower.desired == arm.follower.measured == JointMotion((0.3, -0.4), REST, REST)
    arm.offset = 0.1
    arm.cycles(100)
    assert arm.desired == (0.3, -0.4) and arm.follower.reference(PERIOD) == [0.3, -0.4]
    assert arm.follower.error == near(-0.1, -0.1)
    assert arm.follower.active is None


def test_a_motion() -> None:
    """It begins in the first cycle; the reference ahead is the next cycle's, and it succeeds."""
    arm = Arm()
    assert arm.follower.start(ramp(), "mine") is None
    assert arm.follower.active == "mine"
    assert arm.follower.reference(PERIOD) == [0.0, 0.0]
    for count in range(100):
        assert arm.cycle() == []
        assert arm.follower.desired == JointMotion(near(count / 100, count / 100), (1.0,) * 2, REST)
        for ahead in (0.0, 0.005, 0.01):
            exact = count / 100 + ahead
            assert arm.follower.reference(ahead) == pytest.approx([exact] * 2, abs=1e-12)
    assert arm.cycle() == [("mine", *SUCCESS)]
    assert arm.follower.active is None and arm.follower.error == near(0.0, 0.0)
    arm.cycles(100)
    assert arm.follower.desired == JointMotion((1.0, 1.0), REST, REST)


def test_the_start_has_the_measured_velocity() -> None:
    """Unless the state interfaces have no velocity: then it is 0; so are accelerations."""
    point = Waypoint(1.0, (1.0, 1.0), REST, REST)
    for interfaces, velocity, acceleration in [
        (["position"], 0.0, 0.0),
        (["position", "velocity"], 2.0, 0.0),
        (["position", "velocity", "acceleration"], 2.0, 3.0),
    ]:
        arm = Arm(state_interfaces=interfaces)
        arm.measured = JointMotion((0.5, 0.5), (2.0, 2.0), (3.0, 3.0))
        arm.follower.start(goal(point))
        arm.cycle()
        assert arm.follower.desired == JointMotion((0.5,) * 2, (velocity,) * 2, (acceleration,) * 2)


def test_a_goal_of_velocities() -> None:
    """From where the joints are, also if those are continuous, and end more than a turn away."""
    joints = [FollowedJoint(name, continuous=True) for name in NAMES]
    arm = Arm(joints=joints, positions=(0.5, 7.0), allow_integration_in_goal_trajectories=True)
    speeds = Waypoint(1.0, (), (8.0, -8.0)), Waypoint(2.0, (), REST)
    arm.follower.start(goal(*speeds), "mine")
    assert arm.cycles(201) == [("mine", *SUCCESS)]
    assert arm.measured.positions == near(8.5, -1.0)


def test_measured_accelerations() -> None:
    """Computed from the velocities of two cycles where state_interfaces have them."""
    arm = Arm(state_interfaces=["position", "velocity", "acceleration"])
    for speed, acceleration in ((0.0, 0.0), (0.2, 20.0), (0.1, -10.0)):
        arm.measured = JointMotion(REST, (speed, 0.0), ())
        arm.follower.update(arm.measured, arm.now, PERIOD)
        assert arm.follower.state.accelerations == pytest.approx((acceleration, 0.0))


def test_joints_in_another_order() -> None:
    arm = Arm()
    point = Waypoint(1.0, (1.0, 2.0), (0.1, 0.2), (0.3, 0.4))
    arm.follower.start(goal(point, joints=("wrist", "elbow")))
    arm.cycles(102)
    assert arm.follower.desired == JointMotion((2.0, 1.0), (0.2, 0.1), (0.4, 0.3))


def test_joints_that_a_goal_leaves_out() -> None:
    """They hold their last command, not their measured position, at rest."""
    arm = following(51, allow_partial_joints_goal=True)
    arm.offset = 0.01
    arm.cycle()
    partial = goal(Waypoint(1.0, (3.0,), (0.5,), (0.25,)), joints=("wrist",))
    assert arm.follower.problems(partial, arm.now)  # because of its velocity only
    arm.follower.start(partial)
    arm.cycle()
    assert arm.desired == near(0.53, 0.53)
    arm.cycles(101)
    assert arm.follower.desired == JointMotion(near(0.52, 3.0), (0.0, 0.5), (0.0, 0.25))


@pytest.mark.parametrize("name", ["interpolate_from_desired_state", "open_loop_control"])
def test_a_trajectory_may_begin_at_the_last_command(name: str) -> None:
    """There is no jump then, though the arm is somewhere else; the velocity is continuous, too."""
    arm = following(50, **{name: True})
    arm.offset = 0.01
    arm.follower.start(goal(Waypoint(1.0, (0.0, 0.0), REST)))
    arm.cycle()
    assert arm.follower.desired.positions == near(0.5, 0.5)
    assert arm.follower.desired.velocities == near(1.0, 1.0)


def test_a_joint_may_be_held_at_the_last_command() -> None:
    """So that a finger goes on to press; the other joint begins where it is measured."""
    arm = Arm()
    arm.offset = 0.01
    arm.cycle()
    arm.follower.start(goal(Waypoint(1.0, (0.0, 1.0), REST, REST)), from_command=["elbow"])
    arm.cycle()
    assert arm.follower.desired == JointMotion((0.0, 0.01), (0.0, 1.0), REST)
    for _ in range(110):
        assert arm.follower.reference(PERIOD)[0] == 0.0
        arm.cycle()
    assert arm.desired == (0.0, 1.0)


# Stamps ---------------------------------------------------------------------------------------


def test_a_trajectory_that_began_already() -> None:
    """The reference jumps into the segment that runs, to the nanosecond."""
    arm = Arm()
    points = [Waypoint(time, (time, 10.0 * time)) for time in (1.0, 2.0, 3.0)]
    arm.follower.start(goal(*points, stamp=NOW - 1_500_000_001))
    arm.cycle()
    assert arm.desired == pytest.approx((1.500000001, 15.00000001), abs=1e-14)
    arm.cycles(60)
    assert arm.desired == near(2.100000001, 21.00000001)


def test_a_trajectory_in_the_future() -> None:
    """It leads to the first point over the whole wait."""
    arm = Arm(positions=(1.0, 1.0))
    arm.follower.start(goal(Waypoint(1.0, (2.0, 2.0)), stamp=NOW + 1_000_000_000))
    arm.cycles(51)
    assert arm.desired == near(1.25, 1.25)
    arm.cycles(150)
    assert arm.desired == near(2.0, 2.0)


def test_time_passes_by_periods_not_by_stamps() -> None:
    """A pause, with stamps that go on, stops the trajectory."""
    arm = following(51, "mine")
    arm.now += 3_600_000_000_000
    assert arm.cycle() == [] and arm.desired == near(0.51, 0.51)


# Continuous joints ----------------------------------------------------------------------------

CONTINUOUS = [FollowedJoint("elbow", True), FollowedJoint("wrist")]


def test_errors_of_continuous_joints_are_the_shortest() -> None:
    arm = Arm(joints=CONTINUOUS, positions=(3.1, 3.1))
    arm.measured = JointMotion((-3.1, -3.1), REST, ())
    arm.cycle()
    assert arm.follower.error == near(6.2 - math.tau, 6.2)


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 3])
def test_the_start_of_continuous_joints_is_wrapped(turns: int) -> None:
    """It is within pi of the first point; what is commanded is in the measured turn."""
    start = math.tau * turns + 0.5
    arm = Arm(joints=CONTINUOUS, positions=(start, start))
    arm.follower.start(ramp(to=1.5))
    arm.cycle()
    assert arm.desired == near(0.5, start)
    assert arm.follower.error == near(0.0, 0.0)
    arm.cycles(100)
    assert arm.desired == near(1.5, 1.5)
    assert arm.measured.positions == near(start + 1.0, 1.5)
    arm.follower.cancel()
    arm.cycles(2)
    assert arm.desired == near(start + 1.0, 1.5)


def test_a_late_start_of_several_turns() -> None:
    """The turn is the one nearest to where the trajectory is, not to its first or next point."""
    arm = Arm(joints=CONTINUOUS)
    points = Waypoint(0.0, REST), Waypoint(2.0, (2 * math.tau, 1.0))
    arm.follower.start(goal(*points, stamp=NOW - 1_000_000_000))
    arm.cycle()
    assert arm.desired == near(math.tau, 0.5)
    assert arm.follower.reference(0.0) == pytest.approx([0.0, 0.5], abs=1e-12)


def test_a_command_of_another_turn_is_continued() -> None:
    """The last command is that in the measured turn, also for joints that are left out."""
    values = {"interpolate_from_desired_state": True, "allow_partial_joints_goal": True}
    arm = Arm(joints=CONTINUOUS, positions=(math.tau, 0.0), **values)
    arm.follower.start(ramp(to=0.5))
    arm.cycles(110)
    arm.follower.start(goal(Waypoint(1.0, (1.0,)), joints=("wrist",)))
    arm.cycle()
    assert arm.follower.reference(0.0) == pytest.approx([math.tau + 0.5, 0.5], abs=1e-12)
    assert arm.follower.reference(PERIOD)[0] == pytest.approx(math.tau + 0.5, abs=1e-12)


# Limits ---------------------------------------------------------------------------------------

LIMITED = [FollowedJoint("elbow", False, -1.0, 1.0), FollowedJoint("wrist")]


def test_a_spline_that_overshoots_is_kept_within_the_limits() -> None:
    """It is at rest there, and the other joint moves on."""
    overshoot = goal(Waypoint(1.0, (1.0, 1.0), (5.0, 5.0)), Waypoint(2.0, (1.0, 1.0), REST))
    arm = Arm(joints=LIMITED)
    assert not arm.follower.problems(overshoot, NOW)
    arm.follower.start(overshoot)
    arm.cycles(131)
    exact = 1.0 + 5.0 * 0.3 * 0.7**2  # the cubic with 5 rad/s at its start
    assert arm.follower.desired.positions == near(1.0, exact)
    assert arm.follower.desired.velocities[0] == 0.0 < arm.follower.desired.velocities[1]
    assert arm.follower.desired.accelerations[0] == 0.0 > arm.follower.desired.accelerations[1]
    assert arm.follower.reference(0.0) == pytest.approx([1.0, exact], abs=1e-12)
    assert arm.follower.query(NOW + 1_300_000_000).positions == near(1.0, exact)
    free = Arm(joints=LIMITED, enforce_command_limits=False)
    free.follower.start(overshoot)
    free.cycles(131)
    assert free.desired == near(exact, exact)


def test_a_start_beyond_the_limits() -> None:
    arm = Arm(joints=LIMITED, positions=(1.2, 1.2))
    arm.follower.start(ramp(to=0.8))
    arm.cycle()
    assert arm.follower.reference(0.0) == [1.0, 1.2]
    arm.cycles(75)
    assert arm.desired == near(0.9, 0.9)


@given(
    st.lists(
        st.tuples(st.floats(-1.0, 1.0), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
        min_size=1,
        max_size=4,
    )
)
def test_never_beyond_the_limits(values: list[tuple[float, float, float]]) -> None:
    points = [
        Waypoint(0.1 * (index + 1), (p, 0.0), (v, 0.0), (a, 0.0))
        for index, (p, v, a) in enumerate(values)
    ]
    arm = Arm(joints=LIMITED, allow_nonzero_velocity_at_trajectory_end=True)
    assert not arm.follower.problems(goal(*points), NOW)
    arm.follower.start(goal(*points))
    for _ in range(10 * len(points) + 2):
        arm.cycle()
        assert -1.0 <= arm.measured.positions[0] <= 1.0 and -1.0 <= arm.desired[0] <= 1.0


# Tolerances -----------------------------------------------------------------------------------


def test_the_path_tolerance() -> None:
    """The tolerance itself is allowed; beyond it the goal is aborted and the position is held."""
    arm = following(30, "mine", TOLERANT)
    arm.offset = -0.09
    arm.cycles(20)
    arm.offset = -0.11
    arm.cycle()
    held = arm.measured.positions
    arm.offset = 0.0
    detail = "elbow: position error 0.11, tolerance 0.1"
    assert arm.cycle() == [("mine", -4, "Aborted due to path tolerance violation", detail)]
    assert arm.follower.active is None
    assert arm.follower.reference(0.0) == arm.follower.reference(PERIOD) == list(held)
    arm.cycles(100)
    assert arm.desired == held


def test_the_path_tolerance_of_the_topic() -> None:
    """It holds, and the outcome is of no goal."""
    arm = following(50, None, TOLERANT)
    arm.offset = 0.2
    arm.cycle()
    [outcome] = arm.cycle()
    text = "Holding position due to state tolerance violation"
    assert outcome == (None, -4, text, "elbow: position error -0.2, tolerance 0.1")
    arm.offset = 1.0
    arm.cycles(10)  # what is held is not judged


def test_a_goal_without_time_from_start() -> None:
    """The reference jumps: beyond the path tolerance it fails at once, within it succeeds."""
    arm = Arm(TOLERANT)
    arm.follower.start(ramp(0.0, to=1.0), "far")
    [outcome] = arm.cycle()
    assert outcome[:3] == ("far", -4, "Aborted due to path tolerance violation")
    assert arm.desired == (1.0, 1.0) and arm.follower.reference(PERIOD) == [0.0, 0.0]
    arm.follower.start(ramp(0.0, to=0.02), "near")
    assert arm.cycle() == [("near", *SUCCESS)]
    assert arm.follower.reference(PERIOD) == [0.02, 0.02]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("mine", "Aborted due to goal_time_tolerance exceeding by 0.510000 seconds"),
        (None, "Exceeded goal_time_tolerance: holding position..."),
    ],
    ids=["action", "topic"],
)
def test_the_goal_tolerance_and_goal_time(name: str | None, text: str) -> None:
    """What is beyond the tolerance once goal_time has passed is aborted; the position is held."""
    arm = Arm(TOLERANT, **{"constraints.goal_time": 0.5})
    arm.offset = 0.03
    arm.follower.start(ramp(), name)
    detail = "elbow: position error -0.03, tolerance 0.02"
    assert arm.cycles(152) == [(name, -5, text, detail)]
    assert arm.follower.reference(PERIOD) == pytest.approx([1.03, 1.03])


def test_tolerances_of_a_goal() -> None:
    """They count for the goal, and for the topic's trajectories after it, until the next goal."""
    arm = Arm(TOLERANT)
    wide = TolerancesGiven({"elbow": (-1.0,)}, {"elbow": (0.5,)}, 0.1)
    arm.offset = 0.4
    arm.follower.start(ramp(), "wide", wide)
    assert arm.cycles(101) == [("wide", *SUCCESS)]
    arm.offset = 0.6
    arm.follower.start(ramp())
    [outcome] = arm.cycles(112)
    assert outcome.detail == "elbow: position error -0.6, tolerance 0.5"
    arm.follower.start(ramp(), "default")
    [outcome] = arm.cycles(2)
    assert outcome.detail == "elbow: position error -0.6, tolerance 0.1"


def test_cmd_timeout() -> None:
    """Some time after the last point, the measured position is held instead of that point."""
    arm = Arm(cmd_timeout=0.5)
    arm.offset = 0.1
    arm.follower.start(ramp())
    arm.cycles(151)
    assert arm.follower.reference(0.0) == [1.0, 1.0]
    assert arm.cycle() == [(None, -5, "Aborted due to command timeout", "")]
    assert arm.follower.reference(0.0) == pytest.approx([1.1, 1.1])
    arm.cycles(100)


def test_cmd_timeout_ends_an_action_goal() -> None:
    """It never succeeded, so it is aborted; joint_trajectory_controller has it succeed then."""
    arm = Arm(TOLERANT, cmd_timeout=0.5)
    arm.offset = 0.03
    arm.follower.start(ramp(), "mine")
    detail = "elbow: position error -0.03, tolerance 0.02"
    assert arm.cycles(152) == [("mine", -5, "Aborted due to command timeout", detail)]


def test_cmd_timeout_must_exceed_goal_time() -> None:
    arm = following(1000, cmd_timeout=0.5, **{"constraints.goal_time": 0.5})
    assert arm.follower.reference(0.0) == [1.0, 1.0]


# Ends -----------------------------------------------------------------------------------------


def test_preemption() -> None:
    """A new action goal ends the old one at once, also one that did not begin."""
    arm = Arm()
    arm.follower.start(ramp(), "first")
    arm.cycles(50)
    assert arm.follower.start(ramp(), "second") == ("first", -1, PREEMPTED, "")
    assert arm.follower.start(ramp(), "third") == ("second", -1, PREEMPTED, "")
    assert arm.follower.active == "third"
    assert arm.cycles(101) == [("third", *SUCCESS)]
    assert arm.follower.start(ramp(), "fourth") is None


def test_the_topic_during_an_action() -> None:
    """It ends the goal, which does not succeed where another trajectory ends."""
    arm = following(50, "mine", TOLERANT)
    text = "Current goal preempted by another trajectory, which is not an action goal."
    assert arm.follower.start(ramp(0.2, to=-1.0)) == ("mine", -1, text, "")
    assert arm.follower.active is None
    assert arm.cycles(21) == []
    assert arm.desired == near(-1.0, -1.0)
    assert arm.follower.start(ramp()) is None


def test_cancel_holds_the_measured_position() -> None:
    arm = following(50, "mine")
    arm.offset = 0.07
    arm.cycle()
    arm.follower.cancel()
    assert arm.follower.active is None
    measured = arm.measured.positions
    arm.offset = 0.0
    arm.cycles(100)
    assert arm.follower.desired == JointMotion(measured, REST, REST)
    assert arm.follower.reference(PERIOD) == list(measured)


BRAKES = {"constraints.decelerate_on_cancel": True}
DECELERATIONS = {name: JointConstraint(0.1, 0.0, 5.0) for name in NAMES}


@pytest.mark.parametrize("fails", [False, True])
def test_deceleration(fails: bool) -> None:
    """1 rad/s takes 0.2 s and 0.1 rad at 5 rad/s2, after a cancel and after a path violation."""
    arm = following(50, "mine", DECELERATIONS, **BRAKES)
    arm.measured = JointMotion((0.7, 0.5), (1.0, -2.0), ())
    if fails:
        [outcome] = arm.cycle()
        assert outcome[:2] == ("mine", -4)
    else:
        arm.follower.cancel()
        arm.cycle()
        assert arm.follower.desired == JointMotion((0.7, 0.5), (1.0, -2.0), near(-5.0, 5.0))
    for count in range(1, 20):
        arm.cycle()
        t = count / 100
        assert arm.desired == near(0.7 + t - 2.5 * t * t, 0.5 - 2.0 * t + 2.5 * t * t)
        assert arm.follower.desired.velocities == near(1.0 - 5.0 * t, -2.0 + 5.0 * t)
    arm.cycles(22)
    assert arm.follower.desired == JointMotion(near(0.8, 0.1), REST, REST)


@pytest.mark.parametrize(
    ("constraints", "values"),
    [
        ({"elbow": JointConstraint(0.0, 0.0, 5.0)}, BRAKES),
        (DECELERATIONS, {}),
        (DECELERATIONS, {**BRAKES, "state_interfaces": ["position"]}),
    ],
)
def test_no_deceleration(
    constraints: Mapping[str, JointConstraint], values: dict[str, Any]
) -> None:
    """It holds if a joint has no deceleration, by default, and without the velocity."""
    arm = following(50, "mine", constraints, **values)
    arm.follower.cancel()
    arm.cycles(10)
    assert arm.follower.desired == JointMotion(near(0.5, 0.5), REST, REST)


def test_a_velocity_at_the_end() -> None:
    """The position is held, the velocity is repeated."""
    arm = Arm(allow_nonzero_velocity_at_trajectory_end=True)
    moving = goal(Waypoint(1.0, (1.0, 1.0), (0.5, -0.5), (0.1, 0.2)))
    assert not arm.follower.problems(moving, NOW)
    arm.follower.start(moving, "mine")
    assert arm.cycles(101) == [("mine", *SUCCESS)]
    arm.cycles(50)
    assert arm.follower.desired == JointMotion((1.0, 1.0), (0.5, -0.5), (0.1, 0.2))


def test_abort() -> None:
    """As deactivation: the last command is held, or else the position measured next."""
    for last_command, held in ((True, 0.5), (False, 0.57)):
        name = "set_last_command_interface_value_as_state_on_activation"
        arm = following(49, "mine", **{name: last_command})
        arm.offset = 0.07
        arm.cycle()
        assert arm.follower.abort(DEACTIVATED) == ("mine", -1, DEACTIVATED, "")
        assert arm.follower.active is None
        arm.offset = 0.0
        arm.cycles(100)
        assert arm.desired == near(held, held)
        assert arm.follower.abort(DEACTIVATED) is None


def test_reset() -> None:
    """Other positions are held from then on, without an error."""
    arm = following(50, "mine")
    assert arm.follower.reset((2.0, 3.0)) == ("mine", -1, "Current goal cancelled by a reset.", "")
    assert arm.follower.reference(PERIOD) == [2.0, 3.0]
    assert arm.follower.desired == arm.follower.measured == JointMotion((2.0, 3.0), REST, REST)
    arm.cycles(50)
    assert arm.desired == (2.0, 3.0) and arm.follower.active is None


# Speed scaling --------------------------------------------------------------------------------


def test_speed_scaling() -> None:
    """Time passes as slowly from the next update on, without a jump; at 0 it stands still."""
    arm = Arm(TOLERANT, **{"speed_scaling.initial_scaling_factor": 0.5})
    assert arm.follower.scaling == 0.5
    arm.follower.start(ramp(), "mine")
    arm.cycles(101)
    assert arm.desired == near(0.5, 0.5)
    arm.follower.scaling = 0.0
    assert arm.follower.reference(PERIOD) == pytest.approx([0.505, 0.505])
    arm.cycles(100)
    assert arm.desired == near(0.505, 0.505)
    arm.follower.scaling = 2.0
    arm.cycles(1)
    assert arm.desired == near(0.505, 0.505)
    assert arm.follower.reference(0.005) == pytest.approx([0.515, 0.515])
    arm.cycles(24)
    assert arm.desired == near(0.985, 0.985)
    assert arm.cycle() == [("mine", *SUCCESS)]


def test_periods_whose_sum_is_rounded() -> None:
    """Ten times 0.1 s is less than 1 s, and yet the end."""
    arm = Arm()
    assert sum([0.1] * 10) < 1.0
    arm.follower.scaling = 10.0
    arm.follower.start(ramp(), "mine")
    assert arm.cycles(11) == [("mine", *SUCCESS)]


@pytest.mark.parametrize("wrong", [-0.1, 1001.0, math.nan, math.inf])
def test_an_impossible_speed_scaling(wrong: float) -> None:
    arm = Arm()
    with pytest.raises(OneBotError, match=f"^a speed scaling must be 0 to 1000, not {wrong:g}"):
        arm.follower.scaling = wrong
    assert arm.follower.scaling == 1.0


# Queries --------------------------------------------------------------------------------------

EARLIER = "Requested sample time is earlier than the current trajectory start time."
LATER = "Requested sample time is later than the current trajectory end time."
NOTHING = "Currently there is no valid trajectory instance."


def refusal(arm: Arm, time: int) -> str:
    """Why there is no answer to a query."""
    with pytest.raises(OneBotError) as caught:
        arm.follower.query(time)
    return str(caught.value)


def test_query() -> None:
    """At any time of the trajectory, as it is followed at the present scaling."""
    arm = Arm()
    assert refusal(arm, NOW) == NOTHING
    arm.follower.start(ramp(), "mine")
    arm.cycle()
    assert arm.follower.query(NOW + 999_999_999).positions == near(0.999999999, 0.999999999)
    assert refusal(arm, NOW + 1_000_000_000) == LATER
    arm.cycles(50)
    for seconds in (0.0, 0.25, 0.75, 0.999):
        motion = arm.follower.query(NOW + round(seconds * 1e9))
        assert motion == JointMotion(near(seconds, seconds), (1.0, 1.0), REST)
    assert refusal(arm, NOW - 1_000) == EARLIER
    assert refusal(arm, NOW + 1_000_000_000) == LATER
    arm.follower.scaling = 0.5
    arm.cycle()
    assert arm.follower.query(arm.now - CYCLE + 100_000_000).positions == near(0.56, 0.56)
    assert arm.cycles(98) == [("mine", *SUCCESS)]
    assert refusal(arm, NOW) == NOTHING
