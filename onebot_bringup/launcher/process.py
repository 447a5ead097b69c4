"""One running node: its process, its process group and its output."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO, Literal

from onebot_bringup.launcher.guard import child_setup, group_alive, signal_group

# Opening processes, Python modules among them.

_START_MODULE = "onebot_bringup.launcher.interpreter"
_BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")  # the first is OpenBLAS's own


def open_process(
    command: Sequence[str],
    environment: Mapping[str, str],
    hold_interrupt: bool,
    stdin: int = subprocess.DEVNULL,
) -> subprocess.Popen[bytes]:
    """Start a program that leads a session of its own, its output into pipes.

    Args:
        command: the program and its arguments.
        environment: all of its variables.
        hold_interrupt: start it with SIGINT blocked.
        stdin: ``subprocess.PIPE`` for one to write to.

    Raises:
        OSError: the program cannot be run.
    """
    return subprocess.Popen(
        command,
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        bufsize=0,
        env=environment,
        start_new_session=True,
        preexec_fn=child_setup(hold_interrupt),
    )


def module_command(module: str) -> tuple[str, ...]:
    """Return what runs a Python module as a node, without its arguments."""
    return (sys.executable, "-m", _START_MODULE, module)


def python_environment() -> dict[str, str]:
    """Return the variables that the interpreter of a node needs from its start."""
    variables = {"PYTHONUNBUFFERED": "1", **_safe_path()}
    if not any(name in os.environ for name in _BLAS_THREADS):
        # No node multiplies matrices so large that it would pay, and to start the threads takes
        # longer than all of numpy's other modules.
        variables[_BLAS_THREADS[0]] = "1"
    return variables


def _safe_path() -> dict[str, str]:
    """Keep a stray ``yaml.py`` in the working directory from being imported by the nodes.

    Only where the launcher itself was not found through the working directory.
    """
    here = sys.path[0] in ("", os.getcwd()) if sys.path else False
    return {} if here else {"PYTHONSAFEPATH": "1"}


# What the launcher is asked to run: one node, one process.

OnExit = Literal["shutdown", "restart", "ignore"]


@dataclass(frozen=True)
class Restart:
    """How often and how fast a node that ended is started again.

    Attributes:
        limit: how many times in a row before the launcher gives up.
        first_wait: seconds before the first new start; doubled for each further one.
        longest_wait: seconds, the cap of that doubling.
        healthy_after: seconds; a node that lived this long starts counting from zero again.
    """

    limit: int = 5
    first_wait: float = 1.0
    longest_wait: float = 10.0
    healthy_after: float = 30.0

    def wait(self, restarts: int) -> float:
        """Seconds to wait before a start when there were ``restarts`` in a row already."""
        return float(min(self.first_wait * 2.0**restarts, self.longest_wait))


@dataclass(frozen=True)
class Node:
    """One process to run.

    Attributes:
        name: what its lines of output are prefixed with.
        command: the program and its arguments.
        on_exit: what happens when it ends although nobody asked it to: ``"shutdown"`` brings
            everything down, ``"restart"`` starts it again, ``"ignore"`` goes on without it.
        environment: variables added to those of the launcher.
        restart: for ``on_exit="restart"``.
        hold_interrupt: start with SIGINT blocked; the program unblocks it when it is ready for
            it (see ``start_module``).
        module: the Python module that it is, if an interpreter may stand by for it; else empty.
        nice: how far it stands back where processors are short, 0 to 19 (see nice(2)).
    """

    name: str
    command: tuple[str, ...]
    on_exit: OnExit = "shutdown"
    environment: Mapping[str, str] = field(default_factory=dict)
    restart: Restart = Restart()
    hold_interrupt: bool = False
    module: str = ""
    nice: int = 0

    @property
    def arguments(self) -> tuple[str, ...]:
        """What a Python module gets as arguments."""
        return self.command[len(module_command(self.module)) :]


def python_node(
    name: str,
    module: str,
    arguments: Iterable[str] = (),
    *,
    on_exit: OnExit = "shutdown",
    environment: Mapping[str, str] | None = None,
    nice: int = 0,
) -> Node:
    """Return a node that is a Python module, run by the interpreter that runs the launcher."""
    command = (*module_command(module), *arguments)
    variables = {**python_environment(), **(environment or {})}
    return Node(name, command, on_exit, variables, hold_interrupt=True, module=module, nice=nice)


_READ = 65536  # bytes at once; also the longest line that is kept whole
_MOST_READS = 1000
_LINE_SINK = Callable[[bytes], None]


class LineReader:
    """Cuts what a pipe delivers into lines."""

    def __init__(self, pipe: IO[bytes], sink: _LINE_SINK) -> None:
        """Read from ``pipe`` without blocking; each line goes to ``sink``, without newline."""
        self.pipe = pipe
        self._sink = sink
        self._rest = b""
        os.set_blocking(pipe.fileno(), False)

    def read(self) -> bool:
        """Read once; return whether there may be more to come at once."""
        try:
            data = os.read(self.pipe.fileno(), _READ)
        except BlockingIOError:
            return False
        if not data:
            self.close()
            return False
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            self._sink(line)
        if len(self._rest) >= _READ:
            self._flush()
        return True

    def close(self) -> None:
        """Hand on a last line that has no newline, and close the pipe."""
        self._flush()
        self.pipe.close()

    def _flush(self) -> None:
        if self._rest:
            self._sink(self._rest)
            self._rest = b""


class RunningNode:
    """A node that was started; it leads a process group (and session) of its own.

    So a terminal's Ctrl-C reaches only the launcher, which passes it on once.
    """

    def __init__(
        self,
        node: Node,
        out: _LINE_SINK,
        err: _LINE_SINK,
        process: subprocess.Popen[bytes] | None = None,
    ) -> None:
        """Start ``node``; its lines go to ``out`` and ``err``.

        Args:
            node: to start.
            out: takes each line of its standard output.
            err: takes each line of its standard error.
            process: of ``open_process``, that runs it already; None to start one.

        Raises:
            OSError: the program cannot be run.
        """
        self.node = node
        self.started = time.monotonic()
        self._told_the_rest = False
        environment = {**os.environ, **node.environment}
        self._process = process or open_process(node.command, environment, node.hold_interrupt)
        if node.nice:
            niceness = min(os.getpriority(os.PRIO_PROCESS, 0) + node.nice, 19)
            with contextlib.suppress(ProcessLookupError):  # it has ended already
                os.setpriority(os.PRIO_PROCESS, self._process.pid, niceness)
        assert self._process.stdout is not None and self._process.stderr is not None
        self.readers = (
            LineReader(self._process.stdout, out),
            LineReader(self._process.stderr, err),
        )

    @property
    def group(self) -> int:
        """The id of the process, and of the group that it leads."""
        return self._process.pid

    def exit_code(self) -> int | None:
        """Return the exit code, minus the signal's number if one ended it, None if it runs."""
        return self._process.poll()

    def gone(self) -> bool:
        """Return whether it and all that it started have ended."""
        return self.exit_code() is not None and not group_alive(self.group)

    def interrupt(self) -> None:
        """Ask the node itself to stop; it then stops what it started, in its own order."""
        if self.exit_code() is None:
            os.kill(self.group, signal.SIGINT)

    def terminate_rest(self) -> None:
        """Ask what an ended node has left behind to stop, once."""
        if not self._told_the_rest:
            self._told_the_rest = True
            self.signal_all(signal.SIGTERM)

    def signal_all(self, number: int) -> None:
        """Send a signal to the node and all that it started."""
        signal_group(self.group, number)

    def drain(self) -> None:
        """Read what is left in the pipes, without waiting for whoever else holds them open."""
        for reader in self.readers:
            for _ in range(_MOST_READS):  # a bound, should someone else go on writing for ever
                if reader.pipe.closed or not reader.read():
                    break

    def close(self) -> None:
        """Read what is left and close the pipes."""
        self.drain()
        for reader in self.readers:
            if not reader.pipe.closed:
                reader.close()


def describe_exit(code: int) -> str:
    """Return an exit code in words; a negative one is the signal that ended the process."""
    if code == 0:
        return "it finished (exit code 0)"
    if code > 0:
        return f"exit code {code}"
    hints = {
        signal.SIGSEGV: ", a crash in compiled code",
        signal.SIGABRT: ", a crash in compiled code",
        signal.SIGKILL: ", perhaps the system ran out of memory",
    }
    try:
        number = signal.Signals(-code)
    except ValueError:
        return f"ended by signal {-code}"
    return f"ended by {number.name}{hints.get(number, '')}"
