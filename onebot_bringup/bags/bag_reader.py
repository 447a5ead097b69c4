"""Reads ROS 2 recordings of any origin: MCAP files, SQLite files, and folders of them."""

import shutil
import tempfile
import weakref
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import zstandard

from onebot_bringup.bags.contents import (
    DAMAGE,
    BagMessage,
    Contents,
    check_size,
    decompressed,
    megabytes,
    open_file,
)
from onebot_bringup.bags.mcap_file import McapFile
from onebot_bringup.bags.sqlite_file import SqliteFile
from onebot_description.errors import OneBotError, natural_order
from onebot_description.ros.wire.interface_text import full_definition

MAX_SIZE = 256_000_000  # bytes
_FILE_RATIO = 100  # maximum growth of a whole compressed file

# Besides the chunks of an MCAP file, rosbag2 can compress whole files or single messages.
_COMPRESSED = ".zstd"
_FRAME = b"\x28\xb5\x2f\xfd"  # zstd data begins with this, CDR never does
_ROS1 = ".bag"
_STORAGES = {".mcap": "mcap", ".db3": "sqlite3"}


class Bag(Contents):
    """An existing recording, with its contents.

    Attributes:
        source: the file or folder.
        files: the files with the messages, in order.
        storage: rosbag2's name of the storage: mcap or sqlite3.
        warnings: problems that were found while reading messages.
    """

    def __init__(self, source: Path, max_size: int = MAX_SIZE) -> None:
        """Open a file or folder.

        Args:
            source: the file or folder.
            max_size: the maximum size of a message or chunk, bytes.

        Raises:
            OneBotError: it cannot be read.
        """
        super().__init__()
        self.source = source
        self._max_size = max_size
        self.warnings: list[str] = []
        try:
            self.files = self._find()
        except OSError as error:  # a folder cannot be listed, or a file cannot have that name
            raise OneBotError(f"{source} cannot be read: {error.strerror}") from error
        self._readable = [self._decompressed(file) for file in self.files]
        self.storage = _STORAGES[self._readable[0].suffix]
        for file in self._readable:
            with closing(self._open(file)) as opened:
                opened.describe(self)
        if not self.topics and self.count:
            raise OneBotError(f"{source} holds no messages of ROS 2 (in CDR)")

    def _open(self, file: Path) -> McapFile | SqliteFile:
        kind = McapFile if file.suffix == ".mcap" else SqliteFile
        return kind(file, self._max_size)

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """Yield the messages of ``topics``, file by file, ordered by time.

        For a damaged file, the messages before the damage are yielded, and a warning is added.
        """
        for file in self._readable:
            try:
                with closing(self._open(file)) as opened:
                    for message in opened.messages(topics):
                        if message.data.startswith(_FRAME):
                            plain = decompressed(message.data, self._max_size)
                            yield message._replace(data=plain)
                        else:
                            yield message
            except DAMAGE as error:
                name = f"{file} ({megabytes(file.stat().st_size)})"
                self.warnings.append(f"{name}: {_reason(error)}; only the data before it was read")

    def definition(self, type_name: str) -> str:
        """Return the definition of a type, from the recording or an installed package.

        Raises:
            OneBotError: there is none.
        """
        if type_name in self.definitions:
            return self.definitions[type_name]
        try:
            return full_definition(type_name)
        except (OneBotError, ValueError) as error:  # ValueError: not a ROS 2 type name
            raise OneBotError(
                f"the definition of {type_name} is neither in {self.source} nor installed"
            ) from error

    def _decompressed(self, file: Path) -> Path:
        """Return the file, decompressed if necessary into a temporary folder of the bag."""
        if file.suffix != _COMPRESSED:
            return file
        folder = tempfile.mkdtemp(prefix="onebot-")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        target = Path(folder, file.stem)
        limit = max(self._max_size, _FILE_RATIO * file.stat().st_size)
        try:
            with open_file(file) as source, target.open("wb") as plain:

                def read(size: int) -> bytes:  # Ctrl-C is handled between two calls of Python
                    check_size("a gap", source.tell() - plain.tell(), self._max_size)
                    return source.read(size)

                reader: Any = SimpleNamespace(read=read)
                for part in zstandard.ZstdDecompressor().read_to_iter(reader):
                    plain.write(part)
                    check_size("its content", plain.tell(), limit)
        except (OSError, zstandard.ZstdError, ValueError) as error:
            raise OneBotError(f"{file} cannot be decompressed into {folder}: {error}") from error
        return target

    def _find(self) -> list[Path]:
        """Return the files with the messages, in order."""
        source = self.source
        if source.is_dir():
            # By rosbag2's numbers in their names, which is all that metadata.yaml would add; it is
            # missing if ros2 bag was killed.
            storages = filter(_is_storage, source.iterdir())
            paths = sorted(storages, key=lambda path: natural_order(path.name))
            # ros2 bag leaves a file that it has decompressed beside the compressed one.
            files = {path.name.removesuffix(_COMPRESSED): path for path in paths}
            if not files:
                raise OneBotError(f"{source} is not a recording: it has no .mcap or .db3 file")
            return list(files.values())
        if not source.exists():
            raise OneBotError(f"there is no recording {source}")
        if source.suffix == _ROS1:
            raise OneBotError(
                f"{source} is a ROS 1 recording: convert it with pip install rosbags and "
                f"rosbags-convert --src {source} --dst {source.stem}"
            )
        if not _is_storage(source):
            raise OneBotError(
                f"{source} is not a recording: write a file whose name ends in .mcap, .db3 or "
                ".rrd, or a folder that ros2 bag has made"
            )
        return [source]


def _is_storage(path: Path) -> bool:
    return (Path(path.stem) if path.suffix == _COMPRESSED else path).suffix in _STORAGES


def _reason(error: BaseException) -> str:
    if isinstance(error, KeyError):
        return f"channel {error} is missing"
    return str(error) or "it ends too early"
