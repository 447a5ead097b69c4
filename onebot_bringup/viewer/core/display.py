"""The base class of displays: their settings, their topics, and their part of the layout.

Most displays draw the topics of a message type: see ``drawing``. The others subclass ``Display``.
The viewer's node, the replay of a bag and a snapshot subscribe to its ``topics``; ``apply``
receives changes of the settings; the layout combines every ``layout``.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Generic, NamedTuple, TypeVar

import rerun.blueprint as rrb

from onebot_bringup.viewer.core.columns import TIMELINE, below
from onebot_bringup.viewer.core.inbox import Receiver, WantedTopic
from onebot_bringup.viewer.core.settings import Color
from onebot_bringup.viewer.core.shown_robot import ShownRobot
from onebot_bringup.viewer.core.stage import Stage

S = TypeVar("S")  # a dataclass of settings

# Default colors, easily distinguished on a dark background.
COLORS: tuple[Color, ...] = (
    (255, 176, 32),
    (77, 208, 225),
    (240, 98, 146),
    (174, 213, 129),
    (179, 157, 219),
)

# --- part of the layout -------------------------------------------------------------------------


@dataclass(frozen=True)
class SideView(ABC):
    """A view beside the robot's; equal objects give the same view."""

    entity: str  # it is shown with everything below
    name: str

    @abstractmethod
    def view(self) -> rrb.View:
        """Return the view for Rerun."""


@dataclass(frozen=True)
class Plot(SideView):
    """A view of curves."""

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

    views: tuple[SideView, ...] = ()  # beside the robot's view
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


class Display(Receiver, ABC, Generic[S]):
    """Base class of displays, which each draw one kind of thing; ``S`` are the settings.

    A view has one of each class with a ``key`` in the folder of displays for each robot, or a
    single one for all robots.
    """

    key: str  # the name in a view file, and the prefix of its ROS parameters
    settings: S
    order: ClassVar[int] = 100  # the displays of a robot are drawn and laid out in this order
    of_all_robots: ClassVar[bool] = False
    period_ns: int = 0  # nanoseconds between two calls of ``flush``; 0: every tick
    only_plots: bool = False  # draws nothing in the robots' view

    def __init__(self, stage: Stage, robot: ShownRobot | None = None) -> None:
        """Draw nothing yet; ``robot`` is the robot to show, None for all."""
        self.stage = stage
        self.shown_robot = robot
        self.root = "" if robot is None else robot.root  # the entity above the robot's
        self._flushed_ns = -math.inf
        self.rest_ns = 0.0  # minimum time from that flush to the next, as its period

    @property
    def robot(self) -> ShownRobot:
        """The robot that it shows."""
        assert self.shown_robot is not None
        return self.shown_robot

    def entity(self, name: str) -> str:
        """Return the path of an entity below the robot's."""
        return below(self.root, name)

    def full_name(self, topic: str) -> str:
        """Return the full name of a topic that the view names."""
        robot = self.shown_robot
        return self.stage.resolve(topic) if robot is None else robot.full_name(topic)

    def is_due(self, now_ns: int) -> bool:
        """Whether to flush it now; if so, the period starts again."""
        if abs(now_ns - self._flushed_ns) < max(self.period_ns, self.rest_ns):
            return False
        self._flushed_ns = now_ns
        return True

    def apply(self, settings: S) -> None:
        """Use these settings from now on; called first of all, and later after ``flush``."""
        self.settings = settings

    def topics(self) -> Sequence[WantedTopic]:
        """Return the topics to subscribe to with the current settings."""
        return ()

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

    def layout(self) -> Sequence[LayoutPart]:
        """Return its parts of the layout with the current settings."""
        return ()

    def legend(self) -> Sequence[LegendEntry]:
        """Return its entries of the legend."""
        return ()

    def warnings(self) -> list[str]:
        """Return one sentence per thing that cannot be shown."""
        return []
