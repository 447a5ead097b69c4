"""Runs a module as ``python -m`` does, but lets Ctrl-C end it silently while it is importing.

    python -m onebot_bringup.launcher.start_module MODULE [ARGUMENT ...]

The launcher starts this with SIGINT blocked, so that none can hit the interpreter while it starts
up. Then SIGINT gets its default action, which ends the process at once and without a traceback,
until the node installs its own handler (rclpy does so in ``rclpy.init``).
"""

import runpy
import signal
import sys


def main() -> None:
    """Run the module named by the first argument."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
