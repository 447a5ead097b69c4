"""Runs a module as ``python -m`` does, but lets Ctrl-C end it silently while it is importing.

    python -m onebot_bringup.launcher.interpreter MODULE [ARGUMENT ...]

The launcher starts this with SIGINT blocked, so that none can hit the interpreter while it starts
up. Then SIGINT gets its default action, which ends the process at once and without a traceback,
until the node installs its own handler (``run_node`` does so before it starts ROS).

``MODULE --standby`` imports the module (and while it waits, what is in its ``IMPORTED_LATER``),
and runs it when a line of standard input says with which arguments (see ``standby.py``); it ends
when there comes none.

When the module has ended, and all that is registered to be done at exit has been done, the process
ends as well. To take down the modules of ROS and Rerun one by one would cost the interpreter up to
half a second of a processor; on a busy machine that is longer than a Ctrl-C may take.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import importlib
import json
import os
import runpy
import select
import signal
import subprocess
import sys
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING, NoReturn

from onebot_bringup.launcher.process import module_command, open_process, python_environment

if TYPE_CHECKING:
    from onebot_bringup.launcher.process import Node


# Interpreters that are started early, so that a robot is up sooner.


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


def main() -> None:
    """Run the module named by the first argument."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    del sys.argv[0]
    if sys.argv[1:] == ["--standby"]:
        sys.argv[1:] = _stand_by(sys.argv[0])
    codes = [1]  # of an error that nobody catches
    # What is registered first is called last.
    atexit.register(lambda: _leave(codes[-1]))
    try:
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
        codes.append(0)
    except SystemExit as end:
        codes.append(_number(end.code))
        raise


def _stand_by(module: str) -> list[str]:
    """Import a module and what it imports; return the arguments it is to be run with."""
    with contextlib.suppress(Exception):  # it comes again when the module is run
        later = getattr(importlib.import_module(module), "IMPORTED_LATER", ())
        for name in later:
            if select.select([0], [], [], 0)[0]:
                break  # the module knows better when
            importlib.import_module(name)
    sys.modules.pop(module, None)  # runpy runs it anew, as __main__
    line = sys.stdin.readline()
    if not line:
        os._exit(0)  # nobody needs it
    order = json.loads(line)
    os.environ.update(order["environment"])
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    os.close(null)
    return list(order["arguments"])


def _number(code: object) -> int:
    """Return the exit code that ``sys.exit(code)`` means."""
    if code is None:
        return 0
    return code if isinstance(code, int) else 1


def _leave(code: int) -> NoReturn:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):  # closed, or never open
            stream.flush()
    ctypes.CDLL(None).fflush(None)  # what libraries have printed
    os._exit(code)


if __name__ == "__main__":
    main()
