"""parallel_gripper_action_controller's rules, on a finger that moves at a constant speed."""

import math
from typing import Any

import pytest

from onebot_control.trajectories.following import (
    GOAL_TOLERANCE_VIOLATED,
    INVALID_GOAL,
    SUCCESSFUL,
    Outcome,
)
from onebot_control.trajectories.goal import FollowedJoint
from onebot_control.trajectories.gripping import GripperConfig, GripperFollower, GripperGoal
from onebot_control.trajectories.trajectory import JointMotion
from onebot_description.parameters.reader import read

PERIOD = 0.01  # s
OPEN = 0.05  # m; closed is 0
SPEED = 0.1  # m/s
REACHED = "Reached the goal"
STALLED = "Stalled on the way to the goal"


class Finger:
    """A finger that moves to where it is commanded, unless something is at ``stop``."""

    def __init__(self, stop: float = -math.inf, **values: Any) -> None:
        config = read(GripperConfig, {"joint": "finger", **values})
        joint = FollowedJoint("finger", lower=0.0, upper=OPEN)
        self.gripper = GripperFollower([joint], config, [OPEN])
        self.stop = stop
        self.speed = SPEED
        self.position, self.velocity = OPEN, 0.0
        self.cycles = 0

    @property
    def commanded(self) -> float:
        [position] = self.gripper.reference(PERIOD)
        return position

    def cycle(self) -> list[Outcome]:
        """Do one control cycle: update, and move."""
        motion = JointMotion((self.position,), (self.velocity,), ())
        outcomes = self.gripper.update(motion, 0, PERIOD)
        step = self.speed * PERIOD
        position = self.position + min(max(self.commanded - self.position, -step), step)
        position = max(position, self.stop)
        self.velocity = (position - self.position) / PERIOD
        self.position = position
        self.cycles += 1
        return outcomes

    def outcome(self, within: int = 1000) -> Outcome:
        """Do cycles until the goal ends; how."""
        for _ in range(within):
            if outcomes := self.cycle():
                [outcome] = outcomes
                return outcome
        pytest.fail(f"no outcome in {within} cycles")

    @property
    def flags(self) -> tuple[bool, bool]:
        """Whether the last goal was reached, and whether the finger stalled."""
        return self.gripper.reached, self.gripper.stalled


def closing(**values: Any) -> Finger:
    """A finger that has been told to close."""
    finger = Finger(**values)
    finger.gripper.start(GripperGoal((0.0,)), "mine")
    return finger


def test_it_holds_without_a_goal() -> None:
    finger = Finger()
    assert [finger.cycle() for _ in range(300)] == [[]] * 300
    assert finger.commanded == finger.position == OPEN
    assert finger.flags == (False, False)


def test_it_closes_on_nothing() -> None:
    """The goal is reached in the first cycle in which the error is below the tolerance."""
    finger = Finger(goal_tolerance=0.0095)
    assert finger.gripper.start(GripperGoal((0.0,)), "mine") is None
    assert finger.gripper.active == "mine" and finger.flags == (False, False)
    outcome = finger.outcome()
    assert outcome[:3] == ("mine", SUCCESSFUL, REACHED)
    assert outcome.detail == "finger: position 0.009, goal 0"
    assert finger.cycles == 42  # 41 cycles of 1 mm, and the one that measures the last
    assert finger.flags == (True, False) and finger.gripper.active is None
    assert [finger.cycle() for _ in range(300)] == [[]] * 300
    assert finger.position == pytest.approx(0.0, abs=1e-12)


def test_the_tolerance_is_not_reached_at_its_end() -> None:
    finger = closing(stop=0.01, goal_tolerance=0.01, stall_timeout=0.1)
    assert finger.outcome().text == STALLED
    finger = closing(stop=0.0099, goal_tolerance=0.01, stall_timeout=0.1)
    assert finger.outcome().text == REACHED


@pytest.mark.parametrize("allowed", [False, True])
def test_it_stalls(allowed: bool) -> None:
    """After a second at rest; the position stays commanded, so that what is gripped is held."""
    finger = closing(stop=0.02, allow_stalling=allowed)
    outcome = finger.outcome()
    assert outcome == Outcome(
        "mine",
        SUCCESSFUL if allowed else GOAL_TOLERANCE_VIOLATED,
        STALLED,
        "finger: position 0.02, goal 0",
    )
    # 30 cycles to the stop; the first one without motion is measured in cycle 32, at the stamp 31;
    # time without motion counts from the stamp before, 30, and is above 1 s at the stamp 131.
    assert finger.cycles == 132
    assert finger.flags == (False, True) and finger.gripper.active is None
    assert finger.commanded == 0.0
    finger.stop = -math.inf  # what was gripped is gone
    finger.cycle()
    assert finger.position == pytest.approx(0.019)


@pytest.mark.parametrize(("speed", "text"), [(0.0011, REACHED), (0.0009, STALLED)])
def test_one_that_moves_slowly_does_not_stall(speed: float, text: str) -> None:
    """Faster than the threshold it takes its time, slower it stalls."""
    finger = Finger(stall_velocity_threshold=0.001)
    finger.speed = speed
    finger.gripper.start(GripperGoal((OPEN - 0.012,)), "mine")
    assert finger.outcome().text == text


def test_a_rest_on_the_way_counts_anew() -> None:
    """Rests of 0.75 s and 0.9 s are no stall, and a new goal has a second of its own."""
    finger = Finger(stop=0.03)
    finger.gripper.start(GripperGoal((0.0,)), "first")
    for stop in (0.025, 0.02):
        assert [finger.cycle() for _ in range(95)] == [[]] * 95
        finger.stop = stop
    preempted = finger.gripper.start(GripperGoal((0.0,)), "second")
    assert preempted == Outcome(
        "first", INVALID_GOAL, "Current goal preempted by new incoming action."
    )
    assert [finger.cycle() for _ in range(105)] == [[]] * 105
    assert finger.outcome(10)[:3] == ("second", GOAL_TOLERANCE_VIOLATED, STALLED)


def test_cancel_holds_where_it_is() -> None:
    finger = closing()
    for _ in range(10):
        finger.cycle()
    finger.gripper.cancel()
    assert finger.gripper.active is None
    assert [finger.cycle() for _ in range(200)] == [[]] * 200
    assert finger.position == finger.commanded == pytest.approx(0.04)
    assert finger.flags == (False, False)


def test_an_abort_holds_it() -> None:
    """On the way where it is; what is gripped it goes on to grip."""
    finger = closing(stop=0.02, allow_stalling=True)
    for _ in range(10):
        finger.cycle()
    assert finger.gripper.abort("locked") == Outcome("mine", INVALID_GOAL, "locked")
    finger.cycle()
    assert finger.commanded == finger.position == pytest.approx(0.04)
    finger.gripper.start(GripperGoal((0.0,)), "again")
    finger.outcome()
    assert finger.gripper.abort("locked") is None
    finger.cycle()
    assert finger.commanded == 0.0


def test_a_reset_ends_a_goal() -> None:
    finger = Finger()
    assert finger.gripper.reset([0.03]) is None
    finger.gripper.start(GripperGoal((0.0,)), "mine")
    text = "Current goal cancelled by a reset."
    assert finger.gripper.reset([0.03]) == Outcome("mine", INVALID_GOAL, text)
    assert finger.cycle() == [] and finger.commanded == 0.03


def test_parameters_apply_to_a_goal_that_is_active() -> None:
    finger = closing(stop=0.02)
    for _ in range(100):
        assert finger.cycle() == []
    finger.gripper.configure(GripperConfig("finger", goal_tolerance=0.021))
    assert finger.outcome(1)[:3] == ("mine", SUCCESSFUL, REACHED)


def test_what_is_refused() -> None:
    gripper = Finger().gripper
    assert gripper.problems([OPEN]) == []
    text = "command.position: finger: 0.06 is above the joint's limit 0.05"
    assert gripper.problems([0.06]) == [text]
