"""The launcher: a loop that starts nodes, relays their output and stops them.

One thread only. Everything that happens (output, a signal, the end of a child) wakes one ``poll``,
and what is due by the clock (new starts, harder signals) is looked at in every turn.
"""

import selectors
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from onebot_bringup.launcher.console import Console, OutputStream
from onebot_bringup.launcher.guard import Guard
from onebot_bringup.launcher.interpreter import Standby
from onebot_bringup.launcher.process import LineReader, Node, RunningNode, describe_exit

# The nodes that run, their output wired to the console and their groups known to the guard.


class RunningNodes:
    """Starts nodes, reads what they print, and forgets those that are gone."""

    def __init__(
        self,
        selector: selectors.BaseSelector,
        console: Console,
        temporary: Sequence[Path],
        standby: Standby,
    ) -> None:
        """None runs yet.

        Args:
            selector: to register their pipes with.
            console: where their lines go.
            temporary: folders to be removed should this process be killed.
            standby: interpreters to be used for the nodes they were started for.
        """
        self._selector, self._console, self._standby = selector, console, standby
        self._guard = Guard(temporary)
        self._running: list[RunningNode] = []

    def __bool__(self) -> bool:
        """Whether any runs."""
        return bool(self._running)

    def __iter__(self) -> Iterator[RunningNode]:
        """Those that run now; they may be forgotten meanwhile."""
        return iter(list(self._running))

    def start(self, node: Node) -> None:
        """Start ``node``.

        Raises:
            OSError: the program cannot be run.
        """
        out, err = (self._sink(node, stream) for stream in (self._console.out, self._console.err))
        running = RunningNode(node, out, err, self._standby.take(node))
        self._guard.add(running.group)
        self._running.append(running)
        for reader in running.readers:
            self._selector.register(reader.pipe.fileno(), selectors.EVENT_READ, reader)

    def _sink(self, node: Node, stream: OutputStream) -> Callable[[bytes], None]:
        return lambda line: self._console.line(node.name, line, stream)

    def read(self, reader: LineReader) -> None:
        """Read from a pipe that has something to read."""
        descriptor = reader.pipe.fileno()
        reader.read()
        if reader.pipe.closed:
            self._selector.unregister(descriptor)

    def forget(self, running: RunningNode) -> None:
        """Read what is left of its output; it is gone, or given up."""
        for reader in running.readers:
            if not reader.pipe.closed:
                self._selector.unregister(reader.pipe.fileno())
        running.close()
        self._running.remove(running)
        self._guard.discard(running.group)

    def close(self) -> None:
        """End the guard, which kills what was not forgotten."""
        self._guard.close()


# Which nodes are to be started again, and when.


class Restarts:
    """Counts the starts of nodes that keep ending, and plans the next ones."""

    def __init__(self) -> None:
        """Nothing is planned yet."""
        self._planned: list[tuple[float, Node]] = []
        self._done: dict[str, int] = {}

    def __bool__(self) -> bool:
        """Whether anything is planned."""
        return bool(self._planned)

    def plan(self, node: Node, lived: float) -> float | None:
        """Plan a new start of ``node``.

        Args:
            node: ended just now.
            lived: seconds it ran.

        Returns:
            Seconds until then, or None if it was started often enough in vain.
        """
        done = 0 if lived > node.restart.healthy_after else self.done(node)
        if done >= node.restart.limit:
            return None
        self._done[node.name] = done + 1
        wait = node.restart.wait(done)
        self._planned.append((time.monotonic() + wait, node))
        return wait

    def done(self, node: Node) -> int:
        """Return how many new starts of ``node`` there were, or are planned, in a row."""
        return self._done.get(node.name, 0)

    def until_next(self) -> float | None:
        """Return the seconds until the next start, None if none is planned."""
        if not self._planned:
            return None
        return max(0.0, min(at for at, _ in self._planned) - time.monotonic())

    def take_due(self) -> list[Node]:
        """Return the nodes to start now; they are no longer planned then."""
        now = time.monotonic()
        due = [node for at, node in self._planned if at <= now]
        self._planned = [(at, node) for at, node in self._planned if at > now]
        return due

    def cancel(self) -> None:
        """Start nothing any more."""
        self._planned.clear()


# How the order to stop is pressed harder with time.

TERMINATE, KILL, GIVE_UP = 1, 2, 3  # stages; 0 is SIGINT
# A wrapper such as `uv run` passes a Ctrl-C on that the terminal has already delivered.
_SAME_KEYSTROKE = 0.3  # seconds


@dataclass(frozen=True)
class Grace:
    """When to use which signal, in seconds after the order to stop; all is over within 5 s.

    Attributes:
        terminate: SIGTERM to what did not heed SIGINT.
        kill: SIGKILL to what did not heed SIGTERM either.
        give_up: leave even if the system has not removed them yet.
    """

    terminate: float = 2.5
    kill: float = 4.0
    give_up: float = 4.6


class Stopping:
    """The order to stop, once it was given.

    Attributes:
        stage: how hard it has been pressed so far.
    """

    def __init__(self, grace: Grace) -> None:
        """It has not been given yet."""
        self.stage = 0
        self._grace = grace
        self._since: float | None = None

    def __bool__(self) -> bool:
        """Whether it was given."""
        return self._since is not None

    def order(self) -> None:
        """Give it."""
        self._since = time.monotonic()

    def is_repeated(self) -> bool:
        """Return whether a signal that comes now is another order, and not the same keystroke."""
        return self._waited() > _SAME_KEYSTROKE

    def press(self, stage: int) -> bool:
        """Go to ``stage``; return False if it has got as far already."""
        if stage <= self.stage:
            return False
        self.stage = stage
        return True

    def due(self) -> list[int]:
        """Return the stages that are due by the clock, whether reached or not."""
        grace, waited = self._grace, self._waited()
        moments = {TERMINATE: grace.terminate, KILL: grace.kill, GIVE_UP: grace.give_up}
        return [stage for stage, moment in moments.items() if waited > moment]

    def _waited(self) -> float:
        return 0.0 if self._since is None else time.monotonic() - self._since


# Signals as something to wait for in a ``select`` loop.

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


_TURN = 0.05  # seconds; how often to look while stopping, or while output waits
# How a node may end that was asked to stop; 130 is what shells make of SIGINT.
_OBEDIENT = (0, -signal.SIGINT, -signal.SIGTERM, 130)


class Launcher:
    """Runs nodes until Ctrl-C, or until one that matters has ended.

    ``run`` may be called once, in the main thread.
    """

    def __init__(
        self,
        nodes: Sequence[Node],
        *,
        name: str = "launcher",
        started_message: str = "",
        grace: Grace | None = None,
        temporary: Sequence[Path] = (),
        standby: Standby | None = None,
    ) -> None:
        """Prepare to run ``nodes``.

        Args:
            nodes: what to start, in this order; their names must differ.
            name: the prefix of the launcher's own messages.
            started_message: printed once all processes have been started.
            grace: how long to wait for nodes that do not stop.
            temporary: folders of the nodes, to be removed should the launcher be killed; otherwise
                that is up to the caller.
            standby: interpreters for the first start of some of the nodes; the caller closes it.

        Raises:
            ValueError: two nodes have the same name.
        """
        if len({node.name for node in nodes}) < len(nodes):
            raise ValueError("two nodes have the same name")
        self._nodes = tuple(nodes)
        self._name = name
        self._started_message = started_message
        self._temporary = tuple(temporary)
        self._standby = standby or Standby()
        self._console = Console(sys.stdout, sys.stderr, [node.name for node in nodes])
        self._restarts = Restarts()
        self._stopping = Stopping(grace or Grace())
        self._exit_code = 0

    def run(self) -> int:
        """Start everything and return when everything has ended.

        Returns:
            0 when a signal asked to stop (or whoever read the output left), or when no node was
            left to run; 1 when a node that matters ended by itself or could not be started.
        """
        with SignalQueue() as self._signals, selectors.PollSelector() as self._selector:
            self._selector.register(self._signals, selectors.EVENT_READ)
            self._running = RunningNodes(
                self._selector, self._console, self._temporary, self._standby
            )
            try:
                self._start_all()
                while self._running or self._restarts:
                    self._turn()
            finally:
                self._leave()
        return self._exit_code

    # ---- one turn of the loop ----

    def _turn(self) -> None:
        for key, _ in self._selector.select(self._timeout()):
            if isinstance(key.data, LineReader):
                self._running.read(key.data)
        self._console.pump()
        for number in self._signals.take():
            self._on_signal(number)
        if self._console.out.broken and not self._stopping:
            self._stop()  # as in `mrm_bringup | head`
        self._collect_dead()
        self._start_due()
        self._escalate()

    def _timeout(self) -> float | None:
        """Seconds until something is due by the clock; None if nothing is."""
        if self._stopping or self._console.pending:
            return _TURN
        return self._restarts.until_next()

    # ---- starting ----

    def _start_all(self) -> None:
        names = ", ".join(node.name for node in self._nodes)
        self._say(f"starting {names}")
        for node in self._nodes:
            if not self._stopping:
                self._start(node)
        if self._started_message and not self._stopping:
            self._console.say(self._started_message)

    def _start(self, node: Node) -> None:
        try:
            self._running.start(node)
        except OSError as error:
            self._warn(f"{node.name} cannot be started: {error}")
            self._after_end(node, lived=0.0)

    def _start_due(self) -> None:
        for node in self._restarts.take_due():
            self._say(f"starting {node.name} again")
            self._start(node)

    # ---- when a node has ended ----

    def _collect_dead(self) -> None:
        for running in self._running:
            code = running.exit_code()
            if code is None:
                continue
            if not self._stopping:
                # What it started has no owner any more.
                running.signal_all(signal.SIGKILL)
                self._running.forget(running)
                self._report(running.node, code, time.monotonic() - running.started)
            elif running.gone():
                self._running.forget(running)
                if code not in _OBEDIENT and self._stopping.stage == 0:
                    self._warn(f"{running.node.name} stopped with an error: {describe_exit(code)}")
            else:
                running.terminate_rest()

    def _report(self, node: Node, code: int, lived: float) -> None:
        self._warn(f"{node.name} ended by itself: {describe_exit(code)}")
        self._after_end(node, lived)

    def _after_end(self, node: Node, lived: float) -> None:
        """Do as the node's policy says."""
        if node.on_exit == "ignore":
            self._warn(f"going on without {node.name}")
        elif node.on_exit == "restart":
            self._plan_restart(node, lived)
        else:
            self._fail()

    def _plan_restart(self, node: Node, lived: float) -> None:
        wait = self._restarts.plan(node, lived)
        count = f"{self._restarts.done(node)} of {node.restart.limit}"
        if wait is None:
            self._warn(f"{node.name} was started again {count} times in vain; giving up")
            self._fail()
        else:
            self._warn(f"starting {node.name} again in {wait:g} s (attempt {count})")

    def _fail(self) -> None:
        self._exit_code = 1
        if not self._stopping:
            if self._running:
                self._warn("stopping the others")
            self._stop()

    # ---- stopping ----

    def _on_signal(self, number: int) -> None:
        if not self._stopping:
            self._say(f"{signal.Signals(number).name}: stopping (once more to kill at once)")
            self._stop()
        elif number != signal.SIGHUP and self._stopping.is_repeated():
            self._harder(KILL)

    def _stop(self) -> None:
        self._stopping.order()
        self._restarts.cancel()
        for running in self._running:
            running.interrupt()

    def _escalate(self) -> None:
        for stage in self._stopping.due():
            self._harder(stage)

    def _harder(self, stage: int) -> None:
        """Use SIGTERM, use SIGKILL, or give up; each once."""
        if not self._stopping.press(stage):
            return
        if stage == GIVE_UP:
            for running in self._running:
                self._warn(f"{running.node.name} cannot be killed (process {running.group})")
                self._running.forget(running)
            return
        number = signal.SIGTERM if stage == TERMINATE else signal.SIGKILL
        for running in self._running:
            self._warn(f"{running.node.name} has not stopped yet: {number.name}")
            running.signal_all(number)

    def _leave(self) -> None:
        """Leave nothing behind, even when the loop itself failed."""
        for running in self._running:
            running.signal_all(signal.SIGKILL)
            self._running.forget(running)
        self._running.close()
        if not self._stopping:
            self._say("no node is left to run")
        self._console.flush(timeout=0.3)

    # ---- messages ----

    def _say(self, text: str) -> None:
        self._console.say(f"[{self._name}] {text}")

    def _warn(self, text: str) -> None:
        self._console.warn(f"[{self._name}] {text}")
