"""How a module of a node is run: it ends as by itself, and may be preloaded."""

import asyncio
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from onebot_bringup.launch.bringup import Bringup, bring_up
from onebot_bringup.launcher.guard import Guard
from onebot_bringup.launcher.process import NodeProcess, Preloaded, RunningProcess, python_node
from onebot_description.errors import UsageError
from tests.onebot_bringup.bringup_support import MARK, marked
from tests.onebot_bringup.launcher_support import RunningCommand, alive
from tests.support import wait_for

BEGIN = """
import atexit, sys, threading, time
atexit.register(lambda: print("at exit", end=""))
threading.Thread(target=lambda: (time.sleep(0.1), print("thread"))).start()
"""


@pytest.mark.parametrize(
    ("end", "code", "complaint"),
    [
        ("", 0, ""),
        ("sys.exit()", 0, ""),
        ("sys.exit(3)", 3, ""),
        ("sys.exit('no such file')", 1, "no such file\n"),
        ("raise ValueError('a fault')", 1, "ValueError: a fault\n"),
    ],
)
def test_a_module_ends_as_by_itself(tmp_path: Path, end: str, code: int, complaint: str) -> None:
    """Its threads are awaited, its exit functions called and its output is whole."""
    (tmp_path / "ending.py").write_text(BEGIN + end)
    for runner in ([], ["onebot_bringup.launcher.interpreter"]):
        ended = subprocess.run(
            [sys.executable, "-m", *runner, "ending"], cwd=tmp_path, capture_output=True, text=True
        )
        assert ended.returncode == code
        assert ended.stdout == "thread\nat exit"
        assert ended.stderr.endswith(complaint) and bool(ended.stderr) == bool(complaint)


# Records when and as what it was imported, and how it is run.
MODULE = """
import json, os, sys
with open("imported", "a") as file:
    print(__name__, os.getpid(), file=file)
if __name__ == "__main__":
    print(json.dumps([os.getpid(), sys.argv[1:], os.environ.get("SAID"), sys.stdin.read()]))
"""
DRIVER = """
import os, sys, time
from onebot_bringup.launcher.launcher import Launcher
from onebot_bringup.launcher.process import python_node

with Launcher("test") as launcher:
    launcher.preload(["a_node"])
    while not os.path.exists("imported"):
        time.sleep(0.01)
    os.environ["SAID"] = "later"
    nodes = [python_node("a", "a_node", ["x:=1", "--ros-args"], on_exit="ignore")]
    sys.exit(launcher.run(nodes))
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a module in it."""
    (tmp_path / "a_node.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{Path(__file__).parents[2]}")
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    return tmp_path


@pytest.fixture
def loop() -> Iterator[asyncio.AbstractEventLoop]:
    """An event loop for one test."""
    loop = asyncio.new_event_loop()
    yield loop
    loop.close()


@pytest.fixture
def preloaded(folder: Path, loop: asyncio.AbstractEventLoop) -> Iterator[Preloaded]:
    """An interpreter that has imported the module."""
    guard = Guard()
    preloaded = Preloaded(guard)
    loop.run_until_complete(preloaded.start(["a_node"]))
    wait_for(lambda: imports(folder), "the import")
    yield preloaded
    loop.run_until_complete(preloaded.close())
    guard.close()


def imports(folder: Path) -> list[list[str]]:
    """As what the module was run, and in which process."""
    file = folder / "imported"
    return [line.split() for line in file.read_text().splitlines()] if file.exists() else []


async def code_of(process: RunningProcess) -> int:
    """Wait for the end of ``process``."""
    code = await asyncio.wait_for(process.ended, 60.0)
    await process.close()
    return code


def test_a_node_runs_in_its_preloaded_interpreter(folder: Path) -> None:
    """With its arguments, the variables of the moment, an empty standard input, as __main__."""
    command = RunningCommand(folder, [sys.executable, "-c", DRIVER])
    assert command.wait() == 0
    line = next(line for line in command.out.splitlines() if line.startswith("[a]"))
    pid, arguments, said, typed = json.loads(line.removeprefix("[a] "))
    assert (arguments, said, typed) == (["x:=1", "--ros-args"], "later", "")
    assert imports(folder) == [["a_node", str(pid)], ["__main__", str(pid)]]
    assert command.err.splitlines() == [
        "[test] a exited unexpectedly: it finished (exit code 0)",
        "[test] going on without a",
    ]


def test_what_is_not_needed_is_ended(
    folder: Path, preloaded: Preloaded, loop: asyncio.AbstractEventLoop
) -> None:
    """A node of another module does not take it; closing ends it."""
    (_, pid), *_ = imports(folder)
    assert preloaded.take(python_node("b", "another")) is None
    assert alive(int(pid))
    loop.run_until_complete(preloaded.close())
    assert not alive(int(pid))


def test_one_interpreter_is_for_one_start(
    preloaded: Preloaded, loop: asyncio.AbstractEventLoop
) -> None:
    """A second start of the same node finds none."""
    node = python_node("a", "a_node")
    process = preloaded.take(node)
    assert process is not None and loop.run_until_complete(code_of(process)) == 0
    assert preloaded.take(node) is None
    assert preloaded.take(NodeProcess("x", ("x",))) is None


def test_a_killed_launcher_leaves_none(folder: Path) -> None:
    """Also before it has started any node."""
    endless = DRIVER.replace("    os.environ", "    time.sleep(600)\n    os.environ")
    command = RunningCommand(folder, [sys.executable, "-c", endless])
    wait_for(lambda: imports(folder), "the import")
    (_, pid), *_ = imports(folder)
    command.send(signal.SIGKILL)
    command.wait()
    wait_for(lambda: not alive(int(pid)), "the end of the preloaded interpreter")


def test_a_dead_one_is_not_taken(
    folder: Path, preloaded: Preloaded, loop: asyncio.AbstractEventLoop
) -> None:
    """The launcher then starts the node afresh."""
    (_, pid), *_ = imports(folder)
    os.kill(int(pid), signal.SIGKILL)

    async def notices() -> None:
        while preloaded.waits_for("a_node"):
            await asyncio.sleep(0.01)

    loop.run_until_complete(asyncio.wait_for(notices(), 60.0))
    assert preloaded.take(python_node("a", "a_node")) is None


def test_a_broken_module_is_reported_when_it_is_run(
    folder: Path, loop: asyncio.AbstractEventLoop
) -> None:
    """As without preloading: by its own traceback, and exit code 1."""
    (folder / "broken.py").write_text("raise ValueError('a fault')\n")
    lines: list[bytes] = []
    guard = Guard()
    preloaded = Preloaded(guard)
    loop.run_until_complete(preloaded.start(["broken"]))
    process = preloaded.take(python_node("b", "broken"))
    assert process is not None
    process.connect(lines.append, lines.append)
    assert loop.run_until_complete(code_of(process)) == 1
    assert lines[-1] == b"ValueError: a fault"
    guard.close()


@pytest.mark.parametrize("words", [["--help"], ["viewer:=nowhere"]])
def test_no_bringup_leaves_an_interpreter(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither one that answers a question, nor one that is called wrongly."""
    monkeypatch.setenv(MARK, str(tmp_path))
    command = Bringup("test", "a test", model=str(tmp_path / "none.urdf"), control="x.yaml")
    try:
        assert bring_up(command, words) == 0
    except UsageError:
        assert words != ["--help"]
    assert set(marked(str(tmp_path))) <= {os.getpid()}
