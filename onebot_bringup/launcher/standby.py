"""Interpreters that are started early, so that a robot is up sooner.

Importing ROS and a node's module takes a third of a second. An interpreter that stands by does so
while the launcher still reads the robot's files; then it is told the arguments, and runs the node.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING

from onebot_bringup.launcher.opening import module_command, open_process, python_environment

if TYPE_CHECKING:
    from onebot_bringup.launcher.node import Node


class Standby:
    """Interpreters that have imported a node's module, and wait for its arguments.

    Those that nobody took are ended on leaving the ``with`` block; should this process be killed,
    they end as well.
    """

    def __init__(self, modules: Sequence[str] = ()) -> None:
        """Start an interpreter for each module; those needed first stand first.

        No more than there are processors beside this process's own: more would only slow the
        first ones down.
        """
        self._given = dict(os.environ)
        self._waiting: dict[str, subprocess.Popen[bytes]] = {}
        for module in modules[: max(1, _processors() - 1)]:
            environment = {**self._given, **python_environment()}
            command = [*module_command(module), "--standby"]
            try:
                self._waiting[module] = open_process(
                    command, environment, hold_interrupt=True, stdin=subprocess.PIPE
                )
            except OSError:  # the launcher will say so when it is to start the node
                return

    def take(self, node: Node) -> subprocess.Popen[bytes] | None:
        """Return the process that runs ``node`` from now on; None if none has stood by for it."""
        process = self._waiting.pop(node.module, None)
        if process is None:
            return None
        variables = {**os.environ, **node.environment}
        changed = {name: value for name, value in variables.items() if self._is_new(name, value)}
        order = {"arguments": node.arguments, "environment": changed}
        assert process.stdin is not None
        try:
            process.stdin.write(json.dumps(order).encode() + b"\n")
            process.stdin.close()
            process.stdin = None
        except OSError:  # it has ended already
            _end(process)
            return None
        return process

    def _is_new(self, name: str, value: str) -> bool:
        return self._given.get(name) != value

    def __enter__(self) -> Standby:
        """Return it as it is."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End those that wait still."""
        while self._waiting:
            _end(self._waiting.popitem()[1])


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout, process.stderr):
        if pipe is not None and not pipe.closed:
            pipe.close()


def _processors() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
