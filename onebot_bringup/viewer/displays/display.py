"""What every display is: its settings, its topics, what it logs, and its part of the layout.

A display is a class in a file of its own beside this one, named in ``DISPLAYS`` (``__init__.py``).
Everything else follows from the class: its key in a view file and its ROS parameters from
``Settings``; what the viewer's node, the replay of a bag and a snapshot subscribe from ``topics``;
edits while it runs come to ``apply``; the layout is made of every display's ``layout``.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeVar, cast

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from onebot_bringup.introspection.interfaces import full_definition
from onebot_bringup.introspection.transforms import FrameTree
from onebot_bringup.viewer.columns import (
    TIMELINE,
    ReadyColumn,
    joinable,
    joined,
    one_row,
    time_column,
)
from onebot_bringup.viewer.settings import Color
from onebot_description.description import Description
from onebot_description.wire.cdr import nanoseconds
from onebot_description.wire.messages import BAD_MESSAGE, OdometrySample, odometry_sample
from onebot_description.wire.schema import Schema

if TYPE_CHECKING:
    from onebot_bringup.viewer.displays.tf import TransformStream

T = TypeVar("T")
S = TypeVar("S")  # a dataclass of settings
Report = Callable[[Exception], object]

# Easily distinguished on a dark ground; a view may name others.
COLORS: tuple[Color, ...] = (
    (255, 176, 32),
    (77, 208, 225),
    (240, 98, 146),
    (174, 213, 129),
    (179, 157, 219),
)
# A server with a memory limit drops the oldest data. What is sent seldom is logged anew this often
# (seconds), so that it is never the oldest.
REPEAT_AFTER = 10.0
# Nanoseconds between two calls into Rerun where it matters little: each costs a kilobyte of file
# and of server memory, and work for a page that draws slowly.
SELDOM = 200_000_000
OTHER_CLOCK_NS = 10_000_000_000  # a greater difference of two times is that of two clocks
LARGEST = 1e38  # number that is drawn: in 32 bits it is finite, and its square in 64
WARN_AFTER = 3.0  # seconds that a link, a frame or a transform may be missing without a warning


# --- messages and topics ------------------------------------------------------------------------


@dataclass(frozen=True)
class MessageType(Generic[T]):
    """A type of messages, and how many of them are decoded in one pass."""

    name: str  # as ROS has it, such as "nav_msgs/msg/Odometry"
    # Messages in the order they came, and what is called with the error of a bad one -> a result
    # for each, None for a bad one. Displays that use the same object share its results.
    decode: Callable[[Sequence[bytes], Report], Sequence[T | None]]
    stamp_ns: Callable[[T], int]  # of the header, nanoseconds; 0 for none
    # The stamp is about the time when it was sent; not of what may be latched for long, as a plan.
    live: bool = True


@lru_cache(maxsize=256)
def message_type(name: str, definition: str, live: bool = True) -> "MessageType[Any]":
    """Return a type whose messages are decoded by its definition, see ``Schema``.

    Raises:
        ValueError: the definition cannot be read.
    """
    schema = Schema.of(name, definition)
    return MessageType(name, one_by_one(schema.read), _stamp_of(schema), live)


def _stamp_of(schema: Schema) -> Callable[[Any], int]:
    """Return what reads the stamp of a message: of its header, or its own."""
    fields = schema.numeric_fields()
    if "header.stamp.nanosec" in fields:
        return lambda message: nanoseconds(message.header.stamp)
    if "stamp.nanosec" in fields:
        return lambda message: nanoseconds(message.stamp)
    return lambda message: 0


def one_by_one(read: Callable[[bytes], T]) -> Callable[[Sequence[bytes], Report], list[T | None]]:
    """Return the ``decode`` of a type whose messages ``read`` decodes, or raises BAD_MESSAGE."""

    def decode(messages: Sequence[bytes], report: Report) -> list[T | None]:
        found: list[T | None] = []
        for data in messages:
            try:
                found.append(read(data))
            except BAD_MESSAGE as error:
                report(error)
                found.append(None)
        return found

    return decode


ODOMETRY: MessageType[OdometrySample] = MessageType(
    "nav_msgs/msg/Odometry", one_by_one(odometry_sample), lambda sample: sample.stamp_ns
)


@dataclass(frozen=True)
class WantedTopic:
    """A topic to subscribe."""

    name: str  # relative, so that the robot's namespace applies, or absolute
    types: tuple[MessageType[Any], ...]  # the topic may have any of them
    reliable: bool = False  # else best effort, which matches every publisher
    latched: bool = False  # durability transient_local, which implies reliable
    optional: bool = False  # subscribed only once it is published, if nothing else is shown of it
    as_published: bool = False  # reliable if all publishers are: large messages need it
    depth: int = 100  # messages that wait in DDS; of latched topics also publishers


# --- part of the layout -------------------------------------------------------------------------


class SideView(Protocol):
    """A view beside the robot's; those that are equal look the same."""

    def view(self) -> rrb.View:
        """Return the view for Rerun."""

    def below(self, root: str) -> "SideView":
        """Return the same view of the entities below ``root``."""


@dataclass(frozen=True)
class Plot:
    """A view of curves."""

    entity: str  # everything below it is plotted
    name: str
    window: float  # seconds before the time cursor; 0 for all
    lines: tuple[str, ...] | None = None  # these entities only

    def view(self) -> rrb.View:
        """Return the view for Rerun."""
        contents = "$origin/**" if self.lines is None else [f"+ /{line}" for line in self.lines]
        return rrb.TimeSeriesView(
            origin=self.entity, contents=contents, name=self.name, time_ranges=last(self.window)
        )

    def below(self, root: str) -> "Plot":
        """Return the same view of the entities below ``root``."""
        lines = None if self.lines is None else tuple(below(root, line) for line in self.lines)
        return replace(self, entity=below(root, self.entity), lines=lines)


@dataclass(frozen=True)
class LayoutPart:
    """What a display adds to the layout; a new layout is sent when one of these changes."""

    views: tuple[SideView, ...] = ()  # beside the robot's
    visible: tuple[tuple[str, bool], ...] = ()  # entity, and whether the user sees it at first
    hidden: tuple[str, ...] = ()  # entities left out of the robot's view, with all below,
    shown: tuple[str, ...] = ()  # but for these
    windows: tuple[tuple[str, float], ...] = ()  # entity, and how many seconds of it are shown
    robot: str = ""  # whose views these are, where there are several
    wide: tuple[SideView, ...] = ()  # below the robot's

    def below(self, root: str) -> "LayoutPart":
        """Return the same of the entities below ``root``, a robot's; "" for all there are."""
        if not root:
            return self
        return LayoutPart(
            tuple(view.below(root) for view in self.views),
            tuple((below(root, entity), visible) for entity, visible in self.visible),
            tuple(below(root, entity) for entity in self.hidden),
            tuple(below(root, entity) for entity in self.shown),
            tuple((below(root, entity), seconds) for entity, seconds in self.windows),
            root,
            tuple(view.below(root) for view in self.wide) if root else self.wide,
        )


def drawable(rows: NDArray[Any]) -> NDArray[Any]:
    """Return those of ``rows`` (N, k) whose numbers are all finite and not enormous."""
    found: NDArray[Any] = rows[(np.abs(rows) <= LARGEST).all(axis=1)]
    return found


def below(root: str, entity: str) -> str:
    """Return the path of ``entity`` below ``root``; "" for the root of all."""
    return f"{root}/{entity}" if root else entity


def last(seconds: float) -> rrb.VisibleTimeRanges:
    """Return the last ``seconds`` before the time cursor; 0 for all before it."""
    start = (
        rrb.TimeRangeBoundary.cursor_relative(seconds=-seconds)
        if seconds
        else rrb.TimeRangeBoundary.infinite()
    )
    end = rrb.TimeRangeBoundary.cursor_relative()
    return rrb.VisibleTimeRanges(rrb.VisibleTimeRange(TIMELINE, start=start, end=end))


# --- displays -----------------------------------------------------------------------------------


class _Subtree:
    """What a display uses of a recording, with all entities below one of them."""

    def __init__(self, recording: rr.RecordingStream, root: str) -> None:
        self._recording, self._root = recording, root

    def log(self, entity: str, *components: Any, **options: Any) -> None:
        self._recording.log(f"{self._root}/{entity}", *components, **options)

    def send_columns(self, entity: str, **columns: Any) -> None:
        self._recording.send_columns(f"{self._root}/{entity}", **columns)


class Context:
    """What the displays of one robot share."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        frames: FrameTree,
        transforms: "TransformStream",
        fixed_frame: Callable[[], str],
        frame_prefix: str = "",
        clock: Callable[[], float] = lambda: 0.0,
        root: str = "",
        definitions: Callable[[str], str] = full_definition,
        resolve: Callable[[str], str] = str,
        now_ns: Callable[[], int] = lambda: 0,
    ) -> None:
        """Share where to log, and what is known of the robot.

        Args:
            recording: where to log.
            frames: the latest transforms.
            transforms: logs /tf, and frames that displays place.
            fixed_frame: returns the frame that everything is shown in.
            frame_prefix: put before link names to get their frames.
            clock: seconds.
            root: the entity below which all of the robot is logged; "" where it is the only one.
            definitions: returns the definition of a message type; raises OneBotError.
            resolve: returns the full name of a topic that the view names.
            now_ns: the time on the timeline, nanoseconds.
        """
        self.root = root
        self.now_ns = now_ns
        self._definitions = definitions
        self.resolve = resolve
        self.recording = cast(rr.RecordingStream, _Subtree(recording, root)) if root else recording
        self.frames = frames
        self.transforms = transforms
        self.clock = clock
        self.transform_timeout_ns = 200_000_000  # that a message waits for newer transforms
        self.robot: Description | None = None
        self.fitting_length = 0.0  # of axes and arcs, metres, by the robot's size; 0: not known yet
        self.robot_size = 0.0  # the diagonal of the smallest robot, metres; 0: not known yet
        self.axes_lengths: Mapping[str, float] = {}  # of the frames of links, by the links' sizes
        self.joint_colors: dict[str, Color] = {}  # of every joint whose state has come
        self._fixed_frame = fixed_frame
        self._frame_prefix = frame_prefix

    @property
    def fixed_frame(self) -> str:
        """The frame that everything is shown in; "" before there is any."""
        return self._fixed_frame()

    @property
    def home(self) -> str:
        """A frame that exists: the root link's."""
        return "" if self.robot is None else self.frame_of(self.robot.root_link)

    def frame_of(self, link: str) -> str:
        """Return the TF frame of ``link``."""
        return self._frame_prefix + link

    def message_type(self, name: str, *, live: bool = True) -> "MessageType[Any]":
        """Return a type whose messages are decoded by its definition.

        Raises:
            OneBotError: there is no definition of it.
            ValueError: it cannot be read.
        """
        return message_type(name, self._definitions(name), live)

    def log_row(
        self, entity: str, stamp_ns: int, *archetypes: rr.AsComponents | ReadyColumn
    ) -> None:
        """Log one message's archetypes at its time."""
        self.log_rows(entity, [(stamp_ns, archetypes)])

    def log_rows(
        self, entity: str, rows: Sequence[tuple[int, Sequence[rr.AsComponents | ReadyColumn]]]
    ) -> None:
        """Log messages, each at its time, in as few calls as possible."""
        ready = [
            (stamp_ns, [column for each in archetypes for column in one_row(each)])
            for stamp_ns, archetypes in rows
        ]
        for same in joinable(ready):
            stamps = np.array([stamp_ns for stamp_ns, _ in same])
            columns = joined([columns for _, columns in same])
            self.recording.send_columns(entity, indexes=[time_column(stamps)], columns=columns)

    def connected(self, frame: str) -> bool:
        """Whether transforms lead from ``frame`` to the fixed one.

        An entity in a frame without would be an error in the view: it has to wait.
        """
        return self.frames.top(frame) == self.frames.top(self.fixed_frame)


class Display(ABC, Generic[S]):
    """One thing that is drawn; ``S`` are its settings."""

    key: ClassVar[str]  # in a view file, and of its ROS parameters
    Settings: ClassVar[type]
    named: ClassVar[bool] = False  # a view file has, by names freely chosen, several ``Settings``
    period_ns: ClassVar[int] = 0  # nanoseconds between two calls of ``flush``; 0: every tick
    of_all: ClassVar[bool] = False  # one for all robots: it is made with the context of each
    plots: ClassVar[bool] = False  # it draws curves, and nothing in the robots' own view

    def __init__(self, context: Context) -> None:
        self.context = context

    @abstractmethod
    def apply(self, settings: S) -> None:
        """Use these settings from now on; called after ``flush``."""

    @abstractmethod
    def topics(self) -> Sequence[WantedTopic]:
        """Return what to subscribe, by the settings of now."""

    @abstractmethod
    def add(self, topic: str, kind: MessageType[Any], messages: Sequence[tuple[int, Any]]) -> None:
        """Add messages, to be logged by ``flush``.

        Args:
            topic: as ``topics`` names it.
            kind: one of the topic's types.
            messages: the time of each, nanoseconds (its stamp, or, without, when it came), and
                what ``kind.decode`` made of it.
        """

    @abstractmethod
    def flush(self) -> None:
        """Log what has come, in as few calls as possible."""

    def set_robot(self) -> None:  # noqa: B027  most displays do not depend on the robot
        """Draw for the robot that ``context`` now has."""

    def offer(self, _topics: Mapping[str, str]) -> bool:
        """Note which topics there are now; the type of each by its full name.

        Returns:
            Whether other topics are to be subscribed: ``apply`` follows.
        """
        return False

    def layout(self) -> LayoutPart:
        """Return its part of the layout, by the settings of now."""
        return LayoutPart()

    def warnings(self) -> list[str]:
        """Return what cannot be shown, a sentence each."""
        return []


class Item(Protocol):
    """What a display draws of one topic."""

    frame: str  # in which its entities lie, and without which it waits; "" if in none

    def add(self, stamp_ns: int, message: Any) -> None:
        """Add a message."""

    def flush(self) -> object:
        """Log what has come."""


I = TypeVar("I", bound=Item)  # noqa: E741


class ItemsDisplay(Display[S], Generic[S, I]):
    """A display that draws several items of one kind, each of a topic."""

    noun: ClassVar[str]  # one of them, in warnings
    types: ClassVar[tuple[MessageType[Any], ...]]
    optional: ClassVar[bool] = False  # as of ``WantedTopic``

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.items: dict[str, I] = {}
        self._made_of: dict[str, tuple[Any, Color]] = {}
        self._colors: dict[str, Color] = {}
        self._topics: dict[str, WantedTopic] = {}
        self._waiting_since: dict[str, float] = {}

    @abstractmethod
    def wanted(self, settings: S) -> Mapping[str, tuple[str, Any]]:
        """Return for each item, by its name, its topic and what it is made of."""

    @abstractmethod
    def make(self, name: str, settings: Any, color: Color) -> I:
        """Return a new item; ``color`` where its settings have none."""

    def types_of(self, _settings: Any) -> tuple[MessageType[Any], ...]:
        """Return the types that the topic of an item may have."""
        return self.types

    def subscription(self, topic: str, settings: Any) -> WantedTopic:
        """Return how the topic of an item is subscribed."""
        return WantedTopic(topic, self.types_of(settings), optional=self.optional)

    def apply(self, settings: S) -> None:
        """Keep the items that stay as they are, and make the others anew."""
        made_of: dict[str, tuple[Any, Color]] = {}
        items: dict[str, I] = {}
        self._topics = {}
        wanted = self.wanted(settings)
        self._colors = {name: self._colors[name] for name in wanted if name in self._colors}
        for name, (topic, of) in wanted.items():
            if name not in self._colors:  # others keep theirs, whatever is published besides
                self._colors[name] = min(COLORS, key=[*self._colors.values()].count)
            made_of[name] = (of, self._colors[name])
            same = self._made_of.get(name) == made_of[name]
            items[name] = self.items[name] if same else self.make(name, *made_of[name])
            self._topics[name] = self.subscription(topic, of)
        self._made_of, self.items = made_of, items

    def topics(self) -> Sequence[WantedTopic]:
        """Return the topic of each item."""
        return list(self._topics.values())

    def add(self, topic: str, kind: MessageType[Any], messages: Sequence[tuple[int, Any]]) -> None:
        """Pass messages to the items of their topic."""
        for name, item in self.items.items():
            if self._topics[name].name == topic:
                for stamp_ns, message in messages:
                    item.add(stamp_ns, message)

    def flush(self) -> None:
        """Log the items that can be shown."""
        for item in self.items.values():
            if not item.frame or self.context.connected(item.frame):
                item.flush()

    def warnings(self) -> list[str]:
        """Return which items have waited long for a transform."""
        return [
            f'{self.noun} "{name}" is in the frame "{item.frame}", which no transform connects '
            f'with "{self.context.fixed_frame}": not shown until /tf or /tf_static brings one'
            for name, item in self.items.items()
            if self._waits_long(name, item.frame)
        ]

    def _waits_long(self, name: str, frame: str) -> bool:
        if not frame or self.context.connected(frame):
            self._waiting_since.pop(name, None)
            return False
        now = self.context.clock()
        return now - self._waiting_since.setdefault(name, now) > WARN_AFTER
