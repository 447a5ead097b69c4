"""Which robot a recording shows: its topics, its namespace, its description and its frames."""

from collections.abc import Mapping
from contextlib import suppress
from itertools import islice

from std_msgs.msg import String

from onebot_bringup.bag.messages import BagMessage
from onebot_bringup.bag.reader import Bag
from onebot_bringup.raw_messages import deserialize_message, tf_arrays
from onebot_bringup.rerun_topics import wanted_topics
from onebot_bringup.viewer.geometry import Robot, read_robot
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.errors import OneBotError
from onebot_description.text import did_you_mean

TF, STRING, JOINTS = (
    "tf2_msgs/msg/TFMessage",
    "std_msgs/msg/String",
    "sensor_msgs/msg/JointState",
)
DESCRIPTION = "robot_description"
_FIRST = 1000  # messages of /tf in which every robot has turned up


class RobotTopics:
    """Which topics of a recording show the robot, and its namespace.

    Attributes:
        space: the robot's namespace, "" or "/name".
        spaces: of every robot that is described.
        descriptions: topics of its description.
        joints: topic of its joint states.
        tf: topics of transforms.
        shown: all of these that are recorded.
    """

    def __init__(self, bag: Bag, namespace: str = "") -> None:
        """Choose the robot in ``namespace``, or the first one.

        Raises:
            OneBotError: there is none.
        """
        self._types = bag.topics
        self.descriptions = sorted(
            (topic for topic, kind in bag.topics.items() if _is(topic, DESCRIPTION, kind, STRING)),
            key=lambda topic: (topic.count("/"), topic),
        )
        joints = [t for t, kind in bag.topics.items() if _is(t, "joint_states", kind, JOINTS)]
        self.spaces = [_space(topic) for topic in self.descriptions]
        self.space = self.spaces[0] if self.spaces else ""
        if namespace:
            self.space = f"/{namespace.strip('/')}".rstrip("/")
            known = [*self.spaces, *map(_space, joints)]
            if self.space not in known:
                there = did_you_mean(namespace, {space or "/" for space in known}, "robots")
                raise OneBotError(f"namespace:={namespace}: {bag.source} has no robot there{there}")
            self.descriptions = [t for t in self.descriptions if _space(t) == self.space]
        self.joints = self.resolved("joint_states")
        if not self.descriptions and not namespace and joints and self.joints not in joints:
            self.joints = joints[0]
        self.tf = [t for t in ("/tf", "/tf_static") if bag.topics.get(t) == TF]
        joints = [self.joints] if self.joints in joints else []
        self.shown = [*self.tf, *self.descriptions[:1], *joints]

    def resolved(self, name: str) -> str:
        """Return the full name of a topic that the view names."""
        return name if name.startswith("/") else f"{self.space}/{name}"

    def of_view(self, view: ViewConfig) -> Mapping[str, str]:
        """Return the recorded topics that ``view`` asks for, and how it names them."""
        wanted = {self.resolved(name): name for name in wanted_topics(view)}
        return {full: name for full, name in wanted.items() if full in self._types}


def robot_of(bag: Bag, names: RobotTopics) -> Robot | None:
    """Return the robot by its first description, if that can be read."""
    for message in bag.messages(names.descriptions[:1]):
        with suppress(OneBotError, ValueError):  # it is complained of when it is shown
            return read_robot(text_of(message))
    return None


def frames_of(bag: Bag, names: RobotTopics) -> set[str]:
    """Return the frames that are named at the beginning."""
    frames: set[str] = set()
    for message in islice(bag.messages(names.tf), _FIRST):
        with suppress(ValueError, IndexError):
            transforms = tf_arrays(message.data)
            frames.update(transforms.parents, transforms.children)
    return frames


def text_of(message: BagMessage) -> str:
    """Return the text of a String.

    Raises:
        ValueError: it is none.
    """
    return str(deserialize_message(message.data, String).data)


def _space(topic: str) -> str:
    return topic.rpartition("/")[0]


def _is(topic: str, name: str, kind: str, wanted: str) -> bool:
    return kind == wanted and topic.rpartition("/")[2] == name
