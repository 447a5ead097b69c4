"""Queues the messages of a recording for one viewer, which may read slower than they arrive.

Rerun's server waits for its slowest viewer and meanwhile stores everything that is logged, without
limit. So the messages for each viewer are read at once and queued here. Of messages that have
waited long, only the newest about each subject are kept, so a slow viewer shows the current state.
"""

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Hashable
from contextlib import suppress

import aiohttp

from onebot_bringup.serving.rerun_messages import HEAD, length, subjects

LONGEST = 5.0  # seconds for which every message is kept
MAX_SIZE = 1 << 26  # bytes of such messages


class Backlog:
    """A queue of messages from one task to another."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._recent: deque[tuple[float, bytes]] = deque()  # arrival times and messages
        self._recent_size = 0  # bytes
        self._old: dict[Hashable, bytes] = {}  # latest older message of each subject
        self._arrived, self._room = asyncio.Event(), asyncio.Event()
        self._ended = False
        # A viewer that joins gets the past at once, and has until then to read all of it.
        self._joining_until = self._loop.time() + LONGEST

    async def put(self, message: bytes) -> None:
        """Add a message; while the viewer reads the past, this may wait for room."""
        joining = self._joining_until - self._loop.time()
        if joining > 0.0 and self._recent_size + len(message) > MAX_SIZE:
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self._room_for(len(message)), joining)
        self._recent.append((self._loop.time(), message))
        self._recent_size += len(message)
        self._thin_out()
        self._arrived.set()

    def end(self) -> None:
        """Note that no more messages come."""
        self._ended = True
        self._arrived.set()

    async def get(self) -> bytes:
        """Wait for the next message and return it; empty at the end."""
        while not (self._old or self._recent or self._ended):
            self._arrived.clear()
            await self._arrived.wait()
        if self._old:
            message = self._old.pop(next(iter(self._old)))
            # The subjects of a message are one after the other.
            while self._old and self._old[subject := next(iter(self._old))] is message:
                del self._old[subject]
            return message
        return self._pop_recent() if self._recent else b""

    async def _room_for(self, size: int) -> None:
        while self._recent and self._recent_size + size > MAX_SIZE:
            self._room.clear()
            await self._room.wait()

    def _pop_recent(self) -> bytes:
        message = self._recent.popleft()[1]
        self._recent_size -= len(message)
        self._room.set()
        return message

    def _thin_out(self) -> None:
        oldest = self._loop.time() - LONGEST
        while self._recent and (self._recent_size > MAX_SIZE or self._recent[0][0] < oldest):
            message = self._pop_recent()
            for about in subjects(message):
                self._old.pop(about, None)
                self._old[about] = message


async def messages(stream: aiohttp.StreamReader) -> AsyncIterator[bytes]:
    """Yield the messages of a gRPC-web response, each with its head, until it ends."""
    with suppress(asyncio.IncompleteReadError):
        while True:
            head = await stream.readexactly(HEAD)
            yield head + await stream.readexactly(length(head))
