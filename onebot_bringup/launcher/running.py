"""The nodes that run, their output wired to the console and their groups known to the guard."""

import selectors
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from onebot_bringup.launcher.console import Console, OutputStream
from onebot_bringup.launcher.node import Node
from onebot_bringup.launcher.process import LineReader, RunningNode
from onebot_bringup.launcher.standby import Standby
from onebot_bringup.launcher.watch import Guard


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
