"""onebot_description.joints.limits: how far joints go, and where they rest."""

import pytest

from onebot_description.joints.limits import joint_limits, movable, zero_position
from onebot_description.parameters.reader import ConfigError
from tests.onebot_description.joints_support import joint


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


def test_soft_limits_that_leave_no_range_are_refused() -> None:
    """The message says what to change."""
    with pytest.raises(ConfigError, match="use_smallest_joint_limits to false"):
        joint_limits([joint("a", soft_lower=2.0, soft_upper=3.0)], soft=True)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_limits_are_needed(kind: str) -> None:
    """The message is that of the standard node."""
    text = f'Limits must be specified for joint "j12" of type "{kind}"'
    with pytest.raises(ConfigError, match=text):
        joint_limits([joint("j12", kind, lower=None, upper=None)], soft=True)


def test_no_joints_have_no_limits() -> None:
    """An empty robot gives empty arrays."""
    assert joint_limits([], soft=True).lower.shape == (0,)


@pytest.mark.parametrize(
    ("lower", "upper", "zero"),
    [(-1.0, 1.0, 0.0), (0.0, 1.0, 0.0), (1.0, 2.0, 1.5), (-3.0, -1.0, -2.0)],
)
def test_joints_rest_at_zero_or_mid_range(lower: float, upper: float, zero: float) -> None:
    """The middle only if 0 is out of range."""
    assert zero_position(lower, upper) == zero
