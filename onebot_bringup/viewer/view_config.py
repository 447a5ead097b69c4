"""A saved view: a short YAML file in place of RViz's config.rviz, checked with clear errors.

Example (every key may be left out; the settings of a display are below its key)::

    fixed_frame: base_link        # "" is the frame above all others
    axes: {visible: true, length: 0.5, names: true, frames: []}   # meters; [] is all frames
    grid: {visible: true, spacing: 1.0, height: 0.0}  # meters
    collision: false              # show collision shapes at the start
    background: [48, 48, 48]      # sRGB bytes
    camera:
      eye: [3.0, -3.0, 2.0]       # meters, in the fixed frame
      target: [0.0, 0.0, 0.5]
      follow: base_link           # the link the camera moves with
    trails:                       # trails by Odometry topics, under any names
      odometry: {topic: velocity_controller/odom, color: [255, 176, 32], length: 60.0}   # seconds
    automatic: true               # show topics of all types that have a display
    hidden: [/local_plan]         # topics not shown
    shown: [/camera/points]       # topics always shown
    path: {line_width: 0.02, topics: {/plan: {line_width: 0.1}}}   # nav_msgs/Path; meters
    panels: {blueprint: collapsed, selection: collapsed, time: collapsed, top: expanded}
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_origin

import yaml

from onebot_bringup.viewer.core.display import Display, S
from onebot_bringup.viewer.core.drawing import Drawing
from onebot_bringup.viewer.core.settings import (
    Color,
    FrameSettings,
    color,
    one_of,
    setting,
    signed,
    topic_list,
    vector,
)
from onebot_bringup.viewer.displays import DISPLAY_BY_KEY, settings_type
from onebot_description.elements.packages import package_share
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import Triple
from onebot_description.parameters.files import read_map, read_text
from onebot_description.parameters.reader import as_map, group, read, values_of

T = TypeVar("T")
_PANEL = one_of("hidden", "collapsed", "expanded")


@dataclass(frozen=True)
class GridSettings:
    """The grid on the ground."""

    visible: bool = setting(True, "draw it")
    spacing: float = setting(0.0, "meters; 0: fits the robot's size")
    height: float = setting(0.0, "meters above the fixed frame's origin", signed)


@dataclass(frozen=True)
class CameraSettings:
    """Where the camera is, and what it looks at."""

    eye: Triple | None = setting(None, "meters, in the fixed frame", vector)
    target: Triple | None = setting(None, "meters, in the fixed frame", vector)
    follow: str = setting("", "the link that the camera moves with")


@dataclass(frozen=True)
class PanelsSettings:
    """The state of the viewer's panels."""

    blueprint: str = setting("collapsed", "state of the panel", _PANEL)
    selection: str = setting("collapsed", "state of the panel", _PANEL)
    time: str = setting("collapsed", "state of the panel", _PANEL)
    top: str = setting("expanded", "state of the panel", _PANEL)


def _with_displays(view: type[T]) -> type[T]:
    """Add a field for the settings of each display to the fields of a view."""
    for key, display in DISPLAY_BY_KEY.items():
        kind = view.__annotations__[key] = settings_type(display)
        is_map = get_origin(kind) is not None
        field = setting({}, f"{key}, by names of your own") if is_map else group(kind)
        setattr(view, key, field)
    return view


@dataclass(frozen=True)
@_with_displays
class ViewConfig(FrameSettings):
    """How robots are shown: settings of the whole view, and of each display.

    The settings of a display are a field, too, named as its ``key``.
    """

    grid: GridSettings = group(GridSettings)
    collision: bool = setting(False, "show collision shapes")
    background: Color | None = setting(None, "sRGB bytes; empty: automatic", color)
    camera: CameraSettings = group(CameraSettings)
    panels: PanelsSettings = group(PanelsSettings)
    automatic: bool = setting(True, "show topics of all types that have a display")
    hidden: tuple[str, ...] = setting((), "topics not shown", topic_list)
    shown: tuple[str, ...] = setting((), "topics always shown", topic_list)

    def settings_of(self, display: Display[S] | type[Display[S]] | type[Drawing[S]]) -> S:
        """Return the settings of a display."""
        settings: S = getattr(self, display.key)
        return settings


def load_view(path: Path) -> ViewConfig:
    """Read the saved view at ``path``.

    Raises:
        ConfigError: it is invalid; names the file, the entry and its line.
    """
    return parse_view(read_text(path), str(path))


def parse_view(text: str, name: str = "view") -> ViewConfig:
    """Parse a saved view.

    Args:
        text: the YAML text.
        name: the file's name, for error messages.

    Raises:
        ConfigError: it is invalid.
    """
    parameters = read_map(text, name)
    return read(ViewConfig, parameters.values, parameters.places)


def view_text(view: ViewConfig) -> str:
    """Return ``view`` as YAML text that ``parse_view`` reads, without settings at their default."""
    return str(yaml.dump(as_map(view), Dumper=_Dumper, sort_keys=False, default_flow_style=False))


class _Dumper(yaml.SafeDumper):
    """Writes maps as blocks, but lists, such as vectors and colors, on one line."""

    def represent_sequence(self, tag: str, sequence: Any, flow_style: Any = None) -> Any:
        return super().represent_sequence(tag, sequence, flow_style=True)


def changed_settings(before: ViewConfig, after: ViewConfig) -> dict[str, Any]:
    """Return the settings of ``after`` that differ from ``before``, by dotted names."""
    old = values_of(before)
    return {name: value for name, value in values_of(after).items() if old[name] != value}


# --- the view that belongs to a robot: saved in the config/ of its description --------------------

_VIEW, _WORLD_VIEW = Path("config/view.yaml"), Path("config/world_view.yaml")
# A robot's name must match this for a package to be named after it (REP-144); keeps "../" out, too.
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


def view_for(robot_name: str, *, in_world: bool = False) -> Path | None:
    """Return the saved view of a robot; None if there is none.

    It is ``config/view.yaml`` in the share folder of the package ``<robot_name>_description``,
    which may be in the user's own workspace; in a world, ``config/world_view.yaml`` if it exists.

    Args:
        robot_name: the name in the robot's URDF.
        in_world: whether anything stands around the robot.
    """
    if not _NAME.fullmatch(robot_name):
        return None
    try:
        share = package_share(f"{robot_name}_description")
    except OneBotError:
        return None  # most robots have no package of that name
    views = (share / view for view in ((_WORLD_VIEW, _VIEW) if in_world else (_VIEW,)))
    return next(filter(Path.is_file, views), None)
