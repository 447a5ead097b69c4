"""What is in the file after speeds were collected and flushed."""

import numpy as np
import pytest

from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.displays.speeds import SpeedStream
from onebot_description.wire.messages import TwistSample
from tests.onebot_bringup.drive_support import column, curve, odometry
from tests.onebot_bringup.viewer_support import START_NS

SECOND = 10**9


def _flushed(tmp_path, rows, held=False):
    recording = open_recording(save=tmp_path / "x.rrd")
    stream = SpeedStream(recording.stream, "measured", (1, 2, 3))
    for seconds, linear, angular in rows:
        vectors = np.array([linear, 0, 0]), np.array([0, 0, angular])
        sample = TwistSample(0, *vectors)
        if not held:
            sample = odometry(0)._replace(linear=vectors[0], angular=vectors[1])
        stream.add(START_NS + round(seconds * SECOND), sample)
    assert stream.flush() and not stream.flush()
    recording.close()
    return [curve(tmp_path / "x.rrd", f"/speeds/{axis}/measured") for axis in ("linear", "angular")]


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


def test_infinity_is_a_gap(tmp_path):
    """One infinite value would hide the whole plot."""
    linear, angular = _flushed(tmp_path, [(0, 1.0, 1.0), (0.1, np.inf, -np.inf), (0.2, 2.0, 2.0)])
    np.testing.assert_array_equal([linear, angular], [[1, np.nan, 2]] * 2)


def test_a_steady_speed_is_flat(tmp_path):
    """A plot zooms in on whatever there is: a micrometre a second of noise would fill it."""
    noise = 1.5e-6 * np.random.default_rng(3).standard_normal(200)
    linear, angular = _flushed(
        tmp_path, [(0.02 * i, 0.2 + error, error) for i, error in enumerate(noise)]
    )
    np.testing.assert_array_equal(linear, 0.2)
    np.testing.assert_array_equal(angular, 0.0)
