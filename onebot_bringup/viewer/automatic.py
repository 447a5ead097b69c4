"""What is shown without being named: which topics, and how much of what comes on them."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from onebot_bringup.viewer.displays import DISPLAYS
from onebot_bringup.viewer.displays.message_display import MessageDisplay
from onebot_bringup.viewer.view_config import ViewConfig

T = TypeVar("T")

# Topics that are shown by themselves: more are a wall of curves, and a page that cannot keep up.
MOST_SHOWN, MOST_HEAVY = 40, 6

MESSAGE_DISPLAYS: Mapping[str, type[MessageDisplay[Any]]] = {
    name: display
    for display in DISPLAYS
    if issubclass(display, MessageDisplay)
    for name in display.message_types
}
"""The display of each message type."""


class OfferedTopic(NamedTuple):
    """A topic that could be shown."""

    topic: str  # its full name
    type: str
    visible: bool


class TopicSelection:
    """Chooses of the topics that there are those that are shown."""

    def __init__(self, resolve: Callable[[str], str]) -> None:
        self.offered: tuple[OfferedTopic, ...] = ()
        self.crowded: tuple[str, ...] = ()  # topics for which there is no room
        self._resolve = resolve

    def choose(
        self, topics: Mapping[str, str], view: ViewConfig, drawn_otherwise: Collection[str] = ()
    ) -> None:
        """Choose of ``topics``; those that are shown stay so, whatever else is published later.

        Args:
            topics: the type of each by its full name.
            view: what to show.
            drawn_otherwise: topics not shown by themselves, since the view draws them, as a trail.
        """
        kept = {each.topic for each in self.offered if each.visible}
        known = [name for name, kind in topics.items() if kind in MESSAGE_DISPLAYS]
        hidden, named = set(map(self._resolve, view.hidden)), set(map(self._resolve, view.shown))
        visible, crowded = set[str](), list[str]()
        room = {False: MOST_SHOWN, True: MOST_HEAVY}
        for topic in sorted(known, key=lambda name: (name not in kept, name)):
            display = MESSAGE_DISPLAYS[topics[topic]]
            settings = view.of(display)
            looks = {self._resolve(name): look for name, look in settings.topics.items()}
            other = _is_hidden(topic) or topic in drawn_otherwise
            other = other or display.is_duplicate(topic, topics)
            chosen = topic in named or topic in looks
            drawn = topic in named or looks.get(topic, settings).visible
            wanted = chosen or (view.automatic and not other)
            if topic in hidden or not drawn or not wanted:
                continue
            if chosen or room[display.heavy] > 0:
                visible.add(topic)
                room[display.heavy] -= 1
            else:
                crowded.append(topic)
        self.crowded = tuple(crowded)
        self.offered = tuple(
            OfferedTopic(topic, topics[topic], topic in visible) for topic in sorted(known)
        )

    def of(self, display: MessageDisplay[Any]) -> dict[str, str]:
        """Return the topics that a display is to draw, with their types."""
        return {
            each.topic: each.type
            for each in self.offered
            if each.visible and each.type in display.message_types
        }


def _is_hidden(topic: str) -> bool:
    """Whether it is hidden by ROS's rule, as what tools use among themselves."""
    return any(part.startswith("_") for part in topic.split("/"))


# How much of its time the viewer may spend on one display, and seconds that it may save up.
_SHARE, _SAVED = 0.25, 0.5
_FADING, _FEW = 0.7, 0.1  # of the messages whose cost is known: what is left after each call
_BYTES_PER_SECOND = 400e6  # that Rerun copies, encodes and sends on in threads of its own


class LoadLimit:
    """Drops old messages of a display whose topics bring more than can be shown.

    The display has so many seconds of each second; what a message takes is measured.
    """

    def __init__(self) -> None:
        self._left = _SAVED  # seconds
        self._seconds = self._messages = 0.0  # that were spent on how many, of late
        self._at: float | None = None
        self._bytes = 0
        self._count = 0
        self.dropped = 0  # messages, in all

    def ready(self, now: float) -> bool:
        """Whether there is time for a message at ``now``, seconds."""
        if self._at is not None:
            self._left = min(_SAVED, self._left + _SHARE * max(0.0, now - self._at))
        self._at = now
        return self._left > 0.0

    def admit(self, messages: Sequence[T], sizes: Iterable[int]) -> Sequence[T]:
        """Return the newest messages that there is time for, one at least."""
        cost = self._seconds / self._messages if self._messages else 0.0
        most = max(1, int(self._left / cost)) if cost else len(messages)
        self.dropped += max(0, len(messages) - most)
        admitted = messages[-most:]
        self._count += len(admitted)
        self._bytes += sum(list(sizes)[-most:])
        return admitted

    def spent(self, seconds: float) -> None:
        """Take the time that the messages admitted have taken, or those of a moment ago.

        Some wait for a transform.
        """
        seconds += self._bytes / _BYTES_PER_SECOND
        self._left -= seconds
        if self._count or self._messages > _FEW:
            self._seconds = _FADING * self._seconds + seconds
            self._messages = _FADING * self._messages + self._count
        self._bytes = self._count = 0
