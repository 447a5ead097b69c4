"""Reads rosbag2's SQLite files: stored data only, interruptible by Ctrl-C."""

import sqlite3
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from onebot_bringup.bags.contents import (
    DAMAGE,
    OFFERED,
    BagMessage,
    Contents,
    check_size,
    open_file,
)
from onebot_description.errors import OneBotError

_LOGGED = b"\2\2"  # mark in the header of a SQLite file written with a write-ahead log
_STEPS = 100_000  # steps of SQLite, some ms, between two checks for Ctrl-C
# Views and computed columns could yield endless data, so only stored tables are read.
_TABLES = """
    SELECT name FROM sqlite_master
    WHERE type = 'table' AND rootpage > 0 AND name IN ('topics', 'messages', 'message_definitions')
        AND NOT EXISTS (SELECT 1 FROM pragma_table_xinfo(sqlite_master.name) WHERE hidden)
"""
_TOPICS = "SELECT * FROM topics WHERE serialization_format = 'cdr'"
_DEFINITIONS = """
    SELECT topic_type, encoded_message_definition FROM message_definitions
    WHERE encoding = 'ros2msg'
"""  # exist since Iron
_EXTENTS = "SELECT topic_id, count(*), min(timestamp), max(timestamp) FROM messages GROUP BY 1"
_MESSAGES = """
    SELECT topic_id, timestamp, length(data), CASE WHEN length(data) <= ? THEN data END
    FROM messages WHERE topic_id IN ({}) ORDER BY timestamp, id
"""


class SqliteFile:
    """An open SQLite file, with the interface of ``McapFile``; ``max_size`` is per message."""

    def __init__(self, path: Path, max_size: int) -> None:
        self._path, self._max_size = path, max_size
        options = "mode=ro"  # otherwise SQLite would create a missing file
        with open_file(path) as file:
            # SQLite would also create a missing log beside it. (Foxy's files have one while they
            # are written.)
            if file.read(20)[-2:] == _LOGGED and not Path(f"{path}-wal").is_file():
                options += "&immutable=1"
        url = f"{path.absolute().as_uri()}?{options}"
        self._database = sqlite3.connect(url, uri=True)
        self._database.set_progress_handler(lambda: 0, _STEPS)

    def close(self) -> None:
        self._database.close()

    def describe(self, contents: Contents) -> None:
        """Add the file's contents.

        Raises:
            OneBotError: it is damaged, or not a recording.
        """
        try:
            topics = self._topics()
            for topic in topics.values():
                contents.add_topic(topic["name"], topic["type"], str(topic.get(OFFERED) or ""))
            if "message_definitions" in self._tables():
                for kind, definition in self._rows(_DEFINITIONS):
                    contents.definitions.setdefault(kind, definition)
            for number, *extent in self._rows(_EXTENTS):
                if number in topics:
                    contents.add_messages(topics[number]["name"], *extent)
        except DAMAGE as error:
            raise OneBotError(f"{self._path} is not a rosbag2 recording: {error}") from error

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """Yield messages by time; damage raises one of ``DAMAGE``."""
        chosen = {n: topic for n, topic in self._topics().items() if topic["name"] in topics}
        query = _MESSAGES.format(", ".join("?" * len(chosen)))
        for number, stamp, size, data in self._rows(query, self._max_size, *chosen):
            check_size("a message", size, self._max_size)
            yield BagMessage(chosen[number]["name"], chosen[number]["type"], stamp, data)

    def _topics(self) -> dict[Any, dict[str, Any]]:
        """Return the rows of the topics by id; their columns depend on the distro."""
        if not {"topics", "messages"} <= self._tables():
            raise ValueError("the tables topics and messages are missing")
        columns = [name for _, name, *_ in self._rows("PRAGMA table_info(topics)")]
        rows = [dict(zip(columns, row, strict=True)) for row in self._rows(_TOPICS)]
        return {row["id"]: row for row in rows}

    def _tables(self) -> set[str]:
        return {name for (name,) in self._rows(_TABLES)}

    def _rows(self, query: str, *values: Any) -> Iterator[tuple[Any, ...]]:
        try:
            yield from self._database.execute(query, values)
        except sqlite3.OperationalError as error:
            if str(error) == "interrupted":  # SQLite stops, but drops the handler's exception
                raise KeyboardInterrupt from error
            raise
