"""Recordings of any origin and in any state are read, or refused in words."""

import sqlite3
from contextlib import closing

import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from onebot_bringup.bags.reader import Bag
from onebot_description.errors import OneBotError
from tests.onebot_bringup.bag_support import cdr, write_words

TYPES = get_typestore(Stores.ROS2_JAZZY)


def foreign(folder, plugin, mode=CompressionMode.NONE, version=9):
    """A recording written by rosbags."""
    writer = Writer(folder, version=version, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        one = writer.add_connection("/words", "std_msgs/msg/String", typestore=TYPES)
        for index in range(20):
            writer.write(one, 1000 + index, cdr(f"word {index}"))


def words_of(bag):
    return [message.data for message in bag.messages(["/words"])]


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("version", [8, 9])
def test_reads_foreign_recordings(tmp_path, plugin, version):
    """MCAP and SQLite, as rosbags writes them."""
    foreign(tmp_path / "bag", plugin, version=version)
    bag = Bag(tmp_path / "bag")
    assert (bag.topics, bag.count) == ({"/words": "std_msgs/msg/String"}, 20)
    assert words_of(bag) == [cdr(f"word {index}") for index in range(20)]
    assert bag.warnings == []


@pytest.mark.parametrize(
    ("mode", "what"), [(CompressionMode.FILE, "files"), (CompressionMode.MESSAGE, "messages")]
)
def test_compressed_by_rosbag2(tmp_path, mode, what):
    """Files or messages that rosbag2 has compressed are refused with what to do."""
    foreign(tmp_path / "bag", StoragePlugin.MCAP, mode)
    with pytest.raises(OneBotError, match=f"its {what} compressed by rosbag2: .* bag convert"):
        Bag(tmp_path / "bag")


def test_reads_a_file_alone(tmp_path):
    """A .mcap file needs no metadata.yaml; in a folder without one it is found, with a warning."""
    words = write_words(tmp_path / "bag")
    assert words_of(Bag(tmp_path / "bag/bag_0.mcap")) == words
    (tmp_path / "bag/metadata.yaml").unlink()
    bag = Bag(tmp_path / "bag")
    assert words_of(bag) == words
    assert "has no metadata.yaml" in bag.warnings[0]
    (tmp_path / "bag/metadata.yaml").write_text("- what?")
    bag = Bag(tmp_path / "bag")
    assert words_of(bag) == words
    assert "metadata.yaml is damaged" in bag.warnings[0]


def test_reads_a_truncated_file_as_far_as_it_goes(tmp_path):
    """Cut off anywhere, a file gives a beginning of its messages and one warning, or one error."""
    words = write_words(tmp_path / "bag", 500, chunk_size=1000)
    whole = (tmp_path / "bag/bag_0.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    most = 0
    for length in range(8, len(whole), 97):
        cut.write_bytes(whole[:length])
        bag = Bag(cut)
        found = words_of(bag) if bag.topics else []
        assert found == words[: len(found)]
        assert len(found) >= most
        most = len(found)
        assert len(bag.warnings) == bool(bag.topics)
    assert most == 500


def test_damage_is_noticed(tmp_path):
    """A flipped bit never gives a wrong message: reading ends before it, with a warning."""
    words = write_words(tmp_path / "bag", 500, chunk_size=1000)
    path = tmp_path / "bag/bag_0.mcap"
    whole = path.read_bytes()
    noticed = 0
    for place in range(0, len(whole), 199):
        data = bytearray(whole)
        data[place] ^= 0x10
        path.write_bytes(data)
        try:
            bag = Bag(path)
            found = [message.data for message in bag.messages(bag.topics)]
        except OneBotError:
            noticed += 1
            continue
        assert found == words[: len(found)]
        noticed += bool(bag.warnings)
    assert noticed > 20


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.mcap", b"", "is empty"),
        ("a.mcap", b"what is this?", "is no MCAP file"),
        ("a.db3", b"what is this?", "is no recording of rosbag2"),
        ("a.txt", b"", "its name must end in"),
    ],
)
def test_refuses_what_is_none(tmp_path, name, content, message):
    """Anything else is named as what it is not."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(OneBotError, match=message):
        Bag(tmp_path / name)


def test_refuses_what_is_not_there(tmp_path):
    """No file, an empty folder, a folder without its files."""
    with pytest.raises(OneBotError, match="there is no recording"):
        Bag(tmp_path / "none")
    with pytest.raises(OneBotError, match=r"holds neither metadata\.yaml nor"):
        Bag(tmp_path)
    write_words(tmp_path / "bag")
    (tmp_path / "bag/bag_0.mcap").unlink()
    with pytest.raises(OneBotError, match=r"lacks its files: bag_0\.mcap"):
        Bag(tmp_path / "bag")


def test_anything_in_a_column(tmp_path):
    """SQLite takes NULL and text for data and times, too: such messages are passed over."""
    foreign(tmp_path / "bag", StoragePlugin.SQLITE3)
    (path,) = (tmp_path / "bag").glob("*.db3")
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("UPDATE messages SET data = 'text' WHERE id = 1")
        database.execute("UPDATE messages SET timestamp = 'text' WHERE id = 2")
        # Its own columns are NOT NULL; other writers' are not.
        database.execute("CREATE TABLE m AS SELECT * FROM messages")
        database.execute("DROP TABLE messages")
        database.execute("ALTER TABLE m RENAME TO messages")
        database.execute("UPDATE messages SET data = NULL WHERE id = 3")
        database.execute("UPDATE messages SET timestamp = NULL WHERE id = 4")
    assert words_of(Bag(tmp_path / "bag")) == [cdr(f"word {index}") for index in range(4, 20)]
