"""The picture of the camera of the robot that is steered.

A camera may cost the robot much, so its topic is subscribed to while a page shows the picture.
"""

import io
import math
import time
from collections.abc import Iterable

from PIL import Image
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image as ImageMessage

from onebot_bringup.steering.followed_topics import FollowedTopics, own_topics
from onebot_description.topic_subscription import TopicSubscription

_IMAGE = "sensor_msgs/msg/Image"
# Pillow's modes, as the picture is to be and as it is, of the encodings of pictures for people.
_MODES = {
    "rgb8": ("RGB", "RGB"),
    "bgr8": ("RGB", "BGR"),
    "rgba8": ("RGB", "RGBX"),
    "bgra8": ("RGB", "BGRX"),
    "mono8": ("L", "L"),
}
_SIZE = (480, 360)  # pixels at most
_UNUSED = 3.0  # s without a request until the camera is left


def jpeg(message: ImageMessage) -> bytes | None:
    """Return a picture as a small JPEG; None if it is none for people, such as depth."""
    if message.encoding not in _MODES:
        return None
    (mode, raw), size = _MODES[message.encoding], (message.width, message.height)
    try:
        picture = Image.frombytes(mode, size, bytes(message.data), "raw", raw, message.step, 1)
    except ValueError:
        return None  # less bytes than it says
    picture.thumbnail(_SIZE)
    file = io.BytesIO()
    picture.save(file, "JPEG")
    return file.getvalue()


class CameraFeed:
    """Follows the robot's first camera; all but ``picture`` in the node's thread.

    Attributes:
        topic: that of its pictures, "" for none.
    """

    def __init__(self, node: Node) -> None:
        self._node, self.topic = node, ""
        self._topics = FollowedTopics(node, 1, self._subscription)
        self._used = -math.inf  # when a picture was requested
        self._picture: bytes | None = None  # the newest message
        self._drawn: tuple[bytes | None, bytes | None] = None, None  # a message and its JPEG

    def update(self, namespace: str, robots: Iterable[str]) -> None:
        """Follow publishers that come and go; to be called several times per second.

        ``robots`` are the namespaces of other robots.
        """
        names = own_topics(self._node, namespace, robots, {_IMAGE})
        rank = [("depth" in name, name.count("/"), name) for name in names]
        self.topic = min(rank)[-1] if rank else ""
        used = self.topic and time.monotonic() < self._used + _UNUSED
        if self._topics.update({self.topic: _IMAGE} if used else {}):
            self._picture = None

    def _subscription(self, name: str, _: str) -> TopicSubscription:
        return TopicSubscription(self._node, name, self._on_picture, lambda _: ImageMessage)

    def _on_picture(self, _: str, data: bytes) -> None:
        self._picture = data

    def picture(self) -> bytes | None:
        """Return the newest picture as JPEG, in any thread; the camera is followed for a while."""
        self._used = time.monotonic()
        data, drawn = self._picture, self._drawn
        if data is not None and data is not drawn[0]:
            self._drawn = drawn = data, jpeg(deserialize_message(data, ImageMessage))
        return drawn[1] if data is not None else None
