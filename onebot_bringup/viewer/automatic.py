"""Chooses which of the available topics to show, beside the topics that the view names."""

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from onebot_bringup.introspection.interfaces import is_hidden
from onebot_bringup.viewer.displays import MESSAGE_DRAWINGS
from onebot_bringup.viewer.displays.drawing import Drawing
from onebot_description.errors import OneBotError, listing

if TYPE_CHECKING:
    from onebot_bringup.viewer.stage import Stage

# Topics that are shown by themselves: more are a wall of curves, and a page that cannot keep up.
MOST_SHOWN, MOST_HEAVY = 40, 6
_LISTED = 5  # topics

MESSAGE_DISPLAYS: Mapping[str, type[Drawing[Any]]] = {
    name: drawing for drawing in MESSAGE_DRAWINGS for name in drawing.message_types
}
"""What draws each message type."""


class OfferedTopic(NamedTuple):
    """A topic that could be shown."""

    topic: str  # its full name
    type: str
    visible: bool


class TopicSelection:
    """Keeps the choice of topics."""

    def __init__(self, stage: "Stage") -> None:
        self.offered: tuple[OfferedTopic, ...] = ()
        self.stage = stage

    def choose(self, published: Mapping[str, str], drawn_otherwise: Collection[str]) -> list[str]:
        """Choose topics; a topic that is shown stays, whatever else is published later.

        Args:
            published: the type of each by its full name.
            drawn_otherwise: topics not shown by themselves, since the view draws them, as a trail.

        Returns:
            What cannot be shown, a sentence each.
        """
        topics, problems = self._readable(published)
        view, resolve = self.stage.view, self.stage.resolve
        kept = {display.topic for display in self.offered if display.visible}
        hidden, named = set(map(resolve, view.hidden)), set(map(resolve, view.shown))
        visible, crowded = set[str](), list[str]()
        room = {False: MOST_SHOWN, True: MOST_HEAVY}
        for topic in sorted(topics, key=lambda name: (name not in kept, name)):
            drawing = MESSAGE_DISPLAYS[topics[topic]]
            settings = view.of(drawing)
            of_topics = {resolve(name): setting for name, setting in settings.topics.items()}
            is_excluded = is_hidden(topic) or topic in drawn_otherwise
            is_excluded = is_excluded or drawing.is_duplicate(topic, topics)
            chosen = topic in named or topic in of_topics
            drawn = topic in named or of_topics.get(topic, settings).visible
            is_wanted = chosen or (view.automatic and not is_excluded)
            if topic in hidden or not drawn or not is_wanted:
                continue
            if chosen or room[drawing.heavy] > 0:
                visible.add(topic)
                room[drawing.heavy] -= 1
            else:
                crowded.append(topic)
        self.offered = tuple(
            OfferedTopic(topic, topics[topic], topic in visible) for topic in sorted(topics)
        )
        if crowded:
            names = listing(crowded, _LISTED)
            problems.append(f"too many topics to show all: not {names}; shown: in a view adds some")
        return problems

    def _readable(self, published: Mapping[str, str]) -> tuple[dict[str, str], list[str]]:
        """Return the topics whose type has a display, and a definition that can be read."""
        readable, bad = {}, {}
        for topic, kind in published.items():
            if kind in MESSAGE_DISPLAYS and kind not in bad:
                try:
                    self.stage.message_type(kind)
                    readable[topic] = kind
                except (OneBotError, ValueError) as error:
                    topics = [name for name, topic_type in published.items() if topic_type == kind]
                    bad[kind] = f"{listing(topics, _LISTED)} cannot be shown: {error}"
        return readable, list(bad.values())

    def of(self, drawing: type[Drawing[Any]]) -> dict[str, str]:
        """Return the topics that are to be drawn so, with their types."""
        return {
            display.topic: display.type
            for display in self.offered
            if display.visible and display.type in drawing.message_types
        }
