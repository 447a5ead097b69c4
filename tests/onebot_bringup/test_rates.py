"""The numbers of ``topic hz and bw``, in the very form that ros2 prints, and at their edges."""

import pytest

from onebot_bringup.introspection.rates import Arrivals


def test_rate() -> None:
    """As ros2 topic hz, of a window; nothing without news; 0 if no time passes."""
    arrivals = Arrivals(3)
    for moment in (0.0, 5.0, 6.0, 8.0):
        arrivals.add(moment)
    assert arrivals.rate_report() == (
        "average rate: 0.667\n\tmin: 1.000s max: 2.000s std dev: 0.50000s window: 2"
    )
    assert arrivals.rate_report() is None
    arrivals = Arrivals(10)
    arrivals.add(1.0)
    assert arrivals.rate_report() is None
    arrivals.add(1.0)
    assert (arrivals.rate_report() or "").startswith("average rate: 0.000\n")


def test_bandwidth() -> None:
    """Since the first message of the window, nothing with a single message or without news."""
    arrivals = Arrivals(2)
    arrivals.add(0.0, 10**9)
    assert arrivals.bandwidth_report(1.0) is None
    for moment, size in ((4.0, 1000), (5.0, 2000)):
        arrivals.add(moment, size)
    assert arrivals.bandwidth_report(6.0) == (
        "1.50 KB/s from 2 messages\n\tMessage size mean: 1.50 KB min: 1.00 KB max: 2.00 KB"
    )
    assert arrivals.bandwidth_report(7.0) is None


@pytest.mark.parametrize(
    ("size", "text"),
    [(999, "999 B"), (1000, "1.00 KB"), (999_990, "999.99 KB"), (1_000_000, "1.00 MB")],
)
def test_sizes_have_the_largest_unit_that_fits(size: int, text: str) -> None:
    """Thousands, as ros2 topic bw has them."""
    arrivals = Arrivals(10)
    for moment in (0.0, 1.0):
        arrivals.add(moment, size)
    assert f"mean: {text} min: {text} max: {text}" in (arrivals.bandwidth_report(2.0) or "")
