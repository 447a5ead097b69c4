"""Speeds commanded and measured, as curves: one plot of linear.x, one of angular.z."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from onebot_bringup.viewer.columns import TIMELINE
from onebot_bringup.viewer.displays.display import (
    LARGEST,
    ODOMETRY,
    SELDOM,
    ItemsDisplay,
    LayoutPart,
    MessageType,
    Plot,
    one_by_one,
)
from onebot_bringup.viewer.settings import Color, color, one_of, setting, topic
from onebot_description.parameters.reader import REQUIRED
from onebot_description.wire.messages import (
    OdometrySample,
    TwistSample,
    twist_sample,
    twist_stamped_sample,
)

_DECIMALS = 4  # of m/s and rad/s
LINEAR_ENTITY = "speeds/linear"
ANGULAR_ENTITY = "speeds/angular"
# Seconds without a message over which a curve is not drawn on: nothing was published there.
GAP = 1.5
_SECOND = 1_000_000_000

TWIST: MessageType[TwistSample] = MessageType(
    "geometry_msgs/msg/Twist", one_by_one(twist_sample), lambda sample: sample.stamp_ns
)
TWIST_STAMPED: MessageType[TwistSample] = MessageType(
    "geometry_msgs/msg/TwistStamped",
    one_by_one(twist_stamped_sample),
    lambda sample: sample.stamp_ns,
)
_TYPES: Mapping[str, MessageType[Any]] = {
    "Twist": TWIST,
    "TwistStamped": TWIST_STAMPED,
    "Odometry": ODOMETRY,
}
_AUTO = "auto"


@dataclass(frozen=True)
class SpeedSettings:
    """A curve in each plot of speeds."""

    topic: str = setting(REQUIRED, "a topic of velocities", topic)
    type: str = setting(_AUTO, f"{', '.join(_TYPES)}, or auto", one_of(_AUTO, *_TYPES))
    color: Color | None = setting(None, "sRGB bytes; by default one of ours", color)


@dataclass(frozen=True)
class SpeedsSettings:
    """The curves of linear.x and angular.z."""

    window: float = setting(20.0, "how many seconds are shown; 0 for all")
    lines: Mapping[str, SpeedSettings] = setting({}, "the curves, by names of your own")


class SpeedsDisplay(ItemsDisplay[SpeedsSettings, "SpeedStream"]):
    """Plots speeds commanded and measured."""

    key = "speeds"
    Settings = SpeedsSettings
    noun = "speed"
    plots = True
    period_ns = SELDOM

    def apply(self, settings: SpeedsSettings) -> None:
        """Plot these lines."""
        self._window = settings.window
        super().apply(settings)

    def wanted(self, settings: SpeedsSettings) -> Mapping[str, tuple[str, SpeedSettings]]:
        """Return the lines."""
        return {name: (line.topic, line) for name, line in settings.lines.items()}

    def types_of(self, settings: SpeedSettings) -> tuple[MessageType[Any], ...]:
        """Return the type that the settings name, or all."""
        named = _TYPES.get(settings.type)
        return tuple(_TYPES.values()) if named is None else (named,)

    def make(self, name: str, settings: SpeedSettings, color: Color) -> "SpeedStream":
        """Return a line."""
        return SpeedStream(self.context.recording, name, settings.color or color)

    def layout(self) -> LayoutPart:
        """Return both plots, if there is a line."""
        if not self.items:
            return LayoutPart()
        plots = ((LINEAR_ENTITY, "Speed (m/s)"), (ANGULAR_ENTITY, "Turn rate (rad/s)"))
        return LayoutPart(
            views=tuple(
                Plot(entity, name, self._window, tuple(speed_entity(entity, n) for n in self.items))
                for entity, name in plots
            )
        )


class SpeedStream:
    """Logs the linear and angular speed of one topic."""

    def __init__(
        self, recording: rr.RecordingStream, name: str, color: tuple[int, int, int]
    ) -> None:
        """Log into ``recording``.

        Args:
            recording: where to log.
            name: of the curves, such as "measured".
            color: of the curves, sRGB bytes.
        """
        self._recording = recording
        self._name = name
        self._color = color
        self._rows: list[tuple[int, float, float]] = []
        self._last_ns: int | None = None
        self._has_legend = False
        self.frame = ""  # a curve is in none

    def add(self, stamp_ns: int, sample: TwistSample | OdometrySample) -> None:
        """Add a message; it is logged at the next ``flush``."""
        if not self._has_legend:
            self._has_legend = True
            self._log_legend(held=isinstance(sample, TwistSample))
        linear, angular = float(sample.linear[0]), float(sample.angular[2])
        last = self._last_ns
        if last is not None and stamp_ns - last > GAP * _SECOND:
            self._rows.append((last + 1, math.nan, math.nan))  # a gap in the curve
        self._rows.append((stamp_ns, _finite(linear), _finite(angular)))
        self._last_ns = stamp_ns

    def flush(self) -> bool:
        """Log what was collected, one call for each plot; True if there was anything."""
        if not self._rows:
            return False
        stamps, linear, angular = zip(*self._rows, strict=True)
        self._rows = []
        time = rr.TimeColumn(TIMELINE, timestamp=np.array(stamps, "datetime64[ns]"))
        for entity, values in ((LINEAR_ENTITY, linear), (ANGULAR_ENTITY, angular)):
            # A plot zooms in on whatever there is: without the last digits a steady speed is flat.
            columns = rr.Scalars.columns(scalars=np.round(values, _DECIMALS))
            self._recording.send_columns(self._path(entity), indexes=[time], columns=columns)
        return True

    def _log_legend(self, held: bool) -> None:
        """Log how the curve looks; one that is ``held`` keeps its value, as a command does."""
        for entity in (LINEAR_ENTITY, ANGULAR_ENTITY):
            legend = rr.SeriesLines(
                names=[self._name],
                colors=[self._color],
                # A robot that follows its command hides it: the command lies beneath, as a band.
                widths=[6.0] if held else [2.0],
                interpolation_mode="StepAfter" if held else "Linear",
                # Else a step on which two samples share a pixel gets a stair in the middle.
                aggregation_policy="Off" if held else "Average",
            )
            self._recording.log(self._path(entity), legend, static=True)

    def _path(self, entity: str) -> str:
        return speed_entity(entity, self._name)


def speed_entity(entity: str, name: str) -> str:
    """Return the entity of the curve ``name`` in the plot ``entity``."""
    return rr.new_entity_path([*entity.split("/"), name]).lstrip("/")


def _finite(value: float) -> float:
    """A plot is not drawn at all around infinity, or what is infinite once it is rounded."""
    return value if abs(value) <= LARGEST else math.nan
