"""Starts a real launcher in a process of its own, on small scripts, for the launcher's tests."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from tests.support import PATIENCE, wait_for

_DRIVER = """
import sys
from onebot_bringup.launcher.launcher import Grace, Launcher
from onebot_bringup.launcher.process import NodeProcess, Restart, python_node

def script(name, path, on_exit="shutdown", **more):
    return NodeProcess(name, (sys.executable, "-u", path), on_exit, **more)

with Launcher("test", {grace}) as launcher:
    sys.exit(launcher.run({nodes}))
"""

# A script waits for a signal; signal.pause() would miss one that came just before it.
IDLE = "while True:\n    time.sleep(0.05)\n"
# Beyond any deadline of the tests: on a slow machine, too, a node has the time to stop by itself.
PATIENT = "Grace(terminate=300.0, kill=300.0, give_up=300.0)"


def command_of(nodes: str, grace: str = PATIENT) -> list[str]:
    """A command that launches the nodes that the Python expression ``nodes`` lists."""
    return [sys.executable, "-c", _DRIVER.format(nodes=nodes, grace=grace)]


class RunningCommand:
    """A process whose output goes to files that can be read at any time."""

    def __init__(
        self, folder: Path, command: list[str], environment: dict[str, str] | None = None
    ) -> None:
        name = time.monotonic_ns()  # several may run in one folder
        self._out, self._err = folder / f"stdout-{name}", folder / f"stderr-{name}"
        with self._out.open("wb") as out, self._err.open("wb") as err:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                cwd=folder,
                env={**os.environ, **(environment or {})},
                start_new_session=True,
            )

    @property
    def out(self) -> str:
        """What it wrote to standard output so far."""
        return self._out.read_text()

    @property
    def err(self) -> str:
        """What it wrote to standard error so far."""
        return self._err.read_text()

    def says(self, text: str) -> None:
        """Wait until it has printed ``text``."""

        def condition() -> bool:
            ended = self.process.poll() is not None
            found = text in self.out or text in self.err
            assert found or not ended, self.err
            return found

        wait_for(condition, f"{text!r} in the output")

    def send(self, number: int) -> None:
        """Send a signal to the launcher alone."""
        self.process.send_signal(number)

    def wait(self, timeout: float = PATIENCE) -> int:
        """Wait for its end and return the exit code."""
        return self.process.wait(timeout)

    def interrupt(self) -> int:
        """Press Ctrl-C; the exit code."""
        if self.process.poll() is None:
            self.send(signal.SIGINT)
        return self.wait()

    def close(self) -> None:
        """Kill it if it still runs."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            self.process.wait(PATIENCE)


Start = Callable[..., RunningCommand]


@contextmanager
def launchers(folder: Path, scripts: Mapping[str, str]) -> Iterator[Start]:
    """Start launchers in ``folder``, where the scripts lie; end them afterwards."""
    for name, text in scripts.items():
        (folder / f"{name}.py").write_text(text)
    started: list[RunningCommand] = []

    def make(nodes: str, grace: str = PATIENT) -> RunningCommand:
        started.append(RunningCommand(folder, command_of(nodes, grace)))
        return started[-1]

    yield make
    for launcher in started:
        launcher.close()


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
