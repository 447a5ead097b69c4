"""Spins nodes in their own thread."""

import threading
from collections.abc import Callable, Iterable

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

_PATIENCE = 10.0  # s for the thread to end


class NodeThread:
    """A thread that spins nodes of one context.

    It does not use EventsExecutor, which runs no callbacks in a second thread of a process.
    """

    def __init__(
        self, nodes: Iterable[Node], name: str, failed: Callable[[BaseException], None]
    ) -> None:
        """Start the thread ``name``; ``failed`` is called with the error that ends it."""
        self._nodes, self._failed = list(nodes), failed
        self._executor = SingleThreadedExecutor(context=self._nodes[0].context)
        for node in self._nodes:
            self._executor.add_node(node)
        self._ended = Future()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread, and destroy the nodes."""
        self._ended.set_result(None)
        self._thread.join(_PATIENCE)

    def _run(self) -> None:
        try:
            spin_until(self._ended, self._executor)
        except ExternalShutdownException:
            pass
        except BaseException as error:
            self._failed(error)
        self._executor.shutdown()
        for node in self._nodes:
            node.destroy_node()


def spin_until(stop: Future, executor: SingleThreadedExecutor) -> None:
    """Spin until any thread completes ``stop``."""
    # spin_until_future_complete would add a callback to the future with each message, and never
    # remove any.
    stop.add_done_callback(lambda _: executor.create_task(lambda: None))
    while not stop.done():
        executor.spin_once()
