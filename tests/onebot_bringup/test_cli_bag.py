"""``onebot bag``: what it records, plays and prints, on real DDS, with ros2 bag's options."""

import os
import sqlite3
import time
from contextlib import closing
from pathlib import Path

import pytest
from rosbags.typesys import Stores
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from onebot_bringup.bags.bag_reader import Bag
from tests.onebot_bringup.bag_support import write_words
from tests.onebot_bringup.cli_support import onebot, output_of, running
from tests.onebot_bringup.other_robots import SECOND, START, OtherRobot
from tests.ros_support import LATCHED, Peer
from tests.support import PATIENCE, wait_for


def test_info(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files, size, times, and each topic with its number of messages, as ros2 bag info."""
    monkeypatch.setenv("TZ", "UTC")
    write_words(tmp_path / "run", 5)
    size = os.path.getsize(tmp_path / "run/run_0.mcap")
    assert output_of("bag", "info", str(tmp_path / "run")) == (
        "\n"
        "Files:             run_0.mcap\n"
        f"Bag size:          {size / 1024:.1f} KiB\n"
        "Storage id:        mcap\n"
        "Duration:          0.004000000s\n"
        "Start:             Jan  1 1970 00:00:01.000000000 (1.000000000)\n"
        "End:               Jan  1 1970 00:00:01.004000000 (1.004000000)\n"
        "Messages:          5\n"
        "Topic information: Topic: /words | Type: std_msgs/msg/String | Count: 5 | "
        "Serialization Format: cdr\n\n"
    )


def recording(folder: Path) -> Path:
    """Ten words in 1.8 s, the first of them latched on a topic of its own, and an odd type."""
    with OtherRobot(folder, Stores.ROS2_JAZZY) as robot:
        robot.write("/once", String(data="once"))
        robot.write("/odd", String(data="odd"))
        for index in range(10):
            robot.write("/words", String(data=f"word {index}"), index / 5)
    with closing(sqlite3.connect(next(folder.glob("*.db3")))) as database, database:
        latched = "- {history: 3, depth: 0, reliability: 1, durability: 1}\n"  # numbers, as before
        database.execute(
            "UPDATE topics SET offered_qos_profiles = ? WHERE name = '/once'", [latched]
        )
        database.execute("UPDATE topics SET type = 'odd_msgs/msg/Odd' WHERE name = '/odd'")
    return folder


def add_what_is_not_played(folder: Path) -> None:
    """Names that ROS refuses, and publishers that disagree."""
    offered = "[{reliability: best_effort}, {reliability: reliable}]"
    with closing(sqlite3.connect(next(folder.glob("*.db3")))) as database, database:
        database.execute(
            "UPDATE topics SET offered_qos_profiles = ? WHERE name = '/words'", [offered]
        )
        database.executemany(
            "INSERT INTO topics(name, type, serialization_format, offered_qos_profiles,"
            " type_description_hash) VALUES (?, 'std_msgs/msg/String', 'cdr', '', '')",
            [("/a b",), ("/rosout",)],
        )


def problems(command) -> list[str]:
    """What a command has reported, but that discovery takes long, as it may on a busy machine."""
    return [line for line in command.err.splitlines() if not line.startswith("looking for ")]


def test_play(tmp_path: Path, peer: Peer) -> None:
    """Each message in its time and order, latched ones for who comes later, and the clock.

    What is not installed or not to be published is left out with one line each.
    """
    folder = recording(tmp_path / "run")
    add_what_is_not_played(folder)
    heard = peer.hear(String, "/speech")
    clock = peer.hear(Clock, "/clock")
    words = ("--clock", "50", "-r", "2", "-m", "/words:=/speech")
    started = time.monotonic()
    with running(tmp_path, "bag", "play", str(folder), *words) as command:
        wait_for(lambda: heard, "the first word")
        once = peer.hear(String, "/once", LATCHED)
        assert command.process.wait(PATIENCE) == 0, command.err
    assert time.monotonic() - started > 0.9
    assert [word.data for word in heard] == [f"word {index}" for index in range(10)]
    assert [word.data for word in once] == ["once"]
    stamps = [message.clock.sec * SECOND + message.clock.nanosec for message in clock]
    assert {b - a for a, b in zip(stamps, stamps[1:], strict=False)} == {SECOND // 25}
    assert START <= stamps[0] and stamps[-1] <= START + 9 * SECOND // 5
    expected = (
        '/odd is not played: no message type "odd_msgs/msg/Odd"',
        '/a b is not played: "/a b" is not a valid name: ',
        "/rosout is not played: ",
    )
    for line, start in zip(problems(command), expected, strict=True):
        assert line.startswith(f"warning: {start}")
    assert f"playing {folder}: 1.8 s of 2 topics\n" in command.out


def test_play_a_part_again_and_again(tmp_path: Path, peer: Peer) -> None:
    """Only some topics, from an offset on, for a while, in a loop until Ctrl-C (exit code 0)."""
    folder = recording(tmp_path / "run")
    heard = peer.hear(String, "/words")
    once = peer.hear(String, "/once", LATCHED)
    part = "--start-offset 0.5 --playback-duration 0.4 --exclude-topics /odd --loop".split()
    with running(tmp_path, "bag", "play", str(folder), *part) as command:
        wait_for(lambda: len(heard) >= 5 and once, "two rounds")
        assert command.interrupt() == 0 and "Traceback" not in command.err
    expected = ["word 3", "word 4"] * 3
    assert [word.data for word in heard][:5] == expected[:5]
    assert not problems(command)


def test_loop_of_one_moment(tmp_path: Path, peer: Peer) -> None:
    """A recording without duration is not published as fast as can be."""
    folder = recording(tmp_path / "run")
    heard = peer.hear(String, "/words")
    started = time.monotonic()
    words = ("-l", "--start-offset", "1.8", "--topics", "/words")
    with running(tmp_path, "bag", "play", str(folder), *words) as command:
        wait_for(lambda: len(heard) >= 5, "some rounds")
        assert command.interrupt() == 0
    assert len(heard) <= 1 + (time.monotonic() - started) / 0.1


@pytest.mark.parametrize(
    ("words", "code", "part"),
    [
        (("--topics", "/word"), 1, 'has no topic /word (did you mean "/words"? topics: '),
        (("--topics", "/odd"), 1, "has nothing to play"),
        (("-r", "0"), 2, "not above zero"),
    ],
)  # fmt: skip
def test_play_mistakes(
    tmp_path: Path, ros_domain: int, words: tuple[str, ...], code: int, part: str
) -> None:
    done = onebot("bag", "play", str(recording(tmp_path / "run")), *words)
    assert done.returncode == code and part in done.stderr


def test_record(tmp_path: Path, peer: Peer) -> None:
    """The topics chosen by name and pattern, without those excluded, until Ctrl-C."""
    folder = tmp_path / "run"
    for name in ("/left/words", "/right/words", "/right/secret"):
        peer.node.create_publisher(String, name, LATCHED).publish(String(data=name))
    words = ("/left/words", "-e", "^/right", "-x", "secret", "-o", str(folder))
    with running(tmp_path, "bag", "record", *words) as command:
        wait_for(
            lambda: (folder / "metadata.yaml").is_file() and Bag(folder).count == 2,
            "both messages",
        )
        assert command.interrupt() == 0, command.err
    assert set(Bag(folder).topics) == {"/left/words", "/right/words"}
    assert onebot("bag", "record").returncode == 2
