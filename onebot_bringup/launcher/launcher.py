"""The launcher: a loop that starts nodes, relays their output and stops them.

One thread only. Everything that happens (output, a signal, the end of a child) wakes one ``poll``,
and what is due by the clock (new starts, harder signals) is looked at in every turn.
"""

import selectors
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from onebot_bringup.launcher.console import Console, OutputStream
from onebot_bringup.launcher.node import Node
from onebot_bringup.launcher.process import LineReader, RunningNode, describe_exit
from onebot_bringup.launcher.restarts import Restarts
from onebot_bringup.launcher.signals import SignalQueue
from onebot_bringup.launcher.watch import Guard

_TURN = 0.05  # seconds; how often to look while stopping, or while output waits
# A wrapper such as `uv run` passes a Ctrl-C on that the terminal has already delivered.
_SAME_KEYSTROKE = 0.3  # seconds
# How a node may end that was asked to stop; 130 is what shells make of SIGINT.
_OBEDIENT = (0, -signal.SIGINT, -signal.SIGTERM, 130)


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
    ) -> None:
        """Prepare to run ``nodes``.

        Args:
            nodes: what to start, in this order; their names must differ.
            name: the prefix of the launcher's own messages.
            started_message: printed once all processes have been started.
            grace: how long to wait for nodes that do not stop.
            temporary: folders of the nodes, to be removed should the launcher be killed; otherwise
                that is up to the caller.

        Raises:
            ValueError: two nodes have the same name.
        """
        if len({node.name for node in nodes}) < len(nodes):
            raise ValueError("two nodes have the same name")
        self._nodes = tuple(nodes)
        self._name = name
        self._started_message = started_message
        self._grace = grace or Grace()
        self._temporary = tuple(temporary)
        self._console = Console(sys.stdout, sys.stderr, [node.name for node in nodes])
        self._running: list[RunningNode] = []
        self._restarts = Restarts()
        self._stopping_since: float | None = None
        self._stage = 0
        self._exit_code = 0

    def run(self) -> int:
        """Start everything and return when everything has ended.

        Returns:
            0 when a signal asked to stop (or whoever read the output left), or when no node was
            left to run; 1 when a node that matters ended by itself or could not be started.
        """
        with SignalQueue() as self._signals, selectors.PollSelector() as self._selector:
            self._selector.register(self._signals, selectors.EVENT_READ)
            self._guard = Guard(self._temporary)
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
                self._read(key.data)
        self._console.pump()
        for number in self._signals.take():
            self._on_signal(number)
        if self._console.out.broken and self._stopping_since is None:
            self._stop()  # as in `mrm_bringup | head`
        self._collect_dead()
        self._start_due()
        self._escalate()

    def _timeout(self) -> float | None:
        """Seconds until something is due by the clock; None if nothing is."""
        if self._stopping_since is not None or self._console.pending:
            return _TURN
        return self._restarts.until_next()

    def _read(self, reader: LineReader) -> None:
        descriptor = reader.pipe.fileno()
        reader.read()
        if reader.pipe.closed:
            self._selector.unregister(descriptor)

    # ---- starting ----

    def _start_all(self) -> None:
        names = ", ".join(node.name for node in self._nodes)
        self._say(f"starting {names}")
        for node in self._nodes:
            if self._stopping_since is None:
                self._start(node)
        if self._started_message and self._stopping_since is None:
            self._console.say(self._started_message)

    def _start(self, node: Node) -> None:
        try:
            running = RunningNode(
                node, self._sink(node, self._console.out), self._sink(node, self._console.err)
            )
        except OSError as error:
            self._warn(f"{node.name} cannot be started: {error}")
            self._after_end(node, lived=0.0)
            return
        self._guard.add(running.group)
        self._running.append(running)
        for reader in running.readers:
            self._selector.register(reader.pipe.fileno(), selectors.EVENT_READ, reader)

    def _sink(self, node: Node, stream: OutputStream) -> Callable[[bytes], None]:
        return lambda line: self._console.line(node.name, line, stream)

    def _start_due(self) -> None:
        for node in self._restarts.take_due():
            self._say(f"starting {node.name} again")
            self._start(node)

    # ---- when a node has ended ----

    def _collect_dead(self) -> None:
        for running in list(self._running):
            code = running.exit_code()
            if code is None:
                continue
            if self._stopping_since is None:
                # What it started has no owner any more.
                running.signal_all(signal.SIGKILL)
                self._forget(running)
                self._report(running.node, code, time.monotonic() - running.started)
            elif running.gone():
                self._forget(running)
                if code not in _OBEDIENT and self._stage == 0:
                    self._warn(f"{running.node.name} stopped with an error: {describe_exit(code)}")
            else:
                running.terminate_rest()

    def _forget(self, running: RunningNode) -> None:
        for reader in running.readers:
            if not reader.pipe.closed:
                self._selector.unregister(reader.pipe.fileno())
        running.close()
        self._running.remove(running)
        self._guard.discard(running.group)

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
        if self._stopping_since is None:
            if self._running:
                self._warn("stopping the others")
            self._stop()

    # ---- stopping ----

    def _on_signal(self, number: int) -> None:
        now = time.monotonic()
        if self._stopping_since is None:
            self._say(f"{signal.Signals(number).name}: stopping (once more to kill at once)")
            self._stop()
        elif number != signal.SIGHUP and now - self._stopping_since > _SAME_KEYSTROKE:
            self._harder(2)

    def _stop(self) -> None:
        self._stopping_since = time.monotonic()
        self._restarts.cancel()
        for running in self._running:
            running.interrupt()

    def _escalate(self) -> None:
        if self._stopping_since is None:
            return
        waited = time.monotonic() - self._stopping_since
        if waited > self._grace.terminate:
            self._harder(1)
        if waited > self._grace.kill:
            self._harder(2)
        if waited > self._grace.give_up:
            for running in list(self._running):
                self._warn(f"{running.node.name} cannot be killed (process {running.group})")
                self._forget(running)

    def _harder(self, stage: int) -> None:
        """Go to stage 1 (SIGTERM) or 2 (SIGKILL), once."""
        if stage <= self._stage:
            return
        self._stage = stage
        number = signal.SIGTERM if stage == 1 else signal.SIGKILL
        for running in self._running:
            self._warn(f"{running.node.name} has not stopped yet: {number.name}")
            running.signal_all(number)

    def _leave(self) -> None:
        """Leave nothing behind, even when the loop itself failed."""
        for running in list(self._running):
            running.signal_all(signal.SIGKILL)
            self._forget(running)
        self._guard.close()
        if self._stopping_since is None:
            self._say("no node is left to run")
        self._console.flush(timeout=0.3)

    # ---- messages ----

    def _say(self, text: str) -> None:
        self._console.say(f"[{self._name}] {text}")

    def _warn(self, text: str) -> None:
        self._console.warn(f"[{self._name}] {text}")
