"""Transforms in the file, and the axes of frames."""

from pathlib import Path

import numpy as np
import pytest

from onebot_bringup.viewer.core.rerun_limits import REPEAT_AFTER
from onebot_bringup.viewer.core.shown_robot import RobotToShow
from onebot_bringup.viewer.core.transform_stream import TransformStream
from onebot_bringup.viewer.display_server import open_recording
from onebot_description.ros.frame_tree import FrameTree
from onebot_description.ros.wire.message_arrays import TfArrays
from tests.onebot_bringup import viewer_support as support
from tests.onebot_bringup.drive_support import column, stamps
from tests.onebot_bringup.viewer_support import START_NS, transforms

NO_TURN = np.array([0.0, 0.0, 0.0, 1.0])


def test_static_transforms_are_logged_once_until_they_change(tmp_path):
    """A publisher that repeats itself does not fill the server's memory; a file has all frames."""
    recording = open_recording(save=tmp_path / "x.rrd")
    stream = TransformStream(recording.stream, FrameTree())
    for y in (1.0, 1.0, 1.0, 2.0, 2.0):
        for frame in ("plate", "rack"):
            stream.add_static(transforms("base", frame, y))
    recording.close()
    for frame in ("plate", "rack"):
        rows = column(tmp_path / "x.rrd", f"/tf_static/{frame}", "Transform3D:translation")
        assert rows == [[[0.0, 1.0, 0.0]], [[0.0, 2.0, 0.0]]]


def test_slow_transforms_are_repeated_among_fast_ones(tmp_path, monkeypatch):
    """What was said once is logged anew beside what comes all the time."""
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    recording = open_recording(save=tmp_path / "x.rrd")
    stream = TransformStream(recording.stream, FrameTree())
    stream.add(START_NS, transforms("odom", "base", 3.0))
    stream.flush()
    for step in range(1, 4):
        now[0] += 2.0 * REPEAT_AFTER
        stream.add(START_NS, transforms("base", "tip", 0.0, START_NS + step))
        stream.flush()
    recording.close()
    children = column(tmp_path / "x.rrd", "/tf", "Transform3D:child_frame")
    times = stamps(tmp_path / "x.rrd", "/tf")
    rows = [(child, stamp) for [child], stamp in zip(children, times, strict=True)]
    assert rows.count(("base", START_NS + 3)) == 1
    assert rows.count(("tip", START_NS + 3)) == 1


@pytest.mark.parametrize(
    ("shift", "turn"),
    [
        ([np.nan, 0.0, 0.0], NO_TURN),
        ([1e308, 0.0, 0.0], NO_TURN),
        ([0.0, 0.0, 0.0], np.zeros(4)),
        ([0.0, 0.0, 0.0], 1.01 * NO_TURN),
        ([0.0, 0.0, 0.0], np.array([0.0, 0.0, np.nan, 1.0])),
    ],
)
@pytest.mark.parametrize("static", [False, True])
def test_what_is_no_transform_is_ignored_as_tf2_does(shift, turn, static, tmp_path):
    """The other transforms of its message count, and so does its frame's next one."""
    recording, tree = open_recording(save=tmp_path / "x.rrd"), FrameTree()
    stream = TransformStream(recording.stream, tree)
    rows = np.array([[1.0, 0, 0], shift]), np.array([NO_TURN, turn])
    stamps = np.array([START_NS, START_NS])
    message = TfArrays(("odom", "base"), ("base", "arm"), stamps, *rows)
    if static:
        stream.add_static(message)
    else:
        stream.add(START_NS, message)
    assert stream.flush() != static
    assert tree.names == {"odom", "base"} and tree.pose("base", "odom")[0, 3] == 1.0
    assert stream.ignored == "arm"
    good = message._replace(translations=np.zeros((2, 3)), rotations=np.tile(NO_TURN, (2, 1)))
    stream.add(START_NS, good)
    assert stream.flush() and tree.top("arm") == "odom"
    recording.close()
    frames = column(tmp_path / "x.rrd", "/tf", "Transform3D:child_frame")
    assert frames.count(["arm"]) == 1


ROBOT = """<robot name="r"><link name="base"/><link name="{}"/>
<joint name="j" type="fixed"><parent link="base"/><child link="{}"/></joint></robot>"""


class Shown(support.Shown):
    """A robot whose link "old" becomes "new", drawn into a file."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, robot=False, robots=[RobotToShow(frame_prefix="a_")])

    @property
    def frames(self) -> frozenset[str]:
        """All that are in the tree."""
        return self.view.stage.frames.names

    def set_robot(self, link: str) -> None:
        """Show the robot with this link."""
        support.describe(self.view, ROBOT.format(link, link))
        self.tick()

    def receive(self, *children: str) -> None:
        """A message of /tf names them, and is drawn."""
        for child in children:
            support.take_tf(self.view, transforms("a_base", f"a_{child}", 0.0))
        self.tick()

    def drawn(self, frame: str, name: str = "CoordinateFrame:frame") -> list:
        """What was logged of the axes of a frame; the file is complete then."""
        return [value for [value] in column(self.end(), f"/frames/a_{frame}", name)]


def test_a_link_that_is_no_more_is_hidden_at_once(tmp_path: Path) -> None:
    """It goes to a frame that exists, though a message straggles.

    That of a link both robots have stays, and is drawn once; a link that is back is drawn again.
    """
    shown = Shown(tmp_path)
    shown.receive("old")
    shown.set_robot("old")
    shown.receive("old")
    shown.set_robot("new")
    assert "a_old" not in shown.frames
    shown.receive("old", "new")
    shown.set_robot("old")
    shown.receive("old", "new")
    for link, times in (("old", 2), ("base", 1), ("new", 1)):
        assert shown.drawn(link).count(f"a_{link}") == times, link


def test_names_are_shown_of_few_frames_or_on_request(tmp_path: Path) -> None:
    """Of a robot with many frames they would hide it; drawn anew only when that changes."""
    shown = Shown(tmp_path)
    shown.receive("old")
    shown.set_robot("old")
    shown.receive(*(f"frame{number}" for number in range(15)))
    shown.receive("old", "frame3")
    for axes in ("names_up_to: 17", "", "names: false", "frames: [a_base, a_old]"):
        shown.look(f"axes: {{{axes}}}")
    # At first 2 frames, then 17, and at last 2 again.
    assert shown.drawn("base", "TransformAxes3D:show_frame") == [True, False, True, False, True]
