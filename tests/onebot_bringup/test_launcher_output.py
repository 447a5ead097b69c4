"""How the launcher relays what nodes print."""

import os
import pty
import re
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.onebot_bringup.launcher_support import (
    IDLE,
    RunningLauncher,
    alive,
    command_of,
    number_in,
)
from tests.support import PATIENCE, wait_for

Start = Callable[[str], RunningLauncher]
LINES = 400
TALKER = f"""
import sys
for number in range({LINES}):
    print(number, "x" * 200)
    print(number, "y" * 200, file=sys.stderr)
sys.stdout.write("no newline at the end")
"""
TICKER = """
import os, signal
from pathlib import Path
signal.signal(signal.SIGINT, signal.SIG_DFL)
Path("ticker.pid").write_text(f"{os.getpid()}\\n")
count = 0
while True:
    print("tick", "z" * 500)
    count += 1
    if count % 1000 == 0:
        Path("count").write_text(f"{count}\\n")
"""


@pytest.fixture
def scripts(tmp_path: Path) -> None:
    """Write the scripts that these tests run into ``tmp_path``."""
    (tmp_path / "talker.py").write_text(TALKER)
    (tmp_path / "ticker.py").write_text(TICKER)
    (tmp_path / "once.py").write_text(f"import time\nprint('hello')\n{IDLE}")


@pytest.fixture
def start(tmp_path: Path, scripts: None) -> Iterator[Start]:
    """Start launchers in ``tmp_path``, where the scripts lie; end them after the test."""
    started: list[RunningLauncher] = []

    def make(nodes: str) -> RunningLauncher:
        started.append(RunningLauncher(tmp_path, nodes))
        return started[-1]

    yield make
    for launcher in started:
        launcher.close()


def test_no_line_is_lost_broken_or_without_its_prefix(start: Start) -> None:
    """Two nodes that talk at once: every line arrives whole, in order, under the right name."""
    nodes = "[script('a', 'talker.py', 'ignore'), script('b', 'talker.py', 'ignore')]"
    launcher = start(nodes)
    assert launcher.wait() == 0
    for text, letter in ((launcher.out, "x"), (launcher.err, "y")):
        for name in "ab":
            found = re.findall(rf"^\[{name}\] (\d+) {letter}{{200}}$", text, re.MULTILINE)
            assert [int(number) for number in found] == list(range(LINES))
    assert "[a] no newline at the end\n" in launcher.out


def test_what_a_terminal_would_obey_is_escaped(start: Start, tmp_path: Path) -> None:
    """As names of a file may hold it; colours and letters of any language stay."""
    text = "\x1b[31mred\x1b[0m \x1b[2Jcleared\x07 a\u202eb\x9bc \u05d0 \u00e9\t."
    (tmp_path / "hostile.py").write_text(f"import sys; sys.stdout.buffer.write({text.encode()!r})")
    launcher = start("[script('a', 'hostile.py', 'ignore')]")
    assert launcher.wait() == 0
    shown = "\x1b[31mred\x1b[0m \\x1b[2Jcleared\\x07 a\\u202eb\\x9bc \u05d0 \u00e9\t."
    assert f"[a] {shown}\n" in launcher.out


def test_streams_stay_apart_and_uncoloured_in_files(start: Start) -> None:
    """Standard output and error of nodes go to those of the launcher; files get no colour."""
    launcher = start("[script('a', 'talker.py', 'ignore')]")
    assert launcher.wait() == 0
    assert "yyy" not in launcher.out and "xxx" not in launcher.err
    assert "\x1b" not in launcher.out + launcher.err


def _on_terminal(folder: Path, environment: dict[str, str]) -> str:
    """Run a launcher on a pseudo-terminal, interrupt it, and return what the terminal showed."""
    master, slave = pty.openpty()
    process = subprocess.Popen(
        command_of("[script('a', 'once.py')]"),
        stdin=slave,
        stdout=slave,
        stderr=slave,
        cwd=folder,
        env={**os.environ, "TERM": "xterm", **environment},
    )
    os.close(slave)
    shown = b""
    while b"hello" not in shown:
        shown += os.read(master, 4096)
    process.send_signal(signal.SIGINT)
    while True:
        try:
            data = os.read(master, 4096)
        except OSError:  # how Linux says that the other end of a terminal is closed
            break
        shown += data
    os.close(master)
    assert process.wait(PATIENCE) == 0
    return shown.decode()


@pytest.mark.usefixtures("scripts")
def test_names_are_coloured_on_a_terminal(tmp_path: Path) -> None:
    """On a terminal the prefix has a colour, and lines come at once, not when a buffer fills."""
    assert re.search(r"\x1b\[\d+m\[a\]\x1b\[0m hello", _on_terminal(tmp_path, {"NO_COLOR": ""}))


@pytest.mark.usefixtures("scripts")
def test_no_color_is_respected(tmp_path: Path) -> None:
    """NO_COLOR (no-color.org) turns colours off on a terminal too."""
    assert "\x1b" not in _on_terminal(tmp_path, {"NO_COLOR": "1"})


@pytest.mark.usefixtures("scripts")
def test_a_stalled_reader_neither_stops_the_nodes_nor_the_launcher(tmp_path: Path) -> None:
    """With nobody reading the pipe, a node can go on printing, and Ctrl-C still works."""
    read, write = os.pipe()
    process = subprocess.Popen(
        command_of("[script('t', 'ticker.py')]"),
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


@pytest.mark.usefixtures("scripts")
def test_a_reader_that_leaves_stops_everything_quietly(tmp_path: Path) -> None:
    """As in ``mrm_bringup | head -3``: an orderly end, exit code 0, nothing on standard error."""
    process = subprocess.Popen(
        command_of("[script('t', 'ticker.py')]"),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
    )
    assert process.stdout is not None and process.stderr is not None
    wait_for(lambda: (tmp_path / "ticker.pid").is_file(), "the node")
    process.stdout.readline()
    process.stdout.close()
    assert process.wait(PATIENCE) == 0
    assert process.stderr.read() == b""
    process.stderr.close()
    assert not alive(number_in(tmp_path / "ticker.pid"))
