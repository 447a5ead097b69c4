"""The numbers of ``topic hz and bw``, in the very form that ros2 prints, and at their edges."""

import pytest

from onebot_bringup.introspection.rates import Bandwidth, Intervals


def test_rate() -> None:
    """As ros2 topic hz, of a window; nothing without news; a clock that jumps back starts anew."""
    meter = Intervals(2)
    for moment in (0.0, 5.0, 6.0, 8.0):
        meter.arrived(moment)
    assert meter.report() == (
        "average rate: 0.667\n\tmin: 1.000s max: 2.000s std dev: 0.50000s window: 2"
    )
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


def test_messages_at_the_same_moment_have_an_interval_of_zero() -> None:
    """They do not count as a clock set back; a rate without time is 0."""
    meter = Intervals(10)
    for moment in (1.0, 1.0, 1.0):
        meter.arrived(moment)
    text = meter.report() or ""
    assert text.startswith("average rate: 0.000\n") and text.endswith("window: 2")
    meter.arrived(2.0)
    assert (meter.report() or "").startswith("average rate: 3.000\n")


def test_one_message_has_no_bandwidth() -> None:
    """Nor have messages without time between them, or without news since the last report."""
    meter = Bandwidth(10)
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
    meter = Bandwidth(10)
    for moment in (0.0, 1.0):
        meter.arrived(moment, size)
    assert f"mean: {text} min: {text} max: {text}" in (meter.report(2.0) or "")
