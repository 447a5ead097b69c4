"""Plots numbers in messages: commanded and measured speeds, and any field of any message.

Speeds have two plots, of linear.x and of angular.z. Any other field is written as in Python, names
joined by dots, ``[0]`` for an element of an array: ``{topic: imu, field: linear_acceleration.x}``.
The message type is the one that is published on the topic.
"""

import math
import re
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.core.columns import ColumnMaker, below, entity_path, send
from onebot_bringup.viewer.core.display import LayoutPart, Plot
from onebot_bringup.viewer.core.drawing import Drawing, NamedDisplay
from onebot_bringup.viewer.core.inbox import MessageType, WantedTopic, known_type
from onebot_bringup.viewer.core.rerun_limits import LARGEST, SELDOM
from onebot_bringup.viewer.core.settings import Color, color, one_of, setting, topic
from onebot_bringup.viewer.displays.odometry import ODOMETRY
from onebot_description.errors import OneBotError, shortened
from onebot_description.parameters.reader import REQUIRED

S = TypeVar("S")
C = TypeVar("C", bound="SpeedsSettings | CurvesSettings")

_SCALARS = ColumnMaker(rr.Scalars.columns(scalars=[0.0]))


class Curves:
    """Lines of a plot on one entity, with a number for each line at each time."""

    def __init__(
        self, recording: rr.RecordingStream, entity: str, legend: Callable[[], rr.SeriesLines]
    ) -> None:
        """Plot nothing yet; ``legend`` returns the style of the lines, once there are numbers."""
        self.entity = entity
        self._recording, self._legend = recording, legend
        self._rows: list[tuple[int, Sequence[float] | NDArray[Any]]] = []
        self._styled = False

    def add(self, stamp_ns: int, numbers: Sequence[float] | NDArray[Any]) -> None:
        self._rows.append((stamp_ns, numbers))

    def flush(self) -> None:
        """Log what was added, in one call."""
        if not self._rows:
            return
        if not self._styled:
            self._styled = True
            self._recording.log(self.entity, self._legend(), static=True)
        stamps_ns, rows = zip(*self._rows, strict=True)
        self._rows = []
        numbers = np.array(rows, np.float64)
        # Rerun does not draw a plot that contains infinity.
        numbers[~(np.abs(numbers) <= LARGEST)] = math.nan
        columns = [_SCALARS.column(numbers, each=numbers.shape[1])]
        send(self._recording, self.entity, stamps_ns, columns)


class CurveDrawing(Drawing[S]):
    """Curves of the numbers of one topic."""

    has_header = False

    def _use(self, settings: S) -> None:
        super()._use(settings)
        recording = self.stage.recording
        self.curves = [Curves(recording, entity, self.legend) for entity in self.entities()]

    def entities(self) -> Sequence[str]:
        """Return the entity of each curve."""
        return [self.entity]

    @abstractmethod
    def values(self, message: Any) -> Sequence[float]:
        """Return a number for each curve.

        Raises:
            ValueError: the message does not have these numbers.
        """

    def legend(self) -> rr.SeriesLines:
        """Return the names, colors and style of the curves."""
        return rr.SeriesLines(names=[self.name], colors=[self.color], widths=[2.0])

    def add(self, stamp_ns: int, message: Any) -> None:
        for curve, value in zip(self.curves, self.values(message), strict=True):
            curve.add(stamp_ns, [value])

    def flush(self) -> None:
        for curve in self.curves:
            curve.flush()


class _CurvesDisplay(NamedDisplay[C]):
    """Plots the lines that a view names."""

    only_plots = True
    period_ns = SELDOM

    def wanted(self, settings: C) -> Mapping[str, tuple[Sequence[WantedTopic], Any]]:
        return super().wanted(settings.lines)


# --- speeds ---------------------------------------------------------------------------------------

SPEEDS = {"linear": "Speed (m/s)", "angular": "Turn rate (rad/s)"}  # plots, by entity
_DECIMALS = 4  # digits after the point, in m/s and rad/s
_AUTO = "auto"
_TYPES: Mapping[str, MessageType[Any]] = {
    "Twist": known_type("geometry_msgs/msg/Twist"),
    "TwistStamped": known_type("geometry_msgs/msg/TwistStamped"),
    "Odometry": ODOMETRY,
}


@dataclass(frozen=True)
class SpeedSettings:
    """A curve in each of the two plots of speeds."""

    topic: str = setting(REQUIRED, "a topic of velocities", topic)
    type: str = setting(_AUTO, f"{', '.join(_TYPES)}, or auto", one_of(_AUTO, *_TYPES))
    color: Color | None = setting(None, "sRGB bytes; empty: automatic", color)


@dataclass(frozen=True)
class SpeedsSettings:
    """The curves of linear.x and angular.z."""

    window: float = setting(20.0, "seconds shown; 0: all")
    lines: Mapping[str, SpeedSettings] = setting({}, "the curves, by names of your own")


class SpeedDrawing(CurveDrawing[SpeedSettings]):
    """The curves of linear and angular speed of one topic."""

    _held = False  # a value holds until the next one, as a command does

    def entities(self) -> Sequence[str]:
        name = entity_path(self.name)
        root = self.entity.removesuffix(f"/{name}")
        return [f"{root}/{plot}/{name}" for plot in SPEEDS]

    def add(self, stamp_ns: int, message: Any) -> None:
        self._held = not hasattr(type(message), "pose")
        super().add(stamp_ns, message)

    def values(self, message: Any) -> Sequence[float]:
        while hasattr(type(message), "twist"):  # twists of an Odometry are nested
            message = message.twist
        # A plot zooms in on any difference, so round, to keep a steady speed a flat line.
        return [round(float(n), _DECIMALS) for n in (message.linear.x, message.angular.z)]

    def legend(self) -> rr.SeriesLines:
        return rr.SeriesLines(
            names=[self.name],
            colors=[self.color],
            # The measured speed would hide a command that it follows, so commands are a wider band.
            widths=[6.0] if self._held else [2.0],
            interpolation_mode="StepAfter" if self._held else "Linear",
            # With averaging, a step gets a stair in its middle where two samples share a pixel.
            aggregation_policy="Off" if self._held else "Average",
        )


class SpeedsDisplay(_CurvesDisplay[SpeedsSettings]):
    """Plots speeds commanded and measured."""

    key, noun = "speeds", "speed"
    order = 5
    draws = SpeedDrawing

    def subscriptions(self, line: SpeedSettings) -> Sequence[WantedTopic]:
        types = (_TYPES[line.type],) if line.type in _TYPES else tuple(_TYPES.values())
        return [WantedTopic(line.topic, types)]

    def layout(self) -> Sequence[LayoutPart]:
        """Return both plots, if there is a line to plot."""
        root = self.entity(self.key)
        drawings: Any = self.items.values()
        lines = zip(*(drawing.entities() for drawing in drawings), strict=True)
        plots = (
            Plot(below(root, plot), title, self.settings.window, entities)
            for (plot, title), entities in zip(SPEEDS.items(), lines, strict=False)
        )
        return [LayoutPart(views=tuple(plots))]


# --- any fields -----------------------------------------------------------------------------------

_STEP = re.compile(r"\.?([A-Za-z]\w*)|\[(\d+)\]", re.ASCII)
_FIELD = re.compile(r"[A-Za-z]\w*(\[\d+\]|\.[A-Za-z]\w*)*", re.ASCII)


@dataclass(frozen=True)
class CurveSettings:
    """A curve."""

    topic: str = setting(REQUIRED, "a topic of any type", topic)
    field: str = setting(
        REQUIRED,
        "a number of its messages",
        {"pattern": _FIELD, "write": "a field, such as pose.position.x or covariance[0]"},
    )
    plot: str = setting("Curves", "the plot that it is in, by a name of your own")
    color: Color | None = setting(None, "sRGB bytes; empty: automatic", color)


@dataclass(frozen=True)
class CurvesSettings:
    """Numbers of messages, in plots."""

    window: float = setting(20.0, "seconds shown; 0: all")
    lines: Mapping[str, CurveSettings] = setting({}, "the curves, by names of your own")


class FieldDrawing(CurveDrawing[CurveSettings]):
    """The curve of one field of one topic, named by a path such as ``pose.position.x``."""

    def _use(self, settings: CurveSettings) -> None:
        super()._use(settings)
        steps = (match.groups() for match in _STEP.finditer(settings.field))
        self._steps = [name or int(index) for name, index in steps]

    def values(self, message: Any) -> Sequence[float]:
        value = message
        try:
            for step in self._steps:
                value = value[step]
            return [float(value)]
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            field, where = self.settings.field, shortened(repr(value))
            raise ValueError(f"{field} is not a number in {where}: {error.args[0]}") from error


class CurvesDisplay(_CurvesDisplay[CurvesSettings]):
    """Plots numbers of messages."""

    key, noun = "curves", "curve"
    order = 6
    draws = FieldDrawing

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._unreadable: dict[str, str] = {}

    def apply(self, settings: CurvesSettings) -> None:
        self._unreadable = {}
        super().apply(settings)

    def subscriptions(self, line: CurveSettings) -> Sequence[WantedTopic]:
        name = self.offered.get(self.full_name(line.topic))
        if name is None:
            return ()
        try:
            return [WantedTopic(line.topic, (self.stage.message_type(name),), optional=True)]
        except (OneBotError, ValueError) as error:
            self._unreadable[line.topic] = f"{line.topic} cannot be plotted: {error}"
            return ()

    def layout(self) -> Sequence[LayoutPart]:
        plots: dict[str, list[str]] = {}
        for drawing in self.items.values():
            plots.setdefault(drawing.settings.plot, []).append(drawing.entity)
        root = self.entity(self.key)
        views = (
            Plot(root, title, self.settings.window, tuple(lines)) for title, lines in plots.items()
        )
        return [LayoutPart(views=tuple(views))]

    def warnings(self) -> list[str]:
        return [*self._unreadable.values(), *super().warnings()]
