"""Ends blocking callbacks of nodes in lockstep: simulated time stands still until they return."""

import signal
import sys
import threading
import time
import traceback
from types import FrameType
from weakref import WeakSet

from rclpy.executors import Executor
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node

from onebot_description.errors import OneBotError

_SIGNAL = signal.SIGURG  # interrupts system calls, is unused otherwise, and ignored by default
_LONGEST_WAIT = 1.0  # s between two checks
_CALLER = "onebot_control.nodes.stepped_executor"  # the module that calls callbacks


class _Ended(BaseException):
    """Ends a callback that has caught the error."""


class CallbackWatch:
    """Raises an error in a callback that has not returned in time.

    A signal interrupts the callback, so only callbacks in the main thread can be ended. This is a
    context manager around each callback; see ``running``.

    Attributes:
        foreign: other executors and guard conditions of wait sets, whose waits no signal ends.
    """

    def __init__(self, timeout: float) -> None:
        """Watch callbacks until ``close``, each for ``timeout`` s of wall time; inf: forever."""
        self.foreign: WeakSet[Executor | GuardCondition] = WeakSet()
        self._timeout, self._since = timeout, float("inf")
        self._failure: OneBotError | None = None
        self._node: Node | None = None
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None
        if timeout < threading.TIMEOUT_MAX and _in_main_thread():
            self._previous = signal.signal(_SIGNAL, self._end)
            self._thread = threading.Thread(target=self._watch, name="callbacks", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Stop watching."""
        self._closed.set()
        if self._thread is not None:
            self._thread.join()
            if _in_main_thread():
                signal.signal(_SIGNAL, self._previous)

    def running(self, node: Node | None) -> "CallbackWatch":
        """Return a context in which a callback of ``node`` runs; None if the node is unknown."""
        self._node = node
        return self

    def __enter__(self) -> None:
        self._since = time.monotonic()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._since = float("inf")
        failure, self._failure = self._failure, None
        if failure is not None and kind in (None, _Ended):
            raise failure

    def fail(self, error: OneBotError) -> OneBotError:
        """Return an error to raise in a callback; if the callback catches it, raise it again."""
        if self._since < float("inf"):
            self._failure = error
        return error

    def refuse_to_sleep(self) -> None:
        """Raise an error for a sleep on simulated time in the thread that advances it.

        Raises:
            OneBotError: always.
        """
        if self._since == float("inf"):
            raise OneBotError(
                "simulated time only passes in Simulation.run: nothing can sleep on it"
            )
        raise self.fail(OneBotError(self._text(sys._getframe(1), "sleeps on simulated time")))

    def _watch(self) -> None:
        main = threading.main_thread().ident
        assert main is not None
        while not self._closed.wait(min(self._timeout / 8.0, _LONGEST_WAIT)):
            if time.monotonic() - self._since >= self._timeout:
                for waited in list(self.foreign):
                    (waited.wake if isinstance(waited, Executor) else waited.trigger)()
                signal.pthread_kill(main, _SIGNAL)

    def _end(self, _: int, frame: FrameType | None) -> None:
        """Raise an error in the main thread if its callback has taken too long."""
        now = time.monotonic()
        if now - self._since < self._timeout or _is_debugged():
            return
        self._since = now
        if self._failure is not None:  # the callback has caught it, and continues
            raise _Ended
        late = f"has not returned in {self._timeout:g} s of wall time"
        text = f"{self._text(frame, late)}; ros(callback_timeout=...) allows more"
        raise self.fail(OneBotError(text))

    def _text(self, frame: FrameType | None, problem: str) -> str:
        frames = list[FrameType]()
        for caller, _ in traceback.walk_stack(frame):
            if caller.f_globals.get("__name__") == _CALLER:
                break
            frames.append(caller)
        # An action's callback runs in a task, whose node is only known to the action server.
        owners = (caller.f_locals.get("self") for caller in frames)
        nodes = (self._node, *(getattr(owner, "_node", owner) for owner in owners))
        node = next(
            (f'"{candidate.get_name()}"' for candidate in nodes if isinstance(candidate, Node)), ""
        )
        called = [
            candidate.f_code
            for candidate in frames
            if not candidate.f_globals["__name__"].startswith("rclpy.")
        ]
        code = called[-1] if called else frames[-1].f_code
        name = getattr(code, "co_qualname", code.co_name)  # new in Python 3.11
        return (
            f"node {node}: {name} {problem} ({code.co_filename}:{code.co_firstlineno}). Simulated"
            " time stands still during a callback, so it cannot wait for messages, answers or time"
        )


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def _is_debugged() -> bool:
    """Return whether a debugger, other than a coverage tool, traces the current thread."""
    monitoring = getattr(sys, "monitoring", None)  # new in Python 3.12
    if monitoring is not None and monitoring.get_tool(monitoring.DEBUGGER_ID):
        return True
    trace = sys.gettrace()
    return trace is not None and not type(trace).__module__.startswith("coverage")
