"""Reads the sensors of a document; a faulty sensor is left out, and reported as a problem."""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

from onebot_description.description.sensors.block import NOT_NEGATIVE, Block, text_of
from onebot_description.description.sensors.kind import Kind, word_of
from onebot_description.description.sensors.kind_table import BY_TYPE, clashes
from onebot_description.description.sensors.unread import (
    RATES,
    warn_of_misplaced,
    warn_of_unknown,
    warn_of_unread,
)
from onebot_description.elements.frames import Frames
from onebot_description.elements.reading import Element, Findings
from onebot_description.elements.sensor import Sensor, SensorModel
from onebot_description.elements.urdf import Joint
from onebot_description.errors import did_you_mean
from onebot_description.parameters.values import Rule, ValueType

_RATE = Rule(at_least=0.0, at_most=1000.0)
_FRAMES = ("gz_frame_id", "ignition_frame_id", "frame_id", "frame_name", "frameName")
_TOPIC = Rule(
    pattern=re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII),
    write="a ROS name: words of letters, digits and _ that do not start with a digit, joined by /",
)


def read_sensors(
    findings: Findings, links: Collection[str], joints: Iterable[Joint]
) -> tuple[tuple[Sensor, ...], tuple[str, ...]]:
    """Read the sensors of a document.

    Args:
        findings: findings of the document; faults are added.
        links: links of the robot.
        joints: joints of the robot.

    Returns:
        The sensors, and the names of unreadable ones.
    """
    root = findings.document.root
    parents = [root] if root.tag == "gazebo" else root.findall("gazebo")
    readers = [*_readers(findings, parents, Frames(links, joints))]
    warn_of_misplaced(findings, parents)
    for reader in readers:
        reader.read(links)
    published = list[tuple[dict[str, str], _SensorReader]]()
    sensors = list[Sensor]()
    for reader in readers:
        reader_sensors = [] if reader.wrong else reader.sensors(readers)
        for sensor in reader_sensors:
            topics = {output: topic.lstrip("/") for output, topic in sensor.topics.items()}
            reader.compare(topics, published)
            published.append((topics, reader))
        if not reader.wrong:
            reader.warn_of_frames(reader_sensors, links)
            sensors.extend(reader_sensors)
    bad = dict.fromkeys(reader.name for reader in readers if reader.wrong)
    return tuple(sensors), tuple(bad)


def _readers(
    findings: Findings, parents: Iterable[Element], frames: Frames
) -> Iterator["_SensorReader"]:
    """Yield a reader for each sensor of a known kind; report the others."""
    for parent in parents:
        for element in parent.iterfind("sensor"):
            kind = element.get("type", "")
            if kind in BY_TYPE:
                link = parent.get("reference", "")
                yield _SensorReader(findings, element, link, frames, BY_TYPE[kind])
            else:
                hint = did_you_mean(kind, BY_TYPE, "simulated")
                findings.warning(element, f'sensors of type "{kind}" are not simulated{hint}')


class _SensorReader(Block):
    """A block of a known kind, from which one or several sensors are read."""

    def __init__(
        self, findings: Findings, element: Element, link: str, frames: Frames, kind: type[Kind[Any]]
    ) -> None:
        super().__init__(findings, element, link, frames)
        self.name, self.place = element.get("name", "").strip(), findings.where(element)
        self._kind, self._rate = kind, 0.0
        plugins = [kind(element, plugin) for plugin in element.iterfind("plugin")]
        self._outputs = [plugin for plugin in plugins if plugin.publishes] or [kind(element, None)]

    def read(self, links: Collection[str]) -> None:
        """Read the sensor's model, pose and rate."""
        if not self.link:
            self.problem('is in no link; write <gazebo reference="LINK"> around it')
        elif self.link not in links:
            hint = self.findings.hint(self.link, links, "links")
            self.problem(f'there is no link "{self.link}"{hint}')
        if not self.name:
            self.problem('has no name; write <sensor name="...">')
        warn_of_unknown(self.findings, self.element)
        for plugin in self.element.iterfind("plugin"):
            idle = [rule for kind in self._outputs if kind.plugin is plugin for rule in kind.idle]
            warn_of_unread(self.findings, plugin, self._kind.plugin_elements, idle)
        self.read_pose()
        self._model: SensorModel = self._kind.read(self)
        self._rate = self.number(self.element, "update_rate", 0.0, _RATE)

    def sensors(self, readers: Iterable["_SensorReader"]) -> list[Sensor]:
        """Return one sensor for each publishing plugin; unusable if the block is then ``wrong``.

        ``readers`` are the readers of all blocks of the robot.
        """
        return [
            self._sensor(outputs, topics)
            for outputs in self._outputs
            if (topics := self._topics(outputs, readers))
        ]

    def _topics(self, outputs: Kind[Any], readers: Iterable["_SensorReader"]) -> dict[str, str]:
        if outputs.fault:
            self.findings.warning(outputs.plugin or self.element, outputs.fault)
            return {}
        keys = outputs.made(self._model.rays[0])
        written = outputs.topics(keys, self._above(outputs, readers))
        topics = {output: self._checked(topic) for output, topic in written.items()}
        names = [topics[output].lstrip("/") for output in keys if output != "depth_camera_info"]
        if len({*names}) < len(names) and not self.wrong:
            twice = max(names, key=names.count)
            self.problem(f'publishes two outputs on "{twice}"; give each its own topic')
        return topics

    def _checked(self, topic: str) -> str:
        """Return a topic's name."""
        name = topic.rstrip("/").replace(" ", "_").replace("//", "/")
        try:
            ValueType(str, _TOPIC).checked(name)
        except ValueError as error:
            if not self.wrong:  # a bad name affects the others, too
                self.problem(f"its topic {error}")
        return name

    def _above(self, outputs: Kind[Any], readers: Iterable["_SensorReader"]) -> str:
        """Return a prefix for topics that other sensors would share; "" if there are none."""
        rays = self._model.rays
        defaults = outputs.defaults(rays[0])
        rivals = [(reader, reader.rivals(defaults, rays)) for reader in readers]
        if sum(count for _, count in rivals) < 2:
            return ""
        name = word_of(self.name)
        twin = any(
            count and reader.name == self.name and reader is not self for reader, count in rivals
        )
        return f"{word_of(self.link)}/{name}" if twin else name

    def rivals(self, defaults: Collection[str], rays: tuple[int, int]) -> int:
        """Return how many of its plugins also have one of these default topics.

        A single ray, such as a cliff sensor, does not compete with a scan of many ``rays``.
        """
        own_rays = self._model.rays
        if own_rays == (1, 1) != rays:
            return 0
        return sum(not kind.defaults(own_rays[0]).isdisjoint(defaults) for kind in self._outputs)

    def _sensor(self, outputs: Kind[Any], topics: dict[str, str]) -> Sensor:
        model, rate, plugin = self._model, self._rate, outputs.plugin
        frame = text_of(self.element, *self._kind.frame_tags)
        if plugin is not None:
            rates = (self.number(plugin, tag, 0.0, _RATE) for tag in RATES)
            rate = rate or next(filter(None, rates), 0.0)
            frame = frame or text_of(plugin, *_FRAMES)
            stddev = self.of_plugin(plugin, "gaussianNoise gaussian_noise", NOT_NEGATIVE)
            model = outputs.limited(self, model, plugin, stddev or 0.0)
        frame = frame or text_of(self.element, *_FRAMES) or self.link
        frame = frame.lstrip("/")  # ROS 1 wrote a slash; tf2 rejects it
        return Sensor(
            name=self.name,
            link=self.link,
            origin=self.pose,
            rate=rate,
            topics=topics,
            frame=frame,
            model=model,
            where=self.place,
        )

    def compare(
        self,
        topics: Mapping[str, str],
        published: Iterable[tuple[Mapping[str, str], "_SensorReader"]],
    ) -> None:
        """Report topics that another sensor has ``published`` already."""
        for other_topics, reader in published:
            place = f"the one at {reader.place}" if reader is not self else "another plugin of it"
            for topic in clashes(other_topics, topics)[:1]:
                text = f'publishes "{topic}", as does {place}'
                self.problem(f"{text}; give it its own <topic>")
            info = topics.get("camera_info", "")
            if not self.wrong and info and info in other_topics.values():
                text = f'its CameraInfo is on "{info}", as is that of {place}'
                text += "; to tell them apart, write a <camera_info_topic> in it"
                self.findings.warning(self.element, text)
                return

    def warn_of_frames(self, sensors: Iterable[Sensor], links: Collection[str]) -> None:
        """Warn once about each frame in these sensors' messages that is not a link."""
        for frame in dict.fromkeys(sensor.frame for sensor in sensors):
            if frame not in links:
                hint = self.findings.hint(frame, links, "links")
                text = f'no link is called "{frame}", the frame of its messages{hint}'
                self.findings.warning(self.element, text)
