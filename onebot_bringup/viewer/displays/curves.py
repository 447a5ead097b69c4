"""Any number of any message, as a curve: ``{topic: imu, field: linear_acceleration.x}``.

A field is written as in Python: names joined by dots, ``[0]`` for an element of an array. The type
of a topic is that with which it is published.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from onebot_bringup.viewer.columns import ColumnMaker, time_column
from onebot_bringup.viewer.displays.display import (
    LARGEST,
    SELDOM,
    Context,
    ItemsDisplay,
    LayoutPart,
    MessageType,
    Plot,
    WantedTopic,
)
from onebot_bringup.viewer.settings import Color, color, setting, topic
from onebot_description.errors import OneBotError, listing
from onebot_description.parameters.reader import REQUIRED
from onebot_description.wire.schema import Message, Table

CURVES_ENTITY = "curves"
_STEP = re.compile(r"\.?([A-Za-z]\w*)|\[(\d+)\]", re.ASCII)
_FIELD = re.compile(r"[A-Za-z]\w*(\[\d+\]|\.[A-Za-z]\w*)*", re.ASCII)
_MOST_LISTED = 8  # fields
_SCALARS = ColumnMaker(rr.Scalars.columns(scalars=[0.0]))


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
        found = message
        for step in self._steps:
            found = (
                self._element(found, step) if isinstance(step, int) else self._named(found, step)
            )
        if isinstance(found, (bool, int, float, np.number, np.bool_)):
            return float(found)
        if isinstance(found, Message):
            names = [name for name in dir(found) if name[0] != "_" and not hasattr(Message, name)]
            raise ValueError(
                f"{self.path} is no number but a message of {listing(names, _MOST_LISTED)}"
            )
        what = "text" if isinstance(found, str) else f"an array: write {self.path}[0]"
        raise ValueError(f"{self.path} is {what}")

    def _named(self, found: Any, name: str) -> Any:
        if not isinstance(found, Message):
            raise ValueError(f'{self.path}: there is no "{name}" in what is no message')
        try:
            return found[name]
        except LookupError as error:
            raise ValueError(str(error.args[0])) from error

    def _element(self, found: Any, index: int) -> Any:
        if isinstance(found, Message) or not isinstance(found, (np.ndarray, Table, list)):
            raise ValueError(f"{self.path}: [{index}] is of what is no array")
        if index >= len(found):
            raise ValueError(f"{self.path}: there are {len(found)} elements, counted from 0")
        return found[index]


class CurvesDisplay(ItemsDisplay[CurvesSettings, "Curve"]):
    """Plots numbers of messages."""

    key = "curves"
    Settings = CurvesSettings
    noun = "curve"
    plots = True
    optional = True
    period_ns = SELDOM

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._published: Mapping[str, str] = {}
        self._unreadable: dict[str, str] = {}

    def offer(self, topics: Mapping[str, str]) -> bool:
        """Note the types of the topics."""
        before, self._published = self._published, topics
        names = [self.context.resolve(topic.name) for topic in self._topics.values()]
        return any(before.get(name) != topics.get(name) for name in names)

    def apply(self, settings: CurvesSettings) -> None:
        """Plot these lines."""
        self._window = settings.window
        self._unreadable = {}
        super().apply(settings)

    def wanted(self, settings: CurvesSettings) -> Mapping[str, tuple[str, CurveSettings]]:
        """Return the lines."""
        return {name: (line.topic, line) for name, line in settings.lines.items()}

    def types_of(self, settings: CurveSettings) -> tuple[MessageType[Any], ...]:
        """Return the type that the topic has; none before it is published."""
        name = self._published.get(self.context.resolve(settings.topic))
        if name is None:
            return ()
        try:
            return (self.context.message_type(name),)
        except (OneBotError, ValueError) as error:
            self._unreadable[settings.topic] = f"{settings.topic} cannot be plotted: {error}"
            return ()

    def topics(self) -> Sequence[WantedTopic]:
        """Return the topics whose types are known."""
        return [each for each in self._topics.values() if each.types]

    def make(self, name: str, settings: CurveSettings, color: Color) -> "Curve":
        """Return a line."""
        return Curve(self.context, name, settings, color)

    def layout(self) -> LayoutPart:
        """Return the plots."""
        plots: dict[str, list[str]] = {}
        for item in self.items.values():
            plots.setdefault(item.plot, []).append(item.entity)
        return LayoutPart(
            views=tuple(
                Plot(CURVES_ENTITY, name, self._window, tuple(lines))
                for name, lines in plots.items()
            )
        )

    def warnings(self) -> list[str]:
        """Return which fields there are not."""
        wrong = [
            f'curve "{name}": {item.problem}' for name, item in self.items.items() if item.problem
        ]
        return [*self._unreadable.values(), *wrong]


class Curve:
    """Logs one field of one topic."""

    def __init__(self, context: Context, name: str, settings: CurveSettings, color: Color) -> None:
        """Log nothing yet.

        Args:
            context: where to log.
            name: of the curve.
            settings: what it is of.
            color: where the settings have none.
        """
        self._context, self.plot, self.entity = context, settings.plot, curve_entity(name)
        self._field = FieldPath(settings.field)
        self._rows: list[tuple[int, float]] = []
        self._legend: rr.SeriesLines | None = rr.SeriesLines(
            names=[name], colors=[settings.color or color], widths=[2.0]
        )
        self.frame = ""  # a curve is in none
        self.problem = ""

    def add(self, stamp_ns: int, message: Any) -> None:
        """Add a message; it is logged at the next ``flush``."""
        try:
            value = self._field.value(message)
        except ValueError as error:
            self.problem = str(error)
            return
        # Not infinity: a plot with it is not drawn at all.
        self._rows.append((stamp_ns, value if abs(value) <= LARGEST else math.nan))

    def flush(self) -> None:
        """Log what has come, in one call."""
        if not self._rows:
            return
        if self._legend is not None:
            self._context.recording.log(self.entity, self._legend, static=True)
            self._legend = None
        stamps, values = zip(*self._rows, strict=True)
        self._rows = []
        self._context.recording.send_columns(
            self.entity,
            indexes=[time_column(np.array(stamps, np.int64))],
            columns=[_SCALARS.column(np.array(values))],
        )


def curve_entity(name: str) -> str:
    """Return the entity of the curve ``name``."""
    return rr.new_entity_path([CURVES_ENTITY, name]).lstrip("/")
