"""onebot_description.joints.motion_limits: how far joints go, and where they rest."""

import math

import pytest

from onebot_description.joints import motion_limits as limits_module
from onebot_description.joints.motion_limits import JointLimits, movable, zero_position
from tests.onebot_description.joints_support import joint


def joint_limits(joints: list, *, soft: bool) -> JointLimits:
    """The limits of joints that have nothing wrong."""
    limits, problems = limits_module.joint_limits(joints, soft=soft)
    assert problems == []
    return limits


def test_only_joints_with_one_position_move() -> None:
    kinds = ["prismatic", "fixed", "floating", "planar", "continuous", "revolute"]
    joints = [joint(kind, kind) for kind in kinds]
    assert [j.name for j in movable(joints)] == ["prismatic", "continuous", "revolute"]


def test_soft_limits_narrow_hard_ones_where_asked() -> None:
    joints = [joint("a", soft_lower=-0.5, soft_upper=5.0), joint("b"), joint("c", soft_upper=0.25)]
    limits = joint_limits(joints, soft=True)
    assert limits.lower.tolist() == [-0.5, -1.0, -1.0]
    assert limits.upper.tolist() == [1.0, 1.0, 0.25]
    assert limits.velocity.tolist() == [0.5, 0.5, 0.5]
    hard = joint_limits(joints, soft=False)
    assert hard.lower.tolist() == [-1.0] * 3 and hard.upper.tolist() == [1.0] * 3


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("missing", [("lower",), ("upper",), ("lower", "upper")])
def test_a_joint_without_limits_stays(kind: str, missing: tuple[str, ...]) -> None:
    """The message is that of the standard node."""
    joints = [joint("j12", kind, **dict.fromkeys(missing))]
    limits, [problem] = limits_module.joint_limits(joints, soft=True)
    assert problem.text.startswith(f'Limits must be specified for joint "j12" of type "{kind}"')
    assert not problem.key
    assert (limits.lower.tolist(), limits.upper.tolist()) == ([0.0], [0.0])


@pytest.mark.parametrize(
    ("lower", "upper", "zero"),
    [
        (-1.0, 1.0, 0.0),
        (1.0, 2.0, 1.5),
        (-math.inf, math.inf, 0.0),
    ],
)
def test_joints_rest_at_zero_or_mid_range(lower: float, upper: float, zero: float) -> None:
    assert zero_position(lower, upper) == zero


@pytest.mark.parametrize(
    ("soft_lower", "soft_upper", "ends"),
    [(1.0, 5.0, (1.0, 1.0)), (-5.0, -1.0, (-1.0, -1.0)), (1.5, 5.0, (-1.0, 1.0))],
)
def test_soft_limits_may_leave_a_single_position_and_no_less(
    soft_lower: float, soft_upper: float, ends: tuple[float, float]
) -> None:
    soft = joint("a", soft_lower=soft_lower, soft_upper=soft_upper)
    limits = joint_limits([soft], soft=True)
    assert (limits.lower[0], limits.upper[0]) == ends


def test_a_continuous_joint_has_speed_alone() -> None:
    soft = {"soft_lower": -0.5, "soft_upper": 0.5}
    one = joint("a", "continuous", lower=-1.0, upper=1.0, **soft)
    limits = joint_limits([one], soft=True)
    assert (limits.lower.tolist(), limits.upper.tolist()) == ([-math.inf], [math.inf])
    assert limits.velocity.tolist() == [0.5]


def test_speed_limits() -> None:
    joints = [
        joint(name, velocity=value) for name, value in zip("abc", (None, 0.0, -1.0), strict=True)
    ]
    assert joint_limits(joints, soft=True).velocity.tolist() == [math.inf, 0.0, 0.0]
