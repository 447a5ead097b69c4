"""The numbers of ``topic hz and bw``, in the very form that ros2 prints, and at their edges."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.introspection.rates import Bandwidth, Intervals, Window


def test_rate() -> None:
    """The form of ros2 topic hz; nothing without news; a clock that jumps back starts anew."""
    meter = Intervals(10)
    assert meter.report() is None
    for step in range(4):
        meter.arrived(10.0 + step * 0.25)
    assert meter.report() == (
        "average rate: 4.000\n\tmin: 0.250s max: 0.250s std dev: 0.00000s window: 3"
    )
    assert meter.report() is None
    meter.arrived(1.0)
    assert meter.report() is None
    meter.arrived(2.0)
    assert (meter.report() or "").startswith("average rate: 1.000\n")


def test_rate_of_a_window() -> None:
    """Only the last intervals count."""
    meter = Intervals(2)
    for moment in (0.0, 5.0, 6.0, 8.0):
        meter.arrived(moment)
    assert meter.report() == (
        "average rate: 0.667\n\tmin: 1.000s max: 2.000s std dev: 0.50000s window: 2"
    )


def test_bandwidth() -> None:
    """The form of ros2 topic bw."""
    meter = Bandwidth(10)
    for moment in (0.0, 1.0):
        meter.arrived(moment, 1500)
    assert meter.report(2.0) == (
        "1.50 KB/s from 2 messages\n\tMessage size mean: 1.50 KB min: 1.50 KB max: 1.50 KB"
    )


@given(st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=20), st.integers(1, 8) | st.none())
def test_a_window_is_its_last_samples(samples: list[float], size: int | None) -> None:
    """Mean, least, greatest and deviation, of at most ``size`` of them."""
    window = Window(size)
    for sample in samples:
        window.add(sample)
    kept = samples if size is None else samples[-size:]
    found = window.statistics()
    assert found is not None and window.statistics() is None
    assert (found.low, found.high, found.count) == (min(kept), max(kept), len(kept))
    assert found.mean == pytest.approx(sum(kept) / len(kept), abs=1e-9)
    squares = sum((sample - found.mean) ** 2 for sample in kept) / len(kept)
    assert found.deviation == pytest.approx(math.sqrt(squares), abs=1e-9)


def test_a_window_that_was_cleared_begins_anew() -> None:
    """Nothing of before is in it, and nothing is reported until a sample comes."""
    window = Window(None)
    window.add(1.0)
    window.clear()
    assert window.statistics() is None
    window.add(3.0)
    found = window.statistics()
    assert found is not None and (found.mean, found.count) == (3.0, 1)


def test_messages_at_the_same_moment_have_an_interval_of_zero() -> None:
    """They do not count as a clock set back; a rate without time is 0."""
    meter = Intervals(None)
    for moment in (1.0, 1.0, 1.0):
        meter.arrived(moment)
    text = meter.report() or ""
    assert text.startswith("average rate: 0.000\n") and text.endswith("window: 2")
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
