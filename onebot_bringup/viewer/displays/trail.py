"""Where a robot has been: a line along the poses of an Odometry topic.

Every piece of the line is a row of its own, at its own time; the layout shows those of the last
seconds (see ``blueprint.py``). So the recording grows by the way driven only, never by the time
stood, a late viewer and a file have the trail too, and moving the time cursor back shortens it.
"""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.displays.tf import TIMELINE
from onebot_bringup.viewer.view_config import TrailView
from onebot_description.wire.messages import OdometrySample

TRAILS_ENTITY = "trails"
# Metres driven until the line goes on: finer would not be seen.
SPACING = 0.01
# Metres between two messages that nothing drives: a teleport or a reset, which breaks the line.
JUMP = 0.5
# What is kept while the frame of a trail hangs on nothing known: at most this many pieces.
_MOST_WAITING = 5000

Floats = NDArray[np.float64]


class _Piece(NamedTuple):
    """A straight piece of the line: its time, and its (2, 3) ends in metres."""

    stamp_ns: int
    ends: Floats


class TrailStream:
    """Logs one trail.

    Attributes:
        frame: the frame its messages name; "" before the first one.
    """

    def __init__(
        self,
        recording: rr.RecordingStream,
        name: str,
        view: TrailView,
        color: tuple[int, int, int],
    ) -> None:
        """Log into ``recording``.

        Args:
            recording: where to log.
            name: of the trail, and its entity.
            view: how it is drawn.
            color: where the view names none, sRGB bytes.
        """
        self._recording = recording
        self._view = view
        self._color = view.color or color
        self._entity = trail_entity(name)
        self._pieces: deque[_Piece] = deque(maxlen=_MOST_WAITING)
        self._start: Floats | None = None  # of the next piece
        self._last: Floats | None = None  # where the last message was
        self._last_ns = 0
        self._styled = ""  # the frame the entity is in
        self.frame = ""

    def add(self, stamp_ns: int, sample: OdometrySample) -> None:
        """Take in a message; it is logged at the next ``flush``."""
        place = np.array(sample.translation)
        place[2] += self._view.height
        if not np.isfinite(place).all() or not sample.frame_id:
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
        """Whether the robot was put elsewhere, or the time back, since the last message."""
        assert self._last is not None
        return stamp_ns < self._last_ns or bool(np.linalg.norm(place - self._last) > JUMP)

    def flush(self, connected: Callable[[str], bool]) -> bool:
        """Log what was collected in one call; True if there was anything.

        Args:
            connected: whether transforms lead from a frame to what is shown. An entity in a frame
                that hangs on nothing would be an error in the view: it waits.
        """
        if not self._pieces or not connected(self.frame):
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
        """Say once, for all pieces, in which frame they lie and how they look."""
        if self._styled == self.frame:
            return
        self._styled = self.frame
        look = rr.LineStrips3D.from_fields(colors=[self._color], radii=[self._view.width / 2])
        self._recording.log(self._entity, rr.CoordinateFrame(self.frame), look, static=True)


def trail_entity(name: str) -> str:
    """Return the entity of the trail ``name``."""
    return rr.new_entity_path([TRAILS_ENTITY, name]).lstrip("/")
