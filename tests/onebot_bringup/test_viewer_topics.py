"""The viewer's subscriptions."""

from nav_msgs.msg import Path

from onebot_bringup.viewer.inbox import MessageType, WantedTopic, one_by_one
from onebot_bringup.viewer.topics import TopicSubscriptions
from onebot_description.errors import OneBotError
from tests.ros_support import Peer


def test_a_type_that_is_not_installed_is_said_once(ros_domain, monkeypatch):
    """Of a topic that nobody has asked for; another is named each time."""

    def message_class(name):
        raise OneBotError(f"no message type {name}")

    monkeypatch.setattr("onebot_bringup.viewer.topics.message_class", message_class)
    with Peer(ros_domain) as peer:
        peer.node.create_publisher(Path, "plan", 10)
        path = MessageType("nav_msgs/msg/Path", one_by_one(bytes), lambda _: 0)
        for optional, times in ((True, 1), (False, 3)):
            topics = TopicSubscriptions(peer.node, lambda *_: None)
            problems = []
            for _ in range(3):
                try:
                    topics.set_topics({"/plan": WantedTopic("plan", (path,), optional=optional)})
                except OneBotError as error:
                    problems.append(str(error))
            assert problems == ["no message type nav_msgs/msg/Path"] * times
