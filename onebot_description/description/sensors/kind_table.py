"""The kinds of sensors that are simulated, and tables collected from them."""

from collections.abc import Mapping
from typing import Any

from onebot_description.description.sensors.camera import ColorCamera, DepthCamera, RgbdCamera
from onebot_description.description.sensors.contact import ContactKind
from onebot_description.description.sensors.imu import ImuKind
from onebot_description.description.sensors.kind import Kind
from onebot_description.description.sensors.lidar import LidarKind

# This is the order in which their substitutes are searched.
_KINDS: tuple[type[Kind[Any]], ...] = (
    *(RgbdCamera, DepthCamera, ImuKind, LidarKind, ColorCamera),
    ContactKind,
)

BY_TYPE = {kind_type: kind for kind in _KINDS for kind_type in kind.types}
"""The kind of sensor, by the type of its block."""

MESSAGE_TYPES = {
    output: message for kind in _KINDS for output, message in kind.message_types.items()
}
"""The message type of each sensor output."""

SUBSTITUTES = [substitute for kind in _KINDS for substitute in kind.substitutes]
"""The sensors to write instead of plugins; the first one whose words match is right."""

_COMMON = {
    "sensor": "update_rate topic plugin pose noise gz_frame_id ignition_frame_id frame_id "
    "always_on visualize enable_metrics"
}
_TABLES = [_COMMON, *(kind.elements for kind in _KINDS)]
ELEMENTS = {
    tag: frozenset(" ".join(table.get(tag, "") for table in _TABLES).split())
    for tag in frozenset().union(*_TABLES)
}
"""For each element, the elements in it that are read, or have no effect here."""


def clashes(first: Mapping[str, str], second: Mapping[str, str]) -> list[str]:
    """Return the topics that two sensors have in common; CameraInfo topics may be shared."""
    kinds = {topic: MESSAGE_TYPES[output] for output, topic in first.items()}
    info = MESSAGE_TYPES["camera_info"]
    return [
        topic
        for output, topic in second.items()
        if topic in kinds and {kinds[topic], MESSAGE_TYPES[output]} != {info}
    ]
