"""What type a topic has, by the nodes that publish it or listen to it."""

from typing import Any

from onebot_bringup.cli.ros_session import Session
from onebot_bringup.introspection.interfaces import message_class
from onebot_description.errors import OneBotError
from onebot_description.text import did_you_mean, nearest


def await_class(session: Session, name: str, type_name: str | None = None) -> tuple[str, Any]:
    """Return a topic's full name and its message class, waiting until the topic is there.

    Args:
        session: looks around.
        name: of the topic, absolute or relative.
        type_name: of the messages; None to take what the topic has.

    Raises:
        OneBotError: the type is not installed, or the topic has several.
    """
    topic = session.full_name(name)
    if type_name is not None:
        kind = message_class(type_name)
        # The QoS that suits the publishers shows when they do.
        session.spin(lambda: session.node.count_publishers(topic), 1.0)
        session.spin(lambda: False, 0.1)
        return topic, kind
    types = session.await_or_say(lambda: _types(session, topic), lambda: _missing(session, topic))
    # Others may publish it too, with another QoS or even another type.
    session.spin(lambda: False, 0.1)
    types = _types(session, topic) or types
    if len(types) > 1:
        raise OneBotError(
            f"Cannot echo topic '{topic}', as it contains more than one type: "
            f"[{', '.join(types)}]; name the one you want"
        )
    return topic, message_class(types[0])


def _types(session: Session, topic: str) -> list[str]:
    return list(dict(session.node.get_topic_names_and_types()).get(topic, []))


def _missing(session: Session, topic: str) -> str:
    guess = nearest(topic, (name for name, _ in session.topics()))
    meant = f' (did you mean "{guess}"?)' if guess else ""
    return f"WARNING: topic [{topic}] does not appear to be published yet{meant}; waiting for it"


def types_of(session: Session, name: str) -> tuple[str, list[str]]:
    """Return the full name and the types of a topic that is there.

    Raises:
        OneBotError: it does not turn up; the message lists near names.
    """
    topic = session.full_name(name)
    types = session.look_for(lambda: _types(session, topic), f"the topic {topic}")
    if not types:
        raise OneBotError(
            f"Unknown topic '{topic}'"
            f"{did_you_mean(topic, (known for known, _ in session.topics()), 'topics')}"
        )
    return topic, list(types)
