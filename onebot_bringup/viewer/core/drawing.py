"""Displays of topics, with one drawing for each topic or for each entry of a view.

Each message type is drawn by one class, in a file of the folder ``displays``::

    @dataclass(frozen=True)
    class PathSettings(TopicSettings):
        line_width: float = setting(0.02, "width, meters")

    class PathDrawing(Drawing[PathSettings]):
        key = "path"
        message_types = ("nav_msgs/msg/Path",)

        def draw(self, message): ...  # -> Rerun's archetypes

Messages are decoded by their type's definition (``onebot_description.ros.wire.schema``), so that
a recording's type need not be installed; a live topic's is installed, or has a file in
``ros/wire/definitions``. In a view file, settings for all topics are under the key, and settings
for one topic under its ``topics``: ``path: {height: 0.1, topics: {/plan: {line_width: 0.1}}}``.
"""

import time
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Generic

import numpy as np
import rerun as rr

from onebot_bringup.viewer.core.columns import ReadyColumn, entity_path, one_row
from onebot_bringup.viewer.core.display import COLORS, Display, LayoutPart, S
from onebot_bringup.viewer.core.inbox import WARN_AFTER, MessageType, WantedTopic
from onebot_bringup.viewer.core.rerun_limits import is_old
from onebot_bringup.viewer.core.settings import Color, one_of, setting
from onebot_bringup.viewer.core.stage import Stage
from onebot_description.arrays import Floats
from onebot_description.parameters.reader import OwnClass

AUTO = "auto"
_RELIABILITIES = (AUTO, "reliable", "best_effort")
DEPTH, DEPTH_HIGH_BANDWIDTH = 100, 5  # messages queued in DDS, or for a transform
_REST = 3.0  # seconds that a limited display rests for each second of work
_BYTES_PER_SECOND = 400e6  # rate at which Rerun copies, encodes and sends in its own threads

Archetypes = Sequence[rr.AsComponents | ReadyColumn]


@dataclass(frozen=True)
class TopicSettings:
    """How all topics of a display, or single ones, are subscribed and drawn."""

    visible: bool = setting(True, "draw it")
    reliability: str = setting(AUTO, "auto: as the publishers offer", one_of(*_RELIABILITIES))
    depth: int = setting(0, "depth of the DDS queue; 0: the usual one")
    topics: Mapping[str, OwnClass] = setting({}, "settings of single topics")


# --- drawings -------------------------------------------------------------------------------------


class Drawing(Generic[S]):
    """Draws the messages of one topic; each replaces the last, unless a subclass says otherwise."""

    # Which messages to draw:
    key: ClassVar[str]  # the name in a view file, and the prefix of its ROS parameters
    message_types: ClassVar[tuple[str, ...]]  # full names, such as "nav_msgs/msg/Path"
    high_bandwidth: ClassVar[bool] = False  # megabytes per second: few are shown automatically
    stamped_when_sent: ClassVar[bool] = True  # see ``WantedTopic``
    replaces_previous: ClassVar[bool] = True  # see ``WantedTopic``
    period_ns: ClassVar[int] = 0  # see ``Display``
    rviz_classes: ClassVar[tuple[str, ...]] = ()  # RViz's names besides the key in title case

    # How to draw them:
    has_header: ClassVar[bool] = True  # messages are drawn in the frame of their header
    at_stamp_time: ClassVar[bool] = False  # drawn where the frame was at the time of the stamp
    repeat_when_silent: ClassVar[bool] = False  # logged again if messages are rare: REPEAT_AFTER
    newest_only: ClassVar[bool] = False  # only the newest message of a flush is drawn
    max_waiting: ClassVar[int] = DEPTH  # maximum number of messages that wait for a transform

    topics: Sequence[WantedTopic] = ()
    _styled: bool  # whether ``style`` was logged

    def __init__(self, stage: Stage, name: str, entity: str, settings: S, color: Color) -> None:
        """Draw nothing yet.

        Args:
            stage: where to draw.
            name: the topic's full name, or the name of the view's entry.
            entity: the entity to log to.
            settings: how to draw.
            color: used if the settings have no color.
        """
        self.stage, self.name, self.entity = stage, name, entity
        self.default_color = color
        self.frame = ""  # frame of the drawn message, or the newest one; "" for none
        self.entity_frame = ""  # the frame that the entity is in
        self.stamp_ns = 0  # stamp of the message that is drawn
        self.problems: dict[str, str] = {}  # the first problem of each kind
        self._pending: list[tuple[int, Any]] = []
        self._last: tuple[int, Any] | None = None  # the last message drawn, with its time
        self._logged_at = 0.0
        self._frame_before = ""  # frame of the last message that was logged or queued
        self._use(settings)

    def draw(self, message: Any) -> Archetypes:
        """Return what replaces the previous message at the entity; empty to keep that.

        Raises:
            ValueError: the message cannot be drawn; the text becomes a warning.
        """
        return ()

    def style(self) -> Sequence[rr.AsComponents]:
        """Return the components that all messages share, to be logged once."""
        return ()

    def layout(self) -> LayoutPart:
        """Return its part of the layout."""
        return LayoutPart()

    @classmethod
    def is_duplicate(cls, topic: str, topics: Mapping[str, str]) -> bool:
        """Whether another topic carries the same data, so this one need not be shown."""
        return False

    @classmethod
    def further_topics(cls, stage: Stage, topic: str) -> Sequence[WantedTopic]:
        """Return other topics to subscribe to beside ``topic``, whose messages ``add`` gets."""
        return ()

    def frame_of(self, message: Any) -> str:
        """Return the frame that a message names."""
        return str(message.header.frame_id.lstrip("/")) if self.has_header else ""

    def frame_to_draw_in(self) -> str:
        """Return the frame to put the entity in."""
        return self.frame

    def pose(self) -> Floats | None:
        """Return the (4, 4) pose of the message's frame in the fixed one at the message's stamp.

        It is None while no transforms connect them.
        """
        return self.stage.frames.pose(self.frame, self.stage.fixed_frame, self.stamp_ns)

    def add(self, stamp_ns: int, message: Any) -> None:
        """Add a message, to be logged by ``flush``; raises as ``draw`` does."""
        if self.has_header:
            self.frame = self.frame_of(message) or self.frame
            if not self.frame:
                raise ValueError("its header has no frame_id")
        self._pending.append((stamp_ns, message))

    def flush(self) -> None:
        """Log the messages that can be shown now, or repeat the last one after a long time.

        A message without a transform to its frame waits for it until a newer message is shown.
        """
        pending, self._pending = self._pending, []
        if not pending and self._last is not None and self.repeat_when_silent:
            pending = [self._last] if is_old(self._logged_at) else []
        rows: list[tuple[int, Archetypes]] = []
        for stamp_ns, message in pending[-1:] if self.newest_only else pending:
            # A message without a frame, such as an empty path, keeps the last one's.
            frame = self._frame_before = self.frame_of(message) or self._frame_before
            if not self._is_due(frame, stamp_ns):
                self._pending.append((stamp_ns, message))
                self.frame = frame
                continue
            if self._pending and frame != self.frame:
                self.problems.setdefault("", f'messages in "{self.frame}" are not shown')
                self._pending.clear()
            self.frame, self.stamp_ns = frame, stamp_ns
            self.entity_frame = self.frame_to_draw_in()
            try:
                archetypes = self.draw(message)
            except ValueError as error:
                self.problems.setdefault("", str(error))
                archetypes = ()
            self._last = stamp_ns, message
            if archetypes:
                rows.append((stamp_ns, [*archetypes, *_in_frame(self.entity_frame)]))
        del self._pending[: -self.max_waiting]
        self._log_rows(rows)

    def _is_due(self, frame: str, stamp_ns: int) -> bool:
        """Whether a message can be shown, since transforms lead from its frame to the fixed one.

        As in RViz, a message newer than the last transform waits a moment for the next one.
        """
        stage = self.stage
        if not frame:
            return True
        if not stage.connected(frame):
            return False
        is_ahead = self.at_stamp_time and stamp_ns > stage.frames.known_until(frame)
        return not (is_ahead and 0 <= stage.now_ns - stamp_ns < stage.transform_timeout_ns)

    def _log_rows(self, rows: Sequence[tuple[int, Archetypes]]) -> None:
        if not rows:
            return
        self._logged_at = time.monotonic()
        if not self._styled:
            self._styled = True
            for component in self.style():
                self.stage.recording.log(self.entity, component, static=True)
        self.stage.log_rows(self.entity, rows)

    def erase(self) -> None:
        """Remove what is drawn, from the time of the last message on.

        A latched message can be shown again: data logged later at the same time is drawn.
        """
        if self._last is not None:
            self.stage.clear(self.entity, self._last[0], self.entity_frame)

    def change(self, settings: S) -> None:
        """Draw the last message again, with other settings."""
        self.erase()
        self._use(settings)
        if self._last is not None:
            self._pending.insert(0, self._last)

    def _use(self, settings: S) -> None:
        self.problems.clear()
        self.settings = settings
        self.color: Color = getattr(settings, "color", None) or self.default_color
        self._styled = False


class History:
    """The last places or poses of one frame."""

    def __init__(self) -> None:
        self.rows: list[Floats] = []
        self._frame = ""

    def begin(self, frame: str) -> None:
        """Continue in a frame; forget everything if it differs from the previous frame."""
        if frame != self._frame:
            self._frame = frame
            self.rows.clear()

    def last(self, count: int) -> Floats:
        """Forget all but the last ``count`` rows, and return them."""
        del self.rows[:-count]
        return np.array(self.rows)


@lru_cache(maxsize=128)
def _in_frame(frame: str) -> Archetypes:
    return one_row(rr.CoordinateFrame(frame)) if frame else ()


def topic_entity(key: str, topic: str) -> str:
    """Return the entity of a topic that the display ``key`` draws."""
    return entity_path(key, *topic.strip("/").split("/"))


# --- displays -------------------------------------------------------------------------------------


class DrawingsDisplay(Display[S]):
    """A display with several drawings of one kind."""

    noun: str  # name of one drawing in warnings

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.items: dict[str, Drawing[Any]] = {}
        self._waiting_since: dict[str, float] = {}
        self.offered: Mapping[str, str] = {}

    def offer(self, topics: Mapping[str, str]) -> bool:
        """Use exactly these topics and types from the next ``apply`` on."""
        previous, self.offered = self.offered, topics
        return topics != previous

    @abstractmethod
    def wanted(self, settings: S) -> Mapping[str, tuple[Sequence[WantedTopic], Any]]:
        """Return the topics and the settings of each drawing, by its name."""

    @abstractmethod
    def make(self, name: str, settings: Any, color: Color) -> Drawing[Any]:
        """Return a new drawing; ``color`` is used if its settings have none."""

    def apply(self, settings: S) -> None:
        """Redraw drawings whose settings changed; erase drawings that are gone."""
        super().apply(settings)
        wanted = self.wanted(settings)
        for gone in self.items.keys() - wanted.keys():
            self.items.pop(gone).erase()
        for name, (topics, item) in wanted.items():
            if name not in self.items:
                used = [drawing.default_color for drawing in self.items.values()]
                self.items[name] = self.make(name, item, min(COLORS, key=used.count))
            elif self.items[name].settings != item:
                self.items[name].change(item)
            self.items[name].topics = topics
        self.items = {name: self.items[name] for name in wanted}

    def topics(self) -> Sequence[WantedTopic]:
        return [topic for drawing in self.items.values() for topic in drawing.topics]

    def add(self, topic: str, kind: MessageType[Any], messages: Sequence[tuple[int, Any]]) -> None:
        """Pass messages to the drawings of their topic."""
        for drawing in self.items.values():
            if any(item.name == topic for item in drawing.topics):
                for stamp_ns, message in messages:
                    try:
                        drawing.add(stamp_ns, message)
                    except ValueError as error:
                        drawing.problems.setdefault("", str(error))

    def flush(self) -> None:
        for drawing in self.items.values():
            drawing.flush()

    def layout(self) -> Sequence[LayoutPart]:
        """Return the parts of its drawings; those in the robots' view add nothing."""
        return [drawing.layout() for drawing in self.items.values()]

    def warnings(self) -> list[str]:
        """Return a sentence per drawing that waits long for a transform, or cannot be drawn."""
        waiting = [
            f'{self.noun} "{name}" is in the frame "{drawing.frame}", which no transform connects '
            f'with "{self.stage.fixed_frame}": not shown until /tf or /tf_static has one'
            for name, drawing in self.items.items()
            if self._waits_long(name, drawing.frame)
        ]
        problems = [
            f'{self.noun} "{name}": {text}'
            for name, drawing in self.items.items()
            for text in drawing.problems.values()
        ]
        return waiting + problems

    def _waits_long(self, name: str, frame: str) -> bool:
        if not frame or self.stage.connected(frame):
            self._waiting_since.pop(name, None)
            return False
        now = self.stage.clock()
        return now - self._waiting_since.setdefault(name, now) > WARN_AFTER


class MessageDisplay(DrawingsDisplay[Any]):
    """Draws all topics of some message types, of any robot, as RViz does."""

    def __init__(self, stage: Stage, draws: type[Drawing[Any]]) -> None:
        super().__init__(stage)
        self.draws = draws
        self.key = draws.key
        self.noun = draws.key.replace("_", " ")
        self.period_ns = draws.period_ns

    def flush(self) -> None:
        """Draw the messages; then rest in proportion to the work, if it is limited."""
        is_measured = self.limited and self.size > 0  # measuring takes some microseconds
        began = time.thread_time() if is_measured else 0.0
        super().flush()
        work = time.thread_time() - began + self.size / _BYTES_PER_SECOND if is_measured else 0.0
        self.rest_ns = 1e9 * _REST * work
        self.size = 0

    def wanted(self, settings: Any) -> Mapping[str, tuple[Sequence[WantedTopic], Any]]:
        of_topics = {self.full_name(name): topic for name, topic in settings.topics.items()}
        chosen = {topic: of_topics.get(topic, settings) for topic in self.offered}
        return {topic: (self._subscriptions(topic, item), item) for topic, item in chosen.items()}

    def _subscriptions(self, topic: str, settings: TopicSettings) -> Sequence[WantedTopic]:
        """Return the subscriptions of a topic, with its type's definition and its QoS."""
        draws = self.draws
        subscription = WantedTopic(
            topic,
            (self.stage.message_type(self.offered[topic]),),
            reliable=settings.reliability == "reliable",
            optional=True,
            as_published=settings.reliability == AUTO,
            depth=settings.depth or (DEPTH_HIGH_BANDWIDTH if draws.high_bandwidth else DEPTH),
            stamped_when_sent=draws.stamped_when_sent,
            replaces_previous=draws.replaces_previous,
        )
        return [subscription, *draws.further_topics(self.stage, topic)]

    def make(self, name: str, settings: Any, color: Color) -> Drawing[Any]:
        return self.draws(self.stage, name, topic_entity(self.key, name), settings, color)


class NamedDisplay(DrawingsDisplay[S]):
    """Draws the entries that a view names, with one drawing each."""

    draws: ClassVar[type[Drawing[Any]]]

    def wanted(self, settings: Any) -> Mapping[str, tuple[Sequence[WantedTopic], Any]]:
        return {name: (self.subscriptions(item), item) for name, item in settings.items()}

    @abstractmethod
    def subscriptions(self, item: Any) -> Sequence[WantedTopic]:
        """Return the topics of an entry; none if its type is unknown."""

    def make(self, name: str, settings: Any, color: Color) -> Drawing[Any]:
        entity = self.entity(entity_path(self.key, name))
        return self.draws(self.stage, name, entity, settings, color)
