"""onebot_description.joints.source and .plan: joints move as asked, within their limits."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_description.joints.config import JointsConfig
from onebot_description.joints.source import JointStateSource, wrapped
from onebot_description.parameters.reader import ConfigError, read
from tests.onebot_description.joints_support import configure, constant, joint, mimic, source_from

ROBOT = [
    joint("base", "fixed"),
    joint("elbow"),
    joint("slide", "prismatic", lower=0.2, upper=0.6, velocity=0.1),
    joint("wheel", "continuous", velocity=2.0),
    joint("finger", lower=0.0, upper=0.65, velocity=0.3),
    joint("thumb", lower=-0.6, upper=0.1, velocity=0.3, mimic=mimic("finger", -1.0, 0.05)),
]
LOWER = np.array([-1.0, 0.2, -math.pi, 0.0, -0.6])
UPPER = np.array([1.0, 0.6, math.pi, 0.65, 0.1])
SPEED = np.array([0.5, 0.1, 2.0, 0.3, 0.3])
LEADERS = ["elbow", "slide", "wheel", "finger"]

_number = st.floats(-10.0, 10.0)
_seconds = st.floats(0.05, 5.0)


def _keyframes(pieces: list[tuple[float, float]], blend: str, loop: bool) -> dict[str, Any]:
    times = np.cumsum([duration for duration, _ in pieces]).tolist()
    return {
        "type": "keyframes",
        "times": times,
        "positions": [position for _, position in pieces],
        "blend": blend,
        "loop": loop,
    }


_blend = st.sampled_from(["linear", "minimum_jerk"])


def _sine(amplitude: float, frequency: float, phase: float, offset: float) -> dict[str, Any]:
    numbers = {"amplitude": amplitude, "frequency": frequency, "phase": phase, "offset": offset}
    return {"type": "sine", **numbers}


_pieces = st.lists(st.tuples(_seconds, _number), min_size=1, max_size=5)
_motion = st.one_of(
    st.builds(constant, _number),
    st.builds(_sine, _number, st.floats(0.0, 20.0), _number, _number),
    st.builds(_keyframes, _pieces, _blend, st.booleans()),
)
_pose = st.dictionaries(st.sampled_from(LEADERS), _number, min_size=1)
_parameters = st.fixed_dictionaries(
    {
        "motions": st.dictionaries(st.sampled_from(LEADERS), _motion),
        "poses": st.fixed_dictionaries({"one": _pose, "two": _pose}),
        "delta": st.sampled_from([0.0, 0.01, 1.0]),
        "pose": st.sampled_from(["", "", "", "one", "two"]),
        "zeros": st.dictionaries(st.sampled_from(LEADERS), _number),
    }
)
_edits = st.lists(
    st.tuples(_parameters, st.lists(st.floats(0.001, 3.0), min_size=1, max_size=20)),
    min_size=1,
    max_size=4,
)


@given(_edits)
def test_limits_are_never_exceeded_and_velocities_integrate(edits: list) -> None:
    source = source_from(ROBOT, edits[0][0])
    now = 0.0
    before, velocities = source.sample(now)
    assert not velocities.any()
    for parameters, steps in edits:
        configure(source, parameters)
        for step in steps:
            now += step
            positions, velocities = source.sample(now)
            assert (positions >= LOWER - 1e-9).all()
            assert (positions <= UPPER + 1e-9).all()
            assert (np.abs(velocities) <= SPEED + 1e-12).all()
            error = positions - before - velocities * step
            error[2] = wrapped(error[2:3])[0]
            assert np.abs(error).max() < 1e-7
            assert positions[4] == pytest.approx(0.05 - positions[3], abs=1e-9)
            before = positions


def source_of(parameters: dict[str, Any]) -> JointStateSource:
    """The robot above, so configured."""
    return source_from(ROBOT, parameters)


def settled(source: JointStateSource, at: float = 1000.0) -> dict[str, float]:
    """Positions by name, long after."""
    source.sample(0.0)
    return dict(zip(source.names, source.sample(at)[0].tolist(), strict=True))


def test_zeros_say_where_joints_rest() -> None:
    source = source_of({"zeros": {"elbow": 0.25, "slide": 9.0, "elbw": 1.0}})
    assert source.sample(0.0)[0][:2] == pytest.approx([0.25, 0.6])
    assert {report.key for report in source.reports} >= {"zeros.slide", "zeros.elbw"}


def test_pose_comes_before_motions_before_delta() -> None:
    parameters = {
        "poses": {"one": {"elbow": 0.9}},
        "pose": "one",
        "motions": {"elbow": constant(0.1), "slide": constant(0.3)},
        "delta": 0.01,
    }
    reached = settled(source_of(parameters))
    assert (reached["elbow"], reached["slide"]) == (0.9, 0.3)
    assert reached["wheel"] != 0.0
    reached = settled(source_of({**parameters, "pose": ""}))
    assert reached["elbow"] == 0.1


def test_a_pose_is_held_within_limits_and_may_have_followers() -> None:
    source = source_of({"poses": {"noted": {"finger": 0.9, "thumb": 0.3}}, "pose": "noted"})
    assert settled(source)["thumb"] == pytest.approx(-0.6)
    assert [report.key for report in source.reports] == ["poses.noted.finger"]


def test_delta_sweeps_what_nothing_else_moves() -> None:
    source = source_of({"delta": 0.01, "rate": 10})
    source.sample(0.0)
    positions, velocities = source.sample(1.0)
    assert positions == pytest.approx([0.1, 0.5, 0.1, 0.1, -0.05])
    assert velocities == pytest.approx([0.1, 0.1, 0.1, 0.1, -0.1])
    fast = source_of({"delta": 0.02, "rate": 10})  # too fast for the slide
    fast.sample(0.0)
    assert fast.sample(0.5)[1] == pytest.approx([0.2, 0.1, 0.2, 0.2, -0.2])


def test_joints_that_nothing_else_moves_swing_within_limits() -> None:
    parameters = {"swing": 8.0, "motions": {"slide": constant(0.3)}}
    source = source_of(parameters)
    assert source.reports == ()
    moments = np.arange(0.0, 400.0, 0.05)
    samples = [source.sample(moment) for moment in moments]
    positions, velocities = (np.array(values) for values in zip(*samples, strict=True))
    late = moments > 100.0
    low, high = positions[late].min(axis=0), positions[late].max(axis=0)
    elbow, slide, wheel, finger, thumb = range(5)
    assert (low[slide], high[slide]) == (0.3, 0.3)
    assert (low[elbow], high[elbow]) == pytest.approx((-0.9, 0.9), abs=0.01)
    assert (low[wheel], high[wheel]) == pytest.approx((-math.pi / 2, math.pi / 2), abs=0.01)
    assert (low[finger], high[finger]) == pytest.approx((0.0325, 0.6175), abs=0.01)
    assert high[thumb] == pytest.approx(0.05 - low[finger], abs=1e-6)
    speed = np.abs(velocities[late]).max(axis=0)
    assert (speed <= 0.5 * SPEED + 1e-3).all()
    assert speed[elbow] == pytest.approx(0.25, rel=0.01)
    phases = {round(float(value), 3) for value in positions[-1, [elbow, wheel, finger]]}
    assert len(phases) == 3
    slow = source_of({"swing": 40.0})
    course = [float(slow.sample(moment)[0][0]) for moment in np.arange(0.0, 200.0, 0.5)]
    assert course[-1] == pytest.approx(-course[-41], abs=1e-6)
    assert abs(course[-1]) > 0.01


def test_the_wheel_takes_the_short_way() -> None:
    turning = {"type": "keyframes", "times": [0.0, 4.0], "positions": [0.0, 2.0 * math.pi]}
    source = source_of({"motions": {"wheel": turning}})
    assert source.reports == ()  # of a whole turn the ends are the same
    for moment in np.arange(0.0, 101.0, 0.1):
        _, velocities = source.sample(moment)
    assert velocities[2] == pytest.approx(math.pi / 2.0)
    configure(source, {"motions": {"wheel": constant(-3.0)}})
    stops = [t for t in np.arange(101.0, 110.0, 0.1) if source.sample(t)[0][2] == -3.0]
    assert stops[0] < 103.0


def test_an_edit_leaves_the_other_motions_alone() -> None:
    sine = {"type": "sine", "amplitude": 0.1, "frequency": 0.1}
    edited = source_of({"motions": {"elbow": sine}})
    plain = source_of({"motions": {"elbow": sine}})
    for moment in np.arange(0.0, 10.0, 0.1):
        if moment > 3.0:
            once = _keyframes([(0.0, 0.4), (1.0, 0.41)], "linear", loop=False)
            configure(edited, {"motions": {"elbow": sine, "slide": once}})
        assert edited.sample(moment)[0][0] == plain.sample(moment)[0][0]
    assert edited.sample(11.0)[0][1] == 0.41


def test_a_refused_edit_changes_nothing() -> None:
    source = source_of({"motions": {"elbow": constant(0.5)}})
    with pytest.raises(ConfigError, match="joints that move: elbow, finger, slide, thumb, wheel"):
        configure(source, {"motions": {"elbo": constant(0.1)}})
    with pytest.raises(ConfigError, match='joint "base" is fixed'):
        configure(source, {"poses": {"p": {"base": 0.1}}})
    assert settled(source)["elbow"] == 0.5


def test_a_new_robot_leaves_out_what_does_not_suit_it() -> None:
    parameters = {
        "motions": {name: constant(0.25) for name in ("elbow", "slide", "finger")},
        "poses": {"up": {"elbow": 0.5, "wheel": 0.1}},
    }
    old, config = source_of(parameters), read(JointsConfig, parameters)
    joints = [joint("elbow"), joint("slide", "fixed"), joint("finger", mimic=mimic("elbow", 0.5))]
    with pytest.raises(ConfigError):
        JointStateSource(joints, config, previous=old)
    source = JointStateSource(joints, config, previous=old, tolerant=True)
    assert {report.key: report.text.partition(" (")[0] for report in source.reports} == {
        "motions.slide": 'joint "slide" is fixed',
        "motions.finger": 'joint "finger" follows "elbow"; move its leader, or set use_mimic_tags'
        " to false",
        "poses.up.wheel": 'the robot has no joint "wheel"',
    }
    assert settled(source) == pytest.approx({"elbow": 0.25, "finger": 0.125})
    configure(source, {**parameters, "pose": "up"})
    assert settled(source, 2000.0) == pytest.approx({"elbow": 0.5, "finger": 0.25})
    with pytest.raises(ConfigError) as caught:
        configure(source, {**parameters, "dependent_joints.elbow.parent": "slide"})
    assert [problem.key for problem in caught.value.problems] == ["dependent_joints.elbow"]


def test_a_joint_without_velocity_limit_jumps() -> None:
    source = JointStateSource([joint("a", velocity=None)])
    source.sample(0.0)
    for moment, position, velocity in ((0.01, 1.0, 100.0), (0.03, 1e-17, -50.0)):
        configure(source, {"motions": {"a": constant(position)}})
        positions, velocities = source.sample(moment)
        assert positions[0] == position
        assert velocities[0] == pytest.approx(velocity)


def test_received_states_override_motions() -> None:
    source = source_of({"motions": {"elbow": constant(1.0)}})
    source.sample(0.0)
    names, numbers = ["finger", "elbow", "thumb", "other"], np.array([1.0, 2.0, 3.0, 4.0])
    positions = [0.5, math.nan, 0.3, 1.0]
    assert source.received.receive(names, positions, numbers / 10.0, numbers) is None
    source.received.receive(["elbow"], [math.inf], [], [])
    positions, velocities = source.sample(1.0)
    assert positions == pytest.approx([0.5, 0.4, 0.0, 0.5, -0.45])
    assert velocities == pytest.approx([0.2, 0.0, 0.0, 0.1, -0.1])
    assert source.efforts() == pytest.approx([2.0, 0.0, 0.0, 1.0, 1.0])


def test_a_motion_begins_when_it_is_asked_for() -> None:
    source = source_of({})
    for moment in (1e9, 1e9 + 40.0):
        source.sample(moment)
    sine = {"type": "sine", "amplitude": 0.5, "frequency": 0.1}
    configure(source, {"motions": {"elbow": sine}})
    for since in np.arange(0.0, 5.0, 0.25):
        position = source.sample(1e9 + 40.0 + since)[0][0]
        assert position == pytest.approx(0.5 * math.sin(0.2 * math.pi * since), abs=1e-9)


def test_a_clock_set_back_goes_on_with_the_same_motion() -> None:
    steps = [0.5, 0.25, -100.0, 0.5, 1e6, 0.25]
    sine = {"type": "sine", "amplitude": 0.5, "frequency": 0.1}
    source, plain = (source_of({"motions": {"elbow": sine}, "delta": 0.01}) for _ in range(2))
    source.sample(200.0)
    plain.sample(0.0)
    now, elapsed = 200.0, 0.0
    for step in steps:
        now, elapsed = now + step, elapsed + max(step, 0.0)
        positions, velocities = source.sample(now)
        wanted, speeds = plain.sample(elapsed)
        assert positions == pytest.approx(wanted, abs=1e-6)
        assert velocities == pytest.approx(speeds if step > 0.0 else np.zeros(5), abs=1e-6)
        assert source.moving == (step > 0.0)


WHEELS = [
    joint("left", "continuous", velocity=2.0),
    joint("right", "continuous", velocity=9.0, mimic=mimic("left", -0.5, 0.25)),
    joint("free", "continuous", velocity=2.0),
]


def test_a_wheel_that_leads_is_not_wrapped() -> None:
    """Its follower would jump by half a turn with each of its turns."""
    speed = {"type": "keyframes", "times": [0.0, 10.0], "positions": [0.0, 2.0 * math.pi]}
    source = source_from(WHEELS, {"motions": {"left": speed, "free": speed}})
    for moment in np.arange(0.0, 8.0, 0.1):
        (left, right, free), velocities = source.sample(moment)
        turned = moment * math.tau / 10.0
        assert left == pytest.approx(turned)
        assert right == pytest.approx(0.25 - turned / 2.0)
        assert free == pytest.approx(math.remainder(turned, math.tau))
        if moment:
            assert velocities == pytest.approx([0.2 * math.pi, -0.1 * math.pi, 0.2 * math.pi])


def test_a_wheel_that_leads_takes_the_whole_way_to_its_new_motion() -> None:
    """The short way would not bring its follower to where it ought to be."""
    source = source_from(WHEELS, {"motions": {"left": constant(5.0), "free": constant(2.0)}})
    source.sample(0.0)
    source.sample(100.0)
    configure(source, {"motions": {"left": constant(-1.0), "free": constant(3.0)}})
    course = [source.sample(100.0 + t)[0] for t in (1.0, 2.0, 3.0, 9.0)]
    assert [left for left, _, _ in course] == pytest.approx([3.0, 1.0, -1.0, -1.0])
    assert [right for _, right, _ in course] == pytest.approx([-1.25, -0.25, 0.75, 0.75])
    assert [free for _, _, free in course] == pytest.approx([3.0] * 4)


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=5))
def test_wrapped_angles_are_the_same_angles(angles: list[float]) -> None:
    found = wrapped(np.array(angles))
    assert (np.abs(found) <= math.pi + 1e-12).all()
    assert np.exp(1j * found) == pytest.approx(np.exp(1j * np.array(angles)), abs=1e-9)
    inside = np.abs(angles) <= math.pi
    assert np.array_equal(found[inside], np.array(angles)[inside])


def test_a_new_description_keeps_time_motion_and_received_states() -> None:
    sine = {"type": "sine", "amplitude": 0.5, "frequency": 0.05}
    once = _keyframes([(0.0, 0.0), (10.0, 0.5)], "linear", loop=False)
    config = read(JointsConfig, {"motions": {"elbow": sine, "finger": once}})
    old, plain = JointStateSource(ROBOT, config), JointStateSource(ROBOT, config)
    for source in (old, plain):
        for moment in (5.0, 6.0, 7.0):
            source.sample(moment)
        source.received.receive(["slide"], [0.3], [0.05], [7.0])
    new = JointStateSource([*reversed(ROBOT), joint("extra")], config, previous=old)
    positions, velocities = new.sample(7.5)
    wanted, speeds = plain.sample(7.5)
    assert positions == pytest.approx([*reversed(wanted), 0.0])
    assert velocities == pytest.approx([*reversed(speeds), 0.0])
    assert new.efforts() == pytest.approx([0.0, 0.0, 0.0, 7.0, 0.0, 0.0])


def test_received_velocities_or_efforts_alone_leave_the_positions() -> None:
    source = source_of({"motions": {"elbow": constant(1.0)}})
    source.sample(0.0)
    received = source.received
    assert received.kinds == (False, False, False)
    source.received.receive(["finger"], [], [0.25], [])
    assert received.kinds == (False, True, False)
    positions, velocities = source.sample(1.0)
    assert positions == pytest.approx([0.5, 0.4, 0.0, 0.0, 0.05])
    assert velocities == pytest.approx([0.5, 0.0, 0.0, 0.25, -0.25])
    source.received.receive(["finger", "thumb"], [], [], [3.0, 4.0])
    assert received.kinds == (False, True, True)
    assert source.efforts() == pytest.approx([0.0, 0.0, 0.0, 3.0, 3.0])


@pytest.mark.parametrize("which", [0, 1, 2])
def test_each_list_of_a_message_has_one_value_per_name(which: int) -> None:
    """Else nothing of the message counts, not even its other lists."""
    lists: list[list[float]] = [[0.1, 0.2], [0.1, 0.2], [0.1, 0.2]]
    lists[which] = [0.1, 0.2, 0.3]
    source = source_of({})
    what = ("position", "velocity", "effort")[which]
    reason = source.received.receive(["elbow", "slide"], *lists)
    assert reason == f"2 names but 3 values of {what}"
    received = source.received
    assert received.kinds == (False, False, False)
