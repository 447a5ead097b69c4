"""Reads recordings of ROS 2, ours or anyone's: MCAP files, SQLite files, and folders of them."""

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml
import zstandard

from onebot_bringup.bag.mcap_reader import read_mcap, topics_of_mcap
from onebot_bringup.bag.messages import BagMessage, Contents
from onebot_bringup.bag.metadata import FILE_NAME
from onebot_bringup.bag.sqlite_reader import read_sqlite, topics_of_sqlite
from onebot_description.errors import OneBotError

MCAP, SQLITE = ".mcap", ".db3"
_Read = Callable[[Path, Collection[str], Callable[[str], None]], Iterator[BagMessage]]
_READERS: Mapping[str, _Read] = {MCAP: read_mcap, SQLITE: read_sqlite}
_CONTENTS: Mapping[str, Callable[[Path], Contents]] = {
    MCAP: topics_of_mcap,
    SQLITE: topics_of_sqlite,
}


class Bag:
    """A recording that exists.

    Attributes:
        source: the file or folder.
        topics: the type of each topic, ``package/msg/Type``.
        count: of all messages; 0 where that is not known without reading them.
        warnings: what is not as it should be, though it can be read; reading may add to them.
    """

    def __init__(self, source: Path) -> None:
        """Look into the recording at ``source``.

        Raises:
            OneBotError: there is none, or none that can be read.
        """
        self.source = source
        self.warnings: list[str] = []
        self._compressed = False
        self._files = self._find()
        self.topics: dict[str, str] = {}
        self.count = 0
        for file in self._files:
            contents = _CONTENTS[file.suffix](file)
            self.topics |= contents.topics
            self.count += contents.count

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """Return the messages of ``topics``, by the time they were received.

        What is damaged ends the file it is in, with a warning.

        Raises:
            OneBotError: they are not compressed as metadata.yaml says.
        """
        for file in self._files:
            for message in _READERS[file.suffix](file, topics, self.warnings.append):
                yield self._unpacked(message) if self._compressed else message

    def _unpacked(self, message: BagMessage) -> BagMessage:
        try:
            unpacked = zstandard.ZstdDecompressor().decompressobj().decompress(message.data)
        except zstandard.ZstdError as error:
            raise OneBotError(
                f"{self.source / FILE_NAME} says compression_mode: message, but a message of "
                f"{message.topic} is not compressed by zstd: correct it to compression_mode: ''"
            ) from error
        return message._replace(data=unpacked)

    # --- files ----------------------------------------------------------------------------------

    def _find(self) -> list[Path]:
        source = self.source
        if source.is_dir():
            return self._in_folder()
        if not source.exists():
            raise OneBotError(f"there is no recording {source}")
        if source.suffix not in _READERS:
            raise OneBotError(
                f"{source} is no recording: its name must end in .mcap, .db3 or .rrd, or be that "
                "of a folder that ros2 bag has made"
            )
        return [source]

    def _in_folder(self) -> list[Path]:
        """The files that metadata.yaml names, or else those that are there."""
        there = [path for path in self.source.iterdir() if path.suffix in _READERS]
        information = self._metadata()
        if information is None:
            if not there:
                raise OneBotError(
                    f"{self.source} is no recording: it holds neither {FILE_NAME} nor a .mcap or "
                    ".db3 file"
                )
            return sorted(there, key=_by_number)
        mode = str(information.get("compression_mode") or "").lower()
        if mode == "file":
            raise OneBotError(
                f"{self.source} is compressed as whole files: unpack it by ros2 bag convert, or by "
                "unzstd and the names in metadata.yaml"
            )
        self._compressed = mode == "message"
        names = information.get("relative_file_paths") or []
        files = [self.source / Path(str(name)).name for name in names]
        missing = [file.name for file in files if not file.is_file()]
        files = [file for file in files if file.is_file() and file.suffix in _READERS]
        if not files:
            raise OneBotError(f"{self.source} lacks its files: {', '.join(missing) or 'none'}")
        if missing:
            self.warnings.append(f"{self.source} lacks {', '.join(missing)}; showing the others")
        return files

    def _metadata(self) -> Mapping[str, Any] | None:
        path = self.source / FILE_NAME
        try:
            found = yaml.safe_load(path.read_text())["rosbag2_bagfile_information"]
            found.get("relative_file_paths")
        except OSError:
            self.warnings.append(f"{self.source} has no {FILE_NAME}; showing the files that it has")
            return None
        except (yaml.YAMLError, TypeError, KeyError, AttributeError, ValueError):
            self.warnings.append(f"{path} is damaged; showing the files beside it")
            return None
        information: Mapping[str, Any] = found
        return information


def _by_number(path: Path) -> tuple[object, ...]:
    """A key that puts x_9 before x_10."""
    parts = re.split(r"(\d+)", path.name)
    return tuple(int(part) if part.isdigit() else part for part in parts)
