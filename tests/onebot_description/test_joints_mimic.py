"""onebot_description.joints.mimic: joints that follow others."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_description.joints.config import JointsConfig
from onebot_description.joints.source import JointStateSource
from onebot_description.parameters.reader import ConfigError, read
from tests.onebot_description.joints_support import (
    configure,
    constant,
    joint,
    mimic,
    rest_of,
    source_from,
)


def refused(joints: list, parameters: dict) -> str:
    """The message with which parameters are refused; without them the robot is accepted."""
    JointStateSource(joints)
    config = read(JointsConfig, parameters)
    with pytest.raises(ConfigError) as caught:
        JointStateSource(joints, config)
    reports = JointStateSource(joints, config, tolerant=True).reports
    assert set(caught.value.problems) <= set(reports)
    return str(caught.value)


def reported(joints: list) -> list[str]:
    """The warnings about a robot, whose joints all move."""
    source = JointStateSource(joints)
    assert np.isfinite(source.sample(1.0)[0]).all()
    return [report.text for report in source.reports]


def test_a_circle_is_opened_and_reported() -> None:
    joints = [
        joint("a", mimic=mimic("b")),
        joint("b", mimic=mimic("c")),
        joint("c", mimic=mimic("b")),
        joint("d", mimic=mimic("d")),
    ]
    first, second = reported(joints)
    assert "circle: b -> c -> b" in first and "circle: d -> d" in second
    assert rest_of(joints, {"zeros.b": 0.5}) == pytest.approx([0.5, 0.5, 0.5, 0.0])


def test_a_circle_by_dependent_joints_is_refused() -> None:
    joints = [joint("a", mimic=mimic("b")), joint("b")]
    parameters = {"dependent_joints.b.parent": "a", "zeros.b": 0.5}
    assert "dependent_joints.b: joints follow one another" in refused(joints, parameters)
    config = read(JointsConfig, parameters)
    source = JointStateSource(joints, config, tolerant=True)
    assert source.sample(0.0)[0] == pytest.approx([0.5, 0.5])


def test_following_a_missing_joint_is_reported() -> None:
    joints = [joint("finger"), joint("thumb", mimic=mimic("fingr"))]
    [text] = reported(joints)
    assert 'but the robot has no joint "fingr" (did you mean "finger"?' in text
    said = 'dependent_joints.finger: joint "finger" follows "hand", but the robot has no'
    assert said in refused(joints, {"dependent_joints.finger.parent": "hand"})


def test_use_mimic_tags_false_lets_every_joint_move_alone() -> None:
    joints = [joint("thumb", mimic=mimic("nothing"))]
    assert rest_of(joints, {"use_mimic_tags": False, "zeros.thumb": 0.25}) == [0.25]


def test_dependent_joints_make_a_joint_follow() -> None:
    joints = [joint("a"), joint("b", mimic=mimic("a")), joint("c")]
    written = {"b": {"parent": "c", "factor": 0.5, "offset": 0.25}, "a": {"parent": "b"}}
    assert rest_of(joints, {"dependent_joints": written, "zeros.c": 0.5}) == pytest.approx(
        [0.5, 0.5, 0.5]
    )


def test_a_dependent_joint_that_is_missing_is_an_error() -> None:
    text = refused([joint("a")], {"dependent_joints.x.parent": "a"})
    assert 'dependent_joints.x: the robot has no joint "x"' in text


@pytest.mark.parametrize("multiplier", [1.0, 0.0])
def test_limits_that_contradict_are_reported(multiplier: float) -> None:
    joints = [joint("a"), joint("b", mimic=mimic("a", multiplier, 3.0))]
    [text] = reported(joints)
    assert "no position is within the limits of both" in text
    assert rest_of(joints, {"zeros.b": 0.25}) == pytest.approx([0.0, 0.25])
    joints[1] = joint("b")
    written = {"parent": "a", "factor": multiplier, "offset": 3.0}
    assert refused(joints, {"dependent_joints.b": written}).startswith("dependent_joints.b: ")


def test_a_follower_takes_to_a_new_leader_without_a_jump() -> None:
    source = JointStateSource([joint("a"), joint("b")])
    source.sample(0.0)
    configure(source, {"dependent_joints.b": {"parent": "a", "offset": 1.0}})
    positions, velocities = source.sample(1.0)
    assert np.allclose(positions, [0.0, 0.5])
    assert np.allclose(velocities, [0.0, 0.5])
    assert np.allclose(source.sample(3.0)[0], [0.0, 1.0])


_factor = st.sampled_from([-2.0, -0.5, 0.25, 1.0, 3.0])
_offset = st.sampled_from([-0.125, 0.0, 0.25])


@given(st.lists(st.tuples(_factor, _offset), min_size=1, max_size=4), st.floats(-1.0, 1.0))
def test_each_joint_of_a_chain_follows_the_one_before(
    links: list[tuple[float, float]], position: float
) -> None:
    joints = [joint("j0", velocity=0.5)]
    for number, (factor, offset) in enumerate(links):
        wide = {"lower": -1e3, "upper": 1e3, "velocity": 1e3}
        joints.append(joint(f"j{number + 1}", mimic=mimic(f"j{number}", factor, offset), **wide))
    reverse = joints[::-1]  # the leader comes last
    source = source_from(reverse, {"motions": {"j0": constant(position)}})
    for moment in (0.0, 0.5, 10.0):
        positions, velocities = (values[::-1] for values in source.sample(moment))
        for number, (factor, offset) in enumerate(links):
            assert positions[number + 1] == pytest.approx(positions[number] * factor + offset)
            assert velocities[number + 1] == pytest.approx(velocities[number] * factor)
    assert positions[0] == pytest.approx(position)


@given(st.lists(st.tuples(_factor, _offset), min_size=1, max_size=3), st.sampled_from([-1.0, 1.0]))
def test_a_leader_goes_as_far_and_as_fast_as_the_narrowest_follower(
    links: list[tuple[float, float]], toward: float
) -> None:
    joints = [joint("leader", lower=-2.0, upper=2.0, velocity=0.5)]
    joints += [
        joint(
            f"f{number}",
            lower=-0.5 - number,
            upper=0.75,
            velocity=0.4,
            mimic=mimic("leader", *link),
        )
        for number, link in enumerate(links)
    ]
    ends = [(-2.0, 2.0)]
    for number, (factor, offset) in enumerate(links):
        pair = [(-0.5 - number - offset) / factor, (0.75 - offset) / factor]
        ends.append((min(pair), max(pair)))
    reached = max(low for low, _ in ends) if toward < 0 else min(high for _, high in ends)
    speed = min([0.5, *(0.4 / abs(factor) for factor, _ in links)])
    source = source_from(joints, {"motions": {"leader": constant(9.0 * toward)}})
    start = source.sample(0.0)[0][0]
    positions, velocities = source.sample(1e-3)
    assert velocities[0] == pytest.approx(toward * speed)
    assert positions[0] == pytest.approx(start + toward * speed * 1e-3)
    assert source.sample(1e3)[0][0] == pytest.approx(reached)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("end", [-1.0, 1.0])
def test_a_follower_that_never_moves_narrows_nothing(end: float) -> None:
    joints = [joint("a"), joint("b", velocity=0.0, mimic=mimic("a", 0.0, end))]
    source = source_from(joints, {"motions": {"a": constant(1.0)}})
    source.sample(0.0)
    assert source.sample(1.0)[0] == pytest.approx([0.5, end])
    assert source.reports == ()


@pytest.mark.filterwarnings("error")
def test_a_joint_without_end_keeps_to_the_limits_of_its_follower() -> None:
    free = joint("free", "continuous", mimic=mimic("wheel"))
    bound = joint("bound", mimic=mimic("wheel", 2.0))
    source = source_from([joint("wheel", "continuous"), free, bound], {"zeros.wheel": 9.0})
    assert source.sample(0.0)[0] == pytest.approx([0.5, 0.5, 1.0])
