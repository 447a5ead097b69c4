"""Speeds commanded and measured, as curves: one plot of linear.x, one of angular.z."""

import math

import numpy as np
import rerun as rr

from onebot_bringup.viewer.displays.tf import TIMELINE

_DECIMALS = 4  # of m/s and rad/s
LINEAR_ENTITY = "speeds/linear"
ANGULAR_ENTITY = "speeds/angular"
# Seconds without a message over which a curve is not drawn on: nobody said anything there.
GAP = 1.5
_SECOND = 1_000_000_000


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

    def add(self, stamp_ns: int, linear: float, angular: float, *, held: bool) -> None:
        """Take in a message; it is logged at the next ``flush``.

        Args:
            stamp_ns: its time, nanoseconds.
            linear: metres a second, forward.
            angular: radians a second, counterclockwise.
            held: the speed holds until the next message, as a command does.
        """
        if not self._has_legend:
            self._has_legend = True
            self._log_legend(held)
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
        for entity in (LINEAR_ENTITY, ANGULAR_ENTITY):
            legend = rr.SeriesLines(
                names=[self._name],
                colors=[self._color],
                # A robot that does as told hides the command: it lies beneath, as a band.
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
    """A plot is not drawn at all around infinity."""
    return value if math.isfinite(value) else math.nan
