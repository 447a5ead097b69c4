"""What every display is: its settings, its topics, what it logs, and its part of the layout.

Most displays draw the topics of a message type: see ``drawing``. The others are classes made of
``Display``. Both are registered in ``__init__.py``, and their settings in ``ViewConfig``, under the
``key``. What the viewer's node, the replay of a bag and a snapshot subscribe follows from
``topics``; edits while it runs come to ``apply``; the layout is made of every ``layout``.
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
# Nanoseconds between two calls into Rerun where it matters little: each costs a kilobyte, in the
# file and in the server's memory, and work for a page that draws slowly.
SELDOM = 200_000_000
LARGEST = 1e38  # drawable number: finite in 32 bits, and its square finite in 64


def is_old(logged_at: float) -> bool:
    """Whether what was logged at a time of ``time.monotonic`` is to be logged again."""
    return time.monotonic() - logged_at > REPEAT_AFTER


def drawable(rows: NDArray[Any]) -> NDArray[Any]:
    """Return the ``rows`` (N, k) whose numbers are all finite and not enormous."""
    finite: NDArray[Any] = rows[(np.abs(rows) <= LARGEST).all(axis=1)]
    return finite


# --- part of the layout -------------------------------------------------------------------------


class SideView(Protocol):
    """A view beside the robot's; equal ones look the same."""

    @property
    def entity(self) -> str:
        """What it shows, with everything below."""

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
    """What a display adds to the layout; a new layout is sent when one of these changes."""

    views: tuple[SideView, ...] = ()  # beside the robot's
    visible: tuple[tuple[str, bool], ...] = ()  # entity, and whether the user sees it at first
    hidden: tuple[str, ...] = ()  # entities left out of the robot's view, and all below
    shown: tuple[str, ...] = ()  # exceptions from ``hidden``
    windows: tuple[tuple[str, float], ...] = ()  # entity, and how many seconds of it are shown
    robot: str = ""  # the views' owner, where there are several robots
    wide: tuple[SideView, ...] = ()  # below the robot's


class LegendEntry(NamedTuple):
    """A line or shape in the robots' view, as a legend explains it."""

    kind: str  # the noun of its display, such as "trail"
    name: str  # in the view
    color: Color


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


class Display(ABC, Generic[S]):
    """One thing that is drawn; ``S`` are its settings."""

    key: str  # the name in a view file, and the prefix of its ROS parameters
    period_ns: int = 0  # nanoseconds between two calls of ``flush``; 0: every tick
    plots: bool = False  # it draws curves, and nothing in the robots' own view
    limit: LoadLimit | None = None  # drops messages where too many come

    def __init__(self, stage: "Stage", robot: "ShownRobot | None" = None) -> None:
        """Draw nothing yet; ``robot`` is the robot that it shows, None for all."""
        self.stage = stage
        self._robot = robot
        self._flushed_ns: tuple[int, ...] = ()

    @property
    def robot(self) -> "ShownRobot":
        """Whose display it is."""
        assert self._robot is not None
        return self._robot

    def entity(self, name: str) -> str:
        """Return the path of an entity, below its robot's."""
        return name if self._robot is None else below(self._robot.root, name)

    def full_name(self, topic: str) -> str:
        """Return the full name of a topic that the view names."""
        return self.stage.resolve(topic) if self._robot is None else self._robot.full_name(topic)

    def is_due(self, *now_ns: int) -> bool:
        """Whether it is time to flush it by one of several clocks; if so, that is noted."""
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
        """Return what to subscribe, by the settings of now."""
        return ()

    def add(  # noqa: B027  a display without topics gets none
        self, topic: str, kind: MessageType[Any], messages: Sequence[tuple[int, Any]]
    ) -> None:
        """Add messages, to be logged by ``flush``.

        Args:
            topic: as ``topics`` names it.
            kind: one of the topic's types.
            messages: the time of each, nanoseconds (its stamp, or, without, when it came), and
                what ``kind.decode`` made of it.
        """

    @abstractmethod
    def flush(self) -> None:
        """Log the messages received so far, in as few calls as possible."""

    def set_robot(self) -> None:  # noqa: B027  most displays do not depend on the robot
        """Draw for the description that the robot now has."""

    def offer(self, _topics: Mapping[str, str]) -> bool:
        """Note which topics there are now; the type of each by its full name.

        Returns:
            Whether other topics are to be subscribed: ``apply`` follows.
        """
        return False

    def layout(self) -> LayoutPart:
        """Return its part of the layout, by the settings of now."""
        return LayoutPart()

    def legend(self) -> Sequence[LegendEntry]:
        """Return what a legend has to explain."""
        return ()

    def warnings(self) -> list[str]:
        """Return what cannot be shown, a sentence each."""
        return []
