"""Draws odometry: arrows at past poses, the trail as a line, and the pose covariance.

As in RViz, every topic of the type gets arrows. The topics that the view names get trails and
covariances instead.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import rerun as rr

from onebot_bringup.viewer.core.display import LayoutPart, LegendEntry
from onebot_bringup.viewer.core.drawing import (
    Archetypes,
    Drawing,
    History,
    NamedDisplay,
)
from onebot_bringup.viewer.core.inbox import WantedTopic, known_type
from onebot_bringup.viewer.core.rerun_limits import SELDOM, is_drawable
from onebot_bringup.viewer.core.settings import Color, color, setting, signed, topic
from onebot_bringup.viewer.displays.pose import (
    PosesDrawing,
    PoseSettings,
    covariance_shapes,
    one_pose,
    outlines,
)
from onebot_description.arrays import Floats
from onebot_description.parameters.reader import REQUIRED

ODOMETRY = known_type("nav_msgs/msg/Odometry")
M = TypeVar("M", bound=Mapping[str, Any])

# --- arrows ---------------------------------------------------------------------------------------

_MAX_KEPT = 1000  # arrows, since each is logged with all previous ones


@dataclass(frozen=True)
class OdometrySettings(PoseSettings):
    """Poses of odometry, as arrows along x or as axes."""

    keep: int = setting(100, "poses shown; 0: as many as possible, 1000")
    position_tolerance: float = setting(0.1, "meters from one pose to the next")
    angle_tolerance: float = setting(0.1, "radians from one pose to the next")


class OdometryDrawing(PosesDrawing[OdometrySettings]):
    """The last poses of one topic."""

    key = "odometry"
    message_types = (ODOMETRY.name,)

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._history = History()

    def draw(self, message: Any) -> Archetypes:
        """Return the last poses, if this one is far enough from the previous one."""
        [pose] = one_pose(message.pose.pose)
        self._history.begin(self.frame)
        poses = self._history.rows
        if not poses or not self._is_near(poses[-1], pose):
            poses.append(pose)
        elif self._styled:
            return ()
        return self.shapes(self._history.last(min(self.settings.keep or _MAX_KEPT, _MAX_KEPT)))

    def _is_near(self, before: Floats, pose: Floats) -> bool:
        lengths = np.linalg.norm(before[3:]) * np.linalg.norm(pose[3:])
        cosine = abs(before[3:] @ pose[3:]) / lengths if lengths else 1.0
        turned = 2 * np.arccos(min(1.0, cosine))
        moved = np.linalg.norm(pose[:3] - before[:3])
        limits = self.settings
        return bool(moved < limits.position_tolerance and turned < limits.angle_tolerance)


# --- topics that a view names ---------------------------------------------------------------------


class OdometryDisplay(NamedDisplay[M]):
    """Draws Odometry topics that the view names."""

    def subscriptions(self, item: Any) -> Sequence[WantedTopic]:
        return [WantedTopic(item.topic, (ODOMETRY,))]

    def layout(self) -> Sequence[LayoutPart]:
        """Show its drawings, but hide the drawings of an earlier view."""
        entities = tuple(drawing.entity for drawing in self.items.values())
        return [*super().layout(), LayoutPart(hidden=(self.entity(self.key),), shown=entities)]

    def legend(self) -> Sequence[LegendEntry]:
        items = self.items.items()
        return [LegendEntry(self.noun, name, drawing.color) for name, drawing in items]


def _place(message: Any, height: float) -> Floats | None:
    """Return the place (3,) at ``height`` above the pose, meters; None if it is not finite."""
    place: Floats = message.pose.pose.position.array() + (0.0, 0.0, height)
    return place if is_drawable(place) else None


# --- trails ---------------------------------------------------------------------------------------

SPACING = 0.01  # meters driven per piece of the line: finer would not be visible
# A piece that would be longer (meters) is a teleport or a reset, which interrupts the line.
JUMP = 0.5


@dataclass(frozen=True)
class TrailSettings:
    """A line along the poses of an Odometry topic."""

    topic: str = setting(REQUIRED, "an Odometry topic", topic)
    color: Color | None = setting(None, "sRGB bytes; empty: automatic", color)
    width: float = setting(0.01, "width of the line, meters")
    height: float = setting(0.0, "meters above the poses; negative to lay it on the ground", signed)
    length: float = setting(60.0, "seconds shown; 0: all")


class TrailDrawing(Drawing[TrailSettings]):
    """A line along the robot's past positions.

    Every piece of the line is a row at its own time, and the layout shows the last seconds of them.
    The recording therefore grows only while the robot drives, viewers that join late and files also
    have the trail, and moving the time cursor back shortens it.
    """

    max_waiting = 5000
    _start: Floats | None = None  # start of the next piece
    _previous: tuple[int, str] = (0, "")  # stamp and frame

    def style(self) -> list[rr.AsComponents]:
        return [rr.LineStrips3D.from_fields(colors=[self.color], radii=[self.settings.width / 2])]

    def draw(self, message: Any) -> Archetypes:
        """Return the piece that ends here, once it is long enough."""
        place = _place(message, self.settings.height)
        if place is None or not self.frame_of(message):
            self._start = None
            return ()
        stamp_ns, frame = self._previous
        self._previous = self.stamp_ns, self.frame
        is_reset = self.stamp_ns < stamp_ns or self.frame != frame
        start = self._start
        driven = np.inf if start is None or is_reset else np.linalg.norm(place - start)
        if driven < SPACING:
            return ()
        self._start = place
        if driven > JUMP:
            return ()
        return [rr.LineStrips3D.from_fields(strips=[np.array([start, place])])]

    def layout(self) -> LayoutPart:
        return LayoutPart(windows=((self.entity, self.settings.length),))

    def erase(self) -> None:
        """Leave the pieces, which the layout hides."""

    def change(self, settings: TrailSettings) -> None:
        """Continue with other settings; earlier pieces stay where they are."""
        self._use(settings)
        self._start = None


class TrailDisplay(OdometryDisplay[Mapping[str, TrailSettings]]):
    """Draws the past positions of the robot."""

    key, noun = "trails", "trail"
    order = 3
    draws = TrailDrawing
    period_ns = SELDOM  # the missing last part is under the robot


# --- covariances ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class CovarianceSettings:
    """An ellipse and a sector that show the covariance of the poses of an Odometry topic."""

    topic: str = setting(REQUIRED, "an Odometry topic", topic)
    color: Color | None = setting(None, "sRGB bytes; empty: automatic", color)
    width: float = setting(0.006, "width of the lines, meters")
    height: float = setting(0.0, "meters above the poses; negative to lay it on the ground", signed)
    sigma: float = setting(3.0, "size in standard deviations")
    heading: float = setting(0.5, "radius of the sector, which shows the yaw, meters; 0: none")


class CovarianceDrawing(Drawing[CovarianceSettings]):
    """Pose uncertainty: an ellipse around the position, a sector around the heading."""

    newest_only = True

    def draw(self, message: Any) -> Archetypes:
        """Return the shapes; empty ones if the covariance is not known."""
        place = _place(message, self.settings.height)
        if place is None:
            return ()
        pose = np.concatenate([place, message.pose.pose.orientation.array()])
        limits = self.settings.sigma, self.settings.heading
        lines = outlines(pose, message.pose.covariance, *limits)
        return covariance_shapes(lines, self.color, [self.settings.width / 2])


class CovarianceDisplay(OdometryDisplay[Mapping[str, CovarianceSettings]]):
    """Draws the uncertainty of the robot's pose."""

    key, noun = "covariance", "covariance"
    order = 4
    draws = CovarianceDrawing
