"""onebot_description.joints.mimic: joints that follow others."""

import numpy as np
import pytest

from onebot_description.joints.config import JointsConfig
from onebot_description.joints.source import JointStateSource
from onebot_description.parameters.reader import ConfigError
from tests.onebot_description.joints_support import joint, mimic

CHAIN = [
    joint("a", mimic=mimic("b", -1.0)),
    joint("b", mimic=mimic("c", 1.0, 0.1)),
    joint("c"),
]


def refused(joints: list, config: JointsConfig | None = None) -> str:
    """The message with which the robot is refused."""
    with pytest.raises(ConfigError) as caught:
        JointStateSource(joints, config)
    return str(caught.value)


def test_chains_resolve_in_any_order() -> None:
    """The golden case of the standard node, 0, 0.1 and -0.1, though named from the far end."""
    positions, _ = JointStateSource(CHAIN).sample(0.0)
    assert positions == pytest.approx([-0.1, 0.1, 0.0])


def test_velocity_is_scaled_by_the_factor() -> None:
    """A follower moves as fast as its leader times the factor."""
    joints = [joint("a", mimic=mimic("b", -2.0), velocity=5.0), joint("b", velocity=0.25)]
    config = JointsConfig.from_parameters({"motions": {"b": {"position": 0.5}}})
    source = JointStateSource(joints, config)
    source.sample(0.0)
    positions, velocities = source.sample(0.5)
    assert positions == pytest.approx([-0.25, 0.125])
    assert velocities == pytest.approx([-0.5, 0.25])


def test_a_circle_is_an_error() -> None:
    """The message goes round it."""
    joints = [
        joint("a", mimic=mimic("b")),
        joint("b", mimic=mimic("c")),
        joint("c", mimic=mimic("b")),
    ]
    assert "circle: b -> c -> b" in refused(joints)


def test_following_itself_is_an_error() -> None:
    """The shortest circle."""
    assert "circle: a -> a" in refused([joint("a", mimic=mimic("a"))])


def test_following_a_missing_joint_is_an_error() -> None:
    """The message suggests the joint meant."""
    joints = [joint("finger"), joint("thumb", mimic=mimic("fingr"))]
    assert 'follows "fingr", which does not exist (did you mean "finger"?' in refused(joints)


def test_following_a_fixed_joint_is_an_error() -> None:
    """The message says that it is fixed."""
    joints = [joint("base", "fixed"), joint("thumb", mimic=mimic("base"))]
    assert 'follows "base", which is fixed' in refused(joints)


def test_use_mimic_tags_false_lets_every_joint_move_alone() -> None:
    """Even where the tags make no sense."""
    joints = [joint("thumb", mimic=mimic("nothing"))]
    config = JointsConfig.from_parameters({"use_mimic_tags": False, "zeros.thumb": 0.25})
    assert JointStateSource(joints, config).sample(0.0)[0] == [0.25]


def test_dependent_joints_make_a_joint_follow() -> None:
    """As a mimic tag does, and they come before one."""
    joints = [joint("a"), joint("b", mimic=mimic("a")), joint("c")]
    written = {"b": {"parent": "c", "factor": 0.5, "offset": 0.25}, "a": {"parent": "b"}}
    config = JointsConfig.from_parameters({"dependent_joints": written, "zeros.c": 0.5})
    assert JointStateSource(joints, config).sample(0.0)[0] == pytest.approx([0.5, 0.5, 0.5])


def test_a_dependent_joint_that_is_missing_is_an_error() -> None:
    """It lists what there is."""
    config = JointsConfig.from_parameters({"dependent_joints.x.parent": "a"})
    assert 'dependent_joints.x: the robot has no joint "x"' in refused([joint("a")], config)


def test_followers_keep_their_own_limits() -> None:
    """The leader goes only as far, and as fast, as its follower can."""
    joints = [joint("a"), joint("b", mimic=mimic("a", 2.0), velocity=0.5)]
    config = JointsConfig.from_parameters({"motions": {"a": {"position": 1.0}}})
    source = JointStateSource(joints, config)
    source.sample(0.0)
    positions, velocities = source.sample(1.0)
    assert positions == pytest.approx([0.25, 0.5])
    assert velocities == pytest.approx([0.25, 0.5])
    positions, _ = source.sample(100.0)
    assert positions == pytest.approx([0.5, 1.0])
    assert any("both keep to [-0.5, 0.5]" in report.text for report in source.reports)


@pytest.mark.parametrize("multiplier", [1.0, 0.0])
def test_limits_that_contradict_are_an_error(multiplier: float) -> None:
    """No position of the leader suits its follower."""
    joints = [joint("a"), joint("b", mimic=mimic("a", multiplier, 3.0))]
    assert "no position suits both" in refused(joints)


def test_a_follower_cannot_have_a_motion() -> None:
    """The message names the joint to move instead."""
    config = JointsConfig.from_parameters({"motions.a.position": 0.5})
    assert 'joint "a" follows "b"; move that one' in refused(CHAIN, config)


def test_a_follower_takes_to_a_new_leader_without_a_jump() -> None:
    """Setting dependent_joints on a running node keeps to the velocity limit."""
    source = JointStateSource([joint("a"), joint("b")])
    source.sample(0.0)
    config = JointsConfig.from_parameters({"dependent_joints.b": {"parent": "a", "offset": 1.0}})
    source.configure(config)
    positions, velocities = source.sample(1.0)
    assert np.allclose(positions, [0.0, 0.5])
    assert np.allclose(velocities, [0.0, 0.5])
    assert np.allclose(source.sample(3.0)[0], [0.0, 1.0])
