"""What the launcher does when a node ends by itself, and how it reports it."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from onebot_bringup.launcher.process import describe_exit
from tests.onebot_bringup.launcher_support import IDLE, Start, alive, launchers, number_in
from tests.support import wait_for

RUNS = f"""
import os, time
from pathlib import Path
Path("runs.pid").write_text(str(os.getpid()) + "\\n")
print("ready")
{IDLE}"""
FAILS = """
import sys
print("about to fail")
print("the reason", file=sys.stderr)
sys.exit(3)
"""
FAILS_LATER = f"""
import pathlib, time
while not pathlib.Path("runs.pid").is_file():
    time.sleep(0.01)
{FAILS}"""


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    with launchers(tmp_path, {"runs": RUNS, "fails": FAILS}) as make:
        yield make


def test_shutdown_brings_all_down_and_says_why(start: Start, tmp_path: Path) -> None:
    """A node that matters ends: its last words come before the report, and the exit code is 1."""
    (tmp_path / "later.py").write_text(FAILS_LATER)
    launcher = start("[Node('other', 'runs'), Node('bad', 'later')]")
    assert launcher.wait() == 1
    assert "[bad] about to fail" in launcher.out
    said = launcher.err
    assert said.index("[bad] the reason") < said.index("bad exited unexpectedly")
    assert "exit code 3" in launcher.err and "stopping the others" in launcher.err
    assert launcher.err.splitlines()[-1] == "[test] failed: bad (exit code 3)"
    assert not alive(number_in(tmp_path / "runs.pid"))


def test_ignore_goes_on_without_the_node(start: Start, tmp_path: Path) -> None:
    """The failure of a viewer stops nothing; the exit code and the last line report it."""
    launcher = start("[Node('runner', 'runs'), Node('viewer', 'fails', on_exit='ignore')]")
    wait_for(lambda: "continuing without viewer" in launcher.err, "the report")
    launcher.says("ready")
    assert launcher.process.poll() is None and alive(number_in(tmp_path / "runs.pid"))
    assert launcher.interrupt() == 1
    assert launcher.err.splitlines()[-1] == "[test] failed: viewer (exit code 3)"


def test_the_launcher_ends_when_nothing_is_left(start: Start, tmp_path: Path) -> None:
    """With every node gone there is nothing to wait for; one that has finished did not fail."""
    (tmp_path / "ends.py").write_text("")
    launcher = start("[Node('viewer', 'ends', on_exit='ignore')]")
    assert launcher.wait() == 0
    assert "no node is left to run" in launcher.out and "failed" not in launcher.err


def test_an_error_while_stopping_is_a_failure(start: Start, tmp_path: Path) -> None:
    """Such as that of a recorder, which cannot write the rest: the disk is full."""
    recorder = """
import signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    print("ready")
    while True:
        time.sleep(0.05)
except KeyboardInterrupt:
    raise SystemExit("error: cannot record") from None
"""
    (tmp_path / "recorder.py").write_text(recorder)
    launcher = start("[Node('recorder', 'recorder', on_exit='ignore')]")
    launcher.says("ready")
    assert launcher.interrupt() == 1
    assert launcher.err.splitlines()[-1] == "[test] failed: recorder (exit code 1)"


@pytest.mark.parametrize(
    ("code", "words"),
    [(0, "exit code 0"), (1, "exit code 1"), (-11, "signal 11, Segm"), (-9, "Killed, perhaps the")],
)
def test_exit_codes_in_words(code: int, words: str) -> None:
    assert words in describe_exit(code)


def test_a_nice_node_stands_back(start: Start, tmp_path: Path) -> None:
    """It has the niceness asked for; the launcher keeps its own."""
    launcher = start("[Node('nice', 'runs', nice=7)]")
    pid = number_in(tmp_path / "runs.pid")
    mine = os.getpriority(os.PRIO_PROCESS, 0)
    wait_for(lambda: os.getpriority(os.PRIO_PROCESS, pid) == min(mine + 7, 19), "the niceness")
    assert os.getpriority(os.PRIO_PROCESS, launcher.process.pid) == mine
    assert launcher.interrupt() == 0
