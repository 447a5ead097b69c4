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

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import yaml

from onebot_bringup.viewer import view_values as values
from onebot_bringup.viewer.view_model import (
    AxesView,
    CameraView,
    CovarianceView,
    GridView,
    JointPlotView,
    JointRangesView,
    PanelsView,
    SpeedLineView,
    SpeedsView,
    TrailView,
    ViewConfig,
)
from onebot_description.errors import OneBotError
from onebot_description.text import did_you_mean

__all__ = [
    "AxesView",
    "CameraView",
    "CovarianceView",
    "GridView",
    "JointPlotView",
    "JointRangesView",
    "PanelsView",
    "SpeedLineView",
    "SpeedsView",
    "TrailView",
    "ViewConfig",
    "check_value",
    "load_view",
    "parse_view",
    "view_text",
]


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
    "covariance": _named(CovarianceView),
    "lines": _named(SpeedLineView),
    **{entry.name: values.panel for entry in fields(PanelsView)},
}
