"""Interpreters that stand by: they run the node that comes, with its arguments, or end."""

import json
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from onebot_bringup.launch.bringup import Robot, bring_up
from onebot_bringup.launcher.interpreter import Standby
from onebot_bringup.launcher.process import Node, python_node
from onebot_description.errors import UsageError
from tests.onebot_bringup.bringup_support import MARK, marked
from tests.onebot_bringup.launcher_support import RunningCommand, alive
from tests.support import wait_for

# Says when and as what it was imported, and how it is run.
MODULE = """
import json, os, sys
with open("imported", "a") as file:
    print(__name__, os.getpid(), file=file)
if __name__ == "__main__":
    print(json.dumps([os.getpid(), sys.argv[1:], os.environ.get("SAID"), sys.stdin.read()]))
    sys.exit(CODE)
"""
DRIVER = """
import os, sys, time
from onebot_bringup.launcher.launcher import Launcher
from onebot_bringup.launcher.process import python_node
from onebot_bringup.launcher.interpreter import Standby

with Standby(["a_node"]) as standby:
    while not os.path.exists("imported"):
        time.sleep(0.01)
    os.environ["SAID"] = "later"
    nodes = [python_node("a", "a_node", ["x:=1", "--ros-args"], on_exit="ignore")]
    sys.exit(Launcher(nodes, name="test", standby=standby).run())
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a module in it."""
    (tmp_path / "a_node.py").write_text(MODULE.replace("CODE", "0"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{Path(__file__).parents[2]}")
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    return tmp_path


@pytest.fixture
def standby(folder: Path) -> Iterator[Standby]:
    """An interpreter that stands by for the module, which it has imported."""
    with Standby(["a_node"]) as standby:
        wait_for((folder / "imported").exists, "the import")
        yield standby


def imports(folder: Path) -> list[list[str]]:
    """As what the module was run, and in which process."""
    return [line.split() for line in (folder / "imported").read_text().splitlines()]


def test_node_runs_where_an_interpreter_stood_by(folder: Path) -> None:
    """With its arguments, the variables of the moment, an empty standard input, as __main__."""
    command = RunningCommand(folder, [sys.executable, "-c", DRIVER])
    assert command.wait() == 0
    line = next(line for line in command.out.splitlines() if line.startswith("[a]"))
    pid, arguments, said, typed = json.loads(line.removeprefix("[a] "))
    assert (arguments, said, typed) == (["x:=1", "--ros-args"], "later", "")
    assert imports(folder) == [["a_node", str(pid)], ["__main__", str(pid)]]
    assert command.err.splitlines() == [
        "[test] a ended by itself: it finished (exit code 0)",
        "[test] going on without a",
    ]


def test_who_is_not_needed_is_ended(folder: Path, standby: Standby) -> None:
    """On leaving the block, also after an error; and by itself when its parent was killed."""
    (_, pid), *_ = imports(folder)
    assert standby.take(python_node("b", "another")) is None
    assert alive(int(pid))
    standby.__exit__(None, None, None)
    assert not alive(int(pid))


def test_one_stands_by_for_one_start(standby: Standby) -> None:
    """A second start of the same node finds nobody."""
    node = python_node("a", "a_node")
    process = standby.take(node)
    assert process is not None and process.wait(30.0) == 0
    assert standby.take(node) is None
    assert standby.take(Node("x", ("x",))) is None


def test_a_killed_parent_leaves_nobody(folder: Path) -> None:
    """They ask to die with it."""
    endless = DRIVER.replace("    os.environ", "    time.sleep(600)\n    os.environ")
    command = RunningCommand(folder, [sys.executable, "-c", endless])
    wait_for(lambda: (folder / "imported").exists() and imports(folder), "the import")
    (_, pid), *_ = imports(folder)
    command.send(signal.SIGKILL)
    command.wait()
    wait_for(lambda: not alive(int(pid)), "the end of who stood by")


def test_a_dead_one_is_replaced(folder: Path, standby: Standby) -> None:
    """The launcher then starts the node afresh."""
    (_, pid), *_ = imports(folder)
    os.kill(int(pid), signal.SIGKILL)
    os.waitid(os.P_PID, int(pid), os.WEXITED | os.WNOWAIT)
    assert standby.take(python_node("a", "a_node")) is None


def test_broken_module_is_reported_when_it_is_run(folder: Path, standby: Standby) -> None:
    """As without standing by: by its own traceback, and exit code 1."""
    (folder / "broken.py").write_text("raise ValueError('a fault')\n")
    with Standby(["broken"]) as waiting:
        process = waiting.take(python_node("b", "broken"))
        assert process is not None
        _, said = process.communicate(timeout=30.0)
    assert process.returncode == 1
    assert said.decode().endswith("ValueError: a fault\n")


def test_what_is_imported_later_is_imported_while_waiting(folder: Path) -> None:
    """Only as long as there is nothing else to do."""
    (folder / "later.py").write_text("open('was_imported', 'w').close()\n")
    (folder / "early.py").write_text("IMPORTED_LATER = ('later',)\n")
    with Standby(["early"]) as waiting:
        wait_for((folder / "was_imported").exists, "the import")
        process = waiting.take(python_node("e", "early"))
        assert process is not None and process.wait(30.0) == 0


@pytest.mark.parametrize("words", [["--help"], ["viewer:=nowhere"]])
def test_no_bringup_leaves_anybody_standing_by(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither one that answers a question, nor one that is called wrongly."""
    monkeypatch.setenv(MARK, str(tmp_path))
    robot = Robot("test", "a test", model=str(tmp_path / "none.urdf"), control="x.yaml")
    try:
        assert bring_up(robot, words) == 0
    except UsageError:
        assert words != ["--help"]
    assert set(marked(str(tmp_path))) <= {os.getpid()}
