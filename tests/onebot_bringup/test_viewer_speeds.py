"""What is in the file after speeds were collected and flushed."""

import numpy as np
import pytest

from onebot_bringup.viewer.displays.curves import GAP
from tests.onebot_bringup.drive_support import chunks, column, curve, odometry
from tests.onebot_bringup.viewer_support import START_NS, Shown, take_command, take_odometry

SECOND = 10**9


def _flushed(tmp_path, rows, held=False):
    shown = Shown(tmp_path, "speeds: {lines: {measured: {topic: v, color: [1, 2, 3]}}}")
    for seconds, linear, angular in rows:
        stamp = START_NS + round(seconds * SECOND)
        if held:
            take_command(shown.view, "v", stamp, float(linear), float(angular))
        else:
            take_odometry(shown.view, "v", stamp, odometry(0, speed=linear, turn=angular))
    file = shown.end()
    return [curve(file, f"/speeds/{axis}/measured") for axis in ("linear", "angular")]


@pytest.mark.parametrize("held", [False, True])
def test_speeds_are_two_curves_with_names(tmp_path, held):
    """Linear and angular speeds at their own times; a command holds until the next one."""
    linear, angular = _flushed(tmp_path, [(0.02 * i, 0.1 * i, -0.2 * i) for i in range(9)], held)
    np.testing.assert_allclose(linear, 0.1 * np.arange(9))
    np.testing.assert_allclose(angular, -0.2 * np.arange(9))
    for axis in ("linear", "angular"):
        entity = f"/speeds/{axis}/measured"
        names = column(tmp_path / "x.rrd", entity, "SeriesLines:names")
        modes = column(tmp_path / "x.rrd", entity, "SeriesLines:interpolation_mode")
        assert names == [["measured"]]
        assert modes == [[2 if held else 1]], "Rerun's numbers of StepAfter and Linear"
        times = column(tmp_path / "x.rrd", entity, "ros_time")
        steps = np.diff(np.array(times, "datetime64[ns]").astype(np.int64))
        np.testing.assert_array_equal(steps, 20_000_000)


def test_a_pause_is_a_gap_in_the_curve(tmp_path):
    """Nothing is drawn over seconds in which nobody spoke; a short one is bridged."""
    linear, _ = _flushed(tmp_path, [(0, 1, 1), (1, 2, 2), (9, 3, 3)])
    np.testing.assert_array_equal(linear, [1, 2, np.nan, 3])


@pytest.mark.parametrize("value", [np.inf, 1.7e308])
def test_infinity_is_a_gap(tmp_path, value):
    """One infinite value would hide the whole plot; so would one that is, once it is rounded."""
    linear, angular = _flushed(tmp_path, [(0, 1.0, 1.0), (0.1, value, -value), (0.2, 2.0, 2.0)])
    np.testing.assert_array_equal([linear, angular], [[1, np.nan, 2]] * 2)


def test_a_steady_speed_is_flat(tmp_path):
    """A plot zooms in on whatever there is: a micrometre a second of noise would fill it."""
    noise = 1.5e-6 * np.random.default_rng(3).standard_normal(200)
    linear, angular = _flushed(
        tmp_path, [(0.02 * i, 0.2 + error, error) for i, error in enumerate(noise)]
    )
    np.testing.assert_array_equal(linear, 0.2)
    np.testing.assert_array_equal(angular, 0.0)


def test_a_gap_is_longer_than_a_second_and_a_half(tmp_path):
    """That long itself is still bridged; the gap begins just after the last message."""
    rows = [(0, 1, -1), (GAP, 2, -2), (2 * GAP + 1e-9, 3, -3)]
    linear, angular = _flushed(tmp_path, rows)
    np.testing.assert_array_equal(linear, [1, 2, np.nan, 3])
    np.testing.assert_array_equal(angular, [-1, -2, np.nan, -3])
    *_, rows = chunks(tmp_path / "x.rrd", "/speeds/linear/measured")
    times = rows.to_record_batch().column("ros_time").cast("int64").to_pylist()
    last = round(GAP * SECOND)
    assert [time - START_NS for time in times] == [0, last, last + 1, 2 * last + 1]


def test_a_clock_set_back_is_no_gap(tmp_path):
    """The curve goes on at the earlier time, where a file has it, and gaps count from there."""
    linear, _ = _flushed(tmp_path, [(9, 1, 0), (0, 2, 0), (1, 3, 0), (8, 4, 0)])
    np.testing.assert_array_equal(linear, [2, 3, np.nan, 4, 1])


@pytest.mark.parametrize("held", [False, True])
def test_curves_look_as_what_they_are(tmp_path, held):
    """A command lies beneath as a wide band, without the average that would put stairs into it."""
    _flushed(tmp_path, [(0, 1, 1), (1, 1, 1), (2, 1, 1)], held)
    for axis in ("linear", "angular"):
        entity = f"/speeds/{axis}/measured"
        assert column(tmp_path / "x.rrd", entity, "SeriesLines:colors") == [[0x010203FF]]
        assert column(tmp_path / "x.rrd", entity, "SeriesLines:widths") == [[6.0 if held else 2.0]]
        [[policy]] = column(tmp_path / "x.rrd", entity, "SeriesLines:aggregation_policy")
        assert policy == (1 if held else 2), "Rerun's numbers of Off and Average"


def test_the_last_digits_are_left_out(tmp_path):
    """A tenth of a millimetre a second is kept."""
    linear, angular = _flushed(tmp_path, [(0, 0.12344, -0.12346)])
    assert (linear, angular) == ([0.1234], [-0.1235])
