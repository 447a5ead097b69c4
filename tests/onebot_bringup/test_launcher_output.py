"""How the launcher relays what nodes print."""

import os
import pty
import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from onebot_bringup.launcher.console import Console
from tests.onebot_bringup.launcher_support import (
    IDLE,
    Start,
    alive,
    command_of,
    launchers,
    number_in,
)
from tests.support import PATIENCE, wait_for

LINES = 400
TALKER = f"""
import sys
for number in range({LINES}):
    print(number, "x" * 200)
    print(number, "y" * 200, file=sys.stderr)
sys.stdout.write("no newline at the end")
"""
BEGIN = """
import os, sys, time
from pathlib import Path
Path(sys.argv[0]).with_suffix(".pid").write_text(f"{os.getpid()}\\n")
"""
TICKER = """
count = 0
while True:
    print("tick", "z" * 500)
    count += 1
    if count % 1000 == 0:
        Path("count").write_text(f"{count}\\n")
"""


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    once = f"print('hello')\n{IDLE}"
    scripts = {"talker": TALKER, "ticker": BEGIN + TICKER, "once": BEGIN + once}
    with launchers(tmp_path, scripts) as make:
        yield make


def test_no_line_is_lost_broken_or_without_its_prefix(start: Start) -> None:
    """Two nodes that talk at once: every line arrives whole, in order, under the right name.

    Standard output and error stay apart; in files they have no color.
    """
    nodes = "[Node('a', 'talker', on_exit='ignore'), Node('b', 'talker', on_exit='ignore')]"
    launcher = start(nodes)
    assert launcher.wait() == 0
    for text, letter in ((launcher.out, "x"), (launcher.err, "y")):
        for name in "ab":
            found = re.findall(rf"^\[{name}\] (\d+) {letter}{{200}}$", text, re.MULTILINE)
            assert [int(number) for number in found] == list(range(LINES))
    assert "[a] no newline at the end\n" in launcher.out
    assert "yyy" not in launcher.out and "xxx" not in launcher.err
    assert "\x1b" not in launcher.out + launcher.err


HOSTILE = "\x1b[31mred\x1b[0m \x1b[2Jcleared\x07 a\u202eb\x9bc \u05d0 \u00e9\t."
SHOWN = "\x1b[31mred\x1b[0m \\x1b[2Jcleared\\x07 a\\u202eb\\x9bc \u05d0 \u00e9\t."


@pytest.mark.parametrize(
    ("no_color", "prefix"), [("", "\x1b[36m[a]\x1b[0m"), ("1", "[a]")], ids=["", "NO_COLOR"]
)
def test_a_line_on_a_terminal(monkeypatch: pytest.MonkeyPatch, no_color: str, prefix: str) -> None:
    """Its name is colored, but not with NO_COLOR (no-color.org).

    What a terminal would obey is escaped, as names of a file may hold it; colors and letters of
    any language stay.
    """
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("NO_COLOR", no_color)
    master, slave = pty.openpty()
    with open(slave, "w") as terminal:
        monkeypatch.setattr("sys.stdout", terminal)
        console = Console("test", ["a"])
        console.line("a", console.out, HOSTILE.encode())
        assert os.read(master, 1000).decode() == f"{prefix} {SHOWN}\r\n"
        console.close(PATIENCE)
    os.close(master)


@pytest.mark.usefixtures("start")
def test_a_stalled_reader_neither_stops_the_nodes_nor_the_launcher(tmp_path: Path) -> None:
    """With nobody reading the pipe, a node can go on printing, and Ctrl-C still works."""
    read, write = os.pipe()
    process = subprocess.Popen(
        command_of("[Node('t', 'ticker')]"),
        stdout=write,
        cwd=tmp_path,
    )
    os.close(write)
    count = tmp_path / "count"
    # Far more than pipe and buffer hold.
    wait_for(lambda: count.is_file() and number_in(count) > 5000, "5000 lines")
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE) == 0
    os.close(read)
    assert not alive(number_in(tmp_path / "ticker.pid"))


@pytest.mark.usefixtures("start")
@pytest.mark.parametrize("script", ["ticker", "once"])
def test_a_reader_that_leaves_stops_everything_quietly(tmp_path: Path, script: str) -> None:
    """As in ``mrm_bringup | head -3``: an orderly end, exit code 0, nothing on standard error.

    So does a reader that is killed, as ros2 launch may be, while nobody prints anything.
    """
    process = subprocess.Popen(
        command_of(f"[Node('t', '{script}')]"),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
    )
    assert process.stdout is not None and process.stderr is not None
    wait_for(lambda: b"[t] " in process.stdout.readline(), "the node")
    node = number_in(tmp_path / f"{script}.pid")
    process.stdout.close()
    assert process.wait(PATIENCE) == 0
    assert process.stderr.read() == b""
    process.stderr.close()
    assert not alive(node)
