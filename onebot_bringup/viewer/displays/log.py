"""Shows what nodes log (rcl_interfaces/Log, such as /rosout) as lines of text below the robot.

Every ROS system has /rosout, and its nodes also write to a terminal, so the view is only shown on
request: by the topic's check box, ``shown: [/rosout]`` or ``log: {visible: true}``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumnKind

from onebot_bringup.viewer.core.columns import TIMELINE
from onebot_bringup.viewer.core.display import LayoutPart, SideView
from onebot_bringup.viewer.core.drawing import Drawing, TopicSettings
from onebot_bringup.viewer.core.settings import one_of, setting
from onebot_description.errors import shortened

_LEVELS = {  # the lowest number of each level
    "debug": (10, rr.TextLogLevel.DEBUG),
    "info": (20, rr.TextLogLevel.INFO),
    "warn": (30, rr.TextLogLevel.WARN),
    "error": (40, rr.TextLogLevel.ERROR),
    "fatal": (50, rr.TextLogLevel.CRITICAL),
}
_LONGEST = 5000  # characters of a line


@dataclass(frozen=True)
class LogSettings(TopicSettings):
    """Lines that nodes log."""

    visible: bool = setting(False, "draw it")
    level: str = setting("info", "the least severe level shown", one_of(*_LEVELS))


class LogView(SideView):
    """A view of the lines of one topic."""

    def view(self) -> rrb.View:
        columns = rrb.TextLogColumns(
            timeline_columns=[TIMELINE],
            text_log_columns=[TextLogColumnKind.LogLevel, TextLogColumnKind.Body],
        )
        return rrb.TextLogView(origin=self.entity, name=self.name, columns=columns)


class LogDrawing(Drawing[LogSettings]):
    """Logs the lines of one topic."""

    key = "log"
    message_types = ("rcl_interfaces/msg/Log",)
    has_header = False

    def add(self, stamp_ns: int, message: Any) -> None:
        if message.level >= _LEVELS[self.settings.level][0]:
            super().add(stamp_ns, message)

    def draw(self, message: Any) -> Sequence[rr.AsComponents]:
        text = f"[{message.name}] {message.msg}"
        return [rr.TextLog(shortened(text, _LONGEST), level=_level(message.level))]

    def change(self, settings: LogSettings) -> None:
        """Leave the previous lines as they are."""
        self._use(settings)

    def layout(self) -> LayoutPart:
        return LayoutPart(wide=(LogView(self.entity, self.name),))


def _level(number: int) -> rr.TextLogLevel:
    """Return Rerun's name of a level; numbers between two levels count as the lower one."""
    names = [name for lowest, name in _LEVELS.values() if lowest <= number]
    return rr.TextLogLevel(names[-1] if names else rr.TextLogLevel.TRACE)
