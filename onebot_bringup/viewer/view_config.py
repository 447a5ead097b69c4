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
    curves:                       # numbers of any messages, under any names
      lines:
        charge: {topic: battery, field: percentage, plot: Battery}
    automatic: true               # show every topic of a type that has a display, up to some
    hidden: [/local_plan]         # but for these topics,
    shown: [/camera/points]       # and these in any case
    path: {line_width: 0.02, topics: {/plan: {line_width: 0.1}}}   # of nav_msgs/Path; metres
    map: {alpha: 0.7, color_scheme: auto, draw_behind: false}
    odometry: {keep: 100, position_tolerance: 0.1, angle_tolerance: 0.1}   # metres, rad
    pose: {shape: Axes, axes_length: 0.5}          # metres, as all lengths
    pose_array: {shape: Arrow (Flat), arrow_length: 0.3}
    pose_with_covariance: {covariance: true, sigma: 3.0}
    point_stamped: {radius: 0.2, history_length: 10}
    polygon: {color: [25, 255, 0]}
    laser_scan: {color_transformer: auto, size: 0.05, decay_time: 0.0}   # metres, seconds
    point_cloud2: {color_transformer: Intensity, channel_name: ring}
    image: {normalize_range: false, min_value: 0.0, max_value: 5000.0}   # of 16 or 32 bits
    camera_info: {far_clip: 0.5}  # metres
    imu: {axes: true, axes_scale: 0.3, acceleration: true, acceleration_scale: 0.05}  # metres
    range: {color: [255, 255, 255], alpha: 0.5}
    marker: {hidden_namespaces: [debug]}   # of visualization_msgs/Marker and MarkerArray
    log: {visible: true, level: warn}   # of rcl_interfaces/Log
    panels: {blueprint: collapsed, selection: collapsed, time: collapsed, top: expanded}
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml

from onebot_bringup.viewer.displays import DISPLAYS
from onebot_bringup.viewer.displays.display import Display
from onebot_bringup.viewer.displays.drawing import Drawing
from onebot_bringup.viewer.settings import Color, color, height, one_of, setting, topic_list, vector
from onebot_description.description.description import Triple
from onebot_description.description.packages import package_share
from onebot_description.errors import OneBotError
from onebot_description.parameters.files import read_map, read_text
from onebot_description.parameters.reader import as_map, group, read, values_of

_PANEL = one_of("hidden", "collapsed", "expanded")
T = TypeVar("T")


@dataclass(frozen=True)
class GridSettings:
    """The grid on the ground."""

    visible: bool = setting(True, "draw the grid on the ground")
    spacing: float = setting(0.0, "metres; 0 to choose it by the robot's size")
    height: float = setting(0.0, "metres above the fixed frame's origin", height)


@dataclass(frozen=True)
class CameraSettings:
    """Where to look from, and at."""

    eye: Triple | None = setting(None, "metres, in the fixed frame", vector)
    target: Triple | None = setting(None, "metres, in the fixed frame", vector)
    follow: str = setting("", "the link that the camera moves with")


@dataclass(frozen=True)
class PanelsSettings:
    """The state of the viewer's panels."""

    blueprint: str = setting("collapsed", "state of the panel", _PANEL)
    selection: str = setting("collapsed", "state of the panel", _PANEL)
    time: str = setting("collapsed", "state of the panel", _PANEL)
    top: str = setting("expanded", "state of the panel", _PANEL)


def _with_displays(kind: type[T]) -> type[T]:
    """Add a field for the settings of each display."""
    entries: list[tuple[str, Any, Any]] = [
        (display.key, Mapping[str, display.Settings], field(default_factory=dict))  # type: ignore[name-defined]
        if display.named
        else (display.key, display.Settings, group(display.Settings))
        for display in DISPLAYS
    ]
    made = make_dataclass(kind.__name__, entries, bases=(kind,), frozen=True)
    made.__doc__, made.__module__ = kind.__doc__, kind.__module__
    return made


@_with_displays
@dataclass(frozen=True)
class ViewConfig:
    """How a robot is looked at: what holds for the whole view, and the settings of each display.

    The settings of a display are the field of its ``key``, such as ``axes``.
    """

    fixed_frame: str = setting("", 'the frame that stands still; "" for the root of the TF tree')
    grid: GridSettings = group(GridSettings)
    collision: bool = setting(False, "show collision shapes")
    background: Color | None = setting(None, "sRGB bytes", color)
    camera: CameraSettings = group(CameraSettings)
    panels: PanelsSettings = group(PanelsSettings)
    automatic: bool = setting(True, "show every topic of a type that has a display, up to some")
    hidden: tuple[str, ...] = setting((), "topics that are not shown", topic_list)
    shown: tuple[str, ...] = setting((), "topics that are shown in any case", topic_list)

    def of(self, display: Display[Any] | type[Drawing[Any]]) -> Any:
        """Return the settings of a display."""
        return getattr(self, display.key)


def load_view(path: Path) -> ViewConfig:
    """Read the saved view at ``path``.

    Raises:
        ConfigError: there is no such file, or an entry is wrong; names it, its line and what would
            be right.
    """
    return parse_view(read_text(path), str(path))


def parse_view(text: str, name: str = "view") -> ViewConfig:
    """Read a saved view from YAML text; ``name`` is the file's, for errors.

    Raises:
        ConfigError: an entry is wrong.
    """
    found = read_map(text, name)
    return read(ViewConfig, found.values, found.places)


def view_text(view: ViewConfig) -> str:
    """Return ``view`` as YAML text that ``parse_view`` reads, without what is as by default."""
    return str(yaml.dump(as_map(view), Dumper=_Dumper, sort_keys=False, default_flow_style=False))


class _Dumper(yaml.SafeDumper):
    """Writes maps as blocks, and lists, such as vectors and colours, on a line."""

    def represent_sequence(self, tag: str, sequence: Any, flow_style: Any = None) -> Any:
        return super().represent_sequence(tag, sequence, flow_style=True)


def changed_settings(before: ViewConfig, after: ViewConfig) -> dict[str, Any]:
    """Return the settings of ``after`` that differ from those of ``before``, by dotted names."""
    old = values_of(before)
    return {name: value for name, value in values_of(after).items() if old[name] != value}


# --- the view that belongs to a robot: the one saved in the config/ of its description ----------

_VIEW, _WORLD_VIEW = Path("config/view.yaml"), Path("config/world_view.yaml")
# What a robot's name must be for a package to be named after it (REP-144); also keeps "../" out.
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


def view_for(robot_name: str, *, in_world: bool = False) -> Path | None:
    """Return the saved view of the robot, as its URDF names it; None if there is none.

    It is ``config/view.yaml`` in the share folder of the package ``<robot_name>_description``,
    found as every ROS package is, also one of the user's own workspace; in a world
    ``config/world_view.yaml``, if there is one.
    """
    if not _NAME.fullmatch(robot_name):
        return None
    try:
        share = package_share(f"{robot_name}_description")
    except OneBotError:
        return None  # most robots have no package of that name
    views = (share / view for view in ((_WORLD_VIEW, _VIEW) if in_world else (_VIEW,)))
    return next(filter(Path.is_file, views), None)
