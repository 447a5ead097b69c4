"""The numbers behind ``topic hz, bw, delay``, and the texts of scalars, at their edges."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.introspection.message_text import read_scalar
from onebot_bringup.introspection.rates import Bandwidth, Delays, Intervals, Window


@given(st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=20), st.integers(1, 8) | st.none())
def test_a_window_is_its_last_samples(samples: list[float], size: int | None) -> None:
    """Mean, least, greatest and deviation, of at most ``size`` of them."""
    window = Window(size)
    for sample in samples:
        window.add(sample)
    kept = samples if size is None else samples[-size:]
    found = window.spread()
    assert found is not None and window.spread() is None
    assert (found.low, found.high, found.count) == (min(kept), max(kept), len(kept))
    assert found.mean == pytest.approx(sum(kept) / len(kept), abs=1e-9)
    squares = sum((sample - found.mean) ** 2 for sample in kept) / len(kept)
    assert found.deviation == pytest.approx(math.sqrt(squares), abs=1e-9)


def test_a_window_that_was_cleared_begins_anew() -> None:
    """Nothing of before is in it, and nothing is reported until a sample comes."""
    window = Window(None)
    window.add(1.0)
    window.clear()
    assert window.spread() is None
    window.add(3.0)
    found = window.spread()
    assert found is not None and (found.mean, found.count) == (3.0, 1)


def test_messages_at_the_same_moment_have_an_interval_of_zero() -> None:
    """They do not count as a clock set back; a rate without time is 0."""
    meter = Intervals(None)
    for moment in (1.0, 1.0, 1.0):
        meter.arrived(moment)
    said = meter.report() or ""
    assert said.startswith("average rate: 0.000\n") and said.endswith("window: 2")
    meter.arrived(2.0)
    assert (meter.report() or "").startswith("average rate: 3.000\n")


def test_a_clock_set_back_gives_no_interval() -> None:
    """Neither a negative one nor one from before."""
    meter = Intervals(None)
    for moment in (0.0, 4.0, 8.0, 7.0, 9.0):
        meter.arrived(moment)
    assert meter.report() == (
        "average rate: 0.500\n\tmin: 2.000s max: 2.000s std dev: 0.00000s window: 1"
    )


def test_one_message_has_no_bandwidth() -> None:
    """Nor have messages without time between them, or without news since the last report."""
    meter = Bandwidth(None)
    meter.arrived(1.0, 100)
    assert meter.report(2.0) is None
    meter.arrived(2.0, 300)
    assert meter.report(1.0) is None and meter.report(0.0) is None
    assert (meter.report(5.0) or "").startswith("100 B/s from 2 messages\n")
    assert meter.report(6.0) is None


def test_bandwidth_is_of_the_window_alone() -> None:
    """Since the first message in it."""
    meter = Bandwidth(2)
    for moment, size in ((0.0, 10**9), (4.0, 1000), (5.0, 2000)):
        meter.arrived(moment, size)
    assert meter.report(6.0) == (
        "1.50 KB/s from 2 messages\n\tMessage size mean: 1.50 KB min: 1.00 KB max: 2.00 KB"
    )


@pytest.mark.parametrize(
    ("size", "text"),
    [(999, "999 B"), (1000, "1.00 KB"), (999_990, "999.99 KB"), (1_000_000, "1.00 MB")],
)
def test_sizes_have_the_largest_unit_that_fits(size: int, text: str) -> None:
    """Thousands, as ros2 topic bw has them."""
    meter = Bandwidth(None)
    for moment in (0.0, 1.0):
        meter.arrived(moment, size)
    assert f"mean: {text} min: {text} max: {text}" in (meter.report(2.0) or "")


def test_delays_may_be_negative() -> None:
    """A sender's clock may be ahead."""
    ages = Delays(2)
    assert ages.report() is None
    for age in (9.0, -0.5, -0.25):
        ages.arrived(age)
    assert (ages.report() or "").startswith(
        "average delay: -0.375\n\tmin: -0.500s max: -0.250s std dev: 0.12500s window: 2"
    )
    assert ages.report() is None


@pytest.mark.parametrize("bits", [8, 16, 32, 64])
@pytest.mark.parametrize("unsigned", [False, True])
def test_whole_numbers_within_their_type(bits: int, unsigned: bool) -> None:
    """Both ends are in, the next ones are out, and each text says what it is."""
    low, high = (0, 2**bits - 1) if unsigned else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    kind = f"{'u' if unsigned else ''}int{bits}"
    for value in (low, high, 0, 7):
        assert read_scalar(kind, str(value)) == value
    for value in (low - 1, high + 1):
        with pytest.raises(ValueError, match=f"is an {kind} from {low} to {high}, not {value}"):
            read_scalar(kind, str(value))


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        ("int32", "+5", 5),
        ("int32", " 0x10 ", 16),
        ("int32", "-0x10", -16),
        ("int32", "-3.0", -3),
        ("int32", "1e3", 1000),
        ("int32", "007", 7),
        ("octet", "7", b"\x07"),
        ("octet", "a", b"a"),
        ("octet", "255", b"\xff"),
        ("octet", "\xff", b"\xff"),
        ("octet", " ", b" "),
        ("char", "x", "x"),
        ("wchar", "é", "é"),
        ("boolean", " On ", True),
        ("boolean", "NO", False),
        ("float", "3.4028234e38", 3.4028234e38),
        ("float", "-3.4028235e38", -3.4028235e38),
        ("double", "3.5e38", 3.5e38),
        ("long double", "-1e-9", -1e-9),
    ],
)
def test_texts_of_scalars(kind: str, text: str, value: object) -> None:
    """Value and type."""
    found = read_scalar(kind, text)
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("octet", "256"),
        ("octet", "-1"),
        ("octet", "ab"),
        ("octet", "Ā"),
        ("char", "xy"),
        ("char", ""),
        ("boolean", "2"),
        ("boolean", ""),
        ("int32", "inf"),
        ("int32", "nan"),
        ("int32", "1.5"),
        ("int32", "0x"),
        ("float", "3.4028236e38"),
        ("float", "-3.4028236e38"),
        ("double", "1,5"),
        ("double", ""),
    ],
)
def test_texts_that_are_no_such_scalar(kind: str, text: str) -> None:
    """None is rounded, cut off or guessed, whether infinities are allowed or not."""
    for finite in (True, False):
        with pytest.raises(ValueError, match="is "):
            read_scalar(kind, text, finite)


@pytest.mark.parametrize("kind", ["float", "double"])
def test_infinities_only_when_they_are_meant(kind: str) -> None:
    """They must be allowed and spelled out; a number that is too large never is one."""
    for text, value in (("inf", math.inf), ("-.inf", -math.inf), (".Inf", math.inf)):
        assert read_scalar(kind, text, finite=False) == value
        with pytest.raises(ValueError, match="--allow-non-finite lets it through"):
            read_scalar(kind, text)
    assert math.isnan(read_scalar(kind, ".NaN", finite=False))
    for finite in (True, False):
        with pytest.raises(ValueError, match='is a finite number, not "1e999"$'):
            read_scalar(kind, "1e999", finite)
