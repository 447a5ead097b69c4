"""Numbers of messages as curves: speeds commanded and measured, and any field of any message.

Speeds are two plots, of linear.x and of angular.z. Of any other message a field is written as in
Python, names joined by dots, ``[0]`` for an element of an array:
``{topic: imu, field: linear_acceleration.x}``. The type of its topic is that which is published.
"""

import math
import re
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.columns import ColumnMaker, time_column
from onebot_bringup.viewer.displays.display import LARGEST, SELDOM, LayoutPart, Plot
from onebot_bringup.viewer.displays.drawing import Archetypes, Drawing, DrawingsDisplay
from onebot_bringup.viewer.displays.odometry import ODOMETRY
from onebot_bringup.viewer.inbox import MessageType, WantedTopic, one_by_one
from onebot_bringup.viewer.settings import Color, color, one_of, setting, topic
from onebot_description.errors import OneBotError, listing
from onebot_description.parameters.reader import REQUIRED
from onebot_description.wire.messages import (
    OdometrySample,
    TwistSample,
    twist_sample,
    twist_stamped_sample,
)
from onebot_description.wire.schema import Message, Table

S = TypeVar("S", bound="SpeedSettings | CurveSettings")

_SCALARS = ColumnMaker(rr.Scalars.columns(scalars=[0.0]))


def send_curves(
    recording: rr.RecordingStream, entity: str, stamps_ns: Sequence[int], values: NDArray[Any]
) -> None:
    """Log values (N,) or (N, k), a row at each time."""
    width = 1 if values.ndim == 1 else values.shape[1]
    recording.send_columns(
        entity,
        indexes=[time_column(np.array(stamps_ns, np.int64))],
        columns=[_SCALARS.column(values, each=width)],
    )


class CurveDrawing(Drawing[S]):
    """Curves of the numbers of one topic, each on an entity of its own."""

    stamped = False

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._rows: list[tuple[int, Sequence[float]]] = []

    @abstractmethod
    def values(self, message: Any) -> Sequence[float]:
        """Return a number for each curve.

        Raises:
            ValueError: the message has none.
        """

    @abstractmethod
    def legends(self) -> Mapping[str, rr.SeriesLines]:
        """Return the curves' entities, and how they look."""

    def add(self, stamp_ns: int, message: Any) -> None:
        try:
            values = self.values(message)
        except ValueError as error:
            self.problems[""] = str(error)
            return
        # A plot is not drawn at all around infinity.
        self._rows.append(
            (stamp_ns, [value if abs(value) <= LARGEST else math.nan for value in values])
        )

    def flush(self) -> None:
        if not self._rows:
            return
        legends = self.legends()
        if not self._styled:
            self._styled = True
            for entity, legend in legends.items():
                self.stage.recording.log(entity, legend, static=True)
        stamps, values = zip(*self._rows, strict=True)
        self._rows = []
        for entity, column in zip(legends, np.array(values).T, strict=True):
            send_curves(self.stage.recording, entity, stamps, column)

    def draw(self, message: Any) -> Archetypes:
        """Return nothing: ``flush`` logs many numbers at once."""
        return ()

    def erase(self) -> None:
        """Leave what is drawn: the layout has the plots of now."""

    def replace(self, before: Drawing[S]) -> None:
        assert isinstance(before, CurveDrawing)
        self._rows = before._rows


class _CurvesDisplay(DrawingsDisplay[Any]):
    """Plots the lines that a view names."""

    plots = True
    period_ns = SELDOM

    def apply(self, settings: Any) -> None:
        self._window = settings.window
        super().apply(settings)

    def wanted(self, settings: Any) -> Mapping[str, tuple[Sequence[WantedTopic], Any]]:
        return {name: (self.subscriptions(line), line) for name, line in settings.lines.items()}

    @abstractmethod
    def subscriptions(self, line: Any) -> Sequence[WantedTopic]:
        """Return the topic of a line, if its type is known."""

    def _path(self, *names: str) -> str:
        return self.entity(rr.new_entity_path([*names]).lstrip("/"))


# --- speeds ---------------------------------------------------------------------------------------

SPEEDS = {"linear": "Speed (m/s)", "angular": "Turn rate (rad/s)"}  # plots, by entity
_DECIMALS = 4  # digits of m/s and rad/s
# Seconds without a message over which a curve is not drawn on: nothing was published there.
GAP = 1.5
_AUTO = "auto"
_TYPES: Mapping[str, MessageType[Any]] = {
    "Twist": MessageType(
        "geometry_msgs/msg/Twist", one_by_one(twist_sample), lambda sample: sample.stamp_ns
    ),
    "TwistStamped": MessageType(
        "geometry_msgs/msg/TwistStamped",
        one_by_one(twist_stamped_sample),
        lambda sample: sample.stamp_ns,
    ),
    "Odometry": ODOMETRY,
}


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


class SpeedDrawing(CurveDrawing[SpeedSettings]):
    """The linear and the angular speed of one topic."""

    name: str  # the legend's
    entities: Sequence[str]
    _held = False  # a value holds until the next one, as a command does
    _last_ns: int | None = None

    def add(self, stamp_ns: int, message: TwistSample | OdometrySample) -> None:
        self._held = isinstance(message, TwistSample)
        last = self._last_ns
        if last is not None and stamp_ns - last > GAP * 1e9:
            self._rows.append((last + 1, (math.nan, math.nan)))
        self._last_ns = stamp_ns
        super().add(stamp_ns, message)

    def values(self, message: TwistSample | OdometrySample) -> Sequence[float]:
        # A plot zooms in on whatever there is: without the last digits a steady speed is flat.
        return [round(float(n), _DECIMALS) for n in (message.linear[0], message.angular[2])]

    def legends(self) -> Mapping[str, rr.SeriesLines]:
        legend = rr.SeriesLines(
            names=[self.name],
            colors=[self.color],
            # A robot that follows its command hides it: the command lies beneath, as a band.
            widths=[6.0] if self._held else [2.0],
            interpolation_mode="StepAfter" if self._held else "Linear",
            # Else a step on which two samples share a pixel gets a stair in the middle.
            aggregation_policy="Off" if self._held else "Average",
        )
        return dict.fromkeys(self.entities, legend)


class SpeedsDisplay(_CurvesDisplay):
    """Plots speeds commanded and measured."""

    key, Settings, noun = "speeds", SpeedsSettings, "speed"

    def subscriptions(self, line: SpeedSettings) -> Sequence[WantedTopic]:
        named = _TYPES.get(line.type)
        return [WantedTopic(line.topic, tuple(_TYPES.values()) if named is None else (named,))]

    def make(self, name: str, settings: SpeedSettings, color: Color) -> SpeedDrawing:
        drawing = SpeedDrawing(self.stage, self._path(self.key), settings, color)
        drawing.name = name
        drawing.entities = [self._path(self.key, plot, name) for plot in SPEEDS]
        return drawing

    def layout(self) -> LayoutPart:
        """Return both plots, if there is a line."""
        plots = SPEEDS.items() if self.items else ()
        return LayoutPart(views=tuple(self._plot(entity, name) for entity, name in plots))

    def _plot(self, entity: str, name: str) -> Plot:
        lines = tuple(self._path(self.key, entity, line) for line in self.items)
        return Plot(self._path(self.key, entity), name, self._window, lines)


# --- any fields -----------------------------------------------------------------------------------

_STEP = re.compile(r"\.?([A-Za-z]\w*)|\[(\d+)\]", re.ASCII)
_FIELD = re.compile(r"[A-Za-z]\w*(\[\d+\]|\.[A-Za-z]\w*)*", re.ASCII)
_MOST_LISTED = 8  # fields


@dataclass(frozen=True)
class CurveSettings:
    """A curve."""

    topic: str = setting(REQUIRED, "of any type", topic)
    field: str = setting(
        REQUIRED,
        "a number of its messages",
        {"pattern": _FIELD, "write": "a field, such as pose.position.x or covariance[0]"},
    )
    plot: str = setting("Curves", "the plot that it is in, by a name of your own")
    color: Color | None = setting(None, "sRGB bytes; by default one of ours", color)


@dataclass(frozen=True)
class CurvesSettings:
    """Numbers of messages, in plots."""

    window: float = setting(20.0, "how many seconds are shown; 0 for all")
    lines: Mapping[str, CurveSettings] = setting({}, "the curves, by names of your own")


class FieldPath:
    """A number in messages of some type."""

    def __init__(self, path: str) -> None:
        self.path = path
        self._steps = [
            name or int(index) for name, index in (match.groups() for match in _STEP.finditer(path))
        ]

    def value(self, message: Any) -> float:
        """Return it.

        Raises:
            ValueError: the message has no such number; says what it has.
        """
        value = message
        for step in self._steps:
            value = (
                self._element(value, step) if isinstance(step, int) else self._named(value, step)
            )
        if isinstance(value, (bool, int, float, np.number, np.bool_)):
            return float(value)
        if isinstance(value, Message):
            names = [name for name in dir(value) if name[0] != "_" and not hasattr(Message, name)]
            raise ValueError(
                f"{self.path} is no number but a message of {listing(names, _MOST_LISTED)}"
            )
        what = "text" if isinstance(value, str) else f"an array: write {self.path}[0]"
        raise ValueError(f"{self.path} is {what}")

    def _named(self, value: Any, name: str) -> Any:
        if not isinstance(value, Message):
            raise ValueError(f'{self.path}: there is no "{name}" in what is no message')
        try:
            return value[name]
        except LookupError as error:
            raise ValueError(str(error.args[0])) from error

    def _element(self, value: Any, index: int) -> Any:
        if isinstance(value, Message) or not isinstance(value, (np.ndarray, Table, list)):
            raise ValueError(f"{self.path}: [{index}] is of what is no array")
        if index >= len(value):
            raise ValueError(f"{self.path}: there are {len(value)} elements, counted from 0")
        return value[index]


class FieldDrawing(CurveDrawing[CurveSettings]):
    """One field of one topic."""

    name: str  # the legend's

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._field = FieldPath(self.settings.field)

    def values(self, message: Any) -> Sequence[float]:
        return [self._field.value(message)]

    def legends(self) -> Mapping[str, rr.SeriesLines]:
        return {self.entity: rr.SeriesLines(names=[self.name], colors=[self.color], widths=[2.0])}


class CurvesDisplay(_CurvesDisplay):
    """Plots numbers of messages."""

    key, Settings, noun = "curves", CurvesSettings, "curve"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._published: Mapping[str, str] = {}
        self._named: Iterable[str] = ()  # full names of the topics of all lines
        self._unreadable: dict[str, str] = {}

    def offer(self, topics: Mapping[str, str]) -> bool:
        """Note the types of the topics."""
        previous, self._published = self._published, topics
        return any(previous.get(name) != topics.get(name) for name in self._named)

    def apply(self, settings: CurvesSettings) -> None:
        self._unreadable = {}
        self._named = {self.full_name(line.topic) for line in settings.lines.values()}
        super().apply(settings)

    def subscriptions(self, line: CurveSettings) -> Sequence[WantedTopic]:
        name = self._published.get(self.full_name(line.topic))
        if name is None:
            return ()
        try:
            return [WantedTopic(line.topic, (self.stage.message_type(name),), optional=True)]
        except (OneBotError, ValueError) as error:
            self._unreadable[line.topic] = f"{line.topic} cannot be plotted: {error}"
            return ()

    def make(self, name: str, settings: CurveSettings, color: Color) -> FieldDrawing:
        drawing = FieldDrawing(self.stage, self._path(self.key, name), settings, color)
        drawing.name = name
        return drawing

    def layout(self) -> LayoutPart:
        plots: dict[str, list[str]] = {}
        for drawing in self.items.values():
            plots.setdefault(drawing.settings.plot, []).append(drawing.entity)
        return LayoutPart(
            views=tuple(
                Plot(self._path(self.key), name, self._window, tuple(lines))
                for name, lines in plots.items()
            )
        )

    def warnings(self) -> list[str]:
        return [*self._unreadable.values(), *super().warnings()]
