"""Reads values from one ``<sensor>`` and its plugins; reports unreadable ones as problems."""

import math
from collections.abc import Iterator

from onebot_description.elements.frames import Frames
from onebot_description.elements.reading import Element, Findings, number_fault
from onebot_description.geometry.poses import Origin
from onebot_description.parameters.values import Rule, ValueType

Value = tuple[str, float | None, Rule]
"""A value's element, its default (None if it is required), and its rule; see ``number``."""

ANY, POSITIVE, NOT_NEGATIVE = Rule(), Rule(above=0.0), Rule(at_least=0.0)

# Placeholders for SDFormat's defaults, which exporters write out.
_PLACEHOLDERS = ("__default_topic__", "__default__")


def inside(element: Element) -> Iterator[Element]:
    """Yield all elements inside another, except those of plugins."""
    for child in element:
        if child.tag != "plugin":
            yield child
            yield from inside(child)


def text_of(element: Element, *tags: str) -> str:
    """Return the first text of elements with these tags, in order of tags, outside of plugins."""
    texts = [(child.tag, (child.text or "").strip()) for child in inside(element)]
    candidates = (text for tag in tags for name, text in texts if name == tag)
    return next((text for text in candidates if text and text not in _PLACEHOLDERS), "")


def is_false(text: str) -> bool:
    """Return whether SDFormat reads a text as false."""
    return text.strip().lower() in ("false", "0")


class Block:
    """One <sensor> while it is read.

    Attributes:
        findings: findings of its document; faults are added.
        element: the <sensor>.
        link: the link that it is attached to.
        frames: frames of the robot.
        pose: pose of the sensor, relative to the link.
        wrong: whether it has a problem, so that it is left out.
    """

    def __init__(self, findings: Findings, element: Element, link: str, frames: Frames) -> None:
        self.findings, self.element, self.link, self.frames = findings, element, link, frames
        self.pose, self.wrong = Origin(), False

    def problem(self, text: str, element: Element | None = None) -> None:
        """Report a problem; the sensor is then left out."""
        self.wrong = True
        self.findings.problem(self.element if element is None else element, text)

    def child(self, *tags: str) -> Element:
        """Return the element with the values; in some robots that is the <sensor> itself."""
        elements = (self.element.find(tag) for tag in tags)
        return next((element for element in elements if element is not None), self.element)

    def number(self, parent: Element, path: str, default: float | None, rule: Rule = ANY) -> float:
        """Return a value that is checked by a rule; 0 if it is wrong.

        Args:
            parent: contains the value's element.
            path: path of that element.
            default: the value if there is no such element; None if it is required.
            rule: rule of the value.
        """
        element = parent.find(path)
        text = "" if element is None else (element.text or "").strip()
        if element is None:
            if default is None:
                self.problem(f"has no <{path}>", parent)
            return float(default or 0)
        fault = number_fault(text) if text else "is empty; write a number"
        try:
            if fault is None:
                return float(ValueType(float, rule).checked(float(text)))
        except ValueError as error:
            fault = str(error)
        self.problem(fault, element)
        return 0.0

    def count(self, parent: Element, path: str, default: int | None, most: int) -> int:
        """Return a whole number from 1 to ``most``; 0 if it is wrong. See ``number``."""
        value = self.number(parent, path, default, Rule(at_least=1, at_most=most))
        if not value.is_integer():
            text = (parent.findtext(path) or "").strip()
            self.problem(f"{text} is not a whole number", parent.find(path))
            return 0
        return int(value)

    def of_plugin(self, plugin: Element, tags: str, rule: Rule) -> float | None:
        """Return the value of the first of the elements ``tags`` that a plugin has."""
        written = (tag for tag in tags.split() if plugin.find(tag) is not None)
        return next((self.number(plugin, tag, 0.0, rule) for tag in written), None)

    def narrowed(
        self, plugin: Element, lows: str, highs: str, limits: tuple[float, float]
    ) -> tuple[float, float]:
        """Return a range, narrowed by the limits in a plugin, elements ``lows`` and ``highs``."""
        low = self.of_plugin(plugin, lows, NOT_NEGATIVE)
        high = self.of_plugin(plugin, highs, POSITIVE)
        if low is None and high is None:
            return limits
        minimum, maximum = limits
        minimum = max(minimum, low or 0.0)
        maximum = min(maximum, math.inf if high is None else high)
        if not minimum < maximum and not self.wrong:
            tags = [tag for tag in (*lows.split(), *highs.split()) if plugin.find(tag) is not None]
            text = f"{' and '.join(map('<{}>'.format, tags))} leave nothing of "
            text += f"{limits[0]:g} to {limits[1]:g} m, which is measured; change them"
            self.problem(text, plugin)
        return minimum, maximum

    def limits(self, parent: Element, path: str, low: Value, high: Value) -> tuple[float, float]:
        """Return two values in the element at ``path``; report them if they are not in order."""
        minimum, maximum = (
            self.number(parent, f"{path}/{name}", default, rule)
            for name, default, rule in (low, high)
        )
        self.check_order(parent, path, (low[0], minimum), (high[0], maximum))
        return minimum, maximum

    def check_order(
        self, parent: Element, path: str, low: tuple[str, float], high: tuple[str, float]
    ) -> None:
        """Report two values that are not in ascending order, given with their elements' names."""
        if not low[1] < high[1] and not self.wrong:
            text = f"<{low[0]}> {low[1]:g} is not below <{high[0]}> {high[1]:g}"
            self.problem(f"{text}; swap or change them", parent.find(path))

    def numbers(self, element: Element, names: str) -> list[float]:
        """Return an element's numbers, one for each of ``names``; zeros if empty or wrong."""
        words, count = (element.text or "").split(), len(names.split())
        fault = next(filter(None, map(number_fault, words)), None)
        if fault is None and len(words) == count:
            return [*map(float, words)]
        if words:
            text = fault or f"holds {len(words)} numbers; write {names}"
            self.problem(text, element)
        return [0.0] * count

    def frame(self, element: Element, name: str) -> str:
        """Return the link whose frame has this name; "" means the sensor's link."""
        link = self.frames.link(name, self.link)
        if link is None:
            hint = self.findings.hint(name, self.frames.names, "links and joints")
            self.problem(f'there is no frame "{name}"{hint}', element)
        return link or self.link

    def read_pose(self) -> None:
        """Read the pose of the sensor."""
        element = self.element.find("pose")
        if element is None:
            return
        frame = element.get("relative_to", "").strip()
        link = self.frame(element, frame)
        x, y, z, *angles = self.numbers(element, "x y z roll pitch yaw")
        if element.get("degrees", "").strip().lower() in ("true", "1"):
            angles = [*map(math.radians, angles)]
        pose = Origin((x, y, z), (angles[0], angles[1], angles[2]))
        self.pose = pose if link == self.link else self.frames.relative(pose, link, self.link)
