"""Joint states as curves, and the limits of the joints as level lines between which they run."""

import colorsys
from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.displays.tf import ColumnMaker, time_column

POSITION_ENTITY = "joints/position"
VELOCITY_ENTITY = "joints/velocity"
# Each set of joint names is plotted on its own; more sets than these are a publisher's mistake.
_MOST_SETS = 32
_CURVE_WIDTH, _LIMIT_WIDTH = 2.0, 1.0  # points on the screen

Floats = NDArray[np.float64]
Color = tuple[int, int, int]
Limits = Mapping[str, tuple[float, float]]

_SCALARS = ColumnMaker(rr.Scalars.columns(scalars=np.zeros(1)))


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
        """Take in what is there for each joint."""
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
    """Logs joint positions and velocities as curves, named after the joints.

    Attributes:
        has_velocities: a velocity was ever heard.
        colors: of every joint heard so far, sRGB bytes.
    """

    def __init__(self, recording: rr.RecordingStream) -> None:
        """Log into ``recording``."""
        self._recording = recording
        self._limits: dict[str, tuple[float, float]] = {}
        self._count = 0
        self._sets: dict[tuple[str, ...], _Curves] = {}
        self._order: dict[tuple[str, ...], int] = {}  # in which each set was first heard
        self._last: tuple[object, _Curves | None] = ((), None)  # names that came last
        self.has_velocities = False
        self.colors: dict[str, Color] = {}

    def set_limits(self, limits: Limits) -> None:
        """Draw the lower and upper limit (rad or m) of these joints with their positions."""
        if self._limits == dict(limits):
            return
        self.flush()
        self._limits = dict(limits)
        self._last = ((), None)
        self._sets.clear()  # on entities of their own from now on: the rows are of other lengths

    def add(
        self, stamp_ns: int, names: tuple[str, ...], positions: Floats, velocities: Floats
    ) -> None:
        """Take in a JointState; it is logged at the next ``flush``.

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
        if curves is None and len(self._sets) < _MOST_SETS:
            colors = joint_colors(names, self._order.setdefault(names, len(self._order)))
            curves = _Curves(self._recording, self._count, len(names), colors, self._limits)
            self._sets[names] = curves
            self._count += 1
            self.colors.update(colors)
        return curves


def joint_colors(names: Sequence[str], offset: int = 0) -> dict[str, Color]:
    """Return a colour for each joint, easily told apart on a dark ground (golden-angle hues).

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
