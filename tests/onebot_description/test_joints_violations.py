"""onebot_description.joints.motions: what is beyond limits, and the remedy."""

import dataclasses
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_description.joints.motions import Allowed, Keyframes, Motion, Sine

MRM = Allowed(-3.14, 3.14, 0.5)
SPEED = "over its limit 0.5 rad/s"
RANGE = "is beyond its limits [-3.14, 3.14] rad"


def violations(motion: Motion, allowed: Allowed = MRM) -> list[str]:
    """All that is reported."""
    return list(motion.violations(allowed))


@pytest.mark.parametrize(
    ("motion", "texts"),
    [
        (Sine(1.0, 0.2), [f"sine at 0.2 Hz peaks at 1.257 rad/s, {SPEED}: lower frequency to"]),
        (Sine(1.0, 0.01, 0.0, 4.0), [f"sine from 3 to 5 rad {RANGE}: lower amplitude, or change"]),
        (Keyframes.hold(4.0), [f"position 4 rad {RANGE}: held at 3.14"]),
        (
            Keyframes((0.0, 1.0, 9.0, 9.5), (4.0, 3.0, -4.0, 0.0)),
            [
                f"keyframe 1 at 4 rad {RANGE}: held at 3.14",
                f"keyframe 3 at -4 rad {RANGE}: held at -3.14",
                f"from keyframe 1 to 2 it peaks at 1 rad/s, {SPEED}: give it 2 s instead of 1",
                f"from keyframe 2 to 3 it peaks at 0.875 rad/s, {SPEED}: give it 14 s instead of 8",
                f"from keyframe 3 to 4 it peaks at 8 rad/s, {SPEED}: give it 8 s instead of 0.5",
            ],
        ),
        (
            Keyframes((0.0, 0.5, 9.0), (0.0, 1.0, 0.0), "minimum_jerk"),
            [f"from keyframe 1 to 2 it peaks at 3.75 rad/s, {SPEED}: give it 3.75 s instead"],
        ),
    ],
)
def test_each_thing_beyond_a_limit_is_reported(motion: Motion, texts: list[str]) -> None:
    found = violations(motion)
    assert len(found) == len(texts)
    assert all(message.startswith(text) for message, text in zip(found, texts, strict=True)), found


@given(
    amplitude=st.floats(0.01, 3.0), frequency=st.floats(0.001, 100.0), limit=st.floats(0.01, 10.0)
)
def test_the_remedy_for_a_sine_is_right(amplitude: float, frequency: float, limit: float) -> None:
    allowed = dataclasses.replace(MRM, velocity=limit)
    for text in violations(Sine(amplitude, frequency), allowed):
        advice = float(re.search(r"frequency to (\S+)", text)[1])
        assert violations(Sine(amplitude, advice), allowed) == []


@given(way=st.floats(0.01, 3.0), blend=st.sampled_from(["linear", "minimum_jerk"]))
def test_the_remedy_for_keyframes_is_right(way: float, blend: str) -> None:
    quick = Keyframes((0.0, 0.01), (0.0, way), blend, False)
    for text in violations(quick):
        advice = float(re.search(r"give it (\S+) s", text)[1])
        assert violations(dataclasses.replace(quick, times=(0.0, advice))) == []


@pytest.mark.parametrize(
    ("within", "beyond"),
    [
        (Keyframes.hold(3.14), Keyframes.hold(3.1402)),
        (Sine(1.0, 0.5 / math.tau), Sine(1.0, 0.5001 / math.tau)),
        (Sine(-1.0, 0.01, 0.0, 2.14), Sine(-1.0, 0.01, 0.0, 2.1402)),
        (
            Keyframes((5.0, 7.0), (0.0, 1.0), loop=False),
            Keyframes((5.0, 6.999), (0.0, 1.0), loop=False),
        ),
        (
            Keyframes((0.0, 3.75), (1.0, 0.0), "minimum_jerk", loop=False),
            Keyframes((0.0, 3.749), (1.0, 0.0), "minimum_jerk", loop=False),
        ),
    ],
)
def test_the_edge_of_a_limit(within: Motion, beyond: Motion) -> None:
    assert violations(within) == []
    assert len(violations(beyond)) == 1


def test_a_joint_that_cannot_move_is_reported() -> None:
    """A velocity limit of 0 leaves no time and no frequency that would do."""
    still = Allowed(-1.0, 1.0, 0.0, "m")
    motion = Keyframes((0.0, 1.0), (0.0, 1.0), loop=False)
    assert "over its limit 0 m/s: give it inf s" in violations(motion, still)[0]
    assert violations(Sine(0.5, 1.0), still)[0].endswith("lower frequency to 0")
