"""What is in the file after transforms and joint states were collected and flushed."""

import warnings
from pathlib import Path

import numpy as np
import pytest
import rerun.chunk as rc

from onebot_bringup.introspection.transforms import FrameTree
from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.displays import tf
from onebot_bringup.viewer.displays.joint_plot import JointStream
from onebot_bringup.viewer.displays.tf import TransformStream
from tests.onebot_bringup.viewer_support import START_NS, transforms


def _chunks(path: Path, entity: str) -> list:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a recording without a footer is our choice
        reader = rc.RrdReader(str(path))
    return [chunk for chunk in reader.stream() if str(chunk.entity_path) == entity]


def _column(chunk, name: str) -> list:
    return chunk.to_record_batch().column(name).to_pylist()


def test_messages_between_two_flushes_make_one_chunk_with_their_own_times(tmp_path):
    """Fifty messages are logged in one call, a row each, at the messages' stamps."""
    recording = open_recording(save=tmp_path / "x.rrd")
    stream = TransformStream(recording.stream, FrameTree())
    assert not stream.flush()
    for step in range(50):
        stream.add(START_NS, transforms("base", "tip", float(step), START_NS + step))
    assert stream.flush() and not stream.flush()
    recording.close()
    [chunk] = _chunks(tmp_path / "x.rrd", "/tf")
    assert chunk.num_rows == 50 and chunk.timeline_names == ["ros_time"]
    times = chunk.to_record_batch().column("ros_time").cast("int64").to_pylist()
    assert times == [START_NS + step for step in range(50)]
    places = [row[0] for row in _column(chunk, "Transform3D:translation")]
    np.testing.assert_allclose(places, [[0, step, 0] for step in range(50)])


def test_a_stamp_of_zero_means_now(tmp_path):
    """Transforms without a time are shown at the time they came."""
    recording = open_recording(save=tmp_path / "x.rrd")
    stream = TransformStream(recording.stream, FrameTree())
    stream.add(START_NS, transforms("base", "tip", 0.0, 0))
    stream.flush()
    recording.close()
    [chunk] = _chunks(tmp_path / "x.rrd", "/tf")
    assert chunk.to_record_batch().column("ros_time").cast("int64").to_pylist() == [START_NS]


def test_static_transforms_are_logged_once_until_they_change(tmp_path):
    """A publisher that repeats itself does not fill the server's memory."""
    recording = open_recording(save=tmp_path / "x.rrd")
    stream = TransformStream(recording.stream, FrameTree())
    for y in (1.0, 1.0, 1.0, 2.0, 2.0):
        stream.add_static(transforms("base", "plate", y))
    recording.close()
    assert sum(chunk.num_rows for chunk in _chunks(tmp_path / "x.rrd", "/tf_static/plate")) == 2


def test_slow_transforms_are_repeated_among_fast_ones(tmp_path, monkeypatch):
    """What was said once is logged anew beside what comes all the time."""
    monkeypatch.setattr(tf, "REPEAT_AFTER", 0.0)
    recording = open_recording(save=tmp_path / "x.rrd")
    stream = TransformStream(recording.stream, FrameTree())
    stream.add(START_NS, transforms("odom", "base", 3.0))
    stream.flush()
    for step in range(1, 4):
        stream.add(START_NS, transforms("base", "tip", 0.0, START_NS + step))
        stream.flush()
    recording.close()
    rows = [
        (child[0], time)
        for chunk in _chunks(tmp_path / "x.rrd", "/tf")
        for child, time in zip(
            _column(chunk, "Transform3D:child_frame"),
            chunk.to_record_batch().column("ros_time").cast("int64").to_pylist(),
            strict=True,
        )
    ]
    assert rows.count(("base", START_NS + 3)) == 1
    assert rows.count(("tip", START_NS + 3)) == 1


def test_joints_are_curves_with_the_joints_names(tmp_path):
    """Positions and velocities of one flush are one chunk each, under a legend of names."""
    recording = open_recording(save=tmp_path / "x.rrd")
    stream = JointStream(recording.stream)
    for step in range(10):
        values = np.array([step, -step], float)
        stream.add(START_NS + step, ("left", "right"), values, values / 2)
    assert stream.flush() and not stream.flush() and stream.has_velocities
    recording.close()
    for entity, factor in (("/joints/position/0", 1.0), ("/joints/velocity/0", 0.5)):
        legend, curve = sorted(_chunks(tmp_path / "x.rrd", entity), key=lambda c: not c.is_static)
        assert _column(legend, "SeriesLines:names") == [["left", "right"]]
        rows = _column(curve, "Scalars:scalars")
        np.testing.assert_allclose(rows, [[factor * i, -factor * i] for i in range(10)])


def test_joint_sets_of_several_publishers_do_not_mix(tmp_path):
    """An arm's and a gripper's publisher have curves of their own; a mismatch is left out."""
    recording = open_recording(save=tmp_path / "x.rrd")
    stream = JointStream(recording.stream)
    nothing = np.empty(0)
    stream.add(START_NS, ("arm",), np.ones(1), nothing)
    stream.add(START_NS, ("finger", "thumb"), np.ones(2), nothing)
    stream.add(START_NS + 1, ("arm",), np.ones(2), nothing)
    stream.add(START_NS + 1, (), nothing, nothing)
    stream.flush()
    recording.close()
    rows = [
        sum(chunk.num_rows for chunk in _chunks(tmp_path / "x.rrd", entity) if not chunk.is_static)
        for entity in ("/joints/position/0", "/joints/position/1", "/joints/velocity/0")
    ]
    assert rows == [1, 1, 0] and not stream.has_velocities


@pytest.mark.parametrize(
    "names",
    [
        [(f"joint_{number}",) for number in range(40)],
        [(f"{number}" * 1_000_000,) for number in range(10)],
    ],
)
def test_joint_sets_are_plotted_up_to_a_bound(tmp_path, names):
    """Of their number and of their size, which is reported; those before go on."""
    recording = open_recording(save=tmp_path / "x.rrd")
    stream = JointStream(recording.stream)
    for each in (*names, names[0]):
        stream.add(START_NS, each, np.zeros(1), np.zeros(0))
    plotted = len(stream.colors)
    assert plotted == (32 if len(names) == 40 else 4) and stream.full
    stream.flush()
    recording.close()
    chunks = _chunks(tmp_path / "x.rrd", "/joints/position/0")
    assert sum(chunk.num_rows for chunk in chunks if not chunk.is_static) == 2
