"""Chooses which of the available topics to show, in addition to those that the view names."""

from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple

from onebot_bringup.introspection.interfaces import is_hidden
from onebot_bringup.viewer.core.stage import Stage
from onebot_bringup.viewer.displays import DRAWING_BY_TYPE
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.errors import OneBotError, listing

# Limits of the topics shown automatically: more would be unreadable, and the page would lag behind.
MAX_SHOWN, MAX_HIGH_BANDWIDTH = 40, 6
_LISTED = 5  # topics named in a message


class OfferedTopic(NamedTuple):
    """A topic that could be shown."""

    topic: str  # its full name
    type: str
    visible: bool


def choose_topics(
    stage: Stage,
    view: ViewConfig,
    published: Mapping[str, str],
    drawn_otherwise: Collection[str] = (),
    offered: Iterable[OfferedTopic] = (),
) -> tuple[list[OfferedTopic], list[str]]:
    """Choose the topics to show; a topic once shown stays, whatever is published later.

    Args:
        stage: where they are drawn.
        view: its settings.
        published: message types by full topic names.
        drawn_otherwise: topics that the view already draws, such as trails.
        offered: the previous result.

    Returns:
        The topics that could be shown, and one sentence per thing that cannot.
    """
    topics, problems = _readable(stage, published)
    resolve = stage.resolve
    kept = {offer.topic for offer in offered if offer.visible}
    hidden, named = set(map(resolve, view.hidden)), set(map(resolve, view.shown))
    visible, crowded = set[str](), list[str]()
    room = {False: MAX_SHOWN, True: MAX_HIGH_BANDWIDTH}
    for topic in sorted(topics, key=lambda name: (name not in kept, name)):
        drawing = DRAWING_BY_TYPE[topics[topic]]
        settings = view.settings_of(drawing)
        of_topics = {resolve(name): setting for name, setting in settings.topics.items()}
        is_excluded = is_hidden(topic) or topic in drawn_otherwise
        is_excluded = is_excluded or drawing.is_duplicate(topic, topics)
        chosen = topic in named or topic in of_topics
        drawn = topic in named or of_topics.get(topic, settings).visible
        is_wanted = chosen or (view.automatic and not is_excluded)
        if topic in hidden or not drawn or not is_wanted:
            continue
        if chosen or room[drawing.high_bandwidth] > 0:
            visible.add(topic)
            room[drawing.high_bandwidth] -= 1
        else:
            crowded.append(topic)
    if crowded:
        names = listing(crowded, _LISTED)
        problems.append(f"too many topics, not shown: {names}; add them with shown: in a view")
    names_and_types = sorted(topics.items())
    return [OfferedTopic(name, kind, name in visible) for name, kind in names_and_types], problems


def _readable(stage: Stage, published: Mapping[str, str]) -> tuple[dict[str, str], list[str]]:
    """Return the topics whose type has a display and a readable definition, and problems."""
    readable, bad = {}, {}
    for topic, kind in published.items():
        if kind in DRAWING_BY_TYPE and kind not in bad:
            try:
                stage.message_type(kind)
                readable[topic] = kind
            except (OneBotError, ValueError) as error:
                topics = [name for name, topic_type in published.items() if topic_type == kind]
                bad[kind] = f"{listing(topics, _LISTED)} cannot be shown: {error}"
    return readable, list(bad.values())
