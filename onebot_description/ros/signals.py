"""Handles signals that ask a process to stop: Ctrl-C, SIGTERM, and a closed terminal.

In a node they call a function (``StopSignals``), in a console command they raise KeyboardInterrupt
(``KeyboardInterrupts``), and the launcher passes ``stop_signals`` to its event loop.
"""

import signal
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

# SIGINT is set, too, because shells start background jobs with SIGINT ignored.
_STOP = (signal.SIGINT, signal.SIGTERM)
_LONGEST_STOP = 1.0  # s to wait for a function that a signal calls


def stop_signals() -> tuple[signal.Signals, ...]:
    """Return the signals that stop a command: SIGHUP too, unless ignored as under nohup."""
    hangup: signal.Signals | None = getattr(signal, "SIGHUP", None)  # Windows has none
    if hangup is None or signal.getsignal(hangup) == signal.SIG_IGN:
        return _STOP
    return (*_STOP, hangup)


class KeyboardInterrupts:
    """A context in which each of ``stop_signals`` raises KeyboardInterrupt in the main thread."""

    def __init__(self) -> None:
        self._arrived = self._deferring = False

    def __enter__(self) -> "KeyboardInterrupts":
        """Install the handlers."""
        self._old = {number: signal.signal(number, self._handle) for number in stop_signals()}
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the previous handlers."""
        _restore(self._old)
        _forget_interrupt()

    def check(self) -> None:
        """Raise KeyboardInterrupt again if a library has swallowed it."""
        if self._arrived:
            raise KeyboardInterrupt

    @contextmanager
    def deferred(self) -> Iterator[Callable[[], bool]]:
        """Defer the first signal's KeyboardInterrupt to the end of the context, but not the second.

        Use it for work that an executor has to finish in order: an exception that passes through
        rclpy may leave it without some of its callbacks.

        Yields:
            A function that returns whether a signal has arrived.
        """
        self._deferring = True
        try:
            yield lambda: self._arrived
        finally:
            self._deferring = False
        self.check()

    def _handle(self, *_: object) -> None:
        is_second, self._arrived = self._arrived, True
        if is_second or not self._deferring:
            raise KeyboardInterrupt


class StopSignals:
    """A context that calls ``on_stop`` from a thread as soon as SIGINT or SIGTERM arrives.

    A Python handler alone would run only when the executor's C++ code returns to Python. The
    wake-up socket is written by the C-level handler, whatever the main thread is doing.
    """

    def __init__(
        self, on_stop: Callable[[], None], on_resume: Callable[[], None] = lambda: None
    ) -> None:
        """Prepare; ``on_resume`` is called, from any thread, when SIGCONT ends a SIGSTOP."""
        self._on_stop, self._on_resume = on_stop, on_resume
        self._arrived = self._interrupting = False
        self._read, self._write = socket.socketpair()
        self._write.setblocking(False)

    @contextmanager
    def interrupting(self) -> Iterator[None]:
        """Within this context, a signal also raises KeyboardInterrupt in the main thread.

        Use it around work that may take seconds and can be interrupted anywhere. A signal that
        arrived before counts, too.
        """
        self._interrupting = True
        try:
            if self._arrived:
                raise KeyboardInterrupt
            yield
        except Exception as error:
            if self._arrived:  # C++ code may convert it to another error
                raise KeyboardInterrupt from error
            raise
        finally:
            self._interrupting = False

    def __enter__(self) -> "StopSignals":
        """Install the handlers."""
        self._old_fd = signal.set_wakeup_fd(self._write.fileno(), warn_on_full_buffer=False)
        self._old = {number: signal.signal(number, self._handle) for number in _STOP}
        # In the main thread, this handler runs before any Python code after the signal; other
        # threads may run earlier, and are served by ``_watch``.
        self._old[signal.SIGCONT] = signal.signal(signal.SIGCONT, lambda *_: self._on_resume())
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the previous handlers."""
        signal.set_wakeup_fd(self._old_fd)
        _restore(self._old)
        self._write.close()  # ends the thread's recv
        # Python aborts if a thread returns from rclpy during its exit.
        self._thread.join(_LONGEST_STOP)
        _forget_interrupt()

    def _handle(self, *_: object) -> None:
        self._arrived = True
        if self._interrupting:
            self._interrupting = False  # once is enough: cleaning up must not be interrupted
            raise KeyboardInterrupt

    def _watch(self) -> None:
        while number := self._read.recv(1):
            if number[0] == signal.SIGCONT:
                self._on_resume()
            else:
                self._on_stop()


def _forget_interrupt() -> None:
    """Make the process end with its exit code after a KeyboardInterrupt was handled.

    If the exception passed through exec() of a string, as in the creation of dataclasses and named
    tuples, CPython kills the process by SIGINT at exit. Executing another string resets that.
    """
    eval("None")


def _restore(handlers: Mapping[signal.Signals, Any]) -> None:
    for number, handler in handlers.items():
        signal.signal(number, handler)
