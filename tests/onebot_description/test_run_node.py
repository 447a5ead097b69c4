"""Running nodes: ROS arguments, errors and signals; warnings that are logged only so often."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import String

from onebot_description.ros.command_line import ros_arguments
from onebot_description.ros.node_graph import Lasting
from onebot_description.ros.run_node import MissedMessages, use_writable_log_folder
from onebot_description.ros.topic_qos import LATCHED
from onebot_description.timing.throttled import Throttled
from tests.ros_support import Peer
from tests.support import PATIENCE, lines_of_ours


def test_files_and_names_are_found() -> None:
    line = "node --params-file no.yaml --ros-args --params-file a.yaml -p rate:=5 -r x:=y"
    line += " --param jsp:zeros.a:=1.0 -p broken -- -p no:=1 --ros-args --params-file b.yaml"
    found = ros_arguments(line.split())
    assert found.files == (Path("a.yaml"), Path("b.yaml"))
    assert found.names == (("", "rate"), ("jsp", "zeros.a"))
    assert found.others == ("--params-file", "no.yaml", "-p", "no:=1")


_FAILING = """
from rclpy.node import Node
from onebot_description.errors import OneBotError
from onebot_description.ros.run_node import ends_node, run_node

class Failing(Node):
    def __init__(self, where):
        super().__init__("failing")
        self.where = where
        if where == "start":
            raise OneBotError(where)
        self.create_timer(0.01, self.work)

    @ends_node
    def work(self):
        if self.where == "callback":
            raise OneBotError(self.where)
        signal.raise_signal(signal.SIGINT)

    def destroy_node(self):
        super().destroy_node()
        if self.where == "end":
            raise OneBotError(self.where)

import signal
for where in ("start", "callback", "end", "nowhere"):
    print(run_node(lambda: Failing(where), ["failing"]))
"""


def test_an_error_of_a_node_is_one_line(ros_domain: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _FAILING], capture_output=True, text=True, timeout=180, check=True
    )
    assert done.stdout.split() == ["1", "1", "1", "0"]
    assert lines_of_ours(done.stderr) == ["error: start", "error: callback", "error: end"]


_HANGING = """
import ctypes, signal
from rclpy.node import Node
from onebot_description.ros.run_node import at_stop, run_node

class Hanging(Node):
    def __init__(self):
        super().__init__("hanging")
        at_stop(lambda: ctypes.PyDLL(None).pause())  # it keeps the interpreter's lock
        signal.raise_signal(signal.SIGTERM)

run_node(Hanging, ["hanging"])
"""


def test_a_node_that_hangs_while_it_stops_is_ended(ros_domain: int) -> None:
    """As in a deadlock of Fast DDS, no Python code runs any more."""
    assert subprocess.run([sys.executable, "-c", _HANGING], timeout=PATIENCE).returncode == (
        -signal.SIGALRM
    )


_SLOW_TO_STOP = """
from onebot_description.ros.process_start import start_node

start_node()

import gc, threading, time
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from onebot_description.ros.run_node import at_stop, run_node

stopped = threading.Event()

class Busy(Node):
    def __init__(self):
        super().__init__("busy")
        at_stop(stopped.set)
        self.create_timer(0.01, self.work)

    def work(self):
        print("busy" if gc.isenabled() else "no garbage is collected", flush=True)
        stopped.wait()

def free(executor):
    print("freeing", flush=True)
    time.sleep(1e6)

rclpy_implementation.EventsExecutor.shutdown = free
run_node(Busy, ["busy"])
"""


def test_a_node_that_is_slow_to_stop(ros_domain: int) -> None:
    command = [sys.executable, "-c", _SLOW_TO_STOP]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            for line, number in (("busy\n", signal.SIGINT), ("freeing\n", signal.SIGTERM)):
                assert process.stdout.readline() == line
                process.send_signal(number)
            assert process.wait(PATIENCE) == -signal.SIGTERM
        finally:
            process.kill()


def test_a_kind_is_logged_again_when_its_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    logged: list[str] = []
    log = Throttled(logged.append, every=5.0)
    for moment in (100.0, 104.9, 105.0, 109.9, 110.0):
        now[0] = moment
        log("a", str(moment))
    log("b", "b" * 4001)
    log("b", "now", every=0.0)
    assert logged == ["100.0", "105.0", "110.0", "b" * 4000 + "...", "now"]


def test_what_lasts_is_reported_once() -> None:
    """After its time; something else begins anew, and what comes back is reported again."""
    lasting = Lasting(3.0)
    moments = [
        (0.0, [], False),
        (10.0, ["a"], False),
        (12.9, ["a"], False),
        (13.0, ["a"], True),
        (14.0, ["a"], False),
        (15.0, ["a", "b"], False),
        (18.0, ["a", "b"], True),
        (19.0, [], False),
        (30.0, [], False),
        (31.0, ["a", "b"], False),
        (33.0, ["a"], False),
        (35.0, ["a"], False),
        (36.0, ["a"], True),
    ]
    assert [lasting.new(what, now) for now, what, _ in moments] == [new for _, _, new in moments]


@pytest.mark.parametrize("home", ["/dev/null", "/proc", None])
def test_ros_logs_where_it_can(monkeypatch, tmp_path: Path, home: str | None) -> None:
    for name in ("ROS_LOG_DIR", "ROS_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    if home:
        monkeypatch.setenv("HOME", home)
    use_writable_log_folder()
    assert os.environ["ROS_LOG_DIR"] == str(tmp_path / "cache/onebot/log")
    monkeypatch.setenv("ROS_LOG_DIR", "mine")
    use_writable_log_folder()
    assert os.environ["ROS_LOG_DIR"] == "mine"
    monkeypatch.delenv("ROS_LOG_DIR")
    monkeypatch.setenv("HOME", str(tmp_path))
    use_writable_log_folder()
    assert "ROS_LOG_DIR" not in os.environ and (tmp_path / ".ros/log").is_dir()


def test_a_latched_message_is_not_missed(start_node: Callable[..., Node], peer: Peer) -> None:
    """It is taken although nobody notifies of it, as of one that came before the executor."""
    node = start_node(lambda: Node("subscriber"))
    received: list[str] = []
    node.create_subscription(String, "/once", lambda found: received.append(found.data), LATCHED)
    publisher = peer.publisher(String, "/once", LATCHED)
    publisher.publish(String(data="once"))
    assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE))
    missed = MissedMessages(node)
    for _ in range(2):  # it is not taken before the executor could have
        missed._take_missed()
    assert received == ["once"]
