"""Runs an event loop in a separate thread, beside a node's executor."""

import asyncio
import contextlib
import threading
from collections.abc import Callable

STOP_TIMEOUT = 2.0  # s


class LoopThread:
    """Runs the ``serve`` of a derived class in a thread until it is stopped."""

    def __init__(self, name: str) -> None:
        self._end = asyncio.Event()
        self._running = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._run()), name=name, daemon=True
        )
        self._thread.start()
        self._running.wait()

    def call(self, action: Callable[[], None]) -> None:
        """Call ``action`` in the thread; ignored after ``stop``."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(action)

    def stop(self) -> None:
        self.call(self._end.set)
        self._thread.join(STOP_TIMEOUT)

    async def serve(self, end: asyncio.Event) -> None:
        """Serve until ``end`` is set."""
        raise NotImplementedError

    async def _run(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._running.set()
        await self.serve(self._end)
