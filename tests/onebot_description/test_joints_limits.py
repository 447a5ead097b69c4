"""onebot_description.joints.limits: how far joints go, and where they rest."""

import math

import pytest

from onebot_description.joints.limits import joint_limits, movable, soft_limits, zero_position
from onebot_description.parameters.reader import ConfigError
from tests.onebot_description.joints_support import joint

URDF = """<robot name="r">
  <joint name="a"><safety_controller soft_lower_limit="-0.5" soft_upper_limit="0.5"/></joint>
  <joint name="b"><safety_controller k_velocity="1" soft_upper_limit="0.25"/></joint>
  <joint name="c"/>
</robot>"""


def test_only_joints_with_one_position_move() -> None:
    """Fixed, floating and planar joints are left out; the order stays."""
    kinds = ["prismatic", "fixed", "floating", "planar", "continuous", "revolute"]
    joints = [joint(kind, kind) for kind in kinds]
    assert [j.name for j in movable(joints)] == ["prismatic", "continuous", "revolute"]


def test_soft_limits_are_read() -> None:
    """What is not given does not limit."""
    assert soft_limits(URDF) == {"a": (-0.5, 0.5), "b": (-math.inf, 0.25)}


def test_a_soft_limit_that_is_no_number_is_refused() -> None:
    """The message names joint and attribute."""
    with pytest.raises(ConfigError, match='joint "a": soft_lower_limit="x"'):
        soft_limits(URDF.replace("-0.5", "x"))


def test_the_smaller_limit_counts() -> None:
    """Soft limits narrow hard ones and never widen them."""
    limits = joint_limits([joint("a"), joint("b")], {"a": (-0.5, 5.0)})
    assert limits.lower.tolist() == [-0.5, -1.0]
    assert limits.upper.tolist() == [1.0, 1.0]
    assert limits.velocity.tolist() == [0.5, 0.5]


def test_soft_limits_that_leave_no_range_are_refused() -> None:
    """The message says how to go on."""
    with pytest.raises(ConfigError, match="use_smallest_joint_limits to false"):
        joint_limits([joint("a")], {"a": (2.0, 3.0)})


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_limits_are_needed(kind: str) -> None:
    """The message is that of the standard node."""
    text = f'Limits must be specified for joint "j12" of type "{kind}"'
    with pytest.raises(ConfigError, match=text):
        joint_limits([joint("j12", kind, lower=None, upper=None)], {})


def test_no_joints_have_no_limits() -> None:
    """An empty robot gives empty arrays."""
    assert joint_limits([], {}).lower.shape == (0,)


@pytest.mark.parametrize(
    ("lower", "upper", "zero"),
    [(-1.0, 1.0, 0.0), (0.0, 1.0, 0.0), (1.0, 2.0, 1.5), (-3.0, -1.0, -2.0)],
)
def test_joints_rest_at_zero_or_mid_range(lower: float, upper: float, zero: float) -> None:
    """The middle only if 0 is out of range."""
    assert zero_position(lower, upper) == zero
