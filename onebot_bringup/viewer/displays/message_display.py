"""Displays of whole message types, as RViz has them: every topic of the type is drawn.

A display of this kind names its types and how one topic is drawn::

    @dataclass(frozen=True)
    class PathLook(Look):
        line_width: float = setting(0.02, "of the line, metres")

    class PathDisplay(MessageDisplay["PathLook"]):
        key = "path"
        Look = PathLook
        message_types = ("nav_msgs/msg/Path",)
        draws = PathDrawing

    class PathDrawing(Drawing[PathLook]):
        def draw(self, message): ...  # -> Rerun's archetypes

Messages are decoded by their type's definition (``onebot_description.wire.schema``), so that a
type need not be installed. In a view file the look is under the key, for all topics, and under
``topics`` of that for one of them: ``path: {height: 0.1, topics: {/plan: {line_width: 0.1}}}``.
"""

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, make_dataclass, replace
from itertools import groupby
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from onebot_bringup.viewer.columns import ReadyColumn
from onebot_bringup.viewer.displays.display import (
    REPEAT_AFTER,
    Context,
    ItemsDisplay,
    LayoutPart,
    WantedTopic,
    below,
)
from onebot_bringup.viewer.settings import Color, one_of, setting

AUTO = "auto"
_RELIABILITIES = (AUTO, "reliable", "best_effort")


@dataclass(frozen=True)
class Look:
    """How a topic is drawn."""

    visible: bool = setting(True, "draw it")


@dataclass(frozen=True)
class TopicQos:
    """How one topic is subscribed, where that is not to follow from its publishers."""

    reliability: str = setting(AUTO, "as the publishers are, or as named", one_of(*_RELIABILITIES))
    depth: int = setting(0, "messages that wait in DDS; 0 for the usual number")


L = TypeVar("L", bound=Look)


class MessageDisplay(ItemsDisplay[Any, "Drawing[Any]"], Generic[L]):
    """Draws the topics of some types, each by a ``Drawing`` of its own."""

    Look: ClassVar[type[Look]]
    draws: ClassVar[type["Drawing[Any]"]]  # a topic
    message_types: ClassVar[tuple[str, ...]]  # as ROS has them, such as "nav_msgs/msg/Path"
    of_all = True  # topics are by their full names, whichever robot's they are
    optional = True
    heavy: ClassVar[bool] = False  # megabytes a second: only some topics are shown by themselves
    live: ClassVar[bool] = True  # as of ``MessageType``

    def __init_subclass__(cls, **options: Any) -> None:
        """Make the settings: the look of all topics, and that of one."""
        super().__init_subclass__(**options)
        if "Look" in cls.__dict__:
            look = cls.Look
            one = make_dataclass(f"{look.__name__}OfTopic", [], bases=(look, TopicQos), frozen=True)
            topics: Any = ("topics", Mapping[str, one], field(default_factory=dict))  # type: ignore[valid-type]
            cls.Settings = make_dataclass(
                look.__name__.replace("Look", "Settings"), [topics], bases=(look,), frozen=True
            )
            for made in (one, cls.Settings):
                made.__doc__, made.__module__ = look.__doc__, cls.__module__
            cls.noun = cls.key.replace("_", " ")

    def __init__(self, *contexts: Context) -> None:
        super().__init__(contexts[0])
        self._offered: Mapping[str, str] = {}

    @classmethod
    def is_duplicate(cls, topic: str, topics: Mapping[str, str]) -> bool:
        """Whether one of ``topics`` has the same content, so that one is not shown by itself."""
        return False

    def offer(self, topics: Mapping[str, str]) -> bool:
        """Draw these topics, and no others, from the next ``apply`` on.

        Args:
            topics: the type of each by its full name.

        Returns:
            Whether they are others than before.
        """
        before, self._offered = self._offered, topics
        return topics != before

    def wanted(self, settings: Any) -> Mapping[str, tuple[str, Any]]:
        """Return the look of each topic that is drawn."""
        looks = {self.context.resolve(name): look for name, look in settings.topics.items()}
        return {topic: (topic, looks.get(topic, settings)) for topic in self._offered}

    def make(self, name: str, settings: Any, color: Color) -> "Drawing[Any]":
        """Return the drawing of a topic."""
        return self.draws(self.context, topic_entity(self.key, name), settings, color)

    def apply(self, settings: Any) -> None:
        """Draw the topics anew whose look is another; erase those that are no longer drawn."""
        before = self.items
        super().apply(settings)
        for name, drawing in before.items():
            new = self.items.get(name)
            if new is not drawing:
                drawing.erase()
            if new is not None and new is not drawing:
                new.replace(drawing)

    def subscription(self, topic: str, settings: Any) -> WantedTopic:
        """Return how a topic is subscribed: by its type's definition, reliable if it is."""
        qos = settings if isinstance(settings, TopicQos) else TopicQos()
        return WantedTopic(
            topic,
            (self.context.message_type(self._offered[topic], live=self.live),),
            reliable=qos.reliability == "reliable",
            optional=True,
            as_published=qos.reliability == AUTO,
            depth=qos.depth or (_DEPTH_HEAVY if self.heavy else _DEPTH),
        )

    def flush(self) -> None:
        """Log what has come; of what waits for a transform the last messages are kept."""
        for drawing in self.items.values():
            drawing.flush()
            drawing.keep(_DEPTH_HEAVY if self.heavy else _DEPTH)

    def layout(self) -> LayoutPart:
        """Return what its drawings add: what is in the robots' view needs nothing."""
        if not self.items:  # as of most displays; it is called with every tick
            return _NO_PART
        parts = [drawing.layout() for drawing in self.items.values()]
        return LayoutPart(
            views=tuple(view for part in parts for view in part.views),
            hidden=tuple(entity for part in parts for entity in part.hidden),
            shown=tuple(entity for part in parts for entity in part.shown),
            windows=tuple(window for part in parts for window in part.windows),
            wide=tuple(view for part in parts for view in part.wide),
        )

    def warnings(self) -> list[str]:
        """Return which topics wait for a transform, and what cannot be drawn."""
        if not self.items:
            return []
        bad = [
            f'{self.noun} "{name}": {drawing.problem}'
            for name, drawing in self.items.items()
            if drawing.problem
        ]
        return [*super().warnings(), *bad]


_NO_PART = LayoutPart()


@dataclass(frozen=True)
class TopicView(ABC):
    """A view of one topic, under its name."""

    entity: str
    topic: str

    @abstractmethod
    def view(self) -> rrb.View:
        """Return the view for Rerun."""

    def below(self, root: str) -> "TopicView":
        """Return the same view of the entity below ``root``."""
        return replace(self, entity=below(root, self.entity))


_MOST_FRAMES = 99  # with entities of their own
_DEPTH, _DEPTH_HEAVY = 100, 5  # messages that wait in DDS, or for a transform
_MOST_AWAITED_NS = 1_000_000_000  # from one transform to the next, if the next is waited for


class Drawing(Generic[L]):
    """Draws the messages of one topic, each in place of the one before.

    An entity is in one frame for all time: messages in another are drawn at one of its own, below.
    """

    stamped: ClassVar[bool] = True  # its messages have a header, whose frame it is in
    placed: ClassVar[bool] = False  # drawn where the frame was at the time of the stamp
    # Logged again from time to time, where messages come seldom: see REPEAT_AFTER.
    repeated: ClassVar[bool] = False
    waiting: ClassVar[int | None] = None  # the most messages drawn by a flush; None: all

    def __init__(self, context: Context, entity: str, look: L, color: Color) -> None:
        """Draw nothing yet.

        Args:
            context: where to log, and what is known of the frames.
            entity: to log to.
            look: how to draw.
            color: one of ours, where the look has none.
        """
        self.context, self.entity, self.look, self.color = context, entity, look, color
        self.frame = ""  # of the newest message, or of the one that is drawn; "" if in none
        self.stamp_ns = 0  # of the message that is drawn
        self.problem = ""  # of the first message that could not be drawn
        self._pending: deque[tuple[int, Any]] = deque(maxlen=self.waiting)
        self._last: tuple[int, Any] | None = None  # drawn
        self._drawn_at = 0.0
        self._in_frame = ""  # that the entity drawn at is in
        self._frame_before = ""  # of the message that was logged, or waited, last
        self._entities: dict[str, str] = {}  # by frame

    @abstractmethod
    def draw(self, message: Any) -> Sequence[rr.AsComponents | ReadyColumn]:
        """Return what replaces the message before at the entity; nothing to keep that.

        Raises:
            ValueError: the message cannot be drawn; says why, for a warning.
        """

    @property
    def topic(self) -> str:
        """The full name of its topic."""
        return "/" + self.entity.partition("/")[2]

    def drawn_in(self) -> str:
        """Return the frame that the entity is in."""
        return self.frame

    def pose(self) -> NDArray[np.float64] | None:
        """Return the (4, 4) pose of its frame in the fixed one, when the message was stamped.

        None while no transforms connect them.
        """
        return self.context.frames.pose(self.frame, self.context.fixed_frame, self.stamp_ns)

    def style(self) -> Sequence[rr.AsComponents]:
        """Return what is the same for all messages; logged once."""
        return ()

    def layout(self) -> LayoutPart:
        """Return its part of the layout."""
        return LayoutPart()

    def add(self, stamp_ns: int, message: Any) -> None:
        """Add a message, to be logged by ``flush``."""
        if self.stamped:
            self.frame = _frame(message) or self.frame
            if not self.frame:
                self.problem = self.problem or "its header has no frame_id"
                return
        self._pending.append((stamp_ns, message))

    def flush(self) -> None:
        """Log what can be shown now; where that is seldom, from time to time the last one again.

        The others wait for a transform until a newer message is shown.
        """
        if not self._pending:
            again = self.repeated and time.monotonic() - self._drawn_at > REPEAT_AFTER
            if not again or self._last is None:
                return
            self._pending.append(self._last)
        pending, waits_in = [*self._pending], ""
        self._pending.clear()
        for frame, run in groupby(pending, self._frame_of):
            messages = [*run]
            due = self._due(frame, messages)
            if due:
                if self._pending:
                    self.problem = self.problem or f'messages in "{waits_in}" are not shown'
                    self._pending.clear()
                self._draw_in(frame, messages[:due])
            if messages[due:]:
                self._pending.extend(messages[due:])
                self.frame = waits_in = frame

    def _frame_of(self, pending: tuple[int, Any]) -> str:
        """Return the frame of a message: without one, as of an empty path, that of the last."""
        if self.stamped:
            self._frame_before = _frame(pending[1]) or self._frame_before
        return self._frame_before

    def _due(self, frame: str, messages: Sequence[tuple[int, Any]]) -> int:
        """Return how many of ``messages`` can be shown: transforms lead from their frame.

        Those newer than the last transform wait for the next one a moment, as in RViz.
        """
        if frame and not self.context.connected(frame):
            return 0
        due, now_ns = len(messages), self.context.now_ns()
        known_ns = self.context.frames.known_until(frame) if self.placed else 0
        while due and 0 < messages[due - 1][0] - known_ns < _MOST_AWAITED_NS:
            if not 0 <= now_ns - messages[due - 1][0] < self.context.transform_timeout_ns:
                break
            due -= 1
        return due

    def _draw_in(self, frame: str, messages: Sequence[tuple[int, Any]]) -> None:
        """Log messages that are in one frame."""
        self._drawn_at = time.monotonic()
        self.frame = frame or self.frame
        drawn_in = self.drawn_in()
        if self._in_frame != drawn_in or not self._entities:
            self._move(drawn_in, messages[0][0])
        rows = []
        for stamp_ns, message in messages:
            self.stamp_ns = stamp_ns
            try:
                rows.append((stamp_ns, self.draw(message)))
            except ValueError as error:
                self.problem = self.problem or str(error)
        self.context.log_rows(self._entities[drawn_in], [row for row in rows if row[1]])
        self._last = messages[-1]

    def keep(self, most: int) -> None:
        """Drop the oldest messages that were not drawn, but for so many."""
        while len(self._pending) > most:
            self._pending.popleft()

    def _move(self, frame: str, stamp_ns: int) -> None:
        """Draw in a frame from a time on, in place of what is drawn in another."""
        if self._entities:
            self.log(stamp_ns, rr.Clear(recursive=True))
        if frame not in self._entities:
            if len(self._entities) > _MOST_FRAMES:
                self._entities.popitem()
            number = len(self._entities)
            self._entities[frame] = below(self.entity, f"_{number}") if number else self.entity
        self._in_frame = frame
        coordinates = [rr.CoordinateFrame(frame)] if frame else []
        for component in (*coordinates, *self.style()):
            self.context.recording.log(self._entities[frame], component, static=True)

    def log(
        self, stamp_ns: int, *archetypes: rr.AsComponents | ReadyColumn, below_it: str = ""
    ) -> None:
        """Log at a time, to the entity or to one below it."""
        entity = self._entities.get(self._in_frame, self.entity)
        entity = below(entity, below_it) if below_it else entity
        if archetypes:
            self.context.log_row(entity, stamp_ns, *archetypes)

    def erase(self) -> None:
        """Remove what is drawn, from its last time on.

        What is logged later at that very time is drawn: a latched message, shown again.
        """
        if self._last is not None:
            self.log(self._last[0], rr.Clear(recursive=True))

    def replace(self, before: "Drawing[L]") -> None:
        """Draw anew what another look has drawn, and what it waited with."""
        self.frame = self._frame_before = before.frame
        self._entities = before._entities
        self._pending.extend([before._last] if before._last is not None else [])
        self._pending.extend(before._pending)


def _frame(message: Any) -> str:
    return str(message.header.frame_id.lstrip("/"))


def topic_entity(key: str, topic: str) -> str:
    """Return the entity of a topic that the display ``key`` draws."""
    return rr.new_entity_path([key, *topic.strip("/").split("/")]).lstrip("/")
