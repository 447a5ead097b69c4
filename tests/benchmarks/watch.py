"""Records the times of a loop, and returns them on request."""

import json
import os
import sys
import threading
import time
from array import array
from typing import TextIO


class Watch:
    """Times of a loop, since they were last asked for. It costs about a microsecond a cycle.

    As JSON: ``late``: s that each cycle began late; ``left_out``: s in which cycles were left out;
    ``told``: [command, monotonic time] of each new command when it reached the wheels; ``speed``:
    the last speed measured, m/s.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._command = 0.0
        self._speed = 0.0
        self._clear()

    def _clear(self) -> None:
        self._late = array("d")
        self._told: list[tuple[float, float]] = []
        self._left_out = 0.0

    def woke(self, late: float, left_out: float = 0.0) -> None:
        """Note that a cycle begins, ``late`` seconds after it was due."""
        with self._lock:
            # What was left out was due that much earlier.
            self._late.append(late + left_out)
            self._left_out += left_out

    def commanded(self, command: float) -> None:
        """Note that a command was taken."""
        self._command = command

    def told_wheels(self, speed: float = 0.0) -> None:
        """Note that the wheels' velocities are set now; the robot drives at ``speed``, m/s."""
        now = time.monotonic()
        with self._lock:
            self._speed = speed
            if not self._told or self._told[-1][0] != self._command:
                self._told.append((self._command, now))

    def answer_orders(self) -> None:
        """Answer lines of standard input with what there is, from a thread, until it ends."""
        # Standard output of its own: the simulation leads the other aside while PyBullet starts.
        output = os.fdopen(os.dup(1), "w", encoding="utf-8")
        threading.Thread(target=self._answer, args=(output,), daemon=True).start()

    def _answer(self, output: TextIO) -> None:
        for _ in sys.stdin:
            with self._lock:
                content = {
                    "late": self._late.tolist(),
                    "left_out": self._left_out,
                    "told": self._told,
                    "speed": self._speed,
                }
                self._clear()
            print(json.dumps(content), file=output, flush=True)
