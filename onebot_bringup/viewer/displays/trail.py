"""Where a robot has been: a line along the poses of an Odometry topic.

Every piece of the line is a row of its own, at its own time; the layout shows those of the last
seconds. So the recording grows by the way driven only, never by the time
stood, a late viewer and a file have the trail too, and moving the time cursor back shortens it.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.columns import TIMELINE
from onebot_bringup.viewer.displays.display import (
    LARGEST,
    ODOMETRY,
    SELDOM,
    ItemsDisplay,
    LayoutPart,
)
from onebot_bringup.viewer.settings import Color, color, height, setting, topic
from onebot_description.parameters.reader import REQUIRED
from onebot_description.wire.messages import OdometrySample

TRAILS_ENTITY = "trails"
# Metres driven until the line goes on: finer would not be seen.
SPACING = 0.01
# Metres between two messages that nothing drives: a teleport or a reset, which breaks the line.
JUMP = 0.5
# What is kept while no transform leads to the frame of a trail: at most this many pieces.
_MOST_WAITING = 5000

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class TrailSettings:
    """A line along the poses of an Odometry topic."""

    topic: str = setting(REQUIRED, "an Odometry topic", topic)
    color: Color | None = setting(None, "sRGB bytes; by default one of ours", color)
    width: float = setting(0.01, "of the line, metres")
    height: float = setting(0.0, "metres above the poses; negative to lay it on the ground", height)
    length: float = setting(60.0, "how many seconds of it are shown; 0 for all")


class TrailDisplay(ItemsDisplay[Mapping[str, TrailSettings], "TrailStream"]):
    """Draws where the robot has been."""

    key = "trails"
    Settings = TrailSettings
    named = True
    noun = "trail"
    types = (ODOMETRY,)
    period_ns = SELDOM  # what lags behind is under the robot

    def wanted(
        self, settings: Mapping[str, TrailSettings]
    ) -> Mapping[str, tuple[str, TrailSettings]]:
        """Return the trails."""
        return {name: (trail.topic, trail) for name, trail in settings.items()}

    def make(self, name: str, settings: TrailSettings, color: Color) -> "TrailStream":
        """Return a trail."""
        return TrailStream(self.context.recording, name, settings, color)

    def layout(self) -> LayoutPart:
        """Return the trails, and how much of them is shown."""
        windows = {trail_entity(name): item.settings.length for name, item in self.items.items()}
        return LayoutPart(
            hidden=(TRAILS_ENTITY,), shown=tuple(windows), windows=tuple(windows.items())
        )


class _Piece(NamedTuple):
    """A straight piece of the line: its time, and its (2, 3) ends in metres."""

    stamp_ns: int
    ends: Floats


class TrailStream:
    """Logs one trail."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        name: str,
        settings: TrailSettings,
        color: Color,
    ) -> None:
        """Log into ``recording``.

        Args:
            recording: where to log.
            name: of the trail, and its entity.
            settings: how it is drawn.
            color: where the settings have none.
        """
        self._recording = recording
        self.settings = settings
        self._color = settings.color or color
        self._entity = trail_entity(name)
        self._pieces: deque[_Piece] = deque(maxlen=_MOST_WAITING)
        self._start: Floats | None = None  # of the next piece
        self._last: Floats | None = None  # where the last message was
        self._last_ns = 0
        self._styled = ""  # the frame the entity is in
        self.frame = ""  # that its messages name

    def add(self, stamp_ns: int, sample: OdometrySample) -> None:
        """Add a message; it is logged at the next ``flush``."""
        place = np.array(sample.translation)
        place[2] += self.settings.height
        if not (np.abs(place) <= LARGEST).all() or not sample.frame_id:
            self._start = None
            return
        if sample.frame_id != self.frame:
            self.frame = sample.frame_id
            self._pieces.clear()  # they were in the other frame
            self._start = None
        if self._start is None or self._broken(stamp_ns, place):
            self._start = place
        elif np.linalg.norm(place - self._start) >= SPACING:
            self._pieces.append(_Piece(stamp_ns, np.array([self._start, place])))
            self._start = place
        self._last, self._last_ns = place, stamp_ns

    def _broken(self, stamp_ns: int, place: Floats) -> bool:
        """Whether the robot was moved, or the time set back, since the last message."""
        assert self._last is not None
        return stamp_ns < self._last_ns or bool(np.linalg.norm(place - self._last) > JUMP)

    def flush(self) -> bool:
        """Log what was collected in one call; True if there was anything."""
        if not self._pieces:
            return False
        self._style()
        pieces = list(self._pieces)
        self._pieces.clear()
        stamps = np.array([piece.stamp_ns for piece in pieces], "datetime64[ns]")
        self._recording.send_columns(
            self._entity,
            indexes=[rr.TimeColumn(TIMELINE, timestamp=stamps)],
            columns=rr.LineStrips3D.columns(strips=[piece.ends for piece in pieces]),
        )
        return True

    def _style(self) -> None:
        """Log once, for all pieces, in which frame they lie and how they look."""
        if self._styled == self.frame:
            return
        self._styled = self.frame
        look = rr.LineStrips3D.from_fields(colors=[self._color], radii=[self.settings.width / 2])
        self._recording.log(self._entity, rr.CoordinateFrame(self.frame), look, static=True)


def trail_entity(name: str) -> str:
    """Return the entity of the trail ``name``."""
    return rr.new_entity_path([TRAILS_ENTITY, name]).lstrip("/")
