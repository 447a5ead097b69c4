"""The launcher: starts nodes, shows their output, and stops them together."""

import asyncio
import os
import signal
import stat
import sys
from collections.abc import Sequence
from functools import partial

from onebot_bringup.launcher.console import Console
from onebot_bringup.launcher.process import NodeProcess, RunningProcess, describe_exit, spawn
from onebot_description.ros.signals import stop_signals

# Exit codes that are normal for a node that was asked to stop; shells report SIGINT as 130.
# A node that hangs while it stops is ended by SIGALRM (see ``run_node``).
_STOPPED = (0, -signal.SIGINT, -signal.SIGTERM, -signal.SIGALRM, 130)
# Signals within this time (seconds) count as one. A wrapper such as `uv run` repeats a Ctrl-C that
# the terminal has already delivered; a signal to all processes, such as systemd's, may reach a node
# before the launcher.
_SAME_SIGNAL = 0.3


# When to escalate, in seconds after the order to stop; everything ends within 5 s.
_TERMINATE = 2.5  # SIGTERM for nodes that have not stopped on SIGINT
_KILL = 4.0  # SIGKILL for nodes that have not stopped on SIGTERM either
_GIVE_UP = 4.6  # return even if killed nodes have not disappeared yet


class Launcher:
    """Runs nodes until Ctrl-C, or until a node that matters has ended.

    To be used in the main thread; ``run`` may be called once.
    """

    def __init__(self, name: str) -> None:
        self._name = name  # the prefix of the launcher's own messages
        self._running: dict[RunningProcess, NodeProcess] = {}
        self._stopping, self._stop_now = asyncio.Event(), asyncio.Event()
        self._escalated = False  # whether SIGTERM or SIGKILL was used
        self._failed: dict[str, str] = {}  # how each node that failed for good ended

    def run(self, nodes: Sequence[NodeProcess], *, started_message: str = "") -> int:
        """Start the nodes in this order, and return when everything has ended.

        Args:
            nodes: the nodes, with different names.
            started_message: printed once all processes have been started.

        Returns:
            0 when a signal asked to stop, the output was closed, or no node was left to run; 1
            when a node failed: it ended with an error, even while stopping, had to be killed to
            stop in time, or ended although the others need it. The last line printed names it.
        """
        asyncio.run(self._run(nodes, started_message))
        return 1 if self._failed else 0

    async def _run(self, nodes: Sequence[NodeProcess], started_message: str) -> None:
        self._loop = asyncio.get_running_loop()
        self._console = Console(self._name, [node.name for node in nodes])
        for number in stop_signals():
            self._loop.add_signal_handler(number, self._on_signal, number)
        self._watch_reader()
        self._given_up = self._loop.create_future()
        try:
            ended = asyncio.gather(*await self._start_all(nodes))
            if started_message and not self._stopping.is_set():
                self._console.print(started_message)
            await asyncio.wait([ended, self._given_up], return_when=asyncio.FIRST_COMPLETED)
            if ended.done():
                ended.result()
        finally:
            await self._kill_remaining()

    async def _start_all(self, nodes: Sequence[NodeProcess]) -> list[asyncio.Task[None]]:
        """Start ``nodes`` one after the other; return a task per node that ends with it."""
        self._console.info(f"starting {', '.join(node.name for node in nodes)}")
        console, tasks = self._console, []
        for node in nodes:
            if self._stopping.is_set():
                break
            out, err = (partial(console.line, node.name, s) for s in (console.out, console.err))
            process = await spawn(node, out, err)
            self._running[process] = node
            if self._stopping.is_set():
                process.interrupt()
            tasks.append(self._loop.create_task(self._supervise(node, process)))
        return tasks

    async def _kill_remaining(self) -> None:
        """Kill everything that still runs, even after an error, and write the last lines."""
        for process in self._running:
            process.signal_all(signal.SIGKILL)
        await asyncio.gather(*[self._close_process(process) for process in list(self._running)])
        if not self._stopping.is_set():
            self._console.info("no node is left to run")
        if self._failed:
            nodes = ", ".join(f"{name} ({how})" for name, how in self._failed.items())
            self._console.warn(f"failed: {nodes}")
        self._console.close(timeout=0.2)

    # Supervising one node

    async def _supervise(self, node: NodeProcess, process: RunningProcess) -> None:
        """Report the end of ``node`` and apply its policy."""
        code = await self._end_of(process)
        how = describe_exit(code)
        if self._stopping.is_set():
            self._judge_stopped(node, code, how)
            return
        self._console.warn(f"{node.name} exited unexpectedly: {how}")
        if code != 0 or node.on_exit != "ignore":
            self._failed[node.name] = how
        if node.on_exit == "ignore":
            self._console.warn(f"continuing without {node.name}")
            return
        if self._running:
            self._console.warn("stopping the others")
        self._stop()

    async def _end_of(self, process: RunningProcess) -> int:
        """Wait for the end of ``process``, show its last output and return its exit code."""
        code = await process.ended
        if code in _STOPPED:
            await _is_set_within(_SAME_SIGNAL, self._stopping)
        process.signal_all(signal.SIGKILL)  # its children have no owner any more
        await self._close_process(process)
        return code

    def _judge_stopped(self, node: NodeProcess, code: int, how: str) -> None:
        """Report a node that was asked to stop and failed to."""
        if code == -signal.SIGKILL and not self._stop_now.is_set():
            self._failed[node.name] = "had to be killed"
        elif code not in _STOPPED and not self._escalated:
            self._console.warn(f"{node.name} stopped with an error: {how}")
            self._failed[node.name] = how

    async def _close_process(self, process: RunningProcess) -> None:
        """Show the rest of a process's output, and drop it from the running ones."""
        await process.close()
        self._running.pop(process, None)

    # Stopping

    def _on_signal(self, number: signal.Signals) -> None:
        if not self._stopping.is_set():
            self._console.info(f"{number.name}: stopping (once more to kill at once)")
            self._stop()
        elif number != signal.SIGHUP and self._loop.time() - self._stopped_at > _SAME_SIGNAL:
            self._stop_now.set()

    def _watch_reader(self) -> None:
        """Stop when nobody reads the output any more: ``| head`` or ros2 launch has ended."""
        out = self._console.out.descriptor

        def left() -> None:
            self._loop.remove_reader(out)
            self._stop()

        # Linux also reports this for the writing end of a pipe, which never has input to read.
        if sys.platform == "linux" and out >= 0 and stat.S_ISFIFO(os.fstat(out).st_mode):
            self._loop.add_reader(out, left)

    def _stop(self) -> None:
        """Ask all nodes to stop, unless that was already done."""
        if self._stopping.is_set():
            return
        self._stopping.set()
        self._stopped_at = self._loop.time()
        for process in self._running:
            process.interrupt()
        self._escalation = self._loop.create_task(self._escalate())

    async def _escalate(self) -> None:
        """Send SIGTERM, then SIGKILL, then give up."""
        if not await _is_set_within(_TERMINATE, self._stop_now):
            self._signal_all(signal.SIGTERM)
            await _is_set_within(self._since_stop(_KILL), self._stop_now)
        self._signal_all(signal.SIGKILL)
        await asyncio.sleep(self._since_stop(_GIVE_UP))
        for process, node in self._running.items():
            self._console.warn(f"{node.name} cannot be killed (process {process.group})")
        self._given_up.set_result(None)

    def _since_stop(self, moment: float) -> float:
        """Return the seconds from now until ``moment`` seconds after the order to stop."""
        return self._stopped_at + moment - self._loop.time()

    def _signal_all(self, number: signal.Signals) -> None:
        self._escalated = True
        for process, node in self._running.items():
            self._console.warn(f"{node.name} has not stopped yet: {number.name}")
            process.signal_all(number)


async def _is_set_within(timeout: float, event: asyncio.Event) -> bool:
    """Wait for ``event``, at most ``timeout`` seconds; return whether it was set."""
    try:
        await asyncio.wait_for(event.wait(), timeout)
    except asyncio.TimeoutError:
        return False
    return True
