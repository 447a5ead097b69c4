"""What the tests of recordings share."""

from pathlib import Path

from rosbags.rosbag2 import Reader

from onebot_bringup.bags.writer import BagWriter, Qos, RecordedTopic

STRING = "std_msgs/msg/String"
LATCHED = Qos(durability="transient_local")


def topic(name="/words", kind=STRING, offered=(LATCHED,)):
    return RecordedTopic(name, kind, "RIHS01_" + "0" * 64, offered)


def cdr(text: str) -> bytes:
    """A std_msgs/String as on the wire."""
    data = text.encode() + b"\0"
    return b"\0\1\0\0" + len(data).to_bytes(4, "little") + data


def write_words(folder: Path, count: int = 5, **options) -> list[bytes]:
    """A closed recording of ``count`` strings, one a millisecond; what was written."""
    bag = BagWriter(folder, **options)
    number = bag.add_topic(topic())
    words = [cdr(f"word {index}") for index in range(count)]
    for index, word in enumerate(words):
        bag.write(number, 1_000_000_000 + index * 1_000_000, word)
    bag.close()
    return words


def read_all(folder: Path):
    """What the independent reader finds: [(topic, nanoseconds, bytes)] and its connections."""
    with Reader(folder) as reader:
        found = [(one.topic, stamp, bytes(data)) for one, stamp, data in reader.messages()]
        return found, {one.topic: one for one in reader.connections}


def read_growing(folder: Path):
    """What a recording holds that is written to just now, or nothing while its end is replaced."""
    try:
        return read_all(folder)[0]
    except Exception:  # whatever the reader makes of half an index
        return []
