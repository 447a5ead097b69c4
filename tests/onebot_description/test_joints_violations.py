"""onebot_description.joints.motions: what is beyond limits, and the remedy."""

import dataclasses
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_description.joints.motions import (
    Allowed,
    Keyframes,
    Motion,
    Sine,
    violations,
)

MRM = Allowed(-3.14, 3.14, 0.5)


def test_the_sine_of_the_readme() -> None:
    """Joint speed, limit and remedy, in figures."""
    assert violations(Sine(1.0, 0.2), MRM) == [
        "sine of amplitude 1 at 0.2 Hz peaks at 1.257 rad/s, over its limit 0.5 rad/s:"
        " lower frequency to 0.07957"
    ]


@given(
    amplitude=st.floats(0.01, 3.0),
    frequency=st.floats(0.001, 100.0),
    limit=st.floats(0.01, 10.0),
)
def test_the_remedy_for_a_sine_is_right(amplitude: float, frequency: float, limit: float) -> None:
    """Following the advice leaves nothing to report."""
    allowed = dataclasses.replace(MRM, velocity=limit)
    for text in violations(Sine(amplitude, frequency), allowed):
        advice = float(re.search(r"frequency to (\S+)", text)[1])
        assert violations(Sine(amplitude, advice), allowed) == []


@given(amplitude=st.floats(0.01, 100.0), offset=st.floats(-3.0, 3.0))
def test_the_remedy_for_an_amplitude_is_right(amplitude: float, offset: float) -> None:
    """Following the advice leaves nothing to report."""
    for text in violations(Sine(amplitude, 0.0, 0.0, offset), MRM):
        advice = float(re.search(r"amplitude to (\S+)", text)[1])
        assert violations(Sine(advice, 0.0, 0.0, offset), MRM) == []


@given(way=st.floats(0.01, 3.0), blend=st.sampled_from(["linear", "minimum_jerk"]))
def test_the_remedy_for_keyframes_is_right(way: float, blend: str) -> None:
    """Given the time advised, the joint arrives within its velocity limit."""
    quick = Keyframes((0.0, 0.01), (0.0, way), blend, False)
    for text in violations(quick, MRM):
        advice = float(re.search(r"give it (\S+) s", text)[1])
        assert violations(dataclasses.replace(quick, times=(0.0, advice)), MRM) == []


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (
            Keyframes.hold(4.0),
            "position 4 rad is beyond its limits [-3.14, 3.14] rad: held at 3.14",
        ),
        (Keyframes.hold(-4.0, "home"), 'pose "home" -4 rad is beyond'),
        (Sine(1.0, 0.01, 0.0, 4.0), "bring offset to 0"),
        (Keyframes((0.0, 9.0), (0.0, 4.0), loop=False), "keyframe 2 at 4 rad is beyond"),
        (Keyframes((0.0, 9.0), (0.0, 1.0)), "the loop jumps from 1 to 0 rad"),
    ],
)
def test_everything_beyond_limits_is_told(motion: Motion, words: str) -> None:
    """Each kind of motion, with what to write instead."""
    assert any(words in text for text in violations(motion, MRM))


@pytest.mark.parametrize(
    "motion",
    [
        Keyframes.hold(3.14),
        Sine(3.14, 0.025),
        Keyframes((0.0, 10.0, 20.0), (0.0, 1.0, 0.0)),
        Keyframes((0.0, 10.0), (0.0, 1.0), loop=False),
    ],
)
def test_what_is_within_limits_is_not_told(motion: Motion) -> None:
    """A limit reached exactly is within it."""
    assert violations(motion, MRM) == []


def test_a_joint_without_end_may_loop_over_whole_turns() -> None:
    """The loop does not jump, as the ends are the same angle."""
    endless = Allowed(-math.inf, math.inf, 1.0, endless=True)
    assert violations(Keyframes((0.0, 10.0), (0.0, 2.0 * math.pi)), endless) == []


def test_a_joint_that_cannot_move_is_told() -> None:
    """A velocity limit of 0 leaves no time and no frequency that would do."""
    still = Allowed(-1.0, 1.0, 0.0)
    motion = Keyframes((0.0, 1.0), (0.0, 1.0), loop=False)
    assert "cannot move" in violations(motion, still)[0]
    assert violations(Sine(0.5, 1.0), still)[0].endswith("lower frequency to 0")
    slow = dataclasses.replace(still, velocity=1e-308)  # the time is beyond what a float holds
    assert (
        "give it inf s" in violations(dataclasses.replace(motion, positions=(-1.0, 1.0)), slow)[0]
    )


@pytest.mark.parametrize(
    "motion",
    [
        Keyframes.hold(3.14 + 1e-6),
        Keyframes.hold(-3.14 - 1e-6),
        Sine(1.0, 0.5 / (2 * math.pi) + 1e-6),
        Sine(-1.0, 0.5 / (2 * math.pi) + 1e-6),
        Sine(1.0, 0.01, 0.0, 2.1401),
        Sine(1.0, 0.01, 0.0, -2.1401),
        Sine(-1.0, 0.01, 0.0, -2.1401),
        Keyframes((0.0, 1.9999), (0.0, 1.0), loop=False),
        Keyframes((0.0, 1.9999), (1.0, 0.0), loop=False),
        Keyframes((5.0, 6.9999), (0.0, 1.0), loop=False),
        Keyframes((0.0, 3.7499), (0.0, 1.0), "minimum_jerk", loop=False),
        Keyframes((0.0, 9.0), (3.1401, 0.0), loop=False),
        Keyframes((0.0, 9.0), (0.0, 0.0101)),
        Keyframes((0.0, 9.0), (0.0101, 0.0)),
    ],
)
def test_just_beyond_a_limit_is_reported_once(motion: Motion) -> None:
    """In either direction."""
    assert len(violations(motion, MRM)) == 1


@pytest.mark.parametrize(
    "motion",
    [
        Keyframes.hold(-3.14),
        Sine(1.0, 0.5 / (2 * math.pi)),
        Sine(-1.0, 0.01, 0.0, 2.14),
        Sine(1.0, 0.01, 0.0, -2.14),
        Keyframes((0.0, 2.0), (0.0, 1.0), loop=False),
        Keyframes((0.0, 3.75), (0.0, 1.0), "minimum_jerk", loop=False),
        Keyframes((0.0, 9.0), (-3.14, 0.0), loop=False),
        Keyframes((0.0, 9.0), (0.0, 0.0099)),
        Keyframes((0.0,), (1.0,)),
    ],
)
def test_just_within_a_limit_is_not_reported(motion: Motion) -> None:
    """In either direction."""
    assert violations(motion, MRM) == []


def test_each_thing_beyond_a_limit_is_reported() -> None:
    """A sine too wide and too fast is both; so are keyframes, each by its number."""
    assert len(violations(Sine(4.0, 1.0), MRM)) == 2
    motion = Keyframes((0.0, 1.0, 9.0, 9.5), (4.0, 3.0, -4.0, 0.0))
    assert [text.split(" ", 3)[:3] for text in violations(motion, MRM)] == [
        ["keyframe", "1", "at"],
        ["keyframe", "3", "at"],
        ["from", "keyframe", "1"],
        ["from", "keyframe", "2"],
        ["from", "keyframe", "3"],
        ["the", "loop", "jumps"],
    ]


@pytest.mark.parametrize(("position", "nearest"), [(4.0, "3.14"), (-4.0, "-3.14")])
def test_the_nearest_position_is_advised(position: float, nearest: str) -> None:
    """The limit on its own side."""
    assert violations(Keyframes.hold(position), MRM)[0].endswith(f"held at {nearest}")
    far = Keyframes((0.0, 99.0), (0.0, position), loop=False)
    assert violations(far, MRM)[0].endswith(f"write {nearest}")


@pytest.mark.parametrize("kind", ["offset", "amplitude"])
def test_a_sine_beyond_one_end_is_advised_by_the_other(kind: str) -> None:
    """About a middle off the centre the nearer limit decides how wide it may be."""
    narrow = Allowed(-1.0, 3.0, 9.0, "m")
    if kind == "amplitude":
        for offset in (0.5, 1.5):
            text = violations(Sine(2.0, 0.01, 0.0, offset), narrow)[0]
            assert "lower amplitude to 1.5" in text and " m," in text
    else:
        for offset in (3.0, -1.0, 5.0):
            text = violations(Sine(1.0, 0.01, 0.0, offset), narrow)[0]
            assert text.endswith("bring offset to 1")


def test_a_joint_without_end_that_loops_over_less_than_a_turn_jumps() -> None:
    """Whole turns do not count, in either direction; what is left of them does."""
    wheel = Allowed(-math.inf, math.inf, 99.0, endless=True)
    for turns in (-2, 1, 3):
        whole = Keyframes((0.0, 10.0), (1.0, 1.0 + turns * math.tau))
        assert violations(whole, wheel) == []
        more = dataclasses.replace(whole, positions=(1.0, 1.02 + turns * math.tau))
        assert len(violations(more, wheel)) == 1
    assert (
        len(
            violations(
                Keyframes((0.0, 99.0), (0.0, math.tau)), dataclasses.replace(wheel, endless=False)
            )
        )
        == 1
    )


def test_the_speeds_between_keyframes_in_figures() -> None:
    """The mean of each, and its peak when it blends; the time that would do, in four digits."""
    motion = Keyframes((0.0, 0.5, 1.0, 9.0), (0.0, 1.0, -1.0, 0.0))
    speed = "over its limit 0.5 rad/s"
    assert violations(motion, MRM) == [
        f"from keyframe 1 to 2 it peaks at 2 rad/s, {speed}: give it 2 s instead of 0.5",
        f"from keyframe 2 to 3 it peaks at 4 rad/s, {speed}: give it 4 s instead of 0.5",
    ]
    smooth = dataclasses.replace(motion, blend="minimum_jerk")
    assert violations(smooth, MRM) == [
        f"from keyframe 1 to 2 it peaks at 3.75 rad/s, {speed}: give it 3.75 s instead of 0.5",
        f"from keyframe 2 to 3 it peaks at 7.5 rad/s, {speed}: give it 7.5 s instead of 0.5",
    ]
    third = dataclasses.replace(MRM, velocity=0.3)
    assert "give it 3.334 s" in violations(motion, third)[0]
    assert "lower frequency to 0.04774" in violations(Sine(1.0, 1.0), third)[0]
