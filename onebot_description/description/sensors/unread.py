"""Warns about unread elements: unknown ones, and sensors and plugins in the wrong place."""

import re
from collections.abc import Collection, Iterator

from onebot_description.description.sensors.block import text_of
from onebot_description.description.sensors.kind import Substitute
from onebot_description.description.sensors.kind_table import ELEMENTS, SUBSTITUTES
from onebot_description.elements.reading import Element, Findings, value_text

RATES = ("update_rate", "updateRate", "updateRateHZ")  # the last two occur in plugins
_IN_ANY_PLUGIN = (
    "ros namespace remapping argument qos robotNamespace frame_name frameName gz_frame_id "
    "ignition_frame_id frame_id always_on alwaysOn visualize"
)
_NOTHING = ("", "false", "none")  # like zeros, these values in a plugin have no effect

_TRUTH = re.compile(r"p3d|ground_?truth")
# Plugins of gz sim's world, and those that move a body, are not sensors.
_NO_SENSOR = re.compile(
    r"-system|force|drive|gripper|grasp|wrench|control|joint|attach|lift|buoy|thrust|propel|wind"
)
_LINKS = ("bodyName", "body_name", "link")


def warn_of_unknown(findings: Findings, element: Element) -> None:
    """Warn about elements inside a <sensor> that are not read: a name may be misspelt."""
    known_tags = ELEMENTS.get(element.tag)
    if known_tags is None:
        return
    for child in element:
        if child.tag not in known_tags:
            hint = findings.hint(child.tag, known_tags, "known here")
            text = f"is not simulated inside <{element.tag}>, so it is ignored{hint}"
            findings.warning(child, text)
        warn_of_unknown(findings, child)


def warn_of_unread(
    findings: Findings, plugin: Element, of_kind: str, idle: Collection[tuple[str, str]]
) -> None:
    """Warn about unread elements and remappings of a plugin in a <sensor>, in one warning.

    Args:
        findings: the warning is added.
        plugin: plugin of the <sensor>.
        of_kind: elements that are read in the plugins of its kind.
        idle: remappings of the plugin that match no topic.
    """
    known_tags = [*_IN_ANY_PLUGIN.split(), *of_kind.split(), *RATES]
    children = [*plugin, *plugin.iterfind("ros/*")]
    unread = [
        child.tag for child in children if child.tag not in known_tags and asks_for_something(child)
    ]
    rules = [f"<remapping> {old}:={new}" for old, new in idle]
    names = ", ".join([*(f"<{tag}>" for tag in dict.fromkeys(unread)), *rules])
    if names:
        findings.warning(plugin, f"{names}: not used by the sensor")


def asks_for_something(element: Element) -> bool:
    """Return whether an element asks for an effect; zeros and false do not."""
    words = value_text(element).lower().split()
    return len(element) > 0 or any(word.strip("0.") not in _NOTHING for word in words)


def warn_of_misplaced(findings: Findings, parents: Collection[Element]) -> None:
    """Warn about sensors outside ``parents``, and sensor plugins outside a <sensor>."""
    for element, path in _walk(findings.document.root, ()):
        if element.tag == "sensor" and element.keys() and path[-1] not in parents:
            link = _link_above(path) or "LINK"
            text = f"is in <{path[-1].tag}>, where it is not read; write <gazebo "
            text += f'reference="{link}"> around it, directly in <robot>'
            findings.warning(element, text)
        elif element.tag == "plugin":
            _warn_of_plugin(findings, element, _link_above(path))


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


def _warn_of_plugin(findings: Findings, plugin: Element, above: str) -> None:
    words = f"{plugin.get('filename', '')} {plugin.get('name', '')}".lower()
    if _NO_SENSOR.search(words):
        return
    substitute = next((entry for entry in SUBSTITUTES if re.search(entry.words, words)), None)
    is_truth, named = _TRUTH.search(words), text_of(plugin, *_LINKS)
    if not (substitute or is_truth or named):
        return
    link = named or above
    place = f' on link "{link}"' if link else ""
    text = f"is a sensor{place} without a <sensor>, so it is ignored"
    if is_truth:
        text += "; velocity_controller publishes the true pose and twist on ~/ground_truth"
    elif substitute:
        text += f"; write {_written(substitute, link or 'LINK')}"
    else:
        types = ", ".join(dict.fromkeys(entry.type for entry in SUBSTITUTES))
        text += f'; if it is like one, write <gazebo reference="{link}"><sensor name="NAME" '
        text += f'type="TYPE"/></gazebo>, with TYPE one of: {types}'
    findings.warning(plugin, text)


def _written(substitute: Substitute, link: str) -> str:
    return (
        f'<gazebo reference="{link}"><sensor name="{substitute.name}" type="{substitute.type}">'
        f"<update_rate>{substitute.rate}</update_rate>{substitute.inside}</sensor></gazebo>"
    )
