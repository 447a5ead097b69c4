"""The topics of a <sensor>, in any way that gz sim or the ROS plugins of Gazebo classic have it."""

import re
from collections.abc import Iterator

from onebot_description.description.reading import Element

LIDAR, IMU, CAMERA, DEPTH, RGBD = "lidar", "imu", "camera", "depth_camera", "rgbd_camera"

# The names that Gazebo classic gives to topics, as remappings end with them.
_CLASSIC = {
    "depth/camera_info": "",
    "camera_info_depth": "",
    "depth/image_raw": "depth",
    "image_depth": "depth",
    "image_raw": "image",
    "camera_info": "camera_info",
    "points": "points",
    "out": "out",
}
_CLASSIC_CAMEL = {
    "imageTopicName": "image",
    "cameraInfoTopicName": "camera_info",
    "depthImageTopicName": "depth",
    "pointCloudTopicName": "points",
}
_UNDER_BASE = {
    "image": "image_raw",
    "depth": "depth/image_raw",
    "points": "points",
    "camera_info": "camera_info",
}


def text_of(element: Element, *tags: str) -> str:
    """Return the text of the first of these elements that has one, wherever it lies inside."""
    texts = (inside.text or "" for tag in tags for inside in element.iter(tag))
    return next(filter(None, map(str.strip, texts)), "")


class TopicNames:
    """What a <sensor> says about its topics; ``given``: whether it names them."""

    def __init__(self, element: Element, kind: str) -> None:
        self._element, self._kind = element, kind
        self._word = re.sub(r"\W", "_", element.get("name", "").strip())
        plugin = element.find("plugin")
        self._is_classic = plugin is not None and "gazebo_ros" in plugin.get("filename", "")
        self._remapped = dict(_remappings(element))
        self._topic = text_of(element, "topic", "topicName") or self._remapped.get("out", "")
        self._base = ""  # the first word of a camera's topics in Gazebo classic
        if kind in (CAMERA, DEPTH, RGBD) and self._is_classic:
            self._base = text_of(element, "camera_name", "cameraName") or element.get("name", "")
        self.given = bool(self._topic or self._base)

    def topics(self, *, rows: int, alone: bool) -> dict[str, str]:
        """Return the topic of each output, as written.

        ``rows`` are those of a lidar's rays; ``alone``: every other sensor of its kind has names.
        """
        if self._kind == LIDAR and rows > 1:
            # As gz sim has it; Gazebo classic's plugin publishes the cloud where it is told.
            below = self._topic if "out" in self._remapped else f"{self._topic}/points"
            return {"points": below if self._topic else self._default("points", alone)}
        if self._kind in (LIDAR, IMU):
            output = "scan" if self._kind == LIDAR else "imu"
            return {output: self._topic or self._default(output, alone)}
        return self._camera(alone)

    def _default(self, output: str, alone: bool) -> str:
        return output if alone else f"{self._word}/{output}"

    def _camera(self, alone: bool) -> dict[str, str]:
        outputs = {
            CAMERA: ("image", "camera_info"),
            DEPTH: (*(("image",) if self._is_classic else ()), "depth", "camera_info", "points"),
            RGBD: ("image", "depth", "camera_info", "points"),
        }[self._kind]
        base = self._base or ("camera" if alone else self._word)
        names = {output: f"{base}/{name}" for output, name in _UNDER_BASE.items()}
        if self._topic and self._kind == RGBD:
            names = {output: f"{self._topic}/{output}" for output in outputs}
            names["depth"] = f"{self._topic}/depth_image"
        elif self._topic:
            names["image" if self._kind == CAMERA else "depth"] = self._topic
            names["camera_info"] = f"{self._topic.rpartition('/')[0]}/camera_info"
            names["points"] = f"{self._topic}/points"
        for tag, output in _CLASSIC_CAMEL.items():
            if self._base and (name := text_of(self._element, tag)):
                names[output] = f"{self._base}/{name}"
        names["camera_info"] = text_of(self._element, "camera_info_topic") or names["camera_info"]
        return {output: self._remapped.get(output, names[output]) for output in outputs}


def _remappings(element: Element) -> Iterator[tuple[str, str]]:
    """Yield topics by output, as remapped in a plugin of Gazebo classic for ROS 2."""
    space = text_of(element, "namespace").strip("/")
    for tag in ("remapping", "argument"):
        for inside in element.iter(tag):
            old, arrow, new = (inside.text or "").strip().partition(":=")
            for ending, output in _CLASSIC.items():
                if arrow and f"/{old}".endswith(f"/{ending}"):
                    yield output, f"{space}/{new}"
                    break
