"""One running node: its process, its process group and its output."""

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Callable
from typing import IO

from onebot_bringup.launcher.groups import group_alive, signal_group
from onebot_bringup.launcher.node import Node
from onebot_bringup.launcher.opening import open_process

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
