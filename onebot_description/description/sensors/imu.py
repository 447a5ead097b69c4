"""Inertial measurement units (IMUs)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from onebot_description.description.sensors.block import Block, is_false
from onebot_description.description.sensors.kind import Kind, Substitute
from onebot_description.description.sensors.noise import Noise, read_noise
from onebot_description.elements.reading import Element
from onebot_description.elements.sensor import SensorModel
from onebot_description.errors import did_you_mean
from onebot_description.geometry.poses import ZERO, Origin, Triple

_Noises = tuple[Noise, Noise, Noise]  # noises of x, y and z


class Reference(NamedTuple):
    """The reference axes of an IMU's orientation."""

    rpy: Triple = ZERO  # fixed-axis roll, pitch, yaw in the world: x east, y north, z up; rad
    at_start: bool = False  # relative to the root link's initial frame instead of the world


@dataclass(frozen=True)
class Imu(SensorModel):
    """An inertial measurement unit, with the noise of each axis."""

    angular_velocity: _Noises = (Noise(), Noise(), Noise())  # rad/s
    linear_acceleration: _Noises = (Noise(), Noise(), Noise())  # m/s^2
    reference: Reference | None = Reference()  # None: it measures no orientation

    @property
    def summary(self) -> str:
        return "acceleration, angular velocity"


# Reference axes that an IMU may name, in the world: x east, y north, z up (REP-103).
_AXES: Mapping[str, Triple] = {
    "ENU": (0.0, 0.0, 0.0),
    "NED": (math.pi, 0.0, math.pi / 2.0),
    "NWU": (0.0, 0.0, math.pi / 2.0),
}
_CUSTOM = "CUSTOM"


def _read_noises(block: Block, imu: Element, tag: str, old_name: str) -> _Noises:
    old = imu.find(f"noise/{old_name}")
    elements = (imu.find(f"{tag}/{axis}/noise") for axis in "xyz")
    x, y, z = (read_noise(block, old if noise is None else noise) for noise in elements)
    return x, y, z


def _read_reference(block: Block, imu: Element) -> Reference:
    """Return the reference axes of an IMU's orientation."""
    element = imu.find("orientation_reference_frame")
    if element is None:
        return Reference()
    name = element.findtext("localization", _CUSTOM).strip()
    if name != _CUSTOM:
        if name not in _AXES:
            hint = did_you_mean(name, (*_AXES, _CUSTOM))
            block.problem(f'there are no axes "{name}"{hint}', element)
        return Reference(_AXES.get(name, ZERO))
    custom = element.find("custom_rpy")
    if custom is None:
        return Reference(block.frames.turned(ZERO, block.pose, block.link), at_start=True)
    x, y, z = block.numbers(custom, "roll pitch yaw")
    parent = custom.get("parent_frame", "").strip()
    if parent == "world":
        return Reference((x, y, z))
    link = block.frame(custom, parent)
    pose = Origin() if parent else block.pose
    return Reference(block.frames.turned((x, y, z), pose, link), at_start=True)


class ImuKind(Kind[Imu]):
    """How an IMU is described."""

    types = ("imu",)
    message_types = {"imu": "sensor_msgs/msg/Imu"}
    elements = {
        "sensor": "imu",
        "imu": "angular_velocity linear_acceleration noise orientation_reference_frame topic "
        "enable_orientation",
        "orientation_reference_frame": "localization custom_rpy",
    }
    plugin_elements = "topicName gaussianNoise"
    substitutes = (Substitute(r"(?<![a-z])imu|(?<=ros)imu", "imu", "imu", "100"),)

    @staticmethod
    def read(block: Block) -> Imu:
        imu = block.element.find("imu")
        if imu is None:
            return Imu()
        rates = _read_noises(block, imu, "angular_velocity", "rate")
        accelerations = _read_noises(block, imu, "linear_acceleration", "accel")
        has_none = is_false(imu.findtext("enable_orientation", ""))
        return Imu(rates, accelerations, None if has_none else _read_reference(block, imu))

    def limited(self, block: Block, model: Imu, plugin: Element, stddev: float) -> Imu:
        (a, b, c), (x, y, z) = model.angular_velocity, model.linear_acceleration
        return replace(
            model,
            angular_velocity=(a.plus(stddev), b.plus(stddev), c.plus(stddev)),
            linear_acceleration=(x.plus(stddev), y.plus(stddev), z.plus(stddev)),
        )
