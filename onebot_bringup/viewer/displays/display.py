"""The base class of displays: their settings, their topics, and their part of the layout.

Most displays draw the topics of a message type: see ``drawing``. The others subclass ``Display``.
Both are registered in ``__init__.py``, and their settings in ``ViewConfig``, under the ``key``.
``topics`` says what the viewer's node, the replay of a bag and a snapshot subscribe to; ``apply``
receives changes of the settings; the layout combines every ``layout``.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import NDArray

from onebot_bringup.viewer.columns import TIMELINE
from onebot_bringup.viewer.inbox import LoadLimit, MessageType, WantedTopic
from onebot_bringup.viewer.settings import Color

if TYPE_CHECKING:
    from onebot_bringup.viewer.shown_robot import ShownRobot
    from onebot_bringup.viewer.stage import Stage

S = TypeVar("S")  # a dataclass of settings

# Default colours, easily distinguished on a dark background.
COLORS: tuple[Color, ...] = (
    (255, 176, 32),
    (77, 208, 225),
    (240, 98, 146),
    (174, 213, 129),
    (179, 157, 219),
)
# A server with a memory limit drops the oldest data. Data that seldom changes is logged again this
# often (seconds), so that it is never the oldest.
REPEAT_AFTER = 10.0
# Nanoseconds between calls into Rerun for data that is not urgent: each call costs a kilobyte in
# the file and in the server's memory, and work for a page that draws slowly.
SELDOM = 200_000_000
LARGEST = 1e38  # largest drawable number: finite as float32, and its square finite as float64


def is_old(logged_at: float) -> bool:
    """Whether data logged at this time (of ``time.monotonic``) should be logged again."""
    return time.monotonic() - logged_at > REPEAT_AFTER


def drawable(rows: NDArray[Any]) -> NDArray[Any]:
    """Return the rows of ``rows`` (N, k) whose numbers are all finite and at most LARGEST."""
    finite: NDArray[Any] = rows[(np.abs(rows) <= LARGEST).all(axis=1)]
    return finite


# --- part of the layout -------------------------------------------------------------------------


class SideView(Protocol):
    """A view beside the robot's; equal objects give the same view."""

    @property
    def entity(self) -> str:
        """The entity that it shows, with everything below."""

    def view(self) -> rrb.View:
        """Return the view for Rerun."""


@dataclass(frozen=True)
class Plot:
    """A view of curves."""

    entity: str  # everything below it is plotted
    name: str
    window: float  # seconds before the time cursor; 0 for all
    lines: tuple[str, ...] | None = None  # these entities only

    def view(self) -> rrb.View:
        contents = "$origin/**" if self.lines is None else [f"+ /{line}" for line in self.lines]
        return rrb.TimeSeriesView(
            origin=self.entity, contents=contents, name=self.name, time_ranges=last(self.window)
        )


@dataclass(frozen=True)
class LayoutPart:
    """The views and entities that a display adds to the layout."""

    views: tuple[SideView, ...] = ()  # beside the robot's
    visible: tuple[tuple[str, bool], ...] = ()  # entity, and whether it is visible initially
    hidden: tuple[str, ...] = ()  # entities left out of the robot's view, with all below
    shown: tuple[str, ...] = ()  # exceptions from ``hidden``
    windows: tuple[tuple[str, float], ...] = ()  # entity, and how many seconds of it are shown
    robot: str = ""  # the robot that the views belong to, if there are several
    wide: tuple[SideView, ...] = ()  # below the robot's view


class LegendEntry(NamedTuple):
    """An entry of a legend, which explains a line or shape in the robots' view."""

    kind: str  # the noun of its display, such as "trail"
    name: str  # its name in the view file
    color: Color


def below(root: str, entity: str) -> str:
    """Return the path of ``entity`` below ``root``, which is "" for the top."""
    return f"{root}/{entity}" if root else entity


def last(seconds: float) -> rrb.VisibleTimeRanges:
    """Return the time range of the last ``seconds`` before the time cursor; 0 for all before it."""
    start = (
        rrb.TimeRangeBoundary.cursor_relative(seconds=-seconds)
        if seconds
        else rrb.TimeRangeBoundary.infinite()
    )
    end = rrb.TimeRangeBoundary.cursor_relative()
    return rrb.VisibleTimeRanges(rrb.VisibleTimeRange(TIMELINE, start=start, end=end))


# --- displays -----------------------------------------------------------------------------------


class Display(ABC, Generic[S]):
    """Base class of displays, which each draw one kind of thing; ``S`` are the settings."""

    key: str  # the name in a view file, and the prefix of its ROS parameters
    period_ns: int = 0  # nanoseconds between two calls of ``flush``; 0: every tick
    plots: bool = False  # draws only curves, and nothing in the robots' own view
    limit: LoadLimit | None = None  # drops messages if too many come

    def __init__(self, stage: "Stage", robot: "ShownRobot | None" = None) -> None:
        """Draw nothing yet; ``robot`` is the robot to show, None for all."""
        self.stage = stage
        self._robot = robot
        self._flushed_ns: tuple[int, ...] = ()

    @property
    def robot(self) -> "ShownRobot":
        """The robot that it shows."""
        assert self._robot is not None
        return self._robot

    def entity(self, name: str) -> str:
        """Return the path of an entity below the robot's."""
        return name if self._robot is None else below(self._robot.root, name)

    def full_name(self, topic: str) -> str:
        """Return the full name of a topic that the view names."""
        return self.stage.resolve(topic) if self._robot is None else self._robot.full_name(topic)

    def is_due(self, *now_ns: int) -> bool:
        """Whether to flush it now by any of several clocks; if so, the period starts again."""
        times = zip(now_ns, self._flushed_ns, strict=False)
        if self._flushed_ns and all(abs(now - last) < self.period_ns for now, last in times):
            return False
        if self.limit is not None and not self.limit.ready(time.monotonic()):
            return False
        self._flushed_ns = now_ns
        return True

    @abstractmethod
    def apply(self, settings: S) -> None:
        """Use these settings from now on; called after ``flush``."""

    def topics(self) -> Sequence[WantedTopic]:
        """Return the topics to subscribe to, by the current settings."""
        return ()

    def add(  # noqa: B027  a display without topics gets none
        self, topic: str, kind: MessageType[Any], messages: Sequence[tuple[int, Any]]
    ) -> None:
        """Add messages, to be logged by ``flush``.

        Args:
            topic: the name that ``topics`` gives.
            kind: one of the topic's types.
            messages: the time of each, nanoseconds (its stamp, or without one its receive time),
                and the result of ``kind.decode``.
        """

    @abstractmethod
    def flush(self) -> None:
        """Log the messages received so far, in as few calls as possible."""

    def set_robot(self) -> None:  # noqa: B027  most displays do not depend on the robot
        """Adapt to the robot's new description."""

    def offer(self, _topics: Mapping[str, str]) -> bool:
        """Take the message types of the existing topics, by full topic names.

        Returns:
            Whether the result of ``topics`` changes; the caller then calls ``apply``.
        """
        return False

    def layout(self) -> LayoutPart:
        """Return its part of the layout, by the current settings."""
        return LayoutPart()

    def legend(self) -> Sequence[LegendEntry]:
        """Return its entries of the legend."""
        return ()

    def warnings(self) -> list[str]:
        """Return one sentence per thing that cannot be shown."""
        return []
