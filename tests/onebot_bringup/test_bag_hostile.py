"""Recordings that were made to hang or to fill the memory are refused soon, in little memory."""

import os
import sqlite3
import struct
import sys
from contextlib import closing

import lz4.frame
import pytest
import zstandard
from mcap.writer import MCAP0_MAGIC

from onebot_bringup.bags.bag_reader import Bag
from onebot_bringup.bags.writer import BagWriter
from onebot_bringup.cli.main import main
from tests.onebot_bringup.bag_support import cdr, topic
from tests.support import run_to_end

HUGE = 1_000_000_000  # bytes
MOST = 900_000  # KiB that a process which refuses them may take: less than HUGE
READ = """
import sys
from pathlib import Path
from onebot_bringup.bags.bag_reader import Bag
from onebot_description.errors import OneBotError
for file in sys.argv[1:]:
    try:
        bag = Bag(Path(file))
        print(sum(1 for _ in bag.messages(bag.topics)), *bag.warnings, sep="; ", end=" ")
    except OneBotError as error:
        print(error, end=" ")
    # Unlike getrusage, without what its parent took.
    print(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0])
"""


def zstd_zeros(size, head=b""):
    """A frame of zstd of ``head`` and ``size`` zeros: blocks that repeat one byte 131,072 times."""
    whole, rest = divmod(size, 1 << 17)
    first = (len(head) << 3).to_bytes(3, "little") + head
    blocks = ((1 << 17) << 3 | 2).to_bytes(3, "little") + b"\0"
    last = (rest << 3 | 3).to_bytes(3, "little") + b"\0"
    total = (len(head) + size).to_bytes(8, "little")
    return b"\x28\xb5\x2f\xfd\xe0" + total + first + blocks * whole + last


def lz4_zeros(size):
    packer, part = lz4.frame.LZ4FrameCompressor(), bytes(1 << 24)
    return packer.begin() + b"".join(packer.compress(part) for _ in range(size >> 24))


def compressed(path):
    """A file of zeros that is compressed as a whole, in a stream: its size is not in its header."""
    packer, part = zstandard.ZstdCompressor().compressobj(), bytes(1 << 24)
    path.write_bytes(b"".join(packer.compress(part) for _ in range(64)) + packer.flush())


def record(opcode, data):
    return struct.pack("<BQ", opcode, len(data)) + data


def text(word):
    return struct.pack("<I", len(word)) + word.encode()


DECLARED = (
    record(3, struct.pack("<H", 1) + text("std_msgs/msg/String") + text("ros2msg") + text(""))
    + record(4, struct.pack("<HH", 1, 1) + text("/robot_description") + text("cdr") + text(""))
)  # fmt: skip


def chunk(compression, size, data):
    """A chunk of ``size`` bytes, packed."""
    head = struct.pack("<QQQI", 1, 2, size, 0)
    return record(6, head + text(compression) + struct.pack("<Q", len(data)) + data)


def message(data):
    return record(5, struct.pack("<HIQQ", 1, 0, 1, 1) + data)


def overlapping():
    """A chunk that is indexed again and again."""
    start = len(MCAP0_MAGIC + DECLARED)
    content = message(cdr("x" * 1_000_000))
    packed = chunk("", len(content), content)
    index = record(
        8,
        struct.pack("<QQQQIQ", 1, 2, start, len(packed), 0, 0)
        + text("")
        + struct.pack("<QQ", len(content), len(content)),
    )
    statistics = record(11, struct.pack("<QHIIIIQQIHQ", 1000, 1, 1, 0, 0, 1000, 1, 2, 10, 1, 1000))
    body = MCAP0_MAGIC + DECLARED + packed + record(15, bytes(4))
    footer = record(2, struct.pack("<QQI", len(body), 0, 0))
    return body + DECLARED + statistics + index * 1000 + footer + MCAP0_MAGIC


def mcap(data):
    """A file with what ``data()`` returns."""
    return lambda path: path.write_bytes(MCAP0_MAGIC + DECLARED + data())


def sparse(start):
    def write(path):
        path.write_bytes(start)
        os.truncate(path, 1 << 42)

    return write


def sqlite(*statements):
    """A recording whose messages are made by ``statements``, with values for data."""

    def write(path):
        with closing(sqlite3.connect(path)) as database, database:
            database.execute("CREATE TABLE topics(id, name, type, serialization_format)")
            database.execute(
                "INSERT INTO topics VALUES(1, '/robot_description', 'std_msgs/msg/String', 'cdr')"
            )
            for statement, *values in statements:
                database.execute(statement, values)

    return write


def schemas():
    """Chunks of 60 MB, a schema each."""
    for number in range(10, 40):
        size = 60_000_000
        content = struct.pack("<H", number) + text("a/msg/B") + text("") + struct.pack("<I", size)
        head = struct.pack("<BQ", 3, len(content) + size) + content
        yield chunk("zstd", len(head) + size, zstd_zeros(size, head))


STORED = "CREATE TABLE messages(id, topic_id, timestamp, data)"
INSERT = "INSERT INTO messages VALUES({0}, 1, {0}, ?)"
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n{})"
VIEW = "CREATE VIEW messages AS {} SELECT i AS id, 1 AS topic_id, i AS timestamp, {} AS data FROM n"
LARGE = "zeroblob(900000000)"
NO_TABLES = "is not a rosbag2 recording: the tables topics and messages are missing"
TOO_LARGE = "1,000.0 MB is above 256.0 MB, which max_size sets"
HOSTILE = {
    "pipe.mcap": (os.mkfifo, "cannot be read: not a regular file"),
    "sparse.mcap": (sparse(MCAP0_MAGIC + DECLARED), "(4,398,046.5 MB): a record is damaged"),
    "sparse.mcap.zstd": (sparse(zstd_zeros(0)[:4]), "a gap of 256"),
    "record.mcap": (sparse(MCAP0_MAGIC + struct.pack("<BQ", 3, HUGE)), f"a record of {TOO_LARGE}"),
    "bomb.mcap.zstd": (compressed, "its content of 256"),
    "zstd.mcap": (mcap(lambda: chunk("zstd", HUGE, zstd_zeros(HUGE))), f"a chunk of {TOO_LARGE}"),
    "lz4.mcap": (mcap(lambda: chunk("lz4", HUGE, lz4_zeros(HUGE))), f"a chunk of {TOO_LARGE}"),
    "lying.mcap": (mcap(lambda: chunk("zstd", 9, zstd_zeros(HUGE))), "1,000.0 MB is above 0.0"),
    "schemas.mcap": (mcap(lambda: b"".join(schemas())), "more definitions and indexes than max"),
    "overlapping.mcap": (lambda path: path.write_bytes(overlapping()), "1 "),
    "message.db3": (
        sqlite([STORED], [INSERT.format(1), zstd_zeros(HUGE)], [INSERT.format(2), cdr("last")]),
        f"a message or chunk of {TOO_LARGE}",
    ),
    "large.db3": (sqlite([STORED], [INSERT.format(1).replace("?", LARGE)]), "a message of 900"),
    "endless.db3": (sqlite([VIEW.format(ENDLESS.format(""), "x'00'")]), NO_TABLES),
    "computed.db3": (
        sqlite(
            [f"CREATE TABLE messages(id, topic_id, timestamp, data AS ({LARGE}))"],
            ["INSERT INTO messages(id, topic_id, timestamp) VALUES(1, 1, 1), (2, 1, 2)"],
        ),
        NO_TABLES,
    ),
}  # fmt: skip


def test_refused_soon_in_little_memory(tmp_path):
    """By one number for whatever is read or unpacked at once; what is sound before it is read."""
    for name, (write, _) in HOSTILE.items():
        write(tmp_path / name)
    done = run_to_end([sys.executable, "-c", READ, *HOSTILE], cwd=tmp_path, check=True)
    for (name, (_, words)), line in zip(HOSTILE.items(), done.stdout.splitlines(), strict=True):
        said, _, memory = line.rpartition(" ")
        assert words in f"{said} ", name
        assert int(memory) < MOST, f"up to {name}"


def test_max_size(tmp_path, capsys, ros_domain):
    """What is read at once may be as large as the user says: a chunk, and chunks that overlap."""
    content = message(cdr("x" * 5000))
    mcap(lambda: chunk("", len(content), content))(tmp_path / "a.mcap")
    words = [str(tmp_path / "a.mcap"), "viewer:=none", f"save:={tmp_path}/a.rrd"]
    main(["replay", *words, "max_size:=0.004"])
    assert "a.mcap (0.0 MB): a record of 0.0 MB is above 0.0 MB" in capsys.readouterr().err
    main(["replay", *words, "max_size:=0.01"])
    assert "above" not in capsys.readouterr().err
    main(["bag", "play", words[0], "--max-size", "0.004"])
    assert "above" in capsys.readouterr().err
    writer = BagWriter(tmp_path / "bag", chunk_size=1000)
    number = writer.add_topic(topic())
    for step in range(100):
        for time in (1000 - step, 1000 + step):
            writer.write(number, time, cdr("x" * 100))
    writer.close()
    for max_size, warnings in ((10_000, 1), (100_000, 0)):
        bag = Bag(tmp_path / "bag", max_size)
        times = [found.time for found in bag.messages(["/words"])]
        assert (len(times) < 200, len(bag.warnings)) == (warnings, warnings)
        assert times == sorted(times)


INTERRUPTED = """
import os, signal, sys, threading, time
from onebot_bringup.bags import sqlite_file as reader
from onebot_bringup.cli.main import main
name, query = sys.argv[1:3]
del sys.argv[1:3]
setattr(reader, name, query)
def press():
    samples = 0  # in a row that see the search
    while samples < 3:
        time.sleep(0.1)
        frame = sys._current_frames()[threading.main_thread().ident]
        samples = samples + 1 if frame.f_code.co_filename == reader.__file__ else 0
    os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=press, daemon=True).start()
sys.exit(main())
"""
QUERIES = {
    "_EXTENTS": f"{ENDLESS.format('')} SELECT 1, count(*), 1, 1 FROM n",
    "_MESSAGES": f"{ENDLESS.format('')} SELECT count(*), 1, ?, 1 FROM n WHERE i <> {{}}",
}


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("_EXTENTS", ["bag", "info", "a.db3"]),
        ("_MESSAGES", ["replay", "a.db3", "viewer:=none", "save:=a.rrd"]),
    ],
)
def test_ctrl_c_while_reading(tmp_path, ros_domain, query, words):
    """A search that goes on for ever ends, quietly, and not as if all were read."""
    sqlite([STORED], [INSERT.format(1), cdr("word")])(tmp_path / "a.db3")
    done = run_to_end(
        [sys.executable, "-c", INTERRUPTED, query, QUERIES[query], *words], cwd=tmp_path
    )
    assert (done.returncode, "Traceback" in done.stderr) == (130, False), done.stderr
