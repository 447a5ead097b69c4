"""Receives the camera pictures of the robot that is steered.

A camera may be expensive for the robot, so its topic is only subscribed to while a page shows its
picture, and once at first, since only the encoding shows whether people can look at it (depth
images, for example, are left out).
"""

import io
import math
import time
from dataclasses import dataclass

from PIL import Image
from sensor_msgs.msg import Image as ImageMessage

from onebot_bringup.steering.followed_topics import FollowedTopics, RobotNamespace

_IMAGE = "sensor_msgs/msg/Image"
# For encodings that people can look at: Pillow's modes of the resulting picture and of the data.
_MODES = {
    "rgb8": ("RGB", "RGB"),
    "bgr8": ("RGB", "BGR"),
    "rgba8": ("RGB", "RGBX"),
    "bgra8": ("RGB", "BGRX"),
    "mono8": ("L", "L"),
}
_SIZE = (480, 360)  # maximum, pixels
_OLD = 3.0  # s after which a picture is not shown any more: the robot may be elsewhere
_UNUSED = 3.0  # s without a request after which a camera is unsubscribed


def jpeg(message: ImageMessage) -> bytes | None:
    """Return a picture as a small JPEG; None if people cannot look at it, such as depth."""
    if message.encoding not in _MODES:
        return None
    (mode, raw), size = _MODES[message.encoding], (message.width, message.height)
    try:
        picture = Image.frombytes(mode, size, bytes(message.data), "raw", raw, message.step, 1)
    except ValueError:
        return None  # fewer bytes than its size needs
    picture.thumbnail(_SIZE)
    file = io.BytesIO()
    picture.save(file, "JPEG")
    return file.getvalue()


@dataclass(eq=False)
class _Camera:
    """The state of a camera's topic.

    Attributes:
        shows: whether people can look at its pictures; None if that is not known yet.
        used: when a picture was last requested.
    """

    shows: bool | None = None
    used: float = -math.inf


class CameraFeed:
    """Follows the robot's cameras; call all methods except ``picture`` in the node's thread."""

    def __init__(self, topics: FollowedTopics) -> None:
        self._topics = topics
        self._cameras: dict[str, _Camera] = {}

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics with pictures that people can look at, shortest name first."""
        names = [name for name, camera in self._cameras.items() if camera.shows]
        return tuple(sorted(names, key=lambda name: (name.count("/"), name)))

    def needed(self, namespace: RobotNamespace, watched: bool) -> dict[str, str]:
        """Return the topics to follow, with their types; call this several times per second.

        Args:
            namespace: namespace of the robot.
            watched: whether there is a page.
        """
        names = namespace.topics(self._topics.node, {_IMAGE})
        self._cameras = {name: self._cameras.get(name) or _Camera() for name in names}
        for name, camera in self._cameras.items():
            message = self._topics.newest(name).message
            if camera.shows is None and message is not None:
                camera.shows = message.encoding in _MODES
        recently = time.monotonic() - _UNUSED
        return {
            name: _IMAGE
            for name, camera in self._cameras.items()
            if camera.used > recently or (watched and camera.shows is None)
        }

    def picture(self, name: str) -> bytes | None:
        """Return a camera's newest picture as JPEG, and follow the camera for a while.

        It may be called from any thread. It returns None if there is none, or only an old one.
        """
        camera = self._cameras.get(name)
        if camera is None:
            return None
        camera.used = time.monotonic()
        newest = self._topics.newest(name)
        return None if newest.message is None or newest.age > _OLD else jpeg(newest.message)
