"""A rosbag2 being recorded: a folder with metadata.yaml and an MCAP file, readable at any time."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from onebot_bringup.bag.definitions import full_definition
from onebot_bringup.bag.mcap_file import CHUNK_SIZE, McapFile
from onebot_bringup.bag.metadata import FILE_NAME, Extent, Topic, metadata_yaml, qos_yaml
from onebot_description.errors import OneBotError


class BagWriter:
    """Writes messages into a new folder; see ``McapFile`` for what is safe when.

    Attributes:
        folder: the recording.
        open: messages are taken; False once closed, or after a failure.
    """

    def __init__(
        self, folder: Path, *, compress: bool = True, chunk_size: int = CHUNK_SIZE
    ) -> None:
        """Make the folder, with a recording of no messages.

        Args:
            folder: must not exist, as ``ros2 bag record`` wants it; the one above it must.
            compress: the messages, with zstd.
            chunk_size: bytes that are compressed together.

        Raises:
            OneBotError: it cannot be made.
        """
        self.folder = folder
        self._topics: dict[Topic, int] = {}
        self._schemas: dict[str, int] = {}
        self.open = False
        with self._explained():
            try:
                folder.mkdir()
            except FileExistsError:
                raise OneBotError(f"{folder} exists already: name a new folder") from None
            path = folder / f"{folder.name}_0.mcap"
            self._file = McapFile(path, compress=compress, library="onebot", chunk_size=chunk_size)
            self.open = True
            self._write_metadata()

    @property
    def message_count(self) -> int:
        """Of all topics."""
        return self._file.statistics.message_count

    @property
    def topic_count(self) -> int:
        """Topics added so far."""
        return len(self._topics)

    def add_topic(self, topic: Topic) -> int:
        """Add a topic, and return what ``write`` calls it.

        Raises:
            OneBotError: the definition of its type is not installed.
        """
        schema = self._schema(topic.type)
        metadata = {"offered_qos_profiles": qos_yaml(topic.offered), "topic_type_hash": topic.hash}
        number = self._file.add_channel(topic.name, schema, metadata)
        self._topics[topic] = number
        return number

    def _schema(self, type_name: str) -> int:
        if type_name not in self._schemas:
            definition = full_definition(type_name)
            self._schemas[type_name] = self._file.add_schema(type_name, definition)
        return self._schemas[type_name]

    def write(self, topic: int, time_ns: int, data: bytes, publish_ns: int | None = None) -> None:
        """Add a message.

        Args:
            topic: from ``add_topic``.
            time_ns: when it was received, nanoseconds.
            data: CDR, as on the wire.
            publish_ns: when it was sent, nanoseconds; None where that is not known.

        Raises:
            OneBotError: it cannot be written; what was written before is kept.
        """
        if self.open:
            with self._explained():
                sent = time_ns if publish_ns is None else publish_ns
                self._file.add_message(topic, time_ns, sent, data)

    def checkpoint(self) -> None:
        """Make the folder hold all that was added; about once a second.

        Raises:
            OneBotError: it cannot be written, or the folder is gone.
        """
        if not self.open:
            return
        with self._explained():
            if self._file.vanished:
                raise OneBotError(f"{self._file.path} was deleted or moved while recording")
            if self._file.checkpoint():
                self._write_metadata()

    def _write_metadata(self) -> None:
        statistics = self._file.statistics
        extent = Extent(
            statistics.message_count, statistics.message_start_time, statistics.message_end_time
        )
        counts = statistics.channel_message_counts
        topics = {topic: counts[number] for topic, number in self._topics.items()}
        text = metadata_yaml(self._file.path.name, extent, topics)
        # Replaced as a whole: a reader, or a kill, never meets half of it.
        new = self.folder / f".{FILE_NAME}"
        try:
            new.write_text(text)
            os.replace(new, self.folder / FILE_NAME)
        except OSError:
            new.unlink(missing_ok=True)
            raise

    def close(self) -> None:
        """Write what is left.

        Raises:
            OneBotError: it cannot be written.
        """
        if self.open:
            try:
                self.checkpoint()
            finally:
                self._stop()

    def _stop(self) -> None:
        if self.open:
            self.open = False
            with contextlib.suppress(OSError):  # of a second attempt; the first one told why
                self._file.close()

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn a failure to write into one sentence, and end the recording."""
        try:
            yield
        except OSError as error:
            self._stop()
            raise OneBotError(f"cannot record to {self.folder}: {error.strerror}") from error
        except OneBotError:
            self._stop()
            raise
