"""Joint states as curves, and the limits of the joints as level lines between which they run."""

import colorsys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.columns import ColumnMaker, time_column
from onebot_bringup.viewer.displays.display import (
    SELDOM,
    Context,
    Display,
    LayoutPart,
    MessageType,
    Plot,
    WantedTopic,
    one_by_one,
)
from onebot_bringup.viewer.displays.joint_limits import limited_joints, limits
from onebot_bringup.viewer.settings import Color, setting
from onebot_description.wire.messages import JointStateArrays, one_joint_state
from onebot_description.wire.remembered import MOST_BYTES, size_of_names

POSITION_ENTITY = "joints/position"
VELOCITY_ENTITY = "joints/velocity"
# Each set of joint names is plotted on its own; more sets than these, or names of more than
# MOST_BYTES, are a publisher's mistake.
_MOST_SETS = 32
_CURVE_WIDTH, _LIMIT_WIDTH = 2.0, 1.0  # points on the screen

Floats = NDArray[np.float64]
Limits = Mapping[str, tuple[float, float]]

_SCALARS = ColumnMaker(rr.Scalars.columns(scalars=np.zeros(1)))

JOINT_STATE: MessageType[JointStateArrays] = MessageType(
    "sensor_msgs/msg/JointState", one_by_one(one_joint_state), lambda state: state.stamp_ns
)


@dataclass(frozen=True)
class JointPlotSettings:
    """The curves of the joints."""

    positions: bool = setting(True, "plot the joints' positions")
    velocities: bool = setting(True, "plot the joints' velocities, if the joint states have them")
    limits: bool = setting(False, "with the positions, level lines at the limits of each joint")
    window: float = setting(30.0, "how many seconds are shown; 0 for all")


class JointPlotDisplay(Display[JointPlotSettings]):
    """Plots joint_states."""

    key = "joint_plot"
    Settings = JointPlotSettings
    plots = True
    period_ns = SELDOM

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._settings = JointPlotSettings()
        self._limits: Limits = {}  # of the robot's joints
        self._stream = JointStream(context.recording)

    def topics(self) -> Sequence[WantedTopic]:
        """Return the joint states."""
        return [WantedTopic("joint_states", (JOINT_STATE,))]

    def apply(self, settings: JointPlotSettings) -> None:
        """Plot with or without limits; the rest is in the layout."""
        self._settings = settings
        self._stream.set_limits(self._limits if settings.limits else {})

    def set_robot(self) -> None:
        """Take the limits of the robot's joints."""
        assert self.context.robot is not None
        joints = limited_joints(self.context.robot)
        self._limits = {joint.name: limits(joint) for joint in joints}
        self.apply(self._settings)

    def add(
        self, _topic: str, _kind: MessageType[Any], messages: Sequence[tuple[int, JointStateArrays]]
    ) -> None:
        """Add joint states."""
        for stamp_ns, state in messages:
            self._stream.add(stamp_ns, state.names, state.positions, state.velocities)

    def flush(self) -> None:
        """Log the curves."""
        self._stream.flush()
        self.context.joint_colors = self._stream.colors

    def warnings(self) -> list[str]:
        """Return that joints are not plotted."""
        text = (
            f"joint_states has more than {_MOST_SETS} lists of names, or long ones: not all plotted"
        )
        return [text] if self._stream.full else []

    def layout(self) -> LayoutPart:
        """Return the plots, but those that would stay empty."""
        plot, robot = self._settings, self.context.robot
        position = Plot(POSITION_ENTITY, "Joint positions (rad, m)", plot.window)
        velocity = Plot(VELOCITY_ENTITY, "Joint velocities (rad/s, m/s)", plot.window)
        moves = robot is not None and any(joint.kind != "fixed" for joint in robot.joints)
        shown = [(position, plot.positions and moves)]
        shown += [(velocity, plot.velocities and self._stream.has_velocities)]
        return LayoutPart(views=tuple(view for view, wanted in shown if wanted))


class _Curves:
    """A set of joints, and the entities that it is plotted on."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        number: int,
        count: int,
        colors: Mapping[str, Color],
        limits: Limits,
    ) -> None:
        names = list(colors)
        limited = [name for name in names if name in limits]
        self._recording = recording
        self._number = number
        self._count = count
        self._pending: dict[str, list[tuple[int, Floats]]] = {
            POSITION_ENTITY: [],
            VELOCITY_ENTITY: [],
        }
        self._edges = np.array([limits[name] for name in limited]).ravel()
        # The lines at the limits bear the joint's name, too: one entry in the legend for all three.
        edges = [name for name in limited for _ in range(2)]
        for entity, shown in ((POSITION_ENTITY, [*names, *edges]), (VELOCITY_ENTITY, names)):
            extra = len(shown) - len(names)
            legend = rr.SeriesLines(
                names=shown,
                colors=[colors[name] for name in shown],
                widths=[_CURVE_WIDTH] * len(names) + [_LIMIT_WIDTH] * extra,
            )
            recording.log(f"{entity}/{number}", legend, static=True)

    def add(self, stamp_ns: int, positions: Floats, velocities: Floats) -> None:
        """Add the numbers that are there for each joint."""
        if len(positions) == self._count:
            self._pending[POSITION_ENTITY].append((stamp_ns, positions))
        if len(velocities) == self._count:
            self._pending[VELOCITY_ENTITY].append((stamp_ns, velocities))

    def flush(self) -> bool:
        """Log what was collected, one call for each entity; True if there was anything."""
        waiting = [entity for entity, rows in self._pending.items() if rows]
        for entity in waiting:
            self._log(entity, self._pending[entity])
        return bool(waiting)

    def _log(self, entity: str, rows: list[tuple[int, Floats]]) -> None:
        stamps = np.array([stamp for stamp, _ in rows], np.int64)
        values = np.stack([row for _, row in rows])
        rows.clear()
        if entity == POSITION_ENTITY and len(self._edges):
            edges = np.broadcast_to(self._edges, (len(values), len(self._edges)))
            values = np.concatenate([values, edges], axis=1)
        self._recording.send_columns(
            f"{entity}/{self._number}",
            indexes=[time_column(stamps)],
            columns=[_SCALARS.column(values, each=values.shape[1])],
        )


class JointStream:
    """Logs joint positions and velocities as curves, named after the joints."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._limits: dict[str, tuple[float, float]] = {}
        self._count = 0
        self._sets: dict[tuple[str, ...], _Curves] = {}
        self._size = 0  # of their names, bytes
        self.full = False  # a set is not plotted
        self._order: dict[tuple[str, ...], int] = {}  # in which each set first came
        self._last: tuple[object, _Curves | None] = ((), None)  # names that came last
        self.has_velocities = False  # a velocity ever came
        self.colors: dict[str, Color] = {}  # of every joint so far

    def set_limits(self, limits: Limits) -> None:
        """Draw the lower and upper limit (rad or m) of these joints with their positions."""
        if self._limits == dict(limits):
            return
        self.flush()
        self._limits = dict(limits)
        self._last = ((), None)
        self._size, self.full = 0, False
        self._sets.clear()  # on entities of their own from now on: the rows are of other lengths

    def add(
        self, stamp_ns: int, names: tuple[str, ...], positions: Floats, velocities: Floats
    ) -> None:
        """Add a JointState; it is logged at the next ``flush``.

        Args:
            stamp_ns: its time, nanoseconds.
            names: N joint names.
            positions: (N,) radians or metres, or empty.
            velocities: (N,) radians or metres a second, or empty.
        """
        if not names:
            return
        if names is not self._last[0]:  # it takes long to look up many
            self._last = (names, self._curves_of(names))
        curves = self._last[1]
        if curves is not None:
            self.has_velocities |= len(velocities) == len(names)
            curves.add(stamp_ns, positions, velocities)

    def flush(self) -> bool:
        """Log what was collected, one call for each curve family; True if there was anything."""
        return any([curves.flush() for curves in self._sets.values()])

    def _curves_of(self, names: tuple[str, ...]) -> _Curves | None:
        """The curves of this set of names; a new one gets its legend first."""
        curves = self._sets.get(names)
        if curves is None:
            size = self._size + size_of_names(names)
            if len(self._sets) >= _MOST_SETS or size > MOST_BYTES:
                self.full = True
                return None
            self._size = size
            colors = joint_colors(names, self._order.setdefault(names, len(self._order)))
            curves = _Curves(self._recording, self._count, len(names), colors, self._limits)
            self._sets[names] = curves
            self._count += 1
            self.colors.update(colors)
        return curves


def joint_colors(names: Sequence[str], offset: int = 0) -> dict[str, Color]:
    """Return a colour for each joint, easily distinguished on a dark ground (golden-angle hues).

    Args:
        names: of the joints.
        offset: of the set of joints, so that each set has colours of its own.
    """
    colors = {}
    for index, name in enumerate(names):
        hue = (0.58 + 0.381966 * (index + 3 * offset)) % 1.0
        red, green, blue = colorsys.hsv_to_rgb(hue, 0.6, 1.0)
        colors[name] = (round(255 * red), round(255 * green), round(255 * blue))
    return colors
