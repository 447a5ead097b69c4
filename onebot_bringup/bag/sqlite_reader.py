"""Reads the SQLite files of rosbag2 (.db3), which it wrote by default before Iron."""

import sqlite3
from collections.abc import Callable, Collection, Iterator
from contextlib import closing
from pathlib import Path

from onebot_bringup.bag.messages import BagMessage, Contents
from onebot_description.errors import OneBotError

# SQLite lets anything be in any column.
_TOPICS = """
    SELECT name, type FROM topics
    WHERE serialization_format = 'cdr' AND typeof(name) = 'text' AND typeof(type) = 'text'
"""
_MESSAGES = """
    SELECT topics.name, topics.type, messages.timestamp, messages.data
    FROM messages JOIN topics ON messages.topic_id = topics.id
    WHERE topics.name IN ({})
        AND typeof(messages.data) = 'blob' AND typeof(messages.timestamp) = 'integer'
    ORDER BY messages.timestamp, messages.id
"""


def topics_of_sqlite(path: Path) -> Contents:
    """Return what is in the file.

    Raises:
        OneBotError: it is no recording.
    """
    try:
        with closing(_connect(path)) as database:
            topics = dict(database.execute(_TOPICS))
            (count,) = database.execute("SELECT count(*) FROM messages").fetchone()
    except sqlite3.Error as error:
        raise OneBotError(f"{path} is no recording of rosbag2: {error}") from error
    return Contents(topics, int(count))


def read_sqlite(
    path: Path, topics: Collection[str], warn: Callable[[str], None]
) -> Iterator[BagMessage]:
    """Yield the messages of ``topics`` in the order of their times.

    Args:
        path: the file.
        topics: names.
        warn: told if the file is damaged.
    """
    query = _MESSAGES.format(", ".join("?" * len(topics)))
    try:
        with closing(_connect(path)) as database:
            for topic, kind, stamp, data in database.execute(query, list(topics)):
                yield BagMessage(topic, kind, stamp, data)
    except sqlite3.Error as error:
        warn(f"{path} is damaged: {error}; showing what comes before")


def _connect(path: Path) -> sqlite3.Connection:
    # Read-only, or a file that is missing would be made.
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
