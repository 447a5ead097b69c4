"""Recordings of any origin and in any state are read, or refused in words."""

import sqlite3
import tempfile
import tracemalloc
from contextlib import closing

import pytest
import zstandard
from mcap.writer import IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.typesys import Stores

from onebot_bringup.bags.bag_reader import Bag
from onebot_bringup.cli.snapshot import kind_of
from onebot_description.errors import OneBotError
from tests.onebot_bringup.bag_support import STRING, cdr, write_words
from tests.onebot_bringup.other_robots import OtherRobot

CONTROL = f"""\
builtin_interfaces/Time stamp
float32 steering_angle
{"=" * 80}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


WORDS = [cdr(f"word {index}") for index in range(20)]


def foreign(folder, plugin, mode=CompressionMode.NONE, words=WORDS):
    """A recording written by rosbags."""
    with OtherRobot(folder, Stores.ROS2_JAZZY, plugin, mode) as robot:
        for index, word in enumerate(words):
            robot.write("/words", word, index / 1000, kind=STRING)


def change(folder, *statements):
    """Alter the SQLite file of a recording."""
    (path,) = folder.glob("*.db3")
    with closing(sqlite3.connect(path)) as database, database:
        for statement in statements:
            database.execute(statement)


def words_of(bag):
    return [message.data for message in bag.messages(["/words"])]


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_compressed_by_rosbag2(tmp_path, plugin, mode):
    """Files and messages that rosbag2 has compressed are read, without metadata.yaml too."""
    foreign(tmp_path / "bag", plugin, mode)
    bag = Bag(tmp_path / "bag")
    assert words_of(bag) == WORDS
    assert (bag.count, bag.warnings, bag.storage) == (20, [], plugin.name.lower())
    (file,) = bag.files
    assert (file.suffix == ".zstd") == (mode == CompressionMode.FILE)
    assert words_of(Bag(file)) == words_of(bag)
    assert kind_of(str(file)) == "bag"


def test_decompressed_files_go_away_with_the_bag(tmp_path, monkeypatch):
    """They are in a temporary folder while the recording is read."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    foreign(tmp_path / "bag", StoragePlugin.MCAP, CompressionMode.FILE)
    messages = Bag(tmp_path / "bag").messages(["/words"])
    assert next(messages).data == cdr("word 0")
    assert list(folder.rglob("*.mcap"))
    del messages
    assert list(folder.iterdir()) == []


def test_damaged_compression(tmp_path):
    """A damaged file is an error; a damaged message ends the file."""
    (tmp_path / "a.mcap.zstd").write_bytes(b"what is this?")
    with pytest.raises(OneBotError, match=r"a\.mcap\.zstd cannot be decompressed into"):
        Bag(tmp_path / "a.mcap.zstd")
    foreign(tmp_path / "bag", StoragePlugin.SQLITE3, CompressionMode.MESSAGE)
    change(tmp_path / "bag", "UPDATE messages SET data = substr(data, 1, 9) WHERE id > 1")
    bag = Bag(tmp_path / "bag")
    assert words_of(bag) == WORDS[:1]
    [warning] = bag.warnings
    assert warning.endswith("only the data before it was read")


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_definitions(tmp_path, plugin):
    """Those in the file come first, of types that are not installed too; then the installed."""
    with OtherRobot(tmp_path / "bag", Stores.ROS2_JAZZY, plugin) as robot:
        for kind, text in (
            ("autoware_msgs/msg/Control", CONTROL),
            ("other_msgs/msg/InIdl", f"{'=' * 80}\nIDL: other_msgs/msg/InIdl\n"),
        ):
            robot.write(f"/{kind[:5]}", cdr(""), kind=kind, definition=text)
    bag = Bag(tmp_path / "bag")
    text, *nested = bag.definition("autoware_msgs/msg/Control").split("=" * 80 + "\n")
    assert text == "builtin_interfaces/Time stamp\nfloat32 steering_angle\n"
    assert nested == ["MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"]
    assert "std_msgs/msg/String" not in bag.definitions
    assert bag.definition("std_msgs/msg/String").splitlines()[-1] == "string data"
    for kind in ("other_msgs/msg/InIdl", "other_msgs/msg/None", "strange"):
        with pytest.raises(OneBotError, match=f"{kind} is neither in .* nor installed"):
            bag.definition(kind)


def test_nothing_is_left_beside_a_file(tmp_path):
    """Foxy's SQLite files are in WAL mode: to read one, SQLite would make files of its own."""
    foreign(tmp_path / "bag", StoragePlugin.SQLITE3)
    change(tmp_path / "bag", "PRAGMA journal_mode = WAL")
    before = set((tmp_path / "bag").iterdir())
    assert len(words_of(Bag(tmp_path / "bag"))) == 20
    assert set((tmp_path / "bag").iterdir()) == before
    (path,) = (tmp_path / "bag").glob("*.db3")
    with closing(sqlite3.connect(path)) as database:  # it is still being written
        database.execute("DELETE FROM messages WHERE id > 5")
        database.commit()
        assert len(words_of(Bag(tmp_path / "bag"))) == 5


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.FILE])
def test_is_not_read_into_memory(tmp_path, plugin, mode):
    """Of 32 MB, a few messages at a time are."""
    foreign(tmp_path / "bag", plugin, mode, [cdr("x" * 1_000_000)] * 32)
    (file,) = Bag(tmp_path / "bag").files
    tracemalloc.start()
    try:
        messages = Bag(file).messages(["/words"])
        assert sum(len(message.data) for message in messages) > 32e6
        assert tracemalloc.get_traced_memory()[1] < 16e6
    finally:
        tracemalloc.stop()


def test_the_files_of_a_folder(tmp_path):
    """By their numbers, without metadata.yaml; once, if one is there compressed, too."""
    folder = tmp_path / "bag"
    folder.mkdir()
    for number, words in ((2, WORDS[:5]), (10, WORDS[5:])):
        mcap(folder / f"bag_{number}.mcap", words)
    data = (folder / "bag_10.mcap").read_bytes()
    (folder / "bag_10.mcap.zstd").write_bytes(zstandard.ZstdCompressor().compress(data))
    bag = Bag(folder)
    assert words_of(bag) == WORDS
    assert bag.warnings == []


def mcap(path, content, **options):
    """Words in several chunks, as mcap's own writer has them."""
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=150, **options)
        writer.start("ros2", "test")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        words = writer.register_channel("/words", "cdr", schema)
        for index, word in enumerate(content):
            writer.add_message(words, 1000 + index, word, 0)
        writer.finish()


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"use_statistics": False},
        {"repeat_channels": False},
        {"repeat_schemas": False},
        {"use_summary_offsets": False},
        {"index_types": IndexType.NONE},
        {"index_types": IndexType.CHUNK},
        {"use_chunking": False},
    ],
    ids=str,
)
def test_what_may_be_left_out_of_an_mcap_file(tmp_path, options):
    """Its summary has what it has: ros2 bag's storage options leave out most of it."""
    mcap(tmp_path / "a.mcap", WORDS[:10], **options)
    bag = Bag(tmp_path / "a.mcap")
    assert bag.topics == {"/words": "std_msgs/msg/String"}
    assert (bag.counts, bag.count) == ({"/words": 10}, 10)
    assert (bag.start_ns, bag.end_ns, bag.warnings) == (1000, 1009, [])
    assert words_of(bag) == WORDS[:10]


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
        assert bag.warnings or not bag.topics or most == 500
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
        ("a.mcap", b"what is this?", "is not an MCAP file"),
        ("a.db3", b"what is this?", "is not a rosbag2 recording"),
        ("a.txt", b"", "write a file whose name ends in"),
        ("a.txt.zstd", b"", "write a file whose name ends in"),
        (
            "a.bag",
            b"#ROSBAG V2.0",
            r"a ROS 1 recording: convert it .* rosbags-convert --src \S+a\.bag --dst a",
        ),
    ],
)
def test_refuses_what_is_none(tmp_path, name, content, message):
    """Anything else is named as what it is not."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(OneBotError, match=message):
        Bag(tmp_path / name)


def test_refuses_what_is_not_there(tmp_path):
    """No file, an empty folder."""
    with pytest.raises(OneBotError, match="there is no recording"):
        Bag(tmp_path / "none")
    with pytest.raises(OneBotError, match=r"has no \.mcap or \.db3 file"):
        Bag(tmp_path)
