"""Starts a real launcher in a process of its own, on small scripts, for the launcher's tests."""

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tests.support import RunningProcess, wait_for

_DRIVER = """
import sys
from onebot_bringup.launcher.launcher import Grace, Launcher
from onebot_bringup.launcher.process import NodeProcess, python_node

def script(name, path, on_exit="shutdown", **more):
    return NodeProcess(name, (sys.executable, "-u", path), on_exit, **more)

sys.exit(Launcher("test", {grace}).run({nodes}))
"""

# A script waits for a signal; signal.pause() would miss one that came just before it.
IDLE = "while True:\n    time.sleep(0.05)\n"
# Beyond any deadline of the tests: on a slow machine, too, a node has the time to stop by itself.
PATIENT = "Grace(terminate=300.0, kill=300.0, give_up=300.0)"


def command_of(nodes: str, grace: str = PATIENT) -> list[str]:
    """A command that launches the nodes that the Python expression ``nodes`` lists."""
    return [sys.executable, "-c", _DRIVER.format(nodes=nodes, grace=grace)]


Start = Callable[..., RunningProcess]


@contextmanager
def launchers(folder: Path, scripts: Mapping[str, str]) -> Iterator[Start]:
    """Start launchers in ``folder``, where the scripts lie; end them afterwards."""
    for name, text in scripts.items():
        (folder / f"{name}.py").write_text(text)
    with ExitStack() as stack:

        def make(nodes: str, grace: str = PATIENT) -> RunningProcess:
            process = RunningProcess(command_of(nodes, grace), folder, check=False)
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
