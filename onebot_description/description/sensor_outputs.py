"""Determines outputs and topics of a <sensor>: by its Gazebo classic plugins, or as in gz sim.

A plugin's topics are named as by gazebo_ros: namespace, camera name, topic, then remappings. An
absolute name stays absolute; any other is in the robot's namespace.
"""

import re
from collections.abc import Iterator

from onebot_description.description.reading import Element

LIDAR, IMU, CAMERA, DEPTH, RGBD = "lidar", "imu", "camera", "depth_camera", "rgbd_camera"

# Placeholders for SDFormat's defaults, which exporters write out.
_PLACEHOLDERS = ("__default_topic__", "__default__")
# Output of ray plugins, by the first of these words in their file's name.
_BY_FILE = {
    "ray_sensor": "points",
    "velodyne": "points",
    "ouster": "points",
    "livox": "points",
    "block_laser": "point_cloud",
    "laser": "scan",
    "range": "range",
    "sonar": "range",
}
OUTPUT_TYPES = {
    "LaserScan": "scan",
    "PointCloud2": "points",
    "PointCloud": "point_cloud",
    "Range": "range",
}
"""Outputs of ray plugins, by their type in sensor_msgs."""
_OUTPUTS = {
    IMU: ("imu",),
    CAMERA: ("image", "camera_info"),
    DEPTH: ("depth", "camera_info", "points"),
    RGBD: ("image", "depth", "camera_info", "points"),
}
_ROS_2 = ("ray_sensor", "imu_sensor", "velodyne", "ouster")  # publish ~/out
_OUTPUTS_OF_PLUGINS = _OUTPUTS | {
    DEPTH: ("image", "depth", "camera_info", "points", "depth_camera_info")
}
# Below the camera's name: the name in ROS 2, that in its documentation, and what sets it in ROS 1.
_CAMERA_TOPICS = {
    "image": ("image_raw", "image_raw", "imageTopicName"),
    "depth": ("depth/image_raw", "image_depth", "depthImageTopicName"),
    "points": ("points", "points", "pointCloudTopicName"),
    "camera_info": ("camera_info", "camera_info", "cameraInfoTopicName"),
    "depth_camera_info": (
        "depth/camera_info",
        "camera_info_depth",
        "depthImageCameraInfoTopicName",
    ),
}


def _inside(element: Element) -> Iterator[Element]:
    for child in element:
        if child.tag != "plugin":
            yield child
            yield from _inside(child)


def text_of(element: Element, *tags: str) -> str:
    """Return the text of the first of these elements inside that has one, outside of plugins."""
    texts = [(inside.tag, (inside.text or "").strip()) for inside in _inside(element)]
    found = (text for tag in tags for name, text in texts if name == tag)
    return next((text for text in found if text and text not in _PLACEHOLDERS), "")


def word_of(name: str) -> str:
    """Return a name as a valid part of a topic, which must not begin with a digit."""
    word = re.sub(r"\W", "_", name.strip(), flags=re.ASCII)
    return f"sensor_{word}" if word[:1].isdigit() else word


def _joined(*names: str) -> str:
    """Join names to a path; an absolute name discards those before it."""
    path = ""
    for name in names:
        path = name if name.startswith("/") else f"{path}/{name}" if path and name else path or name
    return path


class Outputs:
    """The outputs of one plugin of a <sensor>, or of a <sensor> without publishing plugins.

    Attributes:
        plugin: the plugin; None for the <sensor> itself.
        given: whether it names its topics.
        unknown_type: the type it asks for, if a lidar cannot publish it; else "".
        idle: its remappings that match no topic.
    """

    def __init__(self, sensor: Element, kind: str, plugin: Element | None = None) -> None:
        self.plugin, self._kind, self.unknown_type = plugin, kind, ""
        self._name = word_of(sensor.get("name", ""))
        self._topic = text_of(sensor, "topic").strip("/")
        self._info = text_of(sensor, "camera_info_topic").strip("/")
        self._file = "" if plugin is None else plugin.get("filename", "")
        self._of_rays, self._space, self._node = "", "", ""
        self._named, self.idle = dict[str, str](), list[tuple[str, str]]()
        if plugin is not None:
            self._read(plugin)
        self.given = bool(self._named or self._topic)

    @property
    def publishes(self) -> bool:
        """Whether the plugin is known, or names what it publishes."""
        is_known = self._of_rays or self.unknown_type or "gazebo_ros" in self._file
        return bool(self._named or is_known)

    def _read(self, plugin: Element) -> None:
        asked = text_of(plugin, "output_type", "outputType")
        if self._kind == LIDAR:
            by_file = (made for word, made in _BY_FILE.items() if word in self._file)
            self._of_rays = next(by_file, "")
        if self._kind == LIDAR and asked:
            self._of_rays = OUTPUT_TYPES.get(asked.rpartition("/")[2], "")
            self.unknown_type = "" if self._of_rays else asked
        self._space = text_of(plugin, "namespace", "robotNamespace").strip("/")
        self._node = _joined(self._space, word_of(plugin.get("name", "")))
        self.idle = [*_remappings(plugin)]
        if self._kind in (LIDAR, IMU):
            self._read_topic(plugin)
        else:
            self._read_camera(plugin)

    def _read_topic(self, plugin: Element) -> None:
        topic = text_of(plugin, "topicName")
        default = _joined(self._space, topic) if topic else _joined(self._node, "out")
        rules = len(self.idle)
        name = self._remapped(self._node, ("out",), default)
        is_of_ros_2 = plugin.find("ros") is not None or any(word in self._file for word in _ROS_2)
        if topic or len(self.idle) < rules or (is_of_ros_2 and not self._topic):
            self._named = dict.fromkeys(("imu", *OUTPUT_TYPES.values()), name)

    def _read_camera(self, plugin: Element) -> None:
        name = text_of(plugin, "camera_name", "cameraName")
        written = {output: text_of(plugin, names[2]) for output, names in _CAMERA_TOPICS.items()}
        is_of_ros_1 = any(written.values())
        base = _joined(self._space, name or ("" if is_of_ros_1 else self._name))
        rules = len(self.idle)
        topics = {
            output: self._remapped(base, names[:2], _joined(base, written[output] or names[0]))
            for output, names in _CAMERA_TOPICS.items()
        }
        names_any = name or is_of_ros_1 or len(self.idle) < rules
        if names_any or ("gazebo_ros" in self._file and not self._topic):
            self._named = topics

    def _remapped(self, base: str, names: tuple[str, ...], default: str) -> str:
        """Return the remapped name of a topic, which is one of ``names`` below ``base``."""
        full = {name.strip("/") for name in (default, *(_joined(base, name) for name in names))}
        for rule in self.idle:
            old, new = rule
            if self._expanded(old).strip("/") in full:
                self.idle.remove(rule)
                return self._expanded(new)
            if old in names and base != self._node:  # as the camera's documentation has it
                self.idle.remove(rule)
                return _joined(base, new)
        return default

    def _expanded(self, name: str) -> str:
        """Expand a name in a remapping, as rcl does."""
        if name.startswith("~"):
            return _joined(self._node, name[1:].lstrip("/"))
        return _joined(self._space, name)

    def made(self, rows: int) -> tuple[str, ...]:
        """Return the outputs, the main one first; ``rows`` are those of a lidar's rays."""
        if self.unknown_type:
            return ()
        if self._kind == LIDAR:
            asked = (self._of_rays,) if self._of_rays else ()
            made = ("points", "scan") if rows > 1 else ("scan", "points")
            return asked or (made[:1] if self._named else made)
        return (_OUTPUTS_OF_PLUGINS if self._named else _OUTPUTS)[self._kind]

    def topics(self, outputs: tuple[str, ...], below: str = "") -> dict[str, str]:
        """Return the topic of each output.

        Args:
            outputs: the outputs.
            below: prefix of topics without a name, if other sensors have the same ``defaults``.
        """
        names = self._named or self._as_in_gz_sim(outputs, below)
        if self._info:
            names = names | {"camera_info": self._info}
        return {output: names[output] for output in outputs}

    def defaults(self, rows: int) -> set[str]:
        """Return the default topics, except CameraInfo, which cameras share."""
        topics = {} if self.given else self.topics(self.made(rows))
        return {topic for output, topic in topics.items() if output != "camera_info"}

    def _as_in_gz_sim(self, outputs: tuple[str, ...], below: str) -> dict[str, str]:
        """Return topics by the <topic> of the <sensor>; those without are ours."""
        topic, base = self._topic, below or "camera"
        names = {output: f"{base}/{names[0]}" for output, names in _CAMERA_TOPICS.items()}
        if self._kind in (LIDAR, IMU):
            main = outputs[0]
            own = topic or _joined(below, main.replace("point_cloud", "points"))
            names = dict.fromkeys(outputs, own)
            if topic or main == "scan":
                names["points"] = f"{own}/points"
            elif "scan" in outputs:
                names["scan"] = f"{below or self._name}/scan"
        elif topic and self._kind == RGBD:
            names = {output: f"{topic}/{output}" for output in outputs}
            names["depth"] = f"{topic}/depth_image"
        elif topic:
            names["image" if self._kind == CAMERA else "depth"] = topic
            names["camera_info"] = _joined(topic.rpartition("/")[0], "camera_info")
            names["points"] = f"{topic}/points"
        return {output: _joined(self._space, name) for output, name in names.items()}


def is_false(text: str) -> bool:
    """Return whether SDFormat reads a text as false."""
    return text.strip().lower() in ("false", "0")


def publishing(sensor: Element, kind: str) -> list[Outputs]:
    """Return the outputs of each publishing plugin of a <sensor>, or else its own."""
    plugins = [Outputs(sensor, kind, plugin) for plugin in sensor.findall("plugin")]
    return [each for each in plugins if each.publishes] or [Outputs(sensor, kind)]


def _remappings(plugin: Element) -> Iterator[tuple[str, str]]:
    for inside in _inside(plugin):
        old, arrow, new = (inside.text or "").strip().partition(":=")
        if inside.tag in ("remapping", "argument") and arrow:
            yield old.strip(), new.strip()
