"""onebot_description.joints.limits: how far joints go, and where they rest."""

import math

import pytest

from onebot_description.joints import limits as limits_module
from onebot_description.joints.limits import JointLimits, movable, zero_position
from tests.onebot_description.joints_support import joint


def joint_limits(joints: list, *, soft: bool) -> JointLimits:
    """The limits of joints that have nothing wrong."""
    limits, problems = limits_module.joint_limits(joints, soft=soft)
    assert problems == []
    return limits


def reported(joints: list) -> tuple[JointLimits, str]:
    """The limits of joints that have something wrong, and what it is."""
    limits, problems = limits_module.joint_limits(joints, soft=True)
    assert not any(problem.key for problem in problems)
    return limits, "\n".join(problem.text for problem in problems)


def test_only_joints_with_one_position_move() -> None:
    """Fixed, floating and planar joints are left out; the order stays."""
    kinds = ["prismatic", "fixed", "floating", "planar", "continuous", "revolute"]
    joints = [joint(kind, kind) for kind in kinds]
    assert [j.name for j in movable(joints)] == ["prismatic", "continuous", "revolute"]


def test_soft_limits_narrow_hard_ones_where_asked() -> None:
    """They never widen them, and one that is not given does not limit."""
    joints = [joint("a", soft_lower=-0.5, soft_upper=5.0), joint("b"), joint("c", soft_upper=0.25)]
    limits = joint_limits(joints, soft=True)
    assert limits.lower.tolist() == [-0.5, -1.0, -1.0]
    assert limits.upper.tolist() == [1.0, 1.0, 0.25]
    assert limits.velocity.tolist() == [0.5, 0.5, 0.5]
    hard = joint_limits(joints, soft=False)
    assert hard.lower.tolist() == [-1.0] * 3 and hard.upper.tolist() == [1.0] * 3


def test_soft_limits_that_leave_no_range_are_not_applied() -> None:
    """The message says what to change."""
    limits, text = reported([joint("a", soft_lower=2.0, soft_upper=3.0)])
    assert "not applied: correct its safety_controller" in text
    assert (limits.lower.tolist(), limits.upper.tolist()) == ([-1.0], [1.0])


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("missing", [("lower",), ("upper",), ("lower", "upper")])
def test_a_joint_without_limits_stays(kind: str, missing: tuple[str, ...]) -> None:
    """The message is that of the standard node."""
    limits, text = reported([joint("j12", kind, **dict.fromkeys(missing))])
    assert text.startswith(f'Limits must be specified for joint "j12" of type "{kind}"')
    assert (limits.lower.tolist(), limits.upper.tolist()) == ([0.0], [0.0])


def test_no_joints_have_no_limits() -> None:
    """An empty robot gives empty arrays."""
    assert joint_limits([], soft=True).lower.shape == (0,)


@pytest.mark.parametrize(
    ("lower", "upper", "zero"),
    [(-1.0, 1.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (1.0, 2.0, 1.5), (-3.0, -1.0, -2.0)],
)
def test_joints_rest_at_zero_or_mid_range(lower: float, upper: float, zero: float) -> None:
    """The middle only if 0 is out of range."""
    assert zero_position(lower, upper) == zero


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_limits_may_leave_a_single_position(kind: str) -> None:
    """Soft and hard limits that meet are no contradiction; a hair beyond they are."""
    limits = joint_limits([joint("a", kind, soft_lower=1.0, soft_upper=5.0)], soft=True)
    assert (limits.lower.tolist(), limits.upper.tolist()) == ([1.0], [1.0])
    limits = joint_limits([joint("a", kind, soft_lower=-5.0, soft_upper=-1.0)], soft=True)
    assert (limits.lower.tolist(), limits.upper.tolist()) == ([-1.0], [-1.0])
    _, text = reported([joint("a", kind, soft_lower=1.5, soft_upper=5.0)])
    assert "limits [-1, 1] and soft limits [1.5, 5]" in text


def test_one_sided_soft_limits_leave_the_other_side() -> None:
    """Each side for itself, and each joint for itself."""
    joints = [joint("a", soft_lower=-0.5), joint("b", soft_upper=0.5), joint("c")]
    limits = joint_limits(joints, soft=True)
    assert limits.lower.tolist() == [-0.5, -1.0, -1.0]
    assert limits.upper.tolist() == [1.0, 0.5, 1.0]


def test_a_continuous_joint_has_speed_alone() -> None:
    """Soft limits, and what a limit says, do not end its turning."""
    soft = {"soft_lower": -0.5, "soft_upper": 0.5}
    one = joint("a", "continuous", lower=-1.0, upper=1.0, **soft)
    limits = joint_limits([one], soft=True)
    assert (limits.lower.tolist(), limits.upper.tolist()) == ([-math.inf], [math.inf])
    assert limits.velocity.tolist() == [0.5]


def test_speed_limits() -> None:
    """None is no limit, zero is one, and below zero there is none."""
    joints = [
        joint(name, velocity=value) for name, value in zip("abc", (None, 0.0, -1.0), strict=True)
    ]
    assert joint_limits(joints, soft=True).velocity.tolist() == [math.inf, 0.0, 0.0]


def test_every_joint_without_limits_is_reported() -> None:
    """At once, also where only one end is missing."""
    joints = [joint("a", lower=None), joint("b"), joint("c", upper=None)]
    _, text = reported(joints)
    assert [name in text for name in ('"a"', '"b"', '"c"')] == [True, False, True]


def test_copied_limits_are_independent() -> None:
    """Narrowing the copy changes nothing else."""
    limits = joint_limits([joint("a")], soft=True)
    copy = limits.copy()
    assert (copy.lower[0], copy.upper[0], copy.velocity[0]) == (-1.0, 1.0, 0.5)
    copy.lower[0], copy.upper[0], copy.velocity[0] = 0.0, 0.0, 0.0
    assert (limits.lower[0], limits.upper[0], limits.velocity[0]) == (-1.0, 1.0, 0.5)


@pytest.mark.parametrize(
    ("lower", "upper", "zero"),
    [(-1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (-math.inf, math.inf, 0.0), (1e-9, 1.0, 0.5 + 5e-10)],
)
def test_zero_at_the_edge_is_in_range(lower: float, upper: float, zero: float) -> None:
    """Beyond it the middle is taken."""
    assert zero_position(lower, upper) == pytest.approx(zero, abs=1e-15)


def test_soft_limits_that_leave_one_position_are_accepted() -> None:
    """The joint stands there; every joint that has none left is named."""
    limits = joint_limits([joint("a", soft_lower=0.5, soft_upper=0.5)], soft=True)
    assert (limits.lower[0], limits.upper[0]) == (0.5, 0.5)
    _, text = reported(
        [
            joint("a", soft_lower=0.5, soft_upper=0.4),
            joint("b"),
            joint("c", soft_lower=2.0, soft_upper=9.0),
        ]
    )
    assert [line.split('"')[1] for line in text.splitlines()] == ["a", "c"]
