"""A saved view, in the place of RViz's config.rviz: a short YAML file, checked with clear errors.

Example (every key may be left out)::

    fixed_frame: base_link        # "" is the frame above all others
    axes: {visible: true, length: 0.5, names: true, frames: []}   # metres; [] is all frames
    grid: {visible: true, spacing: 1.0, height: 0.0}  # metres
    collision: false              # show collision shapes at the start
    background: [48, 48, 48]      # sRGB bytes
    camera:
      eye: [3.0, -3.0, 2.0]       # metres, in the fixed frame
      target: [0.0, 0.0, 0.5]
      follow: base_link           # the link the camera moves with
    joint_plot: {positions: true, velocities: true, window: 30.0}   # seconds
    trails:                       # where it has been, by Odometry topics, under any names
      odometry: {topic: velocity_controller/odom, color: [255, 176, 32], length: 60.0}   # seconds
    speeds:                       # linear.x and angular.z, under any names
      window: 20.0                # seconds
      lines:
        commanded: {topic: velocity_controller/cmd_vel, type: auto}
        measured: {topic: velocity_controller/odom, type: Odometry, color: [255, 176, 32]}
    panels: {blueprint: collapsed, selection: collapsed, time: collapsed, top: expanded}
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import yaml

from onebot_bringup.viewer import view_values as values
from onebot_bringup.viewer.geometry import Vector
from onebot_bringup.viewer.view_values import Color
from onebot_description.errors import OneBotError
from onebot_description.text import did_you_mean


@dataclass(frozen=True)
class AxesView:
    """The frames' axes.

    Attributes:
        visible: they are drawn.
        length: metres; 0 to choose it by the robot's size.
        names: the frames' names are written beside them.
        frames: of these frames only; empty for all.
    """

    visible: bool = True
    length: float = 0.0
    names: bool = True
    frames: tuple[str, ...] = ()


@dataclass(frozen=True)
class GridView:
    """The grid on the ground: drawn or not.

    Attributes:
        visible: it is drawn.
        spacing: metres; 0 to choose it by the robot's size.
        height: metres above the fixed frame's origin; negative where that is up on an axle.
    """

    visible: bool = True
    spacing: float = 0.0
    height: float = 0.0


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
class TrailView:
    """A line along the poses of an Odometry topic.

    Attributes:
        topic: relative, so that the node's namespace applies.
        color: sRGB bytes; None for one of ours.
        length: how many seconds of it are shown; 0 for all.
        width: metres.
        height: metres above the poses; negative to lay it on the ground.
    """

    topic: str = ""
    color: Color | None = None
    length: float = 60.0
    width: float = 0.01
    height: float = 0.0


@dataclass(frozen=True)
class SpeedLineView:
    """A curve in each plot of speeds.

    Attributes:
        topic: relative, so that the node's namespace applies.
        type: Twist, TwistStamped or Odometry; auto for what is on the topic.
        color: sRGB bytes; None for one of ours.
    """

    topic: str = ""
    type: str = "auto"
    color: Color | None = None


@dataclass(frozen=True)
class SpeedsView:
    """The curves of the speeds by name, and how many seconds of them are shown."""

    window: float = 20.0
    lines: Mapping[str, SpeedLineView] = field(default_factory=dict)


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
    background: Color | None = None
    camera: CameraView = field(default_factory=CameraView)
    joint_plot: JointPlotView = field(default_factory=JointPlotView)
    trails: Mapping[str, TrailView] = field(default_factory=dict)
    speeds: SpeedsView = field(default_factory=SpeedsView)
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
        return values.boolean(value, where)
    if isinstance(current, float):
        return values.length(value, where)
    if isinstance(current, str):
        return values.text(value, where)
    return _read(type(current), value, where)


def _named(kind: type[T]) -> Callable[[Any, str], dict[str, T]]:
    """Return the reader of a mapping from names, freely chosen, to what has a topic."""

    def read(content: Any, where: str) -> dict[str, T]:
        if not isinstance(content, Mapping):
            raise ValueError(f'{where} must be "name: {{topic: ...}}" lines')
        found = {}
        for name, entry in content.items():
            path = f"{where}.{name}"
            if not isinstance(name, str) or not name:
                raise ValueError(f"{path}: a name must be text")
            found[name] = _read(kind, entry, path)
            if "topic" not in entry:
                raise ValueError(f"{path} has no topic")
        return found

    return read


_SPECIAL: dict[str, Callable[[Any, str], object]] = {
    "background": values.color,
    "color": values.color,
    "eye": values.vector,
    "frames": values.names,
    "target": values.vector,
    "height": values.height,
    "topic": values.topic,
    "type": values.speed_type,
    "trails": _named(TrailView),
    "lines": _named(SpeedLineView),
    **{entry.name: values.panel for entry in fields(PanelsView)},
}
