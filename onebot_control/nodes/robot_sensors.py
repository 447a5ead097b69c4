"""The topics of a robot's sensors, defined in its URDF and an optional file."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from rclpy.node import Node
from rclpy.publisher import Publisher

from onebot_control.nodes.sensor_messages import SensorPublisher, message_type
from onebot_control.runtime.sensing import Channel
from onebot_control.sensing.rays import HAS_EMBREE
from onebot_control.sensing.sensors import INSTRUMENTS
from onebot_control.simulation_parameters import SimulationConfig
from onebot_description.description import Description
from onebot_description.description.loading import SensorFile, load_sensors
from onebot_description.description.sensors.kind_table import clashes
from onebot_description.elements.sensor import Sensor
from onebot_description.errors import OneBotError, listing
from onebot_description.file_watch import FileWatch
from onebot_description.ros.topic_qos import DEPTH

_NO_FILE = SensorFile((), (), (), ())


class RobotSensors:
    """Keeps the sensors of one robot up to date, from its description and a watched file."""

    def __init__(self, node: Node, changed: Callable[[], None], seed: int = 0) -> None:
        """Start without sensors.

        Args:
            node: the robot's node, which publishes.
            changed: called when the file has been edited.
            seed: seed of the noise.
        """
        self._node, self._changed, self._seed = node, changed, seed
        self._sensors: list[Sensor] = []
        self._publishers: dict[tuple[type, str], Publisher] = {}  # keys: type and topic
        self._file, self._read = "", _NO_FILE
        self._watch = FileWatch(())

    def publisher(self, topic: str) -> Publisher | None:
        """Return the publisher of a topic; None if there is none."""
        return next((p for p in self._publishers.values() if p.topic_name == topic), None)

    def poll(self) -> None:
        """Check whether the file has been edited; call it several times per second."""
        if self._watch.poll():
            self._changed()

    def update(self, row: int, description: Description, config: SimulationConfig) -> list[Channel]:
        """Read the sensors, update the publishers, and return a channel for each sensor.

        A sensor with an error in its block is not changed.

        Args:
            row: index of the robot in its fleet.
            description: description of the robot.
            config: its parameters.

        Raises:
            OneBotError: a newly named file cannot be used.
        """
        self._follow(config.sensors, description)
        warn = self._node.get_logger().warning
        sensors = [*description.sensors, *self._read.sensors]
        bad = {*description.bad_sensors, *self._read.bad_sensors} - {
            listed.name for listed in sensors
        }
        kept = [
            sensor
            for sensor in self._sensors
            if sensor.name in bad and sensor.link in description.link_names
        ]
        for name in dict.fromkeys(sensor.name for sensor in kept):
            warn(f'sensor "{name}" was not changed: there is an error in its block')
        sensors += kept
        named = [replace(sensor, topics=self._full_names(sensor)) for sensor in sensors]
        self._sensors = [*_usable(named, warn)]
        self._announce()
        return [self._channel(row, sensor, config) for sensor in self._sensors]

    def _channel(self, row: int, sensor: Sensor, config: SimulationConfig) -> Channel:
        space, cycles = self._node.get_namespace(), config.update_rate
        instrument = INSTRUMENTS[type(sensor.model)](
            sensor, row, space, cycles, noisy=config.sensor_noise, seed=self._seed
        )
        frame = config.prefixed(sensor.frame, space)
        publishers = {
            output: self._publishers[message_type(output), topic]
            for output, topic in sensor.topics.items()
        }
        return Channel(instrument, SensorPublisher(instrument, frame, publishers), cycles)

    def _follow(self, file: str, description: Description) -> None:
        """Read the file again, or stop watching if ``file`` is ""."""
        if not file:
            self._file, self._read, self._watch = "", _NO_FILE, FileWatch(())
            return
        logger = self._node.get_logger()
        try:
            result = load_sensors(file, description)
        except OneBotError as error:
            if file != self._file:
                raise
            logger.error(f"{error}\nThe sensors are not changed until this is fixed.")
            return
        for notice in result.notices:
            logger.warning(notice)
        if file != self._file:
            self._watch = FileWatch(result.files)
        self._watch.watch(result.files)
        self._file, self._read = file, result

    def _announce(self) -> None:
        """Create publishers for new topics, and destroy those no longer needed."""
        keys = {
            (message_type(output), topic)
            for sensor in self._sensors
            for output, topic in sensor.topics.items()
        }
        for key in self._publishers.keys() - keys:
            self._node.destroy_publisher(self._publishers.pop(key))
        for kind, topic in keys - self._publishers.keys():
            publisher = self._node.create_publisher(kind, topic, DEPTH)
            self._publishers[kind, topic] = publisher

    def _full_names(self, sensor: Sensor) -> dict[str, str]:
        """Return the absolute names of a sensor's topics."""
        # Some robots write their namespace into the names.
        prefix = f"{self._node.get_namespace().strip('/')}/"
        return {
            output: self._node.resolve_topic_name(topic.removeprefix(prefix), only_expand=True)
            for output, topic in sensor.topics.items()
        }


def _usable(sensors: Sequence[Sensor], warn: Callable[[str], object]) -> Iterator[Sensor]:
    """Yield the sensors that can be simulated, and warn about the others."""
    used: list[Sensor] = []
    for sensor in sensors:
        shared = [topic for rival in used for topic in clashes(rival.topics, sensor.topics)]
        if INSTRUMENTS[type(sensor.model)].needs_embree and not HAS_EMBREE:
            reason = "cameras need the package embreex, which is not installed here"
        elif shared:
            reason = f"{listing(shared)} is another sensor's topic"
        else:
            used.append(sensor)
            yield sensor
            continue
        warn(f'{sensor.where}: sensor "{sensor.name}" is not simulated: {reason}')
