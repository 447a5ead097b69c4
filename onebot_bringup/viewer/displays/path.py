"""A planned path (nav_msgs/Path) as a line; an empty one clears it."""

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import nav_msgs.msg
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.columns import time_column
from onebot_bringup.viewer.displays.display import (
    LARGEST,
    REPEAT_AFTER,
    SELDOM,
    ItemsDisplay,
    LayoutPart,
    MessageType,
    one_by_one,
)
from onebot_bringup.viewer.settings import Color, color, height, setting, topic_list
from onebot_description.wire.cdr import nanoseconds
from onebot_description.wire.messages import deserialize_message

PATHS_ENTITY = "paths"
# Of paths of a topic that are kept while no transform leads to their frame: how many, and bytes.
_MOST_WAITING = 100
_MOST_BYTES = 16 * 2**20

Floats = NDArray[np.float64]


class PathPoints(NamedTuple):
    """A nav_msgs/Path."""

    stamp_ns: int
    frame_id: str
    points: Floats  # (N, 3) metres; those that are not finite, or enormous, are left out


def read_path(data: bytes) -> PathPoints:
    """Read a serialized nav_msgs/Path.

    Raises:
        ValueError: it is none.
    """
    message = deserialize_message(data, nav_msgs.msg.Path)
    places = [pose.pose.position for pose in message.poses]
    points = np.array([(p.x, p.y, p.z) for p in places], float).reshape(-1, 3)
    header = message.header
    return PathPoints(
        nanoseconds(header.stamp), header.frame_id, points[(np.abs(points) <= LARGEST).all(axis=1)]
    )


PATH: MessageType[PathPoints] = MessageType(
    "nav_msgs/msg/Path", one_by_one(read_path), lambda path: path.stamp_ns, live=False
)


@dataclass(frozen=True)
class PathSettings:
    """Lines along planned paths."""

    visible: bool = setting(True, "draw planned paths")
    topics: tuple[str, ...] = setting(("plan", "path"), "of nav_msgs/Path", topic_list)
    color: Color | None = setting(None, "sRGB bytes; by default one of ours a topic", color)
    width: float = setting(0.02, "of the lines, metres")
    height: float = setting(0.0, "metres above the poses; negative to lay it on the ground", height)


class PathDisplay(ItemsDisplay[PathSettings, "PathLine"]):
    """Draws planned paths."""

    key = "paths"
    Settings = PathSettings
    noun = "path"
    types = (PATH,)
    optional = True
    period_ns = SELDOM

    def wanted(self, settings: PathSettings) -> Mapping[str, tuple[str, PathSettings]]:
        """Return a line for each topic."""
        look = replace(settings, topics=())  # another topic does not change the line of this one
        return {topic: (topic, look) for topic in settings.topics if settings.visible}

    def make(self, name: str, settings: PathSettings, color: Color) -> "PathLine":
        """Return the line of a topic."""
        return PathLine(self.context.recording, name, settings, color)

    def layout(self) -> LayoutPart:
        """Return the lines."""
        return LayoutPart(hidden=(PATHS_ENTITY,), shown=tuple(map(path_entity, self.items)))


class PathLine:
    """Logs the paths of one topic, each in place of the one before."""

    def __init__(
        self, recording: rr.RecordingStream, name: str, settings: PathSettings, color: Color
    ) -> None:
        """Log into ``recording``; ``color`` is used where the settings have none."""
        self._recording = recording
        self._entity = path_entity(name)
        self._color = settings.color or color
        self._width = settings.width
        self._up = np.array([0.0, 0.0, settings.height])
        self._pending: deque[tuple[int, Floats]] = deque(maxlen=_MOST_WAITING)
        self._logged: tuple[int, Floats] | None = None
        self._logged_at = 0.0
        self._styled = ""  # the frame the entity is in
        self.frame = ""

    def add(self, stamp_ns: int, path: PathPoints) -> None:
        """Add a message; an empty one may come without a frame."""
        if path.frame_id not in ("", self.frame):
            self.frame = path.frame_id
            self._pending.clear()  # they were in the other frame
        if self.frame:
            self._pending.append((stamp_ns, path.points + self._up))
            while len(self._pending) > 1 and self._size() > _MOST_BYTES:
                self._pending.popleft()

    def _size(self) -> int:
        return sum(points.nbytes for _, points in self._pending)

    def flush(self) -> None:
        """Log what has come; from time to time, the last path again."""
        now = time.monotonic()
        if self._pending:
            self._logged = self._pending[-1]
        elif self._logged is not None and now - self._logged_at > REPEAT_AFTER:
            self._pending.append(self._logged)
        else:
            return
        self._logged_at = now
        self._style()
        stamps = np.array([stamp_ns for stamp_ns, _ in self._pending])
        lines = [points for _, points in self._pending if len(points)]
        lengths = [int(len(points) > 0) for _, points in self._pending]
        self._pending.clear()
        self._recording.send_columns(
            self._entity,
            indexes=[time_column(stamps)],
            columns=rr.LineStrips3D.columns(strips=lines).partition(lengths),
        )

    def _style(self) -> None:
        """Log once in which frame the lines lie and how they look."""
        if self._styled == self.frame:
            return
        self._styled = self.frame
        look = rr.LineStrips3D.from_fields(colors=[self._color], radii=[self._width / 2])
        frame = rr.CoordinateFrame(self.frame)
        self._recording.log(self._entity, frame, look, static=True)


def path_entity(topic: str) -> str:
    """Return the entity of the paths of ``topic``."""
    return rr.new_entity_path([PATHS_ENTITY, *topic.strip("/").split("/")]).lstrip("/")
