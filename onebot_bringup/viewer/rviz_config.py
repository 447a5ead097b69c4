"""Reads RViz's own files (.rviz) as views: fixed frame, displays, topics, colors and camera.

Most of RViz's property names are our settings' names written as titles with units: "Size (m)" is
``size``. ``_SPECIAL`` translates the displays whose words or values differ.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from onebot_bringup.viewer.displays import MESSAGE_DRAWINGS
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.errors import OneBotError, listing
from onebot_description.parameters import bounded_yaml
from onebot_description.parameters.reader import ConfigError, defaults, read

RVIZ_SUFFIX = ".rviz"
_MAX_LISTED = 12
_UNIT = re.compile(r"\s*\([^)]*\)$")
_COLOR = re.compile(r"\s*(\d+)\s*;\s*(\d+)\s*;\s*(\d+)\s*")

Properties = Mapping[str, Any]


class RvizConfig:
    """The settings of an RViz file that have a counterpart here.

    Attributes:
        values: settings of a view, by dotted names.
        ignored: displays without a counterpart, and values that a setting cannot have. Properties
            are not listed, since RViz writes them all, even if nobody has changed them.
    """

    def __init__(self, content: Properties) -> None:
        """Translate the file's content; raise a ValueError if it is not an RViz file."""
        manager = content.get("Visualization Manager")
        if not isinstance(manager, Mapping):
            raise ValueError('it has no "Visualization Manager"')
        self.values: dict[str, Any] = {"automatic": False, "axes.visible": False}
        self.values["grid.visible"] = False
        self.ignored: list[str] = []
        options = _mapping(manager.get("Global Options"))
        self.values["fixed_frame"] = str(options.get("Fixed Frame") or "")
        if background := _color(options.get("Background Color")):
            self.values["background"] = background
        for display in _displays(manager.get("Displays")):
            self._add(display)
        self._look(_mapping(_mapping(manager.get("Views")).get("Current")))

    def view(self) -> ViewConfig:
        """Return the view; values that a setting cannot have are left out and ``ignored``."""
        accepted: dict[str, Any] = {}
        for name, value in self.values.items():
            try:
                read(ViewConfig, {name: value})
                accepted[name] = value
            except ConfigError as error:
                self.ignored.append(str(error))
        return read(ViewConfig, accepted)

    # --- displays -------------------------------------------------------------------------------

    def _add(self, display: Properties) -> None:
        kind = str(display.get("Class", "")).rpartition("/")[2]
        if special := _SPECIAL.get(kind):
            self.values |= special(display)
            return
        key, topic = _KEY_BY_CLASS.get(_snake(kind)), _topic(display)
        if key is None or not topic:
            self.ignored.append(f'{kind or "a display"} "{display.get("Name", "")}"')
            return
        prefix = f"{key}.topics.{topic}"
        self.values[f"{prefix}.visible"] = True
        self.values |= _qos(_mapping(display.get("Topic")), prefix)
        fields = _fields(key)
        if "hidden_namespaces" in fields:
            spaces = _mapping(display.get("Namespaces"))
            hidden = [str(name) for name, drawn in spaces.items() if drawn is False]
            self.values[f"{prefix}.hidden_namespaces"] = hidden
        for name, value in _flat(display):
            if name in fields and value != "":  # a transformer is empty until RViz has chosen one
                self.values[f"{prefix}.{name}"] = _color(value) or value
        if "size" in fields and display.get("Style") == "Points":
            self.values[f"{prefix}.size"] = 0.0  # ours is in meters; RViz's may be in pixels

    # --- the camera -----------------------------------------------------------------------------

    def _look(self, view: Properties) -> None:
        """Translate the current view: an orbit, or a top-down view."""
        frame = str(view.get("Target Frame") or "")
        if frame not in ("", "<Fixed Frame>", self.values["fixed_frame"]):
            self.values["camera.follow"] = frame
        kind = str(view.get("Class", "")).rpartition("/")[2]
        if kind == "TopDownOrtho":
            x, y = float(view.get("X", 0.0)), float(view.get("Y", 0.0))
            # RViz's scale is pixels per meter; assume a window of 800 pixels.
            height = 800.0 / max(float(view.get("Scale", 50.0)), 1e-3)
            self.values |= {"camera.eye": [x, y - 1e-3, height], "camera.target": [x, y, 0.0]}
        elif "Distance" in view:
            focus = _mapping(view.get("Focal Point"))
            center = [float(focus.get(axis, 0.0)) for axis in "XYZ"]
            reach = float(view["Distance"])
            pitch, yaw = float(view.get("Pitch", 0.0)), float(view.get("Yaw", 0.0))
            flat = math.cos(pitch)
            # Towards the eye.
            ahead = flat * math.cos(yaw), flat * math.sin(yaw), math.sin(pitch)
            eye = [c + reach * a for c, a in zip(center, ahead, strict=True)]
            self.values |= {"camera.eye": eye, "camera.target": center}


def load_rviz(path: Path, notice: Callable[[str], object]) -> ViewConfig:
    """Read an RViz file as a view.

    Args:
        path: the file.
        notice: called with a sentence about what has no counterpart here.

    Raises:
        OneBotError: there is no such file, or it is not an RViz file.
    """
    try:
        content = bounded_yaml.load(bounded_yaml.read_text(path))
        config = RvizConfig(_mapping(content))
        view = config.view()
    except OSError as error:
        raise OneBotError(f"{path}: {error.strerror}") from error
    except (yaml.YAMLError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise OneBotError(f"{path} is not an RViz file: {reason}") from error
    if config.ignored:
        notice(f"{path}: not shown: {listing(dict.fromkeys(config.ignored), _MAX_LISTED)}")
    return view


def _displays(found: Any) -> Iterator[Properties]:
    """Yield the enabled displays, including those in groups."""
    for display in found if isinstance(found, list) else ():
        if not isinstance(display, Mapping) or not display.get("Enabled", True):
            continue
        if str(display.get("Class", "")).endswith("/Group"):
            yield from _displays(display.get("Displays"))
        else:
            yield display


def _topic(display: Properties) -> str:
    """Return the display's topic, from the property of ROS 2 or of ROS 1."""
    topic = display.get("Topic", display.get("Image Topic", display.get("Marker Topic", "")))
    return str(topic.get("Value", "") if isinstance(topic, Mapping) else topic or "")


def _qos(topic: Properties, prefix: str) -> dict[str, Any]:
    """Return a topic's QoS settings, without durability and history, which are automatic here."""
    settings: dict[str, Any] = {}
    reliability = _snake(topic.get("Reliability Policy", ""))
    if reliability in ("reliable", "best_effort"):
        settings[f"{prefix}.reliability"] = reliability
    if isinstance(topic.get("Depth"), int):
        settings[f"{prefix}.depth"] = topic["Depth"]
    return settings


def _flat(properties: Properties) -> Iterator[tuple[str, Any]]:
    """Yield each property under our kind of name, including those in groups."""
    for name, value in properties.items():
        if isinstance(value, Mapping):
            if "Value" in value:
                yield _snake(name), value["Value"]
            # The colors in a covariance's group are not the display's.
            if name not in ("Covariance", "Namespaces") and not name.endswith("Topic"):
                yield from _flat(value)
        else:
            yield _snake(name), value


def _fields(key: str) -> set[str]:
    settings = defaults(ViewConfig)
    return {name.removeprefix(f"{key}.") for name in settings if name.startswith(f"{key}.")}


def _snake(name: str) -> str:
    """Turn ``PointCloud2`` into ``point_cloud2``, and ``Size (m)`` into ``size``."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", _UNIT.sub("", str(name)))
    return words.replace(" ", "_").replace("-", "_").lower()


# Our keys by RViz's classes of displays, both in small letters.
_KEY_BY_CLASS = {
    _snake(name): drawing.key
    for drawing in MESSAGE_DRAWINGS
    for name in (drawing.key, *drawing.rviz_classes)
}


def _color(value: Any) -> list[int] | None:
    match = _COLOR.fullmatch(value) if isinstance(value, str) else None
    return [int(part) for part in match.groups()] if match else None


def _mapping(value: Any) -> Properties:
    return value if isinstance(value, Mapping) else {}


# --- displays without a message type --------------------------------------------------------------


def _grid(display: Properties) -> dict[str, Any]:
    offset = _mapping(display.get("Offset"))
    spacing, height = display.get("Cell Size", 1.0), offset.get("Z", 0.0)
    return {"grid.visible": True, "grid.spacing": spacing, "grid.height": height}


def _axes(display: Properties) -> dict[str, Any]:
    frames = {
        name: bool(_mapping(value).get("Value", True))
        for name, value in _mapping(display.get("Frames")).items()
        if name != "All Enabled"
    }
    enabled = [name for name, visible in frames.items() if visible]
    only = enabled if len(enabled) < len(frames) else []
    names = bool(display.get("Show Names", True))
    return {"axes.visible": True, "axes.names": names, "axes.frames": only}


def _robot_model(display: Properties) -> dict[str, Any]:
    return {"collision": bool(display.get("Collision Enabled", False))}


_SPECIAL: Mapping[str, Callable[[Properties], dict[str, Any]]] = {
    "Grid": _grid,
    "TF": _axes,
    "RobotModel": _robot_model,
}
