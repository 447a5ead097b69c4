"""Signals as something to wait for in a ``select`` loop."""

import signal
import socket
from types import TracebackType

STOP = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class SignalQueue:
    """While open, collects the signals that ask to stop; its socket wakes a ``select``.

    SIGCHLD only wakes. A SIGHUP that was ignored from the start (nohup) stays ignored.
    """

    def __init__(self) -> None:
        """Nothing is changed until the queue is entered."""
        self._arrived: list[int] = []
        self._read, self._write = socket.socketpair()
        self._read.setblocking(False)
        self._write.setblocking(False)

    def fileno(self) -> int:
        """The descriptor that becomes readable when a signal arrives."""
        return self._read.fileno()

    def take(self) -> list[int]:
        """Return the stop signals that arrived since the last call, in order."""
        try:
            while self._read.recv(64):
                pass
        except BlockingIOError:
            pass
        taken, self._arrived = self._arrived, []
        return taken

    def __enter__(self) -> "SignalQueue":
        """Install the handlers."""
        self._old_wakeup = signal.set_wakeup_fd(self._write.fileno(), warn_on_full_buffer=False)
        self._old = {signal.SIGCHLD: signal.signal(signal.SIGCHLD, lambda *_: None)}
        for number in STOP:
            if number == signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN:
                continue
            self._old[number] = signal.signal(number, lambda n, _: self._arrived.append(n))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Put the former handlers back."""
        for number, handler in self._old.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._old_wakeup)
        self._read.close()
        self._write.close()
