"""The base class of kinds of sensors, and the topic names of a <sensor> and its plugins.

A plugin's topics are named as in gazebo_ros: namespace, camera name, topic, then remappings. An
absolute name stays absolute; any other is in the robot's namespace.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import ClassVar, Generic, NamedTuple, TypeVar

from onebot_description.description.sensors.block import Block, inside, text_of
from onebot_description.elements.reading import Element
from onebot_description.elements.sensor import SensorModel

M = TypeVar("M", bound=SensorModel)

_ROS_2 = ("ray_sensor", "imu_sensor", "velodyne", "ouster")  # publish ~/out


def word_of(name: str) -> str:
    """Return a name as a valid part of a topic, which must not begin with a digit."""
    word = re.sub(r"\W", "_", name.strip(), flags=re.ASCII)
    return f"sensor_{word}" if word[:1].isdigit() else word


def joined(*names: str) -> str:
    """Join names to a path; an absolute name discards the names before it."""
    path = ""
    for name in names:
        path = name if name.startswith("/") else f"{path}/{name}" if path and name else path or name
    return path


class Substitute(NamedTuple):
    """A <sensor> to write instead of a plugin that is outside of any <sensor>."""

    words: str  # pattern of the plugin's file or name
    name: str
    type: str
    rate: str  # Hz
    inside: str = ""


class Kind(ABC, Generic[M]):
    """A <sensor> as published by one of its plugins, or by the <sensor> itself.

    Each kind of sensor is a subclass, which defines the class attributes and abstract methods.

    Attributes:
        types: types of the <sensor>.
        message_types: message types of all outputs, by their names.
        frame_tags: elements that name the frame of the messages, read before those of all kinds.
        elements: for each element, the elements in it that are read, or have no effect here.
        plugin_elements: the same for a plugin.
        substitutes: substitutes for plugins without a <sensor>.
        plugin: the plugin; None for the <sensor> itself.
        topic: the <topic> of the <sensor>; "" if there is none.
        named: topics that the plugin names, by output; empty if it names none.
        fault: why nothing can be published; "" if something can.
        idle: remappings of the plugin that match no topic.
    """

    types: ClassVar[tuple[str, ...]]
    message_types: ClassVar[Mapping[str, str]]
    frame_tags: ClassVar[tuple[str, ...]] = ()
    elements: ClassVar[Mapping[str, str]]
    plugin_elements: ClassVar[str] = ""
    substitutes: ClassVar[tuple[Substitute, ...]] = ()

    def __init__(self, sensor: Element, plugin: Element | None) -> None:
        self.plugin, self.fault, self.sensor_name = plugin, "", word_of(sensor.get("name", ""))
        self.topic = text_of(sensor, "topic").strip("/")
        self.file = "" if plugin is None else plugin.get("filename", "")
        self.space, self._node = "", ""
        self.named, self.idle = dict[str, str](), list[tuple[str, str]]()
        if plugin is not None:
            self.space = text_of(plugin, "namespace", "robotNamespace").strip("/")
            self._node = joined(self.space, word_of(plugin.get("name", "")))
            self.idle = [*_remappings(plugin)]
            self.named = self.read_plugin(plugin)

    @staticmethod
    @abstractmethod
    def read(block: Block) -> M:
        """Return the model of the sensor."""

    def limited(self, block: Block, model: M, plugin: Element, stddev: float) -> M:
        """Return the model, changed by the plugin's limits, options and noise of ``stddev``."""
        return model

    def read_plugin(self, plugin: Element) -> dict[str, str]:
        """Return the topics that a plugin names, by output; empty if it names none.

        Unless a kind overrides this, all outputs have one topic.
        """
        topic = text_of(plugin, "topicName")
        default = joined(self.space, topic) if topic else joined(self._node, "out")
        rules = len(self.idle)
        name = self.remapped(self._node, ("out",), default)
        is_of_ros_2 = plugin.find("ros") is not None or any(word in self.file for word in _ROS_2)
        is_named = topic or len(self.idle) < rules or (is_of_ros_2 and not self.topic)
        return dict.fromkeys(self.message_types, name) if is_named else {}

    def made(self, rows: int) -> tuple[str, ...]:
        """Return the outputs, the main one first; ``rows`` is the number of a lidar's rows."""
        return tuple(self.message_types)

    def default_topics(self, outputs: tuple[str, ...], below: str) -> Mapping[str, str]:
        """Return topics named after the <topic> of the <sensor>, or else by default names."""
        return dict.fromkeys(outputs, self.topic or joined(below, outputs[0]))

    @property
    def publishes(self) -> bool:
        """Whether the plugin is known, or names what it publishes."""
        return bool(self.named) or "gazebo_ros" in self.file

    def topics(self, outputs: tuple[str, ...], below: str = "") -> dict[str, str]:
        """Return the topic of each output.

        Args:
            outputs: the outputs.
            below: prefix of topics without a name, if other sensors have the same ``defaults``.
        """
        if self.named:
            return {output: self.named[output] for output in outputs}
        names = self.default_topics(outputs, below)
        return {output: joined(self.space, names[output]) for output in outputs}

    def defaults(self, rows: int) -> set[str]:
        """Return the default topics, except CameraInfo, which cameras share."""
        has_none = self.fault or self.named or self.topic
        topics = {} if has_none else self.topics(self.made(rows))
        return {topic for output, topic in topics.items() if output != "camera_info"}

    def remapped(self, base: str, names: tuple[str, ...], default: str) -> str:
        """Return the remapped name of a topic, which is one of ``names`` below ``base``."""
        full = {name.strip("/") for name in (default, *(joined(base, name) for name in names))}
        for rule in self.idle:
            old, new = rule
            if self._expanded(old).strip("/") in full:
                self.idle.remove(rule)
                return self._expanded(new)
            if old in names and base != self._node:  # the camera plugin documents this
                self.idle.remove(rule)
                return joined(base, new)
        return default

    def _expanded(self, name: str) -> str:
        """Expand a name in a remapping, as rcl does."""
        if name.startswith("~"):
            return joined(self._node, name[1:].lstrip("/"))
        return joined(self.space, name)


def _remappings(plugin: Element) -> Iterator[tuple[str, str]]:
    for element in inside(plugin):
        old, arrow, new = (element.text or "").strip().partition(":=")
        if element.tag in ("remapping", "argument") and arrow:
            yield old.strip(), new.strip()
