"""Talking to a process of a benchmark: lines of JSON there and back."""

import json
import threading
import time
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import IO, Any

from onebot_description.errors import OneBotError
from tests.benchmarks.measuring import Running

_PATIENCE = 60.0  # s


class Lines:
    """Lines of JSON that a process prints."""

    def __init__(self, source: Running) -> None:
        assert source.process.stdout is not None
        self._lines: SimpleQueue[str] = SimpleQueue()
        self._source = source
        threading.Thread(target=self._read, args=(source.process.stdout,), daemon=True).start()

    def _read(self, pipe: IO[str]) -> None:
        # The pipe may be closed under the reader: then all is over.
        with suppress(ValueError):
            for line in pipe:
                self._lines.put(line)

    def ask(self, order: object, meanwhile: Running) -> Any:
        """Send a line of JSON; return the next line that comes."""
        assert self._source.process.stdin is not None
        print(json.dumps(order), file=self._source.process.stdin, flush=True)
        return self.next(meanwhile)

    def next(self, meanwhile: Running) -> Any:
        """Return the next line.

        Raises:
            OneBotError: the source, or the process ``meanwhile``, has ended, or nothing comes.
        """
        deadline = time.monotonic() + _PATIENCE
        while time.monotonic() < deadline:
            with suppress(Empty):
                return json.loads(self._lines.get(timeout=0.2))
            meanwhile.check()
            self._source.check()
        raise OneBotError(f"waited {_PATIENCE:g} s in vain for a message")
