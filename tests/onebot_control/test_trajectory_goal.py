"""Goals of trajectories: why they are refused, their tolerances and the parameters."""

import math
from typing import Any

import pytest

from onebot_control.trajectories.config import (
    JointConstraint,
    TrajectoryConfig,
)
from onebot_control.trajectories.goal import FollowedJoint, TrajectoryGoal, goal_problems
from onebot_control.trajectories.tolerances import (
    Tolerances,
    TolerancesGiven,
    default_tolerances,
    exceeded,
    resolved_tolerances,
    tolerance_problems,
)
from onebot_control.trajectories.trajectory import Waypoint
from onebot_description.parameters.reader import ConfigError, read, unknown_parameters

SHOULDER, ELBOW = FollowedJoint("shoulder", True), FollowedJoint("elbow", False, -1.5, 2.5)
NAMES = ("shoulder", "elbow")
NOW = 1_700_000_000_000_000_000  # ns
RESTING = Waypoint(1.0, (0.1, 0.2), (0.0, 0.0), (0.0, 0.0))


def problems(*points: Waypoint, joints: tuple[str, ...] = NAMES, **values: Any) -> list[str]:
    """Why a goal is refused; ``values`` are the goal's own fields and parameters."""
    fields = {name: values.pop(name) for name in TrajectoryGoal._fields if name in values}
    goal = TrajectoryGoal(joints, points, **fields)
    return goal_problems(goal, [SHOULDER, ELBOW], read(TrajectoryConfig, values), NOW)


def test_what_is_accepted() -> None:
    """The first point may be at 0 s, joints in any order, a limit rounded to a float32 is met."""
    assert not problems(RESTING)
    assert not problems(Waypoint(0.0, (0.1, 0.2)), Waypoint(1e-9, (99.0, 2.5000001)))
    assert not problems(Waypoint(1.0, (2.5, 99.0)), joints=("elbow", "shoulder"))
    assert not problems(Waypoint(1.0, (2.5,)), joints=("elbow",), allow_partial_joints_goal=True)
    assert not problems(Waypoint(1.0, (0.1, 0.2), (1e-7, -1e-7)))
    assert not problems(Waypoint(1.0, (0.0, 99.0)), enforce_command_limits=False)


@pytest.mark.parametrize(
    ("joints", "partial", "expected"),
    [
        ((), False, ["joint_names is empty"]),
        (
            ("elbow",),
            False,
            ['joint_names: "shoulder" is missing, and allow_partial_joints_goal is false'],
        ),
        (
            ("shoulder", "elbo"),
            True,
            [
                'joint_names: "elbo" is not a joint of the controller '
                '(did you mean "elbow"? known: elbow, shoulder)'
            ],
        ),
        (
            ("elbow", "elbow"),
            False,
            [
                'joint_names: "elbow" occurs twice',
                'joint_names: "shoulder" is missing, and allow_partial_joints_goal is false',
            ],
        ),
    ],
)
def test_joint_names(joints: tuple[str, ...], partial: bool, expected: list[str]) -> None:
    point = Waypoint(1.0, (0.5,) * len(joints))
    assert problems(point, joints=joints, allow_partial_joints_goal=partial) == expected


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        (Waypoint(2.0, ()), "positions: 0 values for 2 joints"),
        (Waypoint(2.0, (0.5,) * 2, (0.0,)), "velocities: 1 values for 2 joints"),
        (Waypoint(2.0, (0.5, math.nan)), "positions: elbow: nan is not finite"),
        (Waypoint(2.0, (1e61, 0.5)), "positions: shoulder: 1e+61 is beyond 1e+60"),
        (Waypoint(2.0, (9.0, 2.51)), "positions: elbow: 2.51 is above the joint's limit 2.5"),
        (Waypoint(2.0, (9.0, -1.51)), "positions: elbow: -1.51 is below the joint's limit -1.5"),
        (
            Waypoint(2.0, (0.5,) * 2, (0.0, 2e-7)),
            "velocities: elbow: 2e-07 is not 0 at the end, "
            "and allow_nonzero_velocity_at_trajectory_end is false",
        ),
        (Waypoint(1.0, (0.5,) * 2), "time_from_start: 1 s is not after the 1 s of points[0]"),
    ],
)
def test_wrong_points(point: Waypoint, expected: str) -> None:
    """One line each, which names point, field, joint and value."""
    assert problems(RESTING, point) == [f"points[1].{expected}"]


def test_points_that_are_integrated() -> None:
    """A point may have any of the three, of the right size; one with none is refused."""
    allowed = {"allow_integration_in_goal_trajectories": True}
    rates = Waypoint(0.5, (), (0.1, 0.2)), Waypoint(1.0, (), (), (0.3, 0.4))
    assert not problems(*rates, Waypoint(2.0, (), (0.0, 0.0)), **allowed)
    assert problems(*rates) == [
        f"points[{index}].positions: 0 values for 2 joints" for index in range(2)
    ]
    for point, expected in (
        (Waypoint(2.0, ()), "positions: 0 values for 2 joints"),
        (Waypoint(2.0, (0.1,), (0.0, 0.0)), "positions: 1 values for 2 joints"),
        (Waypoint(2.0, (), (0.0,)), "velocities: 1 values for 2 joints"),
        (Waypoint(2.0, (), (), (0.0,) * 3), "accelerations: 3 values for 2 joints"),
        (Waypoint(2.0, (), (), (0.0, math.nan)), "accelerations: elbow: nan is not finite"),
    ):
        assert problems(*rates, point, **allowed) == [f"points[2].{expected}"]


@pytest.mark.parametrize("names", [[f"joint{row}" for row in range(50_000)], ["elbow"] * 50_000])
def test_many_names(names: list[str]) -> None:
    """Checking them takes no longer than a few comparisons each."""
    lines = problems(Waypoint(1.0, (0.5,) * len(names)), joints=tuple(names))
    assert len(lines) == (50_002 if len(set(names)) > 1 else 2)
    tolerances = TolerancesGiven(dict.fromkeys(names, (0.1,)))
    assert len(tolerance_problems(tolerances, NAMES)) == (50_000 if len(set(names)) > 1 else 0)


def test_velocities_that_are_nan_are_refused_anywhere() -> None:
    """At the last point, and where only others would be allowed."""
    moving = Waypoint(2.0, (0.5,) * 2, (math.nan, 0.3))
    line = "points[1].velocities: shoulder: nan is not finite"
    allowed = {"allow_nonzero_velocity_at_trajectory_end": True}
    assert problems(RESTING, moving, **allowed) == [line]
    assert problems(RESTING, moving, Waypoint(3.0, (0.5,) * 2)) == [line]


def test_velocities_on_the_way_and_allowed_ones_at_the_end() -> None:
    moving = Waypoint(0.5, (0.5,) * 2, (0.3, 0.3))
    assert not problems(moving, RESTING)
    assert not problems(moving, allow_nonzero_velocity_at_trajectory_end=True)
    assert len(problems(moving)) == 2


def test_a_negative_first_time() -> None:
    assert problems(Waypoint(-1.0, (0.5,) * 2), RESTING) == [
        "points[0].time_from_start: -1 s is negative"
    ]


def test_efforts() -> None:
    assert problems(RESTING, has_efforts=True) == [
        "effort is given, but only positions are commanded"
    ]


def test_the_end_may_not_be_past() -> None:
    """By a nanosecond, however great the stamps are; a stamp of 0 is no time."""
    assert not problems(RESTING, stamp=NOW - 1_000_000_000)
    assert problems(RESTING, stamp=NOW - 1_000_000_001) == [
        "header.stamp: the trajectory ended 1e-09 s ago"
    ]
    assert problems(RESTING, stamp=1_000_000_000) == [
        "header.stamp: the trajectory ended 1.7e+09 s ago"
    ]
    assert not problems(RESTING, stamp=0)
    assert not problems(RESTING, stamp=NOW + 10**9)


def test_all_that_is_wrong_is_reported() -> None:
    lines = problems(
        Waypoint(-1.0, (math.nan, 3.0)), Waypoint(-1.0, (0.5,), (0.1,)), joints=("elbow", "knee")
    )
    assert len(lines) == 8 and all("\n" not in line for line in lines)


# Tolerances -----------------------------------------------------------------------------------

DEFAULTS = Tolerances((0.1, 0.2), (0.01, 0.02), 0.5)


def test_default_tolerances() -> None:
    """A joint without constraints has none."""
    config = read(TrajectoryConfig, {"constraints.goal_time": 0.5})
    constraints = JointConstraint(), JointConstraint(0.2, 0.02)
    assert default_tolerances(constraints, config) == ((0.0, 0.2), (0.0, 0.02), 0.5)


@pytest.mark.parametrize(
    ("given", "expected"),
    [(0.0, 0.2), (0.3, 0.3), (math.inf, math.inf), (-1.0, 0.0), (-1.00000001, 0.0)],
)
def test_tolerances_of_a_goal(given: float, expected: float) -> None:
    """0 is the default, a positive one replaces it, -1 is none; other joints have their default."""
    tolerances = {"elbow": (given, 0.1, -1.0)}
    path = resolved_tolerances(TolerancesGiven(tolerances), NAMES, DEFAULTS)
    assert path == DEFAULTS._replace(path=(0.1, expected))
    defaults = DEFAULTS._replace(goal=DEFAULTS.path)
    goal = resolved_tolerances(TolerancesGiven(goal=tolerances), NAMES, defaults)
    assert goal == defaults._replace(goal=(0.1, expected))


@pytest.mark.parametrize(("given", "expected"), [(0.0, 0.5), (2.0, 2.0), (-1.0, 0.0)])
def test_goal_time_of_a_goal(given: float, expected: float) -> None:
    resolved = resolved_tolerances(TolerancesGiven(goal_time=given), NAMES, DEFAULTS)
    assert resolved == DEFAULTS._replace(goal_time=expected)


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        (
            {"path": {"wrist": (0.5,)}},
            'path_tolerance: "wrist" is not a joint of the controller (known: elbow, shoulder)',
        ),
        (
            {"goal": {"elbow": (0.5, -2.0, 0.0)}},
            "goal_tolerance: elbow: velocity -2 is neither 0 (the default), nor above 0, "
            "nor -1 (none)",
        ),
        (
            {"goal_time": -0.5},
            "goal_time_tolerance -0.5 is neither 0 (the default), nor above 0, nor -1 (none)",
        ),
    ],
)
def test_one_wrong_tolerance_makes_all_the_defaults(wrong: dict[str, Any], expected: str) -> None:
    right = TolerancesGiven({"shoulder": (9.0,)}, {"shoulder": (9.0,)}, 9.0)
    assert resolved_tolerances(right, NAMES, DEFAULTS) == ((9.0, 0.2), (9.0, 0.02), 9.0)
    given = right._replace(**wrong)
    assert resolved_tolerances(given, NAMES, DEFAULTS) == DEFAULTS
    assert tolerance_problems(given, NAMES) == [f"{expected}; the default tolerances are used"]


def test_exceeded() -> None:
    """A tolerance itself is allowed, on either side; 0 allows everything."""
    assert exceeded(NAMES, (9.0, 0.2), (0.0, 0.2)) == ""
    assert exceeded(NAMES, (9.0, -0.2), (0.0, 0.2)) == ""
    expected = "elbow: position error -0.21, tolerance 0.2"
    assert exceeded(NAMES, (9.0, -0.21), (0.0, 0.2)) == expected


# Parameters -----------------------------------------------------------------------------------


def problem(values: dict[str, Any]) -> str:
    """The error of wrong parameters."""
    with pytest.raises(ConfigError) as caught:
        read(TrajectoryConfig, values)
    return str(caught.value)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (
            {"command_interfaces": ["positon"]},
            'command_interfaces: no "positon" (did you mean "position"? '
            "known: acceleration, effort, position, velocity)",
        ),
        (
            {"gains.elbow.kp": 1.0},
            'gains.elbow.kp: no such parameter (did you mean "p"? known: angle_wraparound, '
            "antiwindup_strategy, d, error_deadband, ff_velocity_scale, i, i_clamp, i_clamp_max, "
            "i_clamp_min, normalize_error, p, tracking_time_constant, and 2 more)",
        ),
        (
            {"constraints.goal_tim": 0.1},
            'constraints.goal_tim: no such parameter (did you mean "goal_time"? '
            "known: decelerate_on_cancel, goal_time, stopped_velocity_tolerance)",
        ),
    ],
)
def test_wrong_parameters(values: dict[str, Any], expected: str) -> None:
    assert problem(values) == expected
    names = [problem.key for problem in unknown_parameters(TrajectoryConfig, values)]
    assert names == [name for name in values if "no such parameter" in expected]
