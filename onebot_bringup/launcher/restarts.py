"""Which nodes are to be started again, and when."""

import time

from onebot_bringup.launcher.node import Node


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
