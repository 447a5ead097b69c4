"""Starts nodes as processes, and represents running ones.

``launcher.py`` decides when they are signalled.
"""

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

from onebot_bringup.launcher.orphans import die_with_this_thread
from onebot_description.ros.process_start import blas_variables

OnExit = Literal["shutdown", "ignore"]

_INTERPRETER = "onebot_bringup.launcher.interpreter"
_LONGEST_LINE = 65536  # bytes; longer lines are split
_LAST_OUTPUT = 0.25  # s to wait for the last output: another process may hold the pipe open


@dataclass(frozen=True)
class NodeProcess:
    """A node to be started: a Python module, run by the launcher's interpreter."""

    name: str  # the prefix of its output lines
    module: str  # the full name of the module
    arguments: Sequence[str] = ()  # the module's command-line arguments
    # What to do if it ends unexpectedly: "shutdown" stops everything, "ignore" continues.
    on_exit: OnExit = "shutdown"
    nice: int = 0  # 0 to 19; higher values yield to other processes (see nice(2))


def _safe_path() -> dict[str, str]:
    """Return variables that keep nodes from importing a stray ``yaml.py`` in the working directory.

    They are empty if the launcher itself was found through the working directory.
    """
    here = sys.path[0] in ("", os.getcwd()) if sys.path else False
    return {} if here else {"PYTHONSAFEPATH": "1"}


Sink = Callable[[bytes], object]
"""A function that takes a line of output, without its newline."""


class Lines:
    """Splits output into lines."""

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self._rest = b""

    def feed(self, data: bytes) -> None:
        """Pass on each complete line in the output so far."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            self._sink(line)
        if len(self._rest) >= _LONGEST_LINE:
            self.close()

    def close(self) -> None:
        """Pass on a last line without a newline."""
        if self._rest:
            self._sink(self._rest)
            self._rest = b""


class RunningProcess(asyncio.SubprocessProtocol):
    """A running process that leads its own session, and so its own process group.

    A terminal's Ctrl-C reaches only the launcher, which passes it on once.
    """

    def __init__(self, out: Sink, err: Sink) -> None:
        self.ended: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        self._output_ended = asyncio.Event()
        self._output = {1: Lines(out), 2: Lines(err)}

    # Called by the event loop

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.SubprocessTransport)
        self._transport = transport

    def pipe_data_received(self, fd: int, data: bytes) -> None:
        self._output[fd].feed(data)

    def process_exited(self) -> None:
        # In some versions, asyncio's wait() waits for all processes that hold the pipes.
        code = self._transport.get_returncode()
        if code is not None and not self.ended.done():
            self.ended.set_result(code)

    def connection_lost(self, error: Exception | None) -> None:
        self._output_ended.set()  # it has ended, and no process holds its pipes

    # Called by the launcher

    @property
    def group(self) -> int:
        """The id of the process, and of the process group that it leads."""
        return self._transport.get_pid()

    def interrupt(self) -> None:
        """Ask the node itself to stop; it then stops its own children in its own order."""
        if not self.ended.done():
            # asyncio's send_signal() may take the exit code away from a waiting task.
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.group, signal.SIGINT)

    def signal_all(self, number: int) -> None:
        """Send a signal to the node and all processes that it started, if there are any left."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.group, number)

    async def close(self) -> None:
        """Read the rest of its output and close the pipes; kill it if it still runs."""
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(self._output_ended.wait(), _LAST_OUTPUT)
        self._transport.close()
        for lines in self._output.values():
            lines.close()


async def spawn(node: NodeProcess, out: Sink, err: Sink) -> RunningProcess:
    """Start a node, which is killed with this thread; the sinks take its output."""
    command = (sys.executable, "-m", _INTERPRETER, node.module, *node.arguments)
    variables = {"PYTHONUNBUFFERED": "1", **_safe_path(), **blas_variables()}
    _, process = await asyncio.get_running_loop().subprocess_exec(
        partial(RunningProcess, out, err),
        *command,
        stdin=subprocess.DEVNULL,
        env={**os.environ, **variables},
        start_new_session=True,
        preexec_fn=partial(_set_up_child, node.nice, die_with_this_thread()),
    )
    return process


def _set_up_child(nice: int, die_with_parent: Callable[[], None] | None) -> None:
    """Prepare a child between fork and exec."""
    if die_with_parent is not None:
        die_with_parent()
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # until the interpreter is ready
    os.nice(nice)


def describe_exit(code: int) -> str:
    """Return an exit code in words; a negative one is the signal that ended the process."""
    if code >= 0:
        return f"exit code {code}"
    hint = ", perhaps the system ran out of memory" if code == -signal.SIGKILL else ""
    return f"ended by signal {-code}, {signal.strsignal(-code)}{hint}"
