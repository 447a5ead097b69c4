"""Remembers what was made of the parts of messages that repeat, such as names of joints."""

import threading
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")

MOST = 64  # publishers of one topic, times the subsets of joints each sends; more only costs time
MOST_BYTES = 4 * 2**20


class Remembered(Generic[K, V]):
    """A function that remembers its results, as with ``functools.lru_cache``.

    It forgets the oldest ones where they are too large together, not only where they are too many:
    how large they are is up to whoever publishes. The latest is always remembered.
    """

    def __init__(self, make: Callable[[K], V], size: Callable[[K], int]) -> None:
        self._make, self._size = make, size
        self._kept: dict[K, tuple[V, int]] = {}
        self._bytes = 0
        self._lock = threading.Lock()

    def __call__(self, argument: K) -> V:
        """Return what was made of an equal argument, or make it."""
        kept = self._kept.get(argument)
        return self._added(argument) if kept is None else kept[0]

    def _added(self, argument: K) -> V:
        value, size = self._make(argument), self._size(argument)
        with self._lock:
            if argument not in self._kept:
                self._kept[argument] = value, size
                self._bytes += size
            while len(self._kept) > (MOST if self._bytes <= MOST_BYTES else 1):
                self._bytes -= self._kept.pop(next(iter(self._kept)))[1]
        return value


def size_of_names(names: tuple[str, ...]) -> int:
    """Return about how many bytes a list of names takes in a message."""
    return sum(map(len, names)) + 8 * len(names)
