"""The launcher: a loop that starts nodes, relays their output and stops them.

One thread only. Everything that happens (output, a signal, the end of a child) wakes one ``poll``,
and what is due by the clock (new starts, harder signals) is looked at in every turn.
"""

import selectors
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from onebot_bringup.launcher.console import Console
from onebot_bringup.launcher.node import Node
from onebot_bringup.launcher.process import LineReader, describe_exit
from onebot_bringup.launcher.restarts import Restarts
from onebot_bringup.launcher.running import RunningNodes
from onebot_bringup.launcher.signals import SignalQueue
from onebot_bringup.launcher.standby import Standby
from onebot_bringup.launcher.stopping import GIVE_UP, KILL, TERMINATE, Grace, Stopping

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
