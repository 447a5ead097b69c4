"""A saved view, in the place of RViz's config.rviz: a short YAML file, checked with clear errors.

Example (every key may be left out)::

    fixed_frame: base_link        # "" is the frame above all others
    axes: {visible: true, length: 0.5, names: true}   # metres
    grid: {visible: true, spacing: 1.0}               # metres
    collision: false              # show collision shapes at the start
    background: [48, 48, 48]      # sRGB bytes
    camera:
      eye: [3.0, -3.0, 2.0]       # metres, in the fixed frame
      target: [0.0, 0.0, 0.5]
      follow: base_link           # the link the camera moves with
    joint_plot: {positions: true, velocities: true, window: 30.0}   # seconds
    panels: {blueprint: collapsed, selection: collapsed, time: collapsed, top: expanded}
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import yaml

from onebot_bringup.viewer.geometry import Vector
from onebot_description.errors import OneBotError
from onebot_description.text import did_you_mean

PANEL_STATES = ("hidden", "collapsed", "expanded")


@dataclass(frozen=True)
class AxesView:
    """The frames' axes: drawn or not, length in metres (0: by the robot's size), named or not."""

    visible: bool = True
    length: float = 0.0
    names: bool = True


@dataclass(frozen=True)
class GridView:
    """The grid on the ground: drawn or not, spacing in metres (0: chosen by the robot's size)."""

    visible: bool = True
    spacing: float = 0.0


@dataclass(frozen=True)
class CameraView:
    """Eye and target in the fixed frame, metres (None: chosen to fit); link to follow, or ""."""

    eye: Vector | None = None
    target: Vector | None = None
    follow: str = ""


@dataclass(frozen=True)
class JointPlotView:
    """The curves of the joints, and how many seconds of them are shown."""

    positions: bool = True
    velocities: bool = True
    window: float = 30.0


@dataclass(frozen=True)
class PanelsView:
    """The state of the viewer's panels: hidden, collapsed or expanded."""

    blueprint: str = "collapsed"
    selection: str = "collapsed"
    time: str = "collapsed"
    top: str = "expanded"


@dataclass(frozen=True)
class ViewConfig:
    """How a robot is looked at; see the module's docstring."""

    fixed_frame: str = ""
    axes: AxesView = field(default_factory=AxesView)
    grid: GridView = field(default_factory=GridView)
    collision: bool = False
    background: tuple[int, int, int] | None = None
    camera: CameraView = field(default_factory=CameraView)
    joint_plot: JointPlotView = field(default_factory=JointPlotView)
    panels: PanelsView = field(default_factory=PanelsView)


def load_view(path: Path) -> ViewConfig:
    """Read the saved view at ``path``.

    Raises:
        OneBotError: there is no such file, or an entry is wrong; the message names it and says what
            would be right.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OneBotError(f"view {path}: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise OneBotError(f"view {path}: not YAML: {' '.join(str(error).split())}") from error
    try:
        return _read(ViewConfig, {} if content is None else content, "")
    except ValueError as error:
        raise OneBotError(f"view {path}: {error}") from error


T = TypeVar("T")


def _read(kind: type[T], content: object, where: str) -> T:
    """Build the dataclass ``kind`` from a mapping, checking every entry."""
    names = [entry.name for entry in fields(kind)]  # type: ignore[arg-type]
    if not isinstance(content, Mapping):
        known = ", ".join(names)
        raise ValueError(f'{where or "the file"} must be "key: value" lines, with {known}')
    result = kind()
    for key, value in content.items():
        path = f"{where}.{key}" if where else str(key)
        if key not in names:
            raise ValueError(f'unknown key "{path}"{did_you_mean(str(key), names)}')
        current = getattr(result, key)
        result = replace(result, **{key: _value(key, current, value, path)})  # type: ignore[type-var]
    return result


def _value(key: str, current: object, value: object, where: str) -> object:
    if key in _SPECIAL:
        return _SPECIAL[key](value, where)
    if isinstance(current, bool):
        return _boolean(value, where)
    if isinstance(current, float):
        return _length(value, where)
    if isinstance(current, str):
        return _text(value, where)
    return _read(type(current), value, where)


def _boolean(value: object, where: str) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f'{where} must be true or false, not "{value}"')
    return value


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _length(value: Any, where: str) -> float:
    if not _is_number(value) or not 0 <= value < float("inf"):
        raise ValueError(f'{where} must be a number of at least 0, such as 0.5, not "{value}"')
    return float(value)


def _text(value: object, where: str) -> str:
    if not isinstance(value, str):
        raise ValueError(f'{where} must be a name, not "{value}"')
    return value


def _vector(value: Any, where: str) -> Vector | None:
    if value is None:
        return None
    numbers = isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))
    if not numbers or not all(abs(number) < float("inf") for number in value):
        raise ValueError(f'{where} must be three metres, such as [3.0, -3.0, 2.0], not "{value}"')
    return float(value[0]), float(value[1]), float(value[2])


def _background(value: Any, where: str) -> tuple[int, int, int] | None:
    if value is None:
        return None
    three = isinstance(value, list) and len(value) == 3
    if not three or not all(type(number) is int and 0 <= number <= 255 for number in value):
        raise ValueError(f'{where} must be three bytes, such as [48, 48, 48], not "{value}"')
    return value[0], value[1], value[2]


def _panel(value: object, where: str) -> str:
    if value not in PANEL_STATES:
        raise ValueError(f'{where} must be one of {", ".join(PANEL_STATES)}, not "{value}"')
    return str(value)


_SPECIAL: dict[str, Callable[[Any, str], object]] = {
    "background": _background,
    "eye": _vector,
    "target": _vector,
    **{entry.name: _panel for entry in fields(PanelsView)},
}
