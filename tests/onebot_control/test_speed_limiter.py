"""The speed limiter, against ros2_control's own numbers."""

import dataclasses
import math
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_control.drive.speed_limiter import SpeedLimiter, SpeedLimits
from onebot_description.parameters.reader import ConfigError, read

OLDER = (
    "min_acceleration",
    *(f"has_{kind}_limits" for kind in "velocity acceleration jerk".split()),
)
NAMES = tuple(field.name for field in dataclasses.fields(SpeedLimits) if field.name not in OLDER)
MAXIMA = ("max_velocity", "max_acceleration", "max_jerk")
NEGATIVE = ("min_velocity", "max_deceleration", "max_acceleration_reverse", "min_jerk")

ACCELERATIONS = SpeedLimits(
    max_acceleration=2.0,
    max_deceleration=-4.0,
    max_acceleration_reverse=-8.0,
    max_deceleration_reverse=10.0,
)


@pytest.mark.parametrize("name", [name for name in NAMES if name not in MAXIMA])
def test_a_stage_without_its_maximum_is_off(name: str) -> None:
    """As in control_toolbox."""
    limits = SpeedLimits(**{name: -1.0 if name in NEGATIVE else 1.0})
    assert SpeedLimiter(limits).limit(-100.0, 100.0, 100.0, 0.01) == -100.0


def run(limits: SpeedLimits, commands: Iterable[float], dt: float = 0.01) -> list[float]:
    """Limit a sequence of commands from rest."""
    limiter, last, before = SpeedLimiter(limits), 0.0, 0.0
    results = []
    for command in commands:
        before, last = last, limiter.limit(command, last, before, dt)
        results.append(last)
    return results


@pytest.mark.parametrize(
    ("limits", "commands", "expected"),
    [
        (
            ACCELERATIONS,
            [1.0] * 3 + [0.0] * 3 + [-1.0] * 3 + [0.0] * 3,
            [0.02, 0.04, 0.06, 0.02, 0.0, 0.0, -0.08, -0.16, -0.24, -0.14, -0.04, 0.0],
        ),
        (SpeedLimits(max_jerk=10.0), [1.0] * 3 + [0.0] * 3, [1e-3, 3e-3, 6e-3, 8e-3, 9e-3, 9e-3]),
        # In this order: jerk, acceleration, velocity.
        (SpeedLimits(max_velocity=0.015, max_acceleration=2.0, max_jerk=1e6), [1.0], [0.015]),
    ],
)
def test_golden_vectors(limits: SpeedLimits, commands: list[float], expected: list[float]) -> None:
    assert run(limits, commands) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_limits_have_a_sign(name: str) -> None:
    """The error names the limit and the remedy; 0 is right for all."""
    sign = -1.0 if name in NEGATIVE else 1.0
    with pytest.raises(ConfigError, match=f"{name}: {-sign:g} is .* 0; .* 0, or .nan for"):
        read(SpeedLimits, {name: -sign})
    read(SpeedLimits, {name: 0.0})


def test_parameters_of_older_versions_count() -> None:
    """A least acceleration is the deceleration, unless that is given; switches remove limits."""
    older = SpeedLimits(max_acceleration=1.0, min_acceleration=-2.0)
    assert older.max_deceleration == -2.0
    assert run(older, [0.1] * 12 + [0.0] * 2)[-3:] == pytest.approx([0.1, 0.08, 0.06])
    assert SpeedLimits(max_deceleration=-3.0, min_acceleration=-2.0).max_deceleration == -3.0
    limits = dict.fromkeys(NAMES, 0.0)
    for kind, count in (("velocity", 2), ("acceleration", 4), ("jerk", 2)):
        switched = read(SpeedLimits, {**limits, f"has_{kind}_limits": False})
        gone = [name for name in NAMES if math.isnan(getattr(switched, name))]
        assert gone == [name for name in NAMES if kind[2:] in name]
        assert len(gone) == count


@pytest.mark.parametrize("minimum", [-0.5, -0.0, math.nan])
@pytest.mark.parametrize("last", [-2.0, 0.0, 2.0])
def test_commands_at_and_beyond_the_velocity_limits(minimum: float, last: float) -> None:
    """Each direction has its own limit, also where the robot drove faster before."""
    limiter = SpeedLimiter(SpeedLimits(min_velocity=minimum, max_velocity=0.8))
    lowest = -0.8 if math.isnan(minimum) else minimum
    for command, expected in [
        (-5.0, lowest),
        (math.nextafter(lowest, -1.0), lowest),
        (lowest, lowest),
        (lowest / 2.0, lowest / 2.0),
        (0.4, 0.4),
        (0.8, 0.8),
        (math.nextafter(0.8, 1.0), 0.8),
        (5.0, 0.8),
    ]:
        assert limiter.limit(command, last, last, 0.01) == expected


@pytest.mark.parametrize(
    ("last", "lower", "upper"),
    [(3.0, -0.4, 0.2), (0.1, -0.4, 0.2), (0.0, -0.8, 0.2), (-0.1, -0.8, 1.0), (-3.0, -0.8, 1.0)],
)
def test_the_last_command_chooses_the_acceleration(last: float, lower: float, upper: float) -> None:
    """Forward, at rest or backward: changes within the limits are exact, others are cut to them."""
    limiter = SpeedLimiter(ACCELERATIONS)
    for change in (0.9 * lower, 0.0, 0.9 * upper):
        assert limiter.limit(last + change, last, last, 0.1) == pytest.approx(last + change)
    for beyond in (1.1, 100.0):
        assert limiter.limit(last + beyond * lower, last, 7.0, 0.1) == pytest.approx(last + lower)
        assert limiter.limit(last + beyond * upper, last, 7.0, 0.1) == pytest.approx(last + upper)


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ({}, {"max_acceleration_reverse": -2.0, "max_deceleration": -2.0}),
        ({"max_acceleration_reverse": -8.0}, {"max_deceleration": -8.0}),
        ({"max_deceleration": -4.0}, {"max_acceleration_reverse": -2.0}),
        ({"max_deceleration_reverse": 10.0}, {"max_deceleration": -2.0}),
    ],
)
def test_accelerations_not_given(given: dict[str, float], meant: dict[str, float]) -> None:
    """A deceleration is the acceleration of its sign, and that in reverse mirrors the forward."""
    everything = {"max_acceleration_reverse": -2.0, "max_deceleration_reverse": 2.0}
    everything |= {"max_deceleration": -2.0} | meant | given
    partly = SpeedLimiter(SpeedLimits(max_acceleration=2.0, **given))
    wholly = SpeedLimiter(SpeedLimits(max_acceleration=2.0, **everything))
    for last in (-1.0, 0.0, 1.0):
        for command in (-9.0, 9.0):
            assert partly.limit(command, last, 0.0, 0.1) == wholly.limit(command, last, 0.0, 0.1)


@pytest.mark.parametrize(
    ("last", "before", "command", "expected"),
    [
        # Driving faster and faster forward, by 0.2 a period.
        (1.0, 0.8, 9.0, 1.3),  # to grow still more: by max_jerk
        (1.0, 0.8, 1.25, 1.25),  # within max_jerk
        (1.0, 0.8, 1.1, 1.1),  # to grow less is no jerk to be limited
        (1.0, 0.8, 0.0, 1.15),  # to slow down: by min_jerk
        (-1.0, -0.8, -9.0, -1.25),  # backward, as test_backward_is_the_mirror_of_forward has it
        # Slowing down forward.
        (1.0, 1.2, 0.0, 0.75),
        (1.0, 1.2, 0.9, 0.9),
        (1.0, 1.2, 9.0, 0.9),
        # From rest.
        (0.0, 0.0, 9.0, 0.1),
        (0.0, 0.0, -9.0, -0.05),
    ],
)
def test_jerk_is_limited_where_it_lengthens_the_change(
    last: float, before: float, command: float, expected: float
) -> None:
    """Both signs, each with its own limit: 10 up and 5 down."""
    limiter = SpeedLimiter(SpeedLimits(max_jerk=10.0, min_jerk=-5.0))
    assert limiter.limit(command, last, before, 0.1) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("limits", "deceleration", "jerk"),
    [
        ({}, math.nan, math.nan),
        (vars(ACCELERATIONS), 4.0, math.nan),
        ({"max_acceleration": 3.0, "max_deceleration_reverse": 2.0}, 2.0, math.nan),
        ({"max_jerk": 5.0}, math.nan, 5.0),
        ({"max_jerk": 3.0, "min_jerk": -4.0}, math.nan, 3.0),
    ],
)
def test_braking_is_that_of_the_direction_that_brakes_less(
    limits: dict[str, float], deceleration: float, jerk: float
) -> None:
    limiter = SpeedLimiter(SpeedLimits(**limits))
    assert limiter.deceleration == pytest.approx(deceleration, nan_ok=True)
    assert limiter.braking_jerk == pytest.approx(jerk, nan_ok=True)


limit = st.floats(0.0, 10.0)
speed = st.floats(-10.0, 10.0)


@given(st.tuples(*[limit] * 8), speed, speed, speed, st.floats(0.001, 1.0))
def test_backward_is_the_mirror_of_forward(
    limits: tuple[float, ...], command: float, last: float, before: float, dt: float
) -> None:
    """With each limit in the place of its opposite, all that was forward is backward."""
    values = dict(zip(NAMES, limits, strict=True))
    values |= {name: -values[name] for name in NEGATIVE}
    opposite = {
        "max_velocity": "min_velocity",
        "max_acceleration": "max_acceleration_reverse",
        "max_deceleration_reverse": "max_deceleration",
        "max_jerk": "min_jerk",
    }
    opposite |= {other: name for name, other in opposite.items()}
    forward = SpeedLimiter(SpeedLimits(**values))
    backward = SpeedLimiter(SpeedLimits(**{opposite[n]: -v for n, v in values.items()}))
    result = forward.limit(command, last, before, dt)
    assert backward.limit(-command, -last, -before, dt) == pytest.approx(-result)
    assert values["min_velocity"] <= result <= values["max_velocity"]
