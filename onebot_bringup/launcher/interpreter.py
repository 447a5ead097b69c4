"""Runs a module as ``python -m`` does, but Ctrl-C ends it silently while it is importing.

    python -m onebot_bringup.launcher.interpreter MODULE [ARGUMENT ...]

The launcher starts this with SIGINT blocked, so that it cannot hit the interpreter during startup.
Then SIGINT gets its default action, which ends the process at once and without a traceback,
until the node installs its own handler (``run_node`` does so before it starts ROS).

When the module has ended and all exit handlers have run, the process ends at once. Tearing down the
modules of ROS and Rerun one by one would take the interpreter up to half a second of CPU time; on a
busy machine that is longer than a Ctrl-C may take.
"""

import atexit
import contextlib
import ctypes
import os
import runpy
import signal
import sys
from typing import NoReturn


def main() -> None:
    """Run the module named by the first argument."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    del sys.argv[0]
    codes = [1]  # the exit code of an uncaught error
    # The handler that is registered first is called last.
    atexit.register(lambda: _leave(codes[-1]))
    try:
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
        codes.append(0)
    except SystemExit as end:
        codes.append(_number(end.code))
        raise


def _number(code: object) -> int:
    """Return the exit code that ``sys.exit(code)`` results in."""
    if code is None:
        return 0
    return code if isinstance(code, int) else 1


def _leave(code: int) -> NoReturn:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):  # closed, or never open
            stream.flush()
    ctypes.CDLL(None).fflush(None)  # libraries may have printed
    os._exit(code)


if __name__ == "__main__":
    main()
