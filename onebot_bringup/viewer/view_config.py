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
    joint_plot: {positions: true, velocities: true, limits: false, window: 30.0}   # seconds
    joint_ranges: {visible: false, radius: 0.45}   # how far each joint can go, in the robot; metres
    trails:                       # where it has been, by Odometry topics, under any names
      odometry: {topic: velocity_controller/odom, color: [255, 176, 32], length: 60.0}   # seconds
    covariance:                   # how sure it is of its pose, by Odometry topics, under any names
      odometry: {topic: velocity_controller/odom, sigma: 3.0, heading: 0.4}   # deviations, metres
    speeds:                       # linear.x and angular.z, under any names
      window: 20.0                # seconds
      lines:
        commanded: {topic: velocity_controller/cmd_vel, type: auto}
        measured: {topic: velocity_controller/odom, type: Odometry, color: [255, 176, 32]}
    panels: {blueprint: collapsed, selection: collapsed, time: collapsed, top: expanded}
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import yaml

from onebot_description.description.description import Triple
from onebot_description.description.packages import package_share
from onebot_description.errors import OneBotError, did_you_mean

# The values in a saved view, checked: each function returns one, or says what would be right.

PANEL_STATES = ("hidden", "collapsed", "expanded")
SPEED_TYPES = ("auto", "Twist", "TwistStamped", "Odometry")
Color = tuple[int, int, int]

# Relative, so that a namespace applies; absolute only where it is written so.
_TOPIC = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


def boolean(value: object, where: str) -> bool:
    """Check true or false."""
    if not isinstance(value, bool):
        raise ValueError(f'{where} must be true or false, not "{value}"')
    return value


def length(value: Any, where: str) -> float:
    """Check a number of at least 0."""
    if not _is_number(value) or not 0 <= value < float("inf"):
        raise ValueError(f'{where} must be a number of at least 0, such as 0.5, not "{value}"')
    return float(value)


def height(value: Any, where: str) -> float:
    """Check metres up, or down if negative."""
    if not _is_number(value) or not abs(value) < float("inf"):
        raise ValueError(f'{where} must be metres, such as -0.05, not "{value}"')
    return float(value)


def text(value: object, where: str) -> str:
    """Check a name."""
    if not isinstance(value, str):
        raise ValueError(f'{where} must be a name, not "{value}"')
    return value


def names(value: Any, where: str) -> tuple[str, ...]:
    """Check a list of names."""
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise ValueError(
            f'{where} must be a list of names, such as [odom, base_link], not "{value}"'
        )
    return tuple(value)


def topic(value: object, where: str) -> str:
    """Check the name of a topic."""
    if not isinstance(value, str) or not _TOPIC.fullmatch(value):
        raise ValueError(
            f'{where} must be a topic, such as velocity_controller/odom, not "{value}"'
        )
    return value


def vector(value: Any, where: str) -> Triple | None:
    """Check three metres, or nothing."""
    if value is None or value == []:
        return None
    numbers = isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))
    if not numbers or not all(abs(number) < float("inf") for number in value):
        raise ValueError(f'{where} must be three metres, such as [3.0, -3.0, 2.0], not "{value}"')
    return float(value[0]), float(value[1]), float(value[2])


def color(value: Any, where: str) -> Color | None:
    """Check three sRGB bytes, or nothing."""
    if value is None or value == []:
        return None
    three = isinstance(value, list) and len(value) == 3
    if not three or not all(type(number) is int and 0 <= number <= 255 for number in value):
        raise ValueError(f'{where} must be three bytes, such as [48, 48, 48], not "{value}"')
    return value[0], value[1], value[2]


def panel(value: object, where: str) -> str:
    """Check the state of a panel."""
    return _one_of(value, PANEL_STATES, where)


def speed_type(value: object, where: str) -> str:
    """Check the type of messages that carry a speed."""
    return _one_of(value, SPEED_TYPES, where)


def _one_of(value: object, choices: tuple[str, ...], where: str) -> str:
    if value not in choices:
        raise ValueError(f'{where} must be one of {", ".join(choices)}, not "{value}"')
    return str(value)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


# What a saved view says, as dataclasses; see ``view_config`` for how it is written.


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

    eye: Triple | None = None
    target: Triple | None = None
    follow: str = ""


@dataclass(frozen=True)
class JointPlotView:
    """The curves of the joints.

    Attributes:
        positions: they are plotted.
        velocities: they are plotted, if the joint states tell them.
        limits: with the positions, two level lines at those of each joint that has limits.
        window: how many seconds are shown; 0 for all.
    """

    positions: bool = True
    velocities: bool = True
    limits: bool = False
    window: float = 30.0


@dataclass(frozen=True)
class JointRangesView:
    """How far each joint can go, drawn in the robot: an arc or a bar, and a hand where it is.

    Attributes:
        visible: they are drawn.
        radius: of an arc, metres; 0 to choose it by the robot's size.
    """

    visible: bool = False
    radius: float = 0.0


@dataclass(frozen=True)
class PoseView:
    """What is drawn of the poses of an Odometry topic.

    Attributes:
        topic: relative, so that the node's namespace applies.
        color: sRGB bytes; None for one of ours.
        width: of the lines, metres.
        height: metres above the poses; negative to lay it on the ground.
    """

    topic: str = ""
    color: Color | None = None
    width: float = 0.01
    height: float = 0.0


@dataclass(frozen=True)
class TrailView(PoseView):
    """A line along the poses.

    Attributes:
        length: how many seconds of it are shown; 0 for all.
    """

    length: float = 60.0


@dataclass(frozen=True)
class CovarianceView(PoseView):
    """An ellipse and a sector that show the covariance of the pose.

    Attributes:
        sigma: how many standard deviations they are wide.
        heading: radius of the sector, which shows the yaw, metres; 0 for none.
    """

    width: float = 0.006
    sigma: float = 3.0
    heading: float = 0.5


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
    """How a robot is looked at; see ``view_config``."""

    fixed_frame: str = ""
    axes: AxesView = field(default_factory=AxesView)
    grid: GridView = field(default_factory=GridView)
    collision: bool = False
    background: Color | None = None
    camera: CameraView = field(default_factory=CameraView)
    joint_plot: JointPlotView = field(default_factory=JointPlotView)
    joint_ranges: JointRangesView = field(default_factory=JointRangesView)
    trails: Mapping[str, TrailView] = field(default_factory=dict)
    covariance: Mapping[str, CovarianceView] = field(default_factory=dict)
    speeds: SpeedsView = field(default_factory=SpeedsView)
    panels: PanelsView = field(default_factory=PanelsView)


def load_view(path: Path) -> ViewConfig:
    """Read the saved view at ``path``.

    Raises:
        OneBotError: there is no such file, or an entry is wrong; the message names it and says what
            would be right.
    """
    try:
        return parse_view(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OneBotError(f"view {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise OneBotError(f"view {path}: not YAML: {error}") from error
    except ValueError as error:
        raise OneBotError(f"view {path}: {error}") from error


def parse_view(text: str) -> ViewConfig:
    """Read a saved view from YAML text.

    Raises:
        ValueError: an entry is wrong.
    """
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError(f"not YAML: {' '.join(str(error).split())}") from error
    return _read(ViewConfig, {} if content is None else content, "")


def view_text(view: ViewConfig) -> str:
    """Return ``view`` as YAML text that ``parse_view`` reads, without what is as always."""
    return str(
        yaml.safe_dump(_different(view, ViewConfig()), sort_keys=False, default_flow_style=None)
    )


def _different(config: Any, usual: Any) -> dict[str, Any]:
    """The entries of a dataclass that are not as in ``usual``, as plain values."""
    found: dict[str, Any] = {}
    for entry in fields(config):
        value, other = getattr(config, entry.name), getattr(usual, entry.name)
        if value == other:
            continue
        if is_dataclass(value):
            found[entry.name] = _different(value, other)
        elif isinstance(value, Mapping):
            found[entry.name] = {
                name: _different(item, type(item)()) for name, item in value.items()
            }
        else:
            found[entry.name] = list(value) if isinstance(value, tuple) else value
    return found


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
        result = replace(result, **{key: check_value(key, current, value, path)})  # type: ignore[type-var]
    return result


def check_value(key: str, current: object, value: object, where: str) -> object:
    """Return ``value`` as it stands in a view, where ``current`` stands now.

    Args:
        key: the last word of its name.
        current: a value of its type.
        value: as YAML has it.
        where: its whole name.

    Raises:
        ValueError: what would be right.
    """
    if key in _SPECIAL:
        return _SPECIAL[key](value, where)
    if isinstance(current, bool):
        return boolean(value, where)
    if isinstance(current, float):
        return length(value, where)
    if isinstance(current, str):
        return text(value, where)
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
    "background": color,
    "color": color,
    "eye": vector,
    "frames": names,
    "target": vector,
    "height": height,
    "topic": topic,
    "type": speed_type,
    "trails": _named(TrailView),
    "covariance": _named(CovarianceView),
    "lines": _named(SpeedLineView),
    **{entry.name: panel for entry in fields(PanelsView)},
}


# The single settings of a view, by dotted names such as ``axes.visible``: RViz's check boxes.

Value = bool | float | str | list[float] | list[int] | list[str]


def settings(view: ViewConfig) -> dict[str, Value]:
    """Return every single setting of ``view``; what is left open is an empty list.

    Trails, covariances and curves are no settings: they have names of the user's own.
    """
    return {name: _plain(value) for name, value in _leaves(view, "")}


def with_setting(view: ViewConfig, name: str, value: Any) -> ViewConfig:
    """Return ``view`` with another value of one setting, as a view file would have it.

    Raises:
        ValueError: there is no such setting, or it cannot have that value.
    """
    changed: ViewConfig = _replaced(view, name.split("."), value, name)
    return changed


def changed_settings(before: ViewConfig, after: ViewConfig) -> dict[str, Value]:
    """Return the settings of ``after`` that differ from those of ``before``."""
    old = settings(before)
    return {name: value for name, value in settings(after).items() if old[name] != value}


def _leaves(config: Any, prefix: str) -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for entry in fields(config):
        value = getattr(config, entry.name)
        if is_dataclass(value):
            found += _leaves(value, f"{prefix}{entry.name}.")
        elif not isinstance(value, Mapping):
            found.append((prefix + entry.name, value))
    return found


def _plain(value: Any) -> Value:
    if value is None:
        return []
    return list(value) if isinstance(value, tuple) else value


def _replaced(config: Any, path: list[str], value: Any, name: str) -> Any:
    if (
        not is_dataclass(config)
        or isinstance(config, type)
        or path[0] not in {entry.name for entry in fields(config)}
    ):
        raise ValueError(f'there is no setting "{name}"')
    current = getattr(config, path[0])
    if len(path) > 1:
        new = _replaced(current, path[1:], value, name)
    elif is_dataclass(current) or isinstance(current, Mapping):
        raise ValueError(f'"{name}" is more than one setting')
    else:
        new = check_value(path[0], current, value, name)
    changed: Any = replace(config, **{path[0]: new})
    return changed


# The view that belongs to a robot: the one saved in the config/ of its description.

_VIEW = Path("config/view.yaml")
# What a robot's name must be for a package to be named after it (REP-144); also keeps "../" out.
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


def view_for(robot_name: str) -> Path | None:
    """Return the saved view of the robot, as its URDF names it; None if there is none.

    It is ``config/view.yaml`` in the share folder of the package ``<robot_name>_description``,
    found as every ROS package is, also one of the user's own workspace.
    """
    if not _NAME.fullmatch(robot_name):
        return None
    try:
        path = package_share(f"{robot_name}_description") / _VIEW
    except OneBotError:
        return None  # most robots have no package of that name
    return path if path.is_file() else None
