"""Rerun's own program as a child process that can never outlive us, whatever ends us."""

import contextlib
import ctypes
import os
import signal
import socket
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO

import rerun_cli  # type: ignore[import-untyped]

from onebot_description.errors import OneBotError

LOOPBACK = "127.0.0.1"
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_LIBC = ctypes.CDLL(None)  # looked up before any fork, because the child may not allocate much


def program() -> Path:
    """Return the Rerun program itself.

    Not the ``rerun`` script: that is a Python shim, and killing it would leave the program behind.
    """
    path = Path(rerun_cli.__file__).parent / "rerun"
    if not path.is_file():
        raise OneBotError(f"there is no Rerun viewer at {path}; reinstall the rerun-sdk package")
    return path


class Child:
    """A running Rerun program."""

    def __init__(self, arguments: Sequence[str], environment: dict[str, str] | None = None) -> None:
        """Start it; all its sockets belong to 127.0.0.1, and it dies with this process.

        Call it from the main thread: Linux delivers the death signal when the *thread* that
        started the child ends.
        """
        self._output: IO[bytes] = tempfile.TemporaryFile()
        variables = {**os.environ, "RUST_LOG": "warn", "NO_COLOR": "1"}
        variables["CI"] = "true"  # keeps Rerun from sending usage statistics
        variables.update(environment or {})
        self._process = subprocess.Popen(
            [str(program()), "--bind", LOOPBACK, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
            env=variables,
            start_new_session=True,  # Ctrl-C is for us; we end the child ourselves
            preexec_fn=_die_with(os.getpid()),
        )

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def running(self) -> bool:
        """False once it has ended."""
        return self._process.poll() is None

    def last_words(self) -> str:
        """Return the last line it wrote, or its exit code."""
        self._output.seek(0, os.SEEK_END)
        self._output.seek(max(0, self._output.tell() - 4000))
        lines = self._output.read().decode(errors="replace").strip().splitlines()
        return lines[-1].strip() if lines else f"exit code {self._process.poll()}"

    def output(self) -> str:
        """Return all it wrote."""
        self._output.seek(0)
        return self._output.read().decode(errors="replace")

    def stop(self, patience: float = 1.5) -> None:
        """Ask it to end, and make it after ``patience`` seconds."""
        if self.running:
            self._process.terminate()
            try:
                self._process.wait(patience)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._output.close()


def _die_with(parent: int) -> Callable[[], None]:
    def arrange() -> None:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it died before we asked
            os._exit(1)

    return arrange


def free_port(wanted: int) -> int:
    """Return ``wanted`` if nobody listens there on this host, else (or for 0) any free port.

    Raises:
        OneBotError: ``wanted`` is no port.
    """
    if not 0 <= wanted <= 65535:
        raise OneBotError(f"{wanted} is no port: write a number from 1 to 65535, or 0 for any")
    for port in (wanted, 0):
        # No SO_REUSEADDR alone: a port in use must be refused, one in TIME_WAIT may be taken.
        with contextlib.closing(socket.socket()) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((LOOPBACK, port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise OneBotError("there is no free port on 127.0.0.1")


def answers(port: int) -> bool:
    """Return whether something accepts connections on 127.0.0.1:``port``."""
    try:
        with socket.create_connection((LOOPBACK, port), timeout=0.2):
            return True
    except OSError:
        return False
