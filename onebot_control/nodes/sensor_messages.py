"""Converts sensor measurements to messages, and publishes them."""

from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import Point32, Vector3, Wrench
from numpy.typing import NDArray
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.publisher import Publisher
from sensor_msgs.msg import (
    CameraInfo,
    ChannelFloat32,
    Image,
    LaserScan,
    PointCloud,
    PointCloud2,
    PointField,
    Range,
)
from sensor_msgs.msg import Imu as ImuMessage
from std_msgs.msg import Header, String

from onebot_control.sensing.camera import calibration
from onebot_control.sensing.clouds import finite
from onebot_control.sensing.contact import LinkContact
from onebot_control.sensing.instrument import Instrument
from onebot_control.sensing.lidar import angles
from onebot_description.description.sensors.camera import Camera
from onebot_description.description.sensors.imu import Imu
from onebot_description.description.sensors.kind_table import MESSAGE_TYPES
from onebot_description.description.sensors.lidar import RADIATIONS, Lidar
from onebot_description.description.sensors.noise import Noise
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.ros.wire.messages import time_message

InvalidHandle = rclpy_implementation.InvalidHandle

_FIELDS = {np.dtype("<f4"): PointField.FLOAT32, np.dtype("<u2"): PointField.UINT16}


def _scan(header: Header, lidar: Lidar, rate: float, ranges: NDArray[np.float32]) -> LaserScan:
    first, last = angles(lidar.horizontal)[[0, -1]].tolist()
    steps = lidar.horizontal.samples - 1
    return LaserScan(
        header=header,
        angle_min=first,
        angle_max=last,
        angle_increment=(last - first) / steps if steps else 0.0,
        scan_time=1.0 / rate,
        range_min=lidar.range_min,
        range_max=lidar.range_max,
        ranges=array("f", ranges.tobytes()),
    )


def _range(header: Header, lidar: Lidar, rate: float, distance: np.float32) -> Range:
    return Range(
        header=header,
        radiation_type=RADIATIONS.index(lidar.radiation),
        field_of_view=lidar.field_of_view,
        min_range=lidar.range_min,
        max_range=lidar.range_max,
        range=float(distance),
    )


def _point_cloud(header: Header, lidar: Lidar, rate: float, cloud: NDArray[np.void]) -> PointCloud:
    rows = finite(cloud)[0][["x", "y", "z"]].tolist()
    points = [Point32(x=x, y=y, z=z) for x, y, z in rows]
    intensity = ChannelFloat32(name="intensity", values=[0.0] * len(points))
    return PointCloud(header=header, points=points, channels=[intensity])


def _imu(
    header: Header, imu: Imu, rate: float, values: tuple[NDArray[np.float64] | None, ...]
) -> ImuMessage:
    message = ImuMessage(header=header)
    parts = message.orientation, message.angular_velocity, message.linear_acceleration
    for part, vector in zip(parts, values, strict=True):
        numbers = [] if vector is None else vector.tolist()
        for name, number in zip("xyzw", numbers, strict=False):  # vectors have no w
            setattr(part, name, number)
    if imu.reference is None:
        message.orientation_covariance[0] = -1.0  # "no orientation", as REP-145 defines it
    message.angular_velocity_covariance = _covariance(imu.angular_velocity)
    message.linear_acceleration_covariance = _covariance(imu.linear_acceleration)
    return message


def _covariance(noises: Iterable[Noise]) -> NDArray[np.float64]:
    """Return the covariance matrix (9,), row by row, of independent values."""
    return np.diag([noise.stddev**2 for noise in noises]).ravel()


def _image(header: Header, camera: Camera, rate: float, pixels: NDArray[Any]) -> Image:
    height, width = pixels.shape[:2]
    return Image(
        header=header,
        height=height,
        width=width,
        encoding="rgb8" if pixels.dtype == np.uint8 else "32FC1",
        step=pixels.nbytes // height,
        data=array("B", pixels.tobytes()),
    )


def _camera_info(header: Header, camera: Camera, rate: float, _: object) -> CameraInfo:
    size = {"width": camera.width, "height": camera.height}
    return CameraInfo(header=header, **size, **calibration(camera))


def _points(header: Header, model: object, rate: float, points: NDArray[np.void]) -> PointCloud2:
    height, width = points.shape
    kinds = points.dtype.fields
    assert kinds is not None
    fields = [
        # Colors are packed into a float, as in PCL.
        PointField(name=name, offset=kind[1], datatype=_FIELDS.get(kind[0], 7), count=1)
        for name, kind in kinds.items()
    ]
    return PointCloud2(
        header=header,
        height=height,
        width=width,
        fields=fields,
        point_step=points.itemsize,
        row_step=points.itemsize * width,
        data=array("B", points.tobytes()),
        is_dense=bool(np.isfinite(points["x"]).all()),
    )


def _contacts(header: Header, model: object, rate: float, contacts: Sequence[LinkContact]) -> Any:
    """Return the message of ros_gz_bridge, but in the header's frame and also if empty."""
    names = "Contacts", "Contact", "Entity", "JointWrench"
    contacts_type, contact_type, entity, wrench = (
        load_interface(f"ros_gz_interfaces/msg/{name}") for name in names
    )
    message = contacts_type(header=header)
    message.contacts = [
        contact_type(
            collision1=entity(name=contact.link, type=entity.LINK),
            collision2=entity(name=contact.other, type=entity.LINK),
            positions=_vectors(contact.points),
            normals=_vectors(contact.normals),
            depths=[0.0] * len(contact.points),
            wrenches=[
                wrench(
                    header=header,
                    body_1_name=String(data=contact.link),
                    body_2_name=String(data=contact.other),
                    body_1_wrench=Wrench(force=force),
                    body_2_wrench=Wrench(force=Vector3(x=-force.x, y=-force.y, z=-force.z)),
                )
                for force in _vectors(contact.forces[:, None] * contact.normals)
            ],
        )
        for contact in contacts
    ]
    return message


def _vectors(rows: NDArray[np.float64]) -> list[Vector3]:
    return [Vector3(x=x, y=y, z=z) for x, y, z in rows.tolist()]


Converter = Callable[[Header, Any, float, Any], Any]
_CONVERTERS: Mapping[str, Converter] = {
    "sensor_msgs/msg/LaserScan": _scan,
    "sensor_msgs/msg/Range": _range,
    "sensor_msgs/msg/PointCloud": _point_cloud,
    "sensor_msgs/msg/PointCloud2": _points,
    "sensor_msgs/msg/Imu": _imu,
    "sensor_msgs/msg/Image": _image,
    "sensor_msgs/msg/CameraInfo": _camera_info,
    "ros_gz_interfaces/msg/Contacts": _contacts,
}
MESSAGES = {output: _CONVERTERS[message] for output, message in MESSAGE_TYPES.items()}
"""By output, the function that creates the message from a header, the sensor's model, its rate (Hz)
and its measurement."""


def message_type(output: str) -> type:
    """Return the type of the messages of an output."""
    kind: type = load_interface(MESSAGE_TYPES[output])
    return kind


class SensorPublisher:
    """Publishes the measurements of one sensor."""

    def __init__(
        self, instrument: Instrument[Any], frame: str, publishers: Mapping[str, Publisher]
    ) -> None:
        """Prepare to publish.

        Args:
            instrument: simulates the sensor.
            frame: frame_id of the messages.
            publishers: publishers by output.
        """
        self._instrument, self._frame, self._publishers = instrument, frame, publishers

    @property
    def topics(self) -> Mapping[str, str]:
        """The topic of each output."""
        return {output: publisher.topic_name for output, publisher in self._publishers.items()}

    def wanted(self) -> frozenset[str]:
        """Return the outputs with subscribers, keys of ``Sensor.topics``."""
        try:
            return frozenset(
                output
                for output, publisher in self._publishers.items()
                if publisher.get_subscription_count()
            )
        except InvalidHandle:  # the sensor has been removed meanwhile
            return frozenset()

    def publish(self, stamp: int, outputs: Mapping[str, Any]) -> None:
        """Publish the outputs of one measurement, at ``stamp``, ns."""
        header = Header(stamp=time_message(stamp), frame_id=self._frame)
        model, rate = self._instrument.model, self._instrument.rate
        for output, values in outputs.items():
            message = MESSAGES[output](header, model, rate, values)
            try:
                self._publishers[output].publish(message)
            except InvalidHandle:
                return
