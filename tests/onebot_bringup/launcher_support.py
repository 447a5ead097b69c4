"""Starts a real launcher in a process of its own, on small modules, for the launcher's tests."""

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tests.support import RunningProcess, wait_for

_DRIVER = """
import sys
from onebot_bringup.launcher import launcher
from onebot_bringup.launcher.process import NodeProcess as Node

if {patient}:
    launcher._TERMINATE = launcher._KILL = launcher._GIVE_UP = 300.0
sys.exit(launcher.Launcher("test").run({nodes}))
"""

# A script waits for a signal; signal.pause() would miss one that came just before it.
IDLE = "while True:\n    time.sleep(0.05)\n"


def command_of(nodes: str, *, patient: bool = True) -> list[str]:
    """A command that launches the nodes that the Python expression ``nodes`` lists.

    A ``patient`` one gives them all the time to stop by themselves, as on a slow machine.
    """
    return [sys.executable, "-c", _DRIVER.format(nodes=nodes, patient=patient)]


Start = Callable[..., RunningProcess]


@contextmanager
def launchers(folder: Path, scripts: Mapping[str, str]) -> Iterator[Start]:
    """Start launchers in ``folder``, where the modules lie; end them afterwards."""
    for name, text in scripts.items():
        (folder / f"{name}.py").write_text(text)
    with ExitStack() as stack:

        def make(nodes: str, *, patient: bool = True) -> RunningProcess:
            process = RunningProcess(command_of(nodes, patient=patient), folder, check=False)
            return stack.enter_context(process)

        yield make


def alive(pid: int) -> bool:
    """Return whether a process runs; a zombie does not."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] not in "ZX"


def number_in(path: Path) -> int:
    """Wait for a script to write a whole number and a newline to ``path``, and return it."""
    wait_for(lambda: path.is_file() and path.read_text().endswith("\n"), f"a number in {path.name}")
    return int(path.read_text())
