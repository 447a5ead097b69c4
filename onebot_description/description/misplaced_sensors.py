"""Warns of sensors that are not read: in the wrong place, or plugins without a <sensor>."""

import re
from collections.abc import Collection, Iterator
from typing import NamedTuple

from onebot_description.description.reading import Element, Findings, number_fault
from onebot_description.description.sensor_outputs import text_of

_RAYS = (
    "<lidar><scan><horizontal><samples>360</samples><min_angle>-3.14</min_angle>"
    "<max_angle>3.14</max_angle></horizontal>{}</scan><range><min>0.1</min><max>12</max></range>"
    "</lidar>"
)
_ROWS = (
    "<vertical><samples>16</samples><min_angle>-0.26</min_angle><max_angle>0.26</max_angle>"
    "</vertical>"
)
_CONE = (
    "<ray><scan><horizontal><samples>5</samples><min_angle>-0.1</min_angle>"
    "<max_angle>0.1</max_angle></horizontal></scan><range><min>0.02</min><max>4</max></range></ray>"
    '<plugin name="range" filename="libgazebo_ros_range.so"/>'
)


class _Block(NamedTuple):
    """A <sensor> that replaces a plugin."""

    words: str  # pattern of the plugin's file or name
    name: str
    type: str
    rate: str  # Hz, unless the plugin has one
    inside: str = ""


_BLOCKS = (
    _Block(r"realsense|kinect|openni|depth|rgbd", "camera", "rgbd_camera", "30"),
    _Block(r"(?<![a-z])imu|(?<=ros)imu", "imu", "imu", "100"),
    _Block(r"velodyne|ouster|livox", "lidar", "gpu_lidar", "10", _RAYS.format(_ROWS)),
    _Block(r"sonar|ultrasonic|(?<![a-z])range", "range", "ray", "10", _CONE),
    _Block(r"laser|lidar|hokuyo|ray_sensor", "lidar", "gpu_lidar", "10", _RAYS.format("")),
    _Block(r"camera", "camera", "camera", "30"),
)
_TRUTH = re.compile(r"p3d|ground_?truth")
# Plugins of gz sim's world, and those that move a body, are not sensors.
_NO_SENSOR = re.compile(
    r"-system|force|drive|gripper|grasp|wrench|control|joint|attach|lift|buoy|thrust|propel|wind"
)
_LINKS, _RATES = ("bodyName", "body_name", "link"), ("updateRate", "update_rate", "updateRateHZ")


def warn_of_misplaced(
    findings: Findings, parents: Collection[Element], links: Collection[str]
) -> None:
    """Warn of sensors outside of ``parents``, and of sensor plugins outside of a <sensor>."""
    for element, path in _walk(findings.document.root, ()):
        if element.tag == "sensor" and element.keys() and path[-1] not in parents:
            link = _link_above(path) or _named(element, links) or "LINK"
            text = f"lies in <{path[-1].tag}>, where it is not read; write <gazebo "
            text += f'reference="{link}"> around it, directly in <robot>'
            findings.warning(element, text)
        elif element.tag == "plugin":
            _warn_of_plugin(findings, element, _link_above(path), links)


def _walk(
    element: Element, path: tuple[Element, ...]
) -> Iterator[tuple[Element, tuple[Element, ...]]]:
    """Yield each sensor and plugin that is not inside another sensor, with its ancestors."""
    for child in element:
        if child.tag in ("sensor", "plugin"):
            yield child, (*path, element)
        if child.tag not in ("sensor", "ros2_control"):
            yield from _walk(child, (*path, element))


def _link_above(path: tuple[Element, ...]) -> str:
    names = (
        element.get("name" if element.tag == "link" else "reference", "")
        for element in reversed(path)
        if element.tag in ("link", "gazebo")
    )
    return next(filter(None, names), "")


def _named(element: Element, links: Collection[str]) -> str:
    """Return the link that an element inside names, like <parent link="..."/> in old URDF."""
    texts = (text for inside in element.iter() for text in (inside.get("link"), inside.text))
    return next((text.strip() for text in texts if text and text.strip() in links), "")


def _warn_of_plugin(
    findings: Findings, plugin: Element, above: str, links: Collection[str]
) -> None:
    words = f"{plugin.get('filename', '')} {plugin.get('name', '')}".lower()
    if _NO_SENSOR.search(words):
        return
    block = next((block for block in _BLOCKS if re.search(block.words, words)), None)
    is_truth, named = _TRUTH.search(words), text_of(plugin, *_LINKS)
    if not (block or is_truth or named):
        return
    frame = text_of(plugin, "frame_name", "frameName")
    link = named or above or (frame if frame in links else "")
    place = f' on link "{link}"' if link else ""
    text = f"is a sensor{place} without a <sensor>, so it is ignored"
    if is_truth:
        text += "; the true pose and twist are on ~/ground_truth of velocity_controller"
    elif block:
        text += f"; write {_written(block, plugin, link or 'LINK')}"
    else:
        known = ", ".join(dict.fromkeys(block.type for block in _BLOCKS))
        text += f'; if it is like one, write <gazebo reference="{link}"><sensor name="NAME" '
        text += f'type="TYPE"/></gazebo>, with TYPE one of: {known}'
    findings.warning(plugin, text)


def _written(block: _Block, plugin: Element, link: str) -> str:
    rate = text_of(plugin, *_RATES)
    if not rate or number_fault(rate):
        rate = block.rate
    return (
        f'<gazebo reference="{link}"><sensor name="{block.name}" type="{block.type}">'
        f"<update_rate>{rate}</update_rate>{block.inside}</sensor></gazebo>"
    )
