"""What is recorded, read again by rosbags and mcap: independent of what wrote it."""

import os
import resource
import sys

import pytest

from onebot_bringup.bags.bag_reader import Bag
from onebot_bringup.bags.writer import BagWriter
from onebot_description.errors import OneBotError
from tests.onebot_bringup.bag_support import STRING, cdr, read_all, topic
from tests.support import run_to_end


@pytest.mark.parametrize(("compress", "chunk_size"), [(True, 500), (False, 500), (True, 10**6)])
def test_each_checkpoint_is_complete(tmp_path, compress, chunk_size):
    """After each checkpoint, and never before, an independent reader finds all up to it."""
    bag = BagWriter(tmp_path / "bag", compress=compress, chunk_size=chunk_size)
    assert read_all(tmp_path / "bag")[0] == []
    assert Bag(tmp_path / "bag").topics == {}
    number = bag.add_topic(topic())
    for count in range(1, 60):
        bag.write(number, count, cdr(f"word {count}"))
        bag.checkpoint()
        found, connections = read_all(tmp_path / "bag")
        assert [stamp for _, stamp, _ in found] == list(range(1, count + 1))
        one = connections["/words"]
        assert (one.msgtype, one.msgcount, one.digest) == (STRING, count, topic().hash)
    bag.close()
    assert [data for _, _, data in found] == [cdr(f"word {count}") for count in range(1, 60)]
    (qos,) = one.ext.offered_qos_profiles
    assert (qos.durability.name, qos.reliability.name) == ("TRANSIENT_LOCAL", "RELIABLE")


def test_refuses_a_folder_that_exists(tmp_path):
    """As ros2 bag record does: no recording is overwritten."""
    with pytest.raises(OneBotError, match="exists already: name a new folder"):
        BagWriter(tmp_path)
    with pytest.raises(OneBotError, match="No such file"):
        BagWriter(tmp_path / "none/bag")


def test_killed_while_writing(tmp_path):
    """Of the call that writes, any part may have happened: what was there before can be read."""
    folder = tmp_path / "bag"
    path = folder / "bag_0.mcap"
    bag = BagWriter(folder)
    number = bag.add_topic(topic())
    for count in range(5):
        bag.write(number, count, cdr(f"word {count}"))
        bag.checkpoint()
    before = path.read_bytes()
    for count in range(5, 50):
        bag.write(number, count, cdr(f"word {count}"))
    bag.close()
    after = path.read_bytes()
    start = next(n for n, pair in enumerate(zip(before, after, strict=False)) if len({*pair}) > 1)
    for end in range(start, len(after), 7):
        path.write_bytes(after[:end] + before[end:])
        half = Bag(folder)
        stamps = [message.time for message in half.messages(half.topics)]
        assert stamps in (list(range(5)), list(range(50)))


_FILL = """
import resource, sys
from pathlib import Path
from tests.onebot_bringup.bag_support import cdr, topic
from onebot_bringup.bags.writer import BagWriter
from onebot_description.errors import OneBotError
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
bag = BagWriter(Path(sys.argv[1]), compress=False, chunk_size=3000)
number = bag.add_topic(topic())
try:
    for count in range(1, 10_000):
        bag.write(number, count, cdr(f"word {count}"))
        if count % 10 == 0:
            bag.checkpoint()
            print(count)
except OneBotError as error:
    bag.close()
    print(error)
"""


def test_full_disk(tmp_path):
    """No room left: one clear error, and what was recorded before can be read."""
    done = run_to_end([sys.executable, "-c", _FILL, str(tmp_path / "bag")], check=True)
    *counts, error = done.stdout.splitlines()
    assert error == f"cannot record to {tmp_path / 'bag'}: {os.strerror(27)}"
    found, _ = read_all(tmp_path / "bag")
    assert len(found) == int(counts[-1])
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] != 20_000
