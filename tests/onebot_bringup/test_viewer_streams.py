"""What is in the file after transforms and joint states were collected and flushed."""

import time
import warnings
from pathlib import Path

import numpy as np
import rerun.chunk as rc

from onebot_bringup.introspection.transforms import FrameTree
from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.displays.tf import TransformStream
from tests.onebot_bringup.viewer_support import START_NS, Shown, take_joints, transforms


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
    monkeypatch.setattr("onebot_bringup.viewer.displays.display.REPEAT_AFTER", 0.05)
    recording = open_recording(save=tmp_path / "x.rrd")
    stream = TransformStream(recording.stream, FrameTree())
    stream.add(START_NS, transforms("odom", "base", 3.0))
    stream.flush()
    for step in range(1, 4):
        time.sleep(0.1)
        stream.add(START_NS, transforms("base", "tip", 0.0, START_NS + step))
        stream.flush()
    recording.close()
    rows = [
        (child[0], stamp)
        for chunk in _chunks(tmp_path / "x.rrd", "/tf")
        for child, stamp in zip(
            _column(chunk, "Transform3D:child_frame"),
            chunk.to_record_batch().column("ros_time").cast("int64").to_pylist(),
            strict=True,
        )
    ]
    assert rows.count(("base", START_NS + 3)) == 1
    assert rows.count(("tip", START_NS + 3)) == 1


def _plotted(tmp_path, *states):
    """The file with joint states, (names, positions, velocities) each, and what was said."""
    shown = Shown(tmp_path)
    for step, state in enumerate(states):
        take_joints(shown.view, START_NS + step, *state)
    said = shown.tick(START_NS + len(states) * 10**9)
    return shown.end(), said


def test_joint_states_are_curves_with_the_joints_names(tmp_path):
    """Positions and velocities of one flush are one chunk each, under a legend of names."""
    states = [(("left", "right"), (step, -step), (step / 2, -step / 2)) for step in range(10)]
    file, _ = _plotted(tmp_path, *states)
    for entity, factor in (("/joints/position/0", 1.0), ("/joints/velocity/0", 0.5)):
        legend, curve = sorted(_chunks(file, entity), key=lambda c: not c.is_static)
        assert _column(legend, "SeriesLines:names") == [["left", "right"]]
        rows = _column(curve, "Scalars:scalars")
        np.testing.assert_allclose(rows, [[factor * i, -factor * i] for i in range(10)])


def test_joint_sets_of_several_publishers_do_not_mix(tmp_path):
    """An arm's and a gripper's publisher have curves of their own; a mismatch is left out."""
    names = ("finger", "thumb")
    states = ((("arm",), (1,)), (names, (1, 1)), (("arm",), (1, 1)), ((), ()))
    file, _ = _plotted(tmp_path, *states)
    rows = [
        sum(chunk.num_rows for chunk in _chunks(file, entity) if not chunk.is_static)
        for entity in ("/joints/position/0", "/joints/position/1", "/joints/velocity/0")
    ]
    assert rows == [1, 1, 0]


def test_joint_sets_are_plotted_up_to_a_bound(tmp_path):
    """More are reported; those before go on."""
    names = [(f"joint_{number}",) for number in (*range(40), 0)]
    file, [text] = _plotted(tmp_path, *((name, (0.0,)) for name in names))
    assert text == "joint_states has more than 32 lists of names: not all plotted"
    assert _chunks(file, "/joints/position/31") and not _chunks(file, "/joints/position/32")
    chunks = _chunks(file, "/joints/position/0")
    assert sum(chunk.num_rows for chunk in chunks if not chunk.is_static) == 2
