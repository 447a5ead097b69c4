"""The topics of a robot's sensors, which its URDF and an optional file define."""

import struct
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from sensor_msgs.msg import (
    CameraInfo,
    Image,
    LaserScan,
    PointCloud,
    PointCloud2,
    PointField,
    Range,
)
from sensor_msgs.msg import Imu as ImuMessage
from std_msgs.msg import Header

from onebot_control.frame_names import prefixed
from onebot_control.nodes.sensing import Channel
from onebot_control.parameters import ControlConfig
from onebot_control.sensing.camera import focal_length
from onebot_control.sensing.instruments import Instrument, measuring_rate
from onebot_control.sensing.lidar import angles, met
from onebot_control.sensing.rays import HAS_EMBREE
from onebot_description.description import Description
from onebot_description.description.description import (
    RADIATIONS,
    Camera,
    Fan,
    Imu,
    Lidar,
    Sensor,
    clashes,
)
from onebot_description.description.loading import SensorFile, load_sensors
from onebot_description.errors import OneBotError, listing
from onebot_description.file_watch import FileWatch
from onebot_description.ros.wire.messages import time_message

InvalidHandle = rclpy_implementation.InvalidHandle

_DEPTH = 10  # ROS's system default; reliable and volatile, as drivers and bridges publish
_NO_FILE = SensorFile((), (), (), ())
_FIELDS = {np.dtype("<f4"): PointField.FLOAT32, np.dtype("<u2"): PointField.UINT16}


class SensorPublisher:
    """Publishes what one sensor measures."""

    def __init__(
        self, sensor: Sensor, frame: str, rate: float, publishers: Mapping[str, Publisher]
    ) -> None:
        """Prepare to publish.

        Args:
            sensor: its description.
            frame: frame_id of the messages.
            rate: measurements per second, Hz.
            publishers: by output.
        """
        self._sensor, self._frame, self._rate = sensor, frame, rate
        self._publishers = publishers

    @property
    def topics(self) -> Mapping[str, str]:
        """The topic of each output."""
        return {output: each.topic_name for output, each in self._publishers.items()}

    def wanted(self) -> frozenset[str]:
        """Return the outputs that are subscribed to."""
        try:
            return frozenset(
                output
                for output, publisher in self._publishers.items()
                if publisher.get_subscription_count()
            )
        except InvalidHandle:  # the sensor was taken away meanwhile
            return frozenset()

    def publish(self, stamp: int, outputs: Mapping[str, Any]) -> None:
        """Publish the outputs of one measurement; see ``Outlet``."""
        header = Header(stamp=time_message(stamp), frame_id=self._frame)
        for output, values in outputs.items():
            message = _MESSAGES[output][1](self, values)
            message.header = header
            try:
                self._publishers[output].publish(_ready(message, values))
            except InvalidHandle:
                return

    def _scan(self, ranges: NDArray[np.float32]) -> LaserScan:
        lidar = self._sensor.model
        assert isinstance(lidar, Lidar)
        fan: Fan = lidar.horizontal
        first, last = angles(fan)[[0, -1]].tolist()
        return LaserScan(
            angle_min=first,
            angle_max=last,
            angle_increment=(last - first) / (fan.samples - 1) if fan.samples > 1 else 0.0,
            scan_time=1.0 / self._rate,
            range_min=lidar.least,
            range_max=lidar.greatest,
            ranges=array("f", ranges.tobytes()),
        )

    def _range(self, distance: np.float32) -> Range:
        lidar = self._sensor.model
        assert isinstance(lidar, Lidar)
        return Range(
            radiation_type=RADIATIONS.index(lidar.radiation),
            field_of_view=lidar.field_of_view,
            min_range=lidar.least,
            max_range=lidar.greatest,
            range=float(distance),
        )

    def _point_cloud(self, _: object) -> PointCloud:
        return PointCloud()

    def _imu(self, values: tuple[NDArray[np.float64] | None, ...]) -> ImuMessage:
        imu = self._sensor.model
        assert isinstance(imu, Imu)
        message = ImuMessage()
        parts = message.orientation, message.angular_velocity, message.linear_acceleration
        for part, vector in zip(parts, values, strict=True):
            numbers = [] if vector is None else vector.tolist()
            for name, number in zip("xyzw", numbers, strict=False):  # vectors have no w
                setattr(part, name, number)
        if imu.reference is None:
            message.orientation_covariance[0] = -1.0  # as REP-145 and the message have it
        variances = [
            [noise.stddev**2 for noise in noises]
            for noises in (imu.angular_velocity, imu.linear_acceleration)
        ]
        message.angular_velocity_covariance = np.diag(variances[0]).ravel()
        message.linear_acceleration_covariance = np.diag(variances[1]).ravel()
        return message

    def _image(self, pixels: NDArray[Any]) -> Image:
        height, width = pixels.shape[:2]
        encoding = "rgb8" if pixels.dtype == np.uint8 else "32FC1"
        step = pixels.nbytes // height
        data = array("B", pixels.tobytes())
        return Image(height=height, width=width, encoding=encoding, step=step, data=data)

    def _camera_info(self, _: object) -> CameraInfo:
        return self._info

    @cached_property
    def _info(self) -> CameraInfo:
        camera = self._sensor.model
        assert isinstance(camera, Camera)
        focal, x, y = focal_length(camera), camera.width / 2.0, camera.height / 2.0
        shift = 0.0 - focal * camera.baseline  # of a pair's right camera, pixels times metres
        return CameraInfo(
            height=camera.height,
            width=camera.width,
            distortion_model="plumb_bob",
            d=[0.0] * 5,
            k=[focal, 0.0, x, 0.0, focal, y, 0.0, 0.0, 1.0],
            r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p=[focal, 0.0, x, shift, 0.0, focal, y, 0.0, 0.0, 0.0, 1.0, 0.0],
        )

    def _points(self, points: NDArray[np.void]) -> PointCloud2:
        height, width = points.shape
        kinds = points.dtype.fields
        assert kinds is not None
        fields = [
            # Colours are packed into a float, as in PCL.
            PointField(name=name, offset=kind[1], datatype=_FIELDS.get(kind[0], 7), count=1)
            for name, kind in kinds.items()
        ]
        return PointCloud2(
            height=height,
            width=width,
            fields=fields,
            point_step=points.itemsize,
            row_step=points.itemsize * width,
            data=array("B", points.tobytes()),
            is_dense=bool(np.isfinite(points["x"]).all()),
        )


# By output: the message type, and the method that converts arrays to it.
_MESSAGES: Mapping[str, tuple[type, Callable[[SensorPublisher, Any], Any]]] = {
    "scan": (LaserScan, SensorPublisher._scan),
    "range": (Range, SensorPublisher._range),
    "point_cloud": (PointCloud, SensorPublisher._point_cloud),
    "imu": (ImuMessage, SensorPublisher._imu),
    "image": (Image, SensorPublisher._image),
    "depth": (Image, SensorPublisher._image),
    "camera_info": (CameraInfo, SensorPublisher._camera_info),
    "depth_camera_info": (CameraInfo, SensorPublisher._camera_info),
    "points": (PointCloud2, SensorPublisher._points),
}


def _ready(message: Any, values: Any) -> Any:
    """Return the message; a PointCloud as bytes, because its points would be Python objects."""
    if not isinstance(message, PointCloud):
        return message
    points = met(values)[0]
    xyz = np.stack([points[name] for name in "xyz"], axis=-1)
    head = serialize_message(message)[:-8]  # two empty sequences
    count = struct.pack("<I", len(points))
    intensities = struct.pack("<II12s", 1, 10, b"intensity") + count + bytes(4 * len(points))
    return head + count + xyz.tobytes() + intensities


class RobotSensors:
    """Keeps the sensors of one robot up to date: from its description, and from a watched file."""

    def __init__(self, node: Node, changed: Callable[[], None], seed: int = 0) -> None:
        """Begin without sensors.

        Args:
            node: the robot's, which publishes.
            changed: called when the file was edited.
            seed: of the noise.
        """
        self._node, self._changed, self._seed = node, changed, seed
        self._sensors: list[Sensor] = []
        self._publishers: dict[tuple[type, str], Publisher] = {}  # keys: type and topic
        self._file, self._read = "", _NO_FILE
        self._watch = FileWatch(())

    @property
    def topics(self) -> list[str]:
        """Names of all sensor topics, absolute."""
        return sorted({each.topic_name for each in self._publishers.values()})

    def publisher(self, topic: str) -> Publisher | None:
        """Return the publisher of a topic; None if there is none."""
        return next((p for p in self._publishers.values() if p.topic_name == topic), None)

    def poll(self) -> None:
        """Check whether the file was edited; call it several times a second."""
        if any(self._watch.poll()):
            self._changed()

    def update(self, row: int, description: Description, config: ControlConfig) -> list[Channel]:
        """Read the sensors, update the publishers, and return a channel for each sensor.

        A sensor whose block has a fault stays as it was.

        Args:
            row: index of the robot in its fleet.
            description: of the robot.
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
            warn(f'sensor "{name}" stays as it was: there is a fault in its block')
        sensors += kept
        named = [replace(sensor, topics=self._full_names(sensor)) for sensor in sensors]
        self._sensors = [*_usable(named, config.update_rate, warn)]
        self._announce()
        space = self._node.get_namespace()
        channels = []
        for sensor in self._sensors:
            rate = measuring_rate(sensor, config.update_rate)
            enabled, prefix = config.tf_frame_prefix_enable, config.tf_frame_prefix
            frame = prefixed(sensor.frame, enabled, prefix, space)
            topics = {
                output: self._publishers[_MESSAGES[output][0], topic]
                for output, topic in sensor.topics.items()
            }
            outlet = SensorPublisher(sensor, frame, rate, topics)
            rates, noisy = config.update_rate, config.sensor_noise
            instrument = Instrument(sensor, row, space, rates, noisy, self._seed)
            channels.append(Channel(instrument, outlet, config.update_rate))
        return channels

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
            logger.error(f"{error}\nThe sensors stay as they were until this is mended.")
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
            (_MESSAGES[output][0], topic)
            for sensor in self._sensors
            for output, topic in sensor.topics.items()
        }
        for key in self._publishers.keys() - keys:
            self._node.destroy_publisher(self._publishers.pop(key))
        for kind, topic in keys - self._publishers.keys():
            publisher = self._node.create_publisher(kind, topic, _DEPTH)
            self._publishers[kind, topic] = publisher

    def _full_names(self, sensor: Sensor) -> dict[str, str]:
        """Return a sensor's topics, absolute."""
        space = self._node.get_namespace().strip("/")
        names = {}
        for output, topic in sensor.topics.items():
            name = topic.removeprefix(f"{space}/")  # some robots write their namespace into it
            names[output] = (
                topic if topic.startswith("/") else f"/{space}/{name}".replace("//", "/")
            )
        return names


def _usable(
    sensors: Sequence[Sensor], cycles: float, warn: Callable[[str], object]
) -> Iterator[Sensor]:
    """Yield the sensors that can be simulated; warn of the others."""
    used: list[Sensor] = []
    for sensor in sensors:
        shared = [topic for other in used for topic in clashes(other.topics, sensor.topics)]
        if isinstance(sensor.model, Camera) and not HAS_EMBREE:
            reason = "cameras need the package embreex, which is not installed here"
        elif shared:
            reason = f"{listing(shared)} is another sensor's topic"
        else:
            if sensor.rate > cycles:
                rates = f"{sensor.rate:g} Hz is more than update_rate, {cycles:g} Hz"
                warn(f'sensor "{sensor.name}": {rates}, so it is published at {cycles:g} Hz')
            used.append(sensor)
            yield sensor
            continue
        warn(f'{sensor.where}: sensor "{sensor.name}" is not simulated: {reason}')
