"""The one entry of a view: raw messages in, decoded together, shown by their displays."""

from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState, LaserScan
from std_msgs.msg import Header, String

from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.view_config import parse_view
from onebot_description.errors import OneBotError
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.messages import transforms_message
from tests.onebot_bringup import viewer_support as support
from tests.onebot_bringup.drive_support import column, stamps
from tests.onebot_bringup.viewer_support import START_NS

SECOND = 10**9
NOW = START_NS + 100 * SECOND
GARBAGE = b"\0\1\0\0\xff\xff\xff\xff\0\0\0\0"


class Shown(support.Shown):
    """A view without a robot, into which bytes go."""

    def __init__(self, folder: Path, view: str = "") -> None:
        super().__init__(folder, view, robot=False)

    def take_tf(self, data: bytes, time_ns: int = NOW) -> None:
        self.view.take("/tf", "tf2_msgs/msg/TFMessage", data, time_ns)

    def take_joints(self, data: bytes, time_ns: int = NOW) -> None:
        self.view.take("joint_states", "sensor_msgs/msg/JointState", data, time_ns)


def _tf(child: str, y: float, sec: int) -> bytes:
    place = np.array([[0.0, y, 0.0, 0.0, 0.0, 0.0, 1.0]])
    return bytes(serialize_message(transforms_message(Time(sec=sec), ["base"], [child], place)))


def _joints(position: float, sec: int, names=("slide",)) -> bytes:
    header = Header(stamp=Time(sec=sec))
    return bytes(
        serialize_message(
            JointState(header=header, name=list(names), position=[position] * len(names))
        )
    )


def _text(text: str) -> bytes:
    return bytes(serialize_message(String(data=text)))


def test_messages_of_several_publishers_are_logged_in_the_order_they_came(tmp_path):
    """With their own names, times and numbers; the latest of each frame is kept."""
    shown = Shown(tmp_path)
    sent = []
    for step in range(20):
        for child in ("tip", "tap", "a_longer_name"):
            sent.append((child, 0.25 * len(sent), 1000 + step))
            shown.take_tf(_tf(*sent[-1]))
        if step % 5 == 4:
            shown.view.tick(NOW)
    edges = shown.view.stage.frames.edges
    shown.end()
    assert column(shown.file, "/tf", "Transform3D:child_frame") == [[name] for name, _, _ in sent]
    places = np.array(column(shown.file, "/tf", "Transform3D:translation"))
    np.testing.assert_array_equal(places[:, 0, 1], [y for _, y, _ in sent])
    assert stamps(shown.file, "/tf") == [sec * SECOND for _, _, sec in sent]
    assert [edges[child].translation[1] for child, _, _ in sent[-3:]] == [
        y for _, y, _ in sent[-3:]
    ]
    assert not shown.bad


def test_bad_messages_are_reported_with_their_topic_and_cost_no_good_one(tmp_path):
    """They lie between good ones, in the same tick, on topics of every kind of display."""
    shown = Shown(tmp_path, "trails: {a: {topic: odom}}\nspeeds: {lines: {b: {topic: odom}}}")
    good = _tf("tip", 1.0, 1000)
    for data in (good, GARBAGE, b"", good[:-1], _tf("tip", 2.0, 1001)):
        shown.take_tf(data)
    for data in (GARBAGE, _joints(1.0, 1000), b"\0", _joints(2.0, 1001)):
        shown.take_joints(data)
    shown.view.take("odom", "nav_msgs/msg/Odometry", GARBAGE, NOW)
    shown.view.take("robot_description", "std_msgs/msg/String", GARBAGE, NOW)
    shown.view.take("robot_description", "std_msgs/msg/String", _text("<robot>"), NOW)
    shown.end()
    topics = [topic for topic, _ in shown.bad]
    assert topics == ["robot_description"] * 2 + ["/tf"] * 3 + ["joint_states"] * 2 + ["odom"]
    assert "malformed XML" in str(shown.bad[1][1])
    assert all("truncated" in str(said) or "CDR" in str(said) for _, said in shown.bad[2:])
    assert stamps(shown.file, "/tf") == [1000 * SECOND, 1001 * SECOND]
    assert column(shown.file, "/joints/position/0", "Scalars:scalars") == [[1.0], [2.0]]


@pytest.mark.parametrize(("second", "first_ns"), [(0, NOW), (5, 5 * SECOND)])
def test_what_has_no_time_is_shown_when_it_came_in_the_time_of_the_others(
    tmp_path, second, first_ns
):
    """Not when it was decoded; also among stamps since the simulation's start."""
    shown = Shown(tmp_path)
    for step, sec in enumerate((second, 0, 0)):
        shown.take_joints(_joints(float(step), sec), NOW + step)
    shown.end()
    assert stamps(shown.file, "/joints/position/0") == [first_ns, first_ns + 1, first_ns + 2]


def test_one_sensor_with_another_clock_moves_nothing_else(tmp_path):
    """What has no time is shown at that of /tf; after a while the sensor is reported."""
    shown, said = Shown(tmp_path), []
    for second in range(6):
        now = NOW + second * SECOND
        shown.take_tf(_tf("tip", 1.0, now // SECOND), now)
        scan = LaserScan(header=Header(stamp=Time(sec=7 + second), frame_id="tip"))
        shown.view.offer({"/scan": "sensor_msgs/msg/LaserScan"})
        shown.view.take("/scan", "sensor_msgs/msg/LaserScan", bytes(serialize_message(scan)), now)
        shown.take_joints(_joints(1.0, 0), now)
        said += shown.view.tick(now)
    shown.end()
    assert stamps(shown.file, "/joints/position/0") == [NOW + n * SECOND for n in range(6)]
    [text] = [text for text in said if "clock" in text]
    assert text.startswith("the stamps of /scan are -17000") and "those of /tf 0 s" in text


def test_a_stamp_in_the_future_is_shown_when_it_came(tmp_path):
    """The viewer follows the latest, and would show nothing else until then; it is reported."""
    shown, now, latest = Shown(tmp_path), NOW // SECOND, 2**31 - 1
    shown.view.take(
        "robot_description",
        "std_msgs/msg/String",
        _text('<robot name="r"><link name="base"/></robot>'),
        NOW,
    )
    for number, second in enumerate((now + 9, latest, now)):
        shown.take_joints(_joints(1.0, second), NOW + number)
    edges = [deserialize_message(_tf("tip", 1.0, second), TFMessage) for second in (latest, now)]
    both = TFMessage(transforms=[edge for message in edges for edge in message.transforms])
    for data in (_tf("tip", 1.0, latest), bytes(serialize_message(both))):
        shown.take_tf(data)
    assert [text for text in shown.view.tick(NOW) if "ahead of their receive time" in text]
    shown.end()
    assert sorted(stamps(shown.file, "/joints/position/0")) == [NOW, NOW + 1, NOW + 9 * SECOND]
    assert stamps(shown.file, "/tf") == [NOW] * 3


@pytest.mark.parametrize(
    ("text", "topics"),
    [
        ("", {}),
        ("speeds: {lines: {a: {topic: v}}}", {"v": {"Twist", "TwistStamped", "Odometry"}}),
        ("{speeds: {lines: {a: {topic: v}}}, trails: {t: {topic: v}}}", {"v": {"Odometry"}}),
        ("speeds: {lines: {a: {topic: v}, b: {topic: v, type: Twist}}}", {"v": {"Twist"}}),
    ],
)
def test_each_topic_is_wanted_once_as_what_all_its_displays_take(tmp_path, text, topics):
    """A trail's topic is an Odometry; a type that is named counts more than "auto"."""
    shown = Shown(tmp_path, text)
    known = set(Shown(tmp_path).view.topics)
    found = {
        name: {kind.name.rpartition("/")[2] for kind in topic.types}
        for name, topic in shown.view.topics.items()
        if name not in known
    }
    assert found == topics
    shown.end()


def test_a_topic_wanted_as_two_types_is_refused(tmp_path):
    """By its full name, and when the view is changed, with a warning."""
    text = "trails: {t: {topic: /r/joint_states}}"
    recording = open_recording(save=tmp_path / "x.rrd")

    def resolve(name: str) -> str:
        return name if name.startswith("/") else f"/r/{name}"

    with pytest.raises(OneBotError, match=r'"/r/joint_states" cannot be subscribed as nav_msgs'):
        RobotView(recording.stream, parse_view(text), resolve=resolve)
    view = RobotView(recording.stream, resolve=resolve)
    [warning] = view.set_view(parse_view(text))
    assert "another display already reads it as sensor_msgs/msg/JointState" in warning
    recording.close()
