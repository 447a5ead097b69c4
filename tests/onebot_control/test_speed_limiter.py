"""The speed limiter, against ros2_control's own numbers."""

import math
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_control.speed_limiter import SpeedLimiter, SpeedLimits
from onebot_description.parameters.reader import ConfigError


def run(limits: SpeedLimits, commands: Iterable[float], dt: float = 0.01) -> list[float]:
    """Limit a sequence of commands from rest."""
    limiter, last, before = SpeedLimiter(limits), 0.0, 0.0
    results = []
    for command in commands:
        before, last = last, limiter.limit(command, last, before, dt)
        results.append(last)
    return results


def test_golden_vector_of_acceleration() -> None:
    """Each of the four accelerations has its own limit."""
    limits = SpeedLimits(
        max_acceleration=2.0,
        max_deceleration=-4.0,
        max_acceleration_reverse=-8.0,
        max_deceleration_reverse=10.0,
    )
    expected = [0.02, 0.04, 0.06, 0.02, 0.0, 0.0, -0.08, -0.16, -0.24, -0.14, -0.04, 0.0]
    commands = [1.0] * 3 + [0.0] * 3 + [-1.0] * 3 + [0.0] * 3
    assert run(limits, commands) == pytest.approx(expected, abs=1e-12)


def test_golden_vector_of_jerk() -> None:
    """Only jerk is limited, and only where it adds to the change."""
    expected = [0.001, 0.003, 0.006, 0.008, 0.009, 0.009]
    assert run(SpeedLimits(max_jerk=10.0), [1.0] * 3 + [0.0] * 3) == pytest.approx(
        expected, abs=1e-12
    )


@pytest.mark.parametrize(
    ("start", "target", "rate"),
    [(0.0, 1.0, 2.0), (1.0, 0.0, 4.0), (0.0, -1.0, 8.0), (-1.0, 0.0, 10.0)],
)
def test_ramps_arrive_on_time_and_hold(start: float, target: float, rate: float) -> None:
    """A ramp is not there before its time, within 1e-3 at its time, and then holds."""
    limits = SpeedLimits(
        max_acceleration=2.0,
        max_deceleration=-4.0,
        max_acceleration_reverse=-8.0,
        max_deceleration_reverse=10.0,
    )
    dt, limiter = 0.001, SpeedLimiter(limits)
    last = before = start
    due = round(abs(target - start) / rate / dt)
    for step in range(1, due + 100):
        before, last = last, limiter.limit(target, last, before, dt)
        assert (abs(last - target) > 1e-4) == (step < due), step
    assert last == pytest.approx(target, abs=1e-3)


def test_order_is_jerk_acceleration_velocity() -> None:
    """Velocity has the last word."""
    limits = SpeedLimits(max_velocity=0.015, max_acceleration=2.0, max_jerk=1e6)
    assert run(limits, [1.0] * 3) == pytest.approx([0.015] * 3)


def test_unset_values_follow_the_set_ones() -> None:
    """A minimum not given mirrors the maximum; decelerations are as the accelerations."""
    limits = SpeedLimits(max_acceleration=2.0, max_velocity=0.03)
    assert run(limits, [1.0] * 3 + [-1.0] * 4) == pytest.approx(
        [0.02, 0.03, 0.03, 0.01, -0.01, -0.03, -0.03]
    )


@pytest.mark.parametrize("stage", ["velocity", "acceleration", "jerk"])
def test_stage_without_maximum_does_nothing(stage: str) -> None:
    """A minimum alone limits nothing: the maximum switches the stage on."""
    low = {"velocity": "min_velocity", "acceleration": "max_deceleration", "jerk": "min_jerk"}
    assert run(SpeedLimits(**{low[stage]: -0.1}), [5.0, -5.0]) == [5.0, -5.0]


@given(
    st.lists(st.floats(-100.0, 100.0), max_size=50),
    st.floats(0.01, 5.0),
    st.floats(0.01, 5.0),
)
def test_never_beyond_the_limits(commands: list[float], speed: float, acceleration: float) -> None:
    """Whatever is commanded, neither speed nor its change is beyond what is allowed."""
    results = run(SpeedLimits(max_velocity=speed, max_acceleration=acceleration), commands)
    last = 0.0
    for value in results:
        assert abs(value) <= speed
        assert abs(value - last) <= acceleration * 0.01 * (1 + 1e-9) + 1e-12
        last = value


@pytest.mark.parametrize("name", ["max_velocity", "max_deceleration_reverse", "max_jerk"])
def test_positive_limits_must_be_positive(name: str) -> None:
    """The error names the limit and the remedy."""
    with pytest.raises(ConfigError, match=f"{name}: -1 is below 0; .* from 0, or .nan for no"):
        SpeedLimiter(SpeedLimits(**{name: -1.0}))


@pytest.mark.parametrize("name", ["min_velocity", "max_acceleration_reverse", "min_jerk"])
def test_negative_limits_must_be_negative(name: str) -> None:
    """The error names the limit and the remedy."""
    with pytest.raises(ConfigError, match=f"{name}: 1 is above 0; .* up to 0, or .nan for minus"):
        SpeedLimiter(SpeedLimits(**{name: 1.0}))


def test_zero_is_a_limit() -> None:
    """Unlike NaN, a maximum of 0 forbids."""
    assert run(SpeedLimits(max_velocity=0.0), [1.0]) == [0.0]
    assert run(SpeedLimits(max_velocity=math.nan), [1.0]) == [1.0]
