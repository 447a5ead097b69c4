import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.displays.tf import AxesSettings, TfDisplay, TransformStream
from onebot_bringup.viewer.frames import FrameTree
from onebot_bringup.viewer.shown_robot import RobotToShow
from onebot_bringup.viewer.stage import Stage
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.description import parse_description
from onebot_description.wire.messages import TfArrays
from tests.onebot_bringup.drive_support import column
from tests.onebot_bringup.viewer_support import START_NS, transforms
from tests.support import assert_time_grows_with_size

QUARTER_TURN = np.array([0, 0, np.sqrt(0.5), np.sqrt(0.5)])  # about z
NO_TURN = np.array([0.0, 0.0, 0.0, 1.0])


def _tree() -> FrameTree:
    tree = FrameTree()
    tree.update(
        ["odom", "base", "base"],
        ["base", "arm", "wheel"],
        np.array([[1.0, 0, 0], [0, 2, 0], [0, 0, 3]]),
        np.array([QUARTER_TURN, NO_TURN, NO_TURN]),
    )
    return tree


def test_the_top_frame_is_the_one_above_all():
    """Every frame leads to odom; an unknown one is its own top."""
    tree = _tree()
    assert {tree.top(name) for name in tree.names} == {"odom"}
    assert tree.top("elsewhere") == "elsewhere"


def test_poses_chain_transforms():
    """A point 2 m along y of a base turned by a quarter lies at x = 1 - 2."""
    tree = _tree()
    np.testing.assert_allclose(tree.pose("arm", "odom")[:3, 3], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(tree.pose("wheel", "arm")[:3, 3], [0, -2, 3], atol=1e-12)
    assert tree.pose("elsewhere", "odom") is None
    assert set(tree.poses(["arm", "elsewhere"], "base")) == {"arm"}


def _joined(parents: Sequence[str], children: Sequence[str]) -> FrameTree:
    tree, count = FrameTree(), len(parents)
    tree.update(parents, children, np.tile([1.0, 0, 0], (count, 1)), np.tile(NO_TURN, (count, 1)))
    return tree


def test_each_frame_of_a_circle_is_its_own_top():
    """Nonsense on /tf must not hang the viewer; what is below the circle remains connected."""
    tree = _joined(["b", "c", "a", "b", "link", "d"], ["a", "b", "c", "link", "tip", "d"])
    assert [tree.top(name) for name in "abcd"] == ["a", "b", "c", "d"]
    assert tree.top("tip") == tree.top("link") == "b"
    assert tree.pose("tip", "link")[0, 3] == 1.0 and tree.pose("tip", "b")[0, 3] == 2.0
    assert tree.pose("a", "b") is None and tree.pose("a", "a")[0, 3] == 0.0
    tree = _joined(["b", "c", "a", "b", "link"], ["a", "b", "c", "link", "tip"])
    assert tree.top("tip") == "b" and tree.top("c") == "c" and tree.top("b") == "b"


def test_a_large_circle_takes_time_by_its_size():
    """And not by its square."""

    def seconds(count: int) -> float:
        names = [f"frame_{number}" for number in range(count)]
        tree, start = _joined(names, [*names[1:], names[0]]), time.process_time()
        for name in names:
            tree.top(name)
        return time.process_time() - start

    assert_time_grows_with_size(seconds, 20_000)


def test_forgotten_frames_are_gone_until_heard_again():
    """Frames of a removed link vanish."""
    tree = _tree()
    tree.forget(["arm", "never"])
    assert tree.names == {"odom", "base", "wheel"}
    tree.update(["base"], ["arm"], np.zeros((1, 3)), NO_TURN[None])
    assert "arm" in tree.names


def test_the_same_lists_of_names_again_only_move_the_frames():
    """Poses follow, and nothing says that what hangs on what has changed."""
    tree, parents, children = FrameTree(), ["a", "b"], ["b", "c"]
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    tree.update(parents, children, np.array([[1.0, 0, 0], [2.0, 0, 0]]), turns)
    version = tree.version
    tree.update(parents, children, np.array([[3.0, 0, 0], [4.0, 0, 0]]), turns)
    assert tree.version == version
    assert tree.pose("c", "a")[0, 3] == 7.0


def test_another_message_on_a_frame_counts_and_so_does_the_next_of_the_first():
    """The last word on each frame holds, whoever says it; hanging elsewhere is a change."""
    tree, parents, children = FrameTree(), ["a", "b"], ["b", "c"]
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    both = np.array([[1.0, 0, 0], [2.0, 0, 0]])
    tree.update(parents, children, both, turns)
    version = tree.version
    tree.update(["x"], ["c"], np.array([[9.0, 0, 0]]), turns[:1])
    assert tree.version != version and tree.top("c") == "x"
    tree.update(parents, children, both, turns)
    assert tree.top("c") == "a" and tree.pose("c", "a")[0, 3] == 3.0
    tree.forget(["b"])
    assert tree.top("c") == "b" and tree.names == {"b", "c"}
    tree.update(parents, children, both, turns)
    assert tree.top("c") == "a" and tree.names == {"a", "b", "c"}


def _moved(tree, parents, children, *steps):
    """Add messages of one transform each, at (seconds, x, quaternion)."""
    messages = [
        TfArrays(
            parents,
            children,
            np.array([int(seconds * 1e9)]),
            np.array([[x, 0.0, 0.0]]),
            np.array([turn]),
        )
        for seconds, x, turn in steps
    ]
    last = messages[-1]
    tree.update(parents, children, last.translations, last.rotations, messages)


def test_a_pose_at_a_time():
    """Interpolated between two messages, as tf2 does; else that of the nearest."""
    tree, names = FrameTree(), (["odom"], ["base"])
    tree.update(["base"], ["laser"], np.array([[1.0, 0, 0]]), NO_TURN[None])  # static
    _moved(tree, *names, (1.0, 0.0, NO_TURN), (2.0, 4.0, -QUARTER_TURN))
    _moved(tree, *names, (3.0, 6.0, QUARTER_TURN))

    def laser(seconds):
        return tree.pose("laser", "odom", int(seconds * 1e9))[:2, 3]

    np.testing.assert_allclose(laser(1.5), [2 + np.sqrt(0.5), np.sqrt(0.5)])
    np.testing.assert_allclose(laser(2.75), [5.5, 1], atol=1e-12)
    for first in (0.5, 1.0):
        np.testing.assert_allclose(laser(first), [1, 0])
    for latest in (0, -20.0, 3.0, 9.0):
        np.testing.assert_allclose(laser(latest), [6, 1], atol=1e-12)
    back = tree.pose("odom", "laser", int(1.5e9))
    np.testing.assert_allclose(back, np.linalg.inv(tree.pose("laser", "odom", int(1.5e9))))
    _moved(tree, *names, (1.0, 8.0, NO_TURN), (2.0, 8.0, NO_TURN))
    np.testing.assert_allclose(laser(1.5), [9, 0])  # the clock was set back


def test_a_transform_that_comes_late_takes_its_place_in_the_history():
    """The latest is that of the latest stamp, as in tf2."""
    tree, names = FrameTree(), (["odom"], ["base"])
    for seconds in (1.0, 2.0, 3.0, 2.5, 4.0, 3.5):
        _moved(tree, *names, (seconds, 10 * seconds, NO_TURN))
    for seconds, x in ((0, 40), (1.5, 15), (2.25, 22.5), (3.25, 32.5)):
        assert tree.pose("base", "odom", int(seconds * 1e9))[0, 3] == pytest.approx(x)
    assert tree.known_until("base") == 4e9


def test_the_history_is_bounded():
    """By time, and by the number of messages."""
    tree, names = FrameTree(), (["odom"], ["base"])
    for number in range(200):
        _moved(tree, *names, (1 + number / 10, float(number), NO_TURN))
    for seconds, x in ((15.95, 149.5), (10.95, 99.5), (9.95, 99.0), (0.5, 199.0)):
        assert tree.pose("base", "odom", int(seconds * 1e9))[0, 3] == pytest.approx(x)
    for number in range(2000):
        _moved(tree, *names, (30 + number / 1000, float(number), NO_TURN))
    for seconds, x in ((31.5, 1500), (30.9, 1000)):
        assert tree.pose("base", "odom", int(seconds * 1e9))[0, 3] == pytest.approx(x)


@pytest.mark.parametrize(
    ("shift", "turn"),
    [
        ([np.nan, 0.0, 0.0], NO_TURN),
        ([0.0, -np.inf, 0.0], NO_TURN),
        ([1e308, 0.0, 0.0], NO_TURN),
        ([0.0, 0.0, 0.0], np.zeros(4)),
        ([0.0, 0.0, 0.0], 1.01 * NO_TURN),
        ([0.0, 0.0, 0.0], np.array([0.0, 0.0, np.nan, 1.0])),
        ([0.0, 0.0, 0.0], np.array([1e308, 0.0, 0.0, 1e308])),
    ],
)
@pytest.mark.parametrize("static", [False, True])
def test_what_is_no_transform_is_ignored_as_tf2_does(shift, turn, static, tmp_path):
    """The other transforms of its message count, and so does its frame's next one."""
    recording, tree = open_recording(save=tmp_path / "x.rrd"), FrameTree()
    stream = TransformStream(recording.stream, tree)
    rows = np.array([[1.0, 0, 0], shift]), np.array([NO_TURN, turn])
    stamps = np.array([START_NS, START_NS])
    message = TfArrays(["odom", "base"], ["base", "arm"], stamps, *rows)
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


class _Shown:
    """A robot whose link "old" becomes "new", drawn into a file at times that the test sets."""

    def __init__(self, file: Path) -> None:
        self.now, self._file = 100.0, file
        self._recording = open_recording(save=file)
        robots = [RobotToShow(frame_prefix="a_")]
        self._stage = Stage(self._recording.stream, ViewConfig(), robots, clock=lambda: self.now)
        self.tree = self._stage.frames
        self._display = TfDisplay(self._stage)

    def set_robot(self, link: str) -> None:
        """Show the robot with this link."""
        self._stage.robots[0].description = parse_description(ROBOT.format(link, link))
        self._display.set_robot()

    def receive(self, *children: str) -> None:
        """A message of /tf names them, and is drawn."""
        for child in children:
            self._stage.transforms.add(START_NS, transforms("a_base", f"a_{child}", 0.0))
        self.flush()

    def flush(self) -> None:
        """Draw what there is."""
        self._display.flush()

    def apply(self, settings: AxesSettings) -> None:
        """Draw as these settings have it."""
        self._display.apply(settings)

    def named(self, frame: str) -> list[bool]:
        """Whether the name was shown, each time that axes were drawn in a frame."""
        self._recording.close()
        shown = column(self._file, f"/frames/a_{frame}", "TransformAxes3D:show_frame")
        return [name for [name] in shown]

    def drawn(self, frame: str) -> int:
        """How often axes were drawn in a frame; the file is complete then."""
        self._recording.close()
        frames = column(self._file, f"/frames/a_{frame}", "CoordinateFrame:frame")
        return frames.count([f"a_{frame}"])


@pytest.fixture
def shown(tmp_path: Path) -> _Shown:
    """Frames of both links of the first robot are shown, and then it is replaced."""
    shown = _Shown(tmp_path / "x.rrd")
    shown.receive("old")
    shown.set_robot("old")
    shown.receive("old")
    shown.set_robot("new")
    return shown


def test_a_link_that_is_no_more_is_hidden_at_once(shown: _Shown) -> None:
    """It goes to a frame that exists; that of a link both robots have stays, and is drawn once."""
    assert "a_old" not in shown.tree.names
    shown.receive("new")
    assert shown.drawn("old") == 1 and shown.drawn("base") == 1 and shown.drawn("new") == 1


@pytest.mark.parametrize("after", [0.0, 1.0, 1.001])
def test_a_straggling_message_does_not_draw_it_again(shown: _Shown, after: float) -> None:
    """For a second; what came within it is forgotten when that is over."""
    shown.receive("old")
    shown.now += after
    shown.flush()
    assert ("a_old" in shown.tree.names) == (after <= 1.0)
    assert shown.drawn("old") == 1


def test_whoever_names_it_later_means_it(shown: _Shown) -> None:
    """Another node may publish a frame of that name: it is drawn, after the second."""
    shown.now += 1.5
    shown.flush()
    shown.receive("old")
    assert shown.drawn("old") == 2


def test_another_robot_within_the_second_is_waited_for_anew(shown: _Shown) -> None:
    """What it has no more is hidden, and what was hidden before may be there again."""
    shown.now += 0.9
    shown.receive("new")
    shown.set_robot("old")
    shown.now += 0.9
    shown.receive("old", "new")
    assert shown.drawn("old") == 2 and shown.drawn("new") == 1


def test_names_are_shown_of_few_frames_or_on_request(tmp_path: Path) -> None:
    """Of a robot with many frames they would hide it; drawn anew only when that changes."""
    shown = _Shown(tmp_path / "x.rrd")
    shown.receive("old")
    shown.set_robot("old")
    shown.receive(*(f"frame{number}" for number in range(15)))
    shown.receive("old", "frame3")
    for settings in (
        AxesSettings(names_up_to=17),
        AxesSettings(),
        AxesSettings(names=False),
        AxesSettings(frames=("a_base", "a_old")),
    ):
        shown.apply(settings)
        shown.flush()
    # At first 2 frames, then 17, and at last 2 again.
    assert shown.named("base") == [True, False, True, False, True]
