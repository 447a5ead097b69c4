"""Raw messages, kept and handed over to the view together."""

from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Transform, TransformStamped, Vector3
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.robot_view import LiveView
from onebot_bringup.viewer.topics import Inbox
from onebot_description.wire.tf_message import TFMessage
from tests.onebot_bringup.drive_support import chunks, column
from tests.onebot_bringup.viewer_support import START_NS

SECOND = 10**9
NOW = START_NS + 100 * SECOND
GARBAGE = b"\0\1\0\0\xff\xff\xff\xff\0\0\0\0"


class Shown:
    """A view in a file, its inbox, and what was complained of."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "x.rrd"
        self._recording = open_recording(save=self.file)
        self.live = LiveView(self._recording.stream)
        self.complaints: list[tuple[str, str]] = []
        self.now = NOW
        self.inbox = Inbox(self.live, self._complain, lambda: self.now)

    def _complain(self, topic: str, error: Exception) -> None:
        self.complaints.append((topic, str(error)))

    def end(self) -> None:
        self.inbox.hand_over()
        self.live.finish(self.now)
        self._recording.close()


def _tf(child: str, y: float, sec: int) -> bytes:
    edge = TransformStamped(
        header=Header(stamp=Time(sec=sec), frame_id="base"),
        child_frame_id=child,
        transform=Transform(translation=Vector3(y=y)),
    )
    return bytes(serialize_message(TFMessage(transforms=[edge])))


def _joints(position: float, sec: int, names=("slide",)) -> bytes:
    header = Header(stamp=Time(sec=sec))
    return bytes(
        serialize_message(
            JointState(header=header, name=list(names), position=[position] * len(names))
        )
    )


def _times(file: Path, entity: str) -> list[int]:
    return [
        stamp
        for chunk in chunks(file, entity)
        if not chunk.is_static
        for stamp in chunk.to_record_batch().column("ros_time").cast("int64").to_pylist()
    ]


def test_messages_of_several_publishers_are_logged_in_the_order_they_came(tmp_path):
    """With their own names, times and numbers; the last of each is where it stands."""
    shown = Shown(tmp_path)
    sent = []
    for step in range(20):
        for child in ("tip", "tap", "a_longer_name"):
            sent.append((child, 0.25 * len(sent), 1000 + step))
            shown.inbox.add_transforms(_tf(*sent[-1]))
        if step % 5 == 4:
            shown.inbox.hand_over()
            shown.live.tick(NOW)
    edges = shown.live.frames.edges
    shown.end()
    assert column(shown.file, "/tf", "Transform3D:child_frame") == [[name] for name, _, _ in sent]
    places = np.array(column(shown.file, "/tf", "Transform3D:translation"))
    np.testing.assert_array_equal(places[:, 0, 1], [y for _, y, _ in sent])
    assert _times(shown.file, "/tf") == [sec * SECOND for _, _, sec in sent]
    assert [edges[child].translation[1] for child, _, _ in sent[-3:]] == [
        y for _, y, _ in sent[-3:]
    ]
    assert not shown.complaints


def test_bad_bytes_are_told_with_their_topic_and_cost_no_good_message(tmp_path):
    """They lie between good ones, in the same tick."""
    shown = Shown(tmp_path)
    good = _tf("tip", 1.0, 1000)
    for data in (good, GARBAGE, b"", good[:-1], _tf("tip", 2.0, 1001)):
        shown.inbox.add_transforms(data)
    for data in (GARBAGE, _joints(1.0, 1000), b"\0", _joints(2.0, 1001)):
        shown.inbox.add_joints(data)
    shown.end()
    assert [topic for topic, _ in shown.complaints] == ["/tf"] * 3 + ["joint_states"] * 2
    assert all("it is no" in said for _, said in shown.complaints)
    assert _times(shown.file, "/tf") == [1000 * SECOND, 1001 * SECOND]
    assert column(shown.file, "/joints/position/0", "Scalars:scalars") == [[1.0], [2.0]]


def test_joint_states_without_a_time_are_shown_when_they_came(tmp_path):
    """Not when they were handed over: several in a tick are several points of the curve."""
    shown = Shown(tmp_path)
    for step, sec in enumerate((0, 1000, 0)):
        shown.now = NOW + step
        shown.inbox.add_joints(_joints(float(step), sec))
    shown.now = NOW + 10
    shown.inbox.hand_over(joints=False)
    shown.end()
    assert sorted(_times(shown.file, "/joints/position/0")) == [1000 * SECOND, NOW, NOW + 2]


@pytest.mark.parametrize("names", [(), ("a", "b")])
def test_strange_joint_states_are_taken_as_they_are(tmp_path, names):
    """Without names, or with too few positions: not shown, and no mistake in the bytes."""
    shown = Shown(tmp_path)
    shown.inbox.add_joints(
        bytes(serialize_message(JointState(name=list(names), position=[1.0, 2.0, 3.0])))
    )
    shown.end()
    assert not shown.complaints
    assert _times(shown.file, "/joints/position/0") == []
