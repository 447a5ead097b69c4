"""The viewer's subscriptions."""

from collections import Counter

from nav_msgs.msg import Odometry, Path

from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.topics import ViewFeed
from onebot_bringup.viewer.view_config import parse_view
from onebot_description.errors import OneBotError
from tests.ros_support import Peer


def test_a_type_that_is_not_installed_is_said_once(ros_domain, monkeypatch, tmp_path):
    """Of a topic that nobody has asked for; another is named each time."""

    def message_class(name):
        raise OneBotError(f"no message type {name}")

    monkeypatch.setattr("onebot_bringup.viewer.topics.message_class", message_class)
    recording = open_recording(save=tmp_path / "x.rrd")
    view = RobotView(recording.stream, parse_view("trails: {a: {topic: /way}}"))
    with Peer(ros_domain) as peer:
        peer.node.create_publisher(Path, "/plan", 10)
        peer.node.create_publisher(Odometry, "/way", 10)
        feed = ViewFeed(peer.node, view)
        problems = Counter(problem for _ in range(3) for problem in feed.update())
    assert problems["no message type nav_msgs/msg/Path"] == 1
    assert problems["no message type nav_msgs/msg/Odometry"] == 3
    recording.close()
