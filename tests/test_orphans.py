"""tests.orphans: nothing that a test run starts outlives it."""

import signal
import subprocess
import sys

from tests.mutation.targets import CHECKOUT
from tests.onebot_bringup.launcher_support import alive
from tests.support import wait_for

_RUN = """
import subprocess
from tests.orphans import end_with_this_process
end_with_this_process()
subprocess.run(["sh", "-c", "sleep 600 & echo $$ $!; wait"], start_new_session=True)
"""


def test_nothing_outlives_a_test_run() -> None:
    """However it ends: neither its children, in sessions of their own, nor what they started."""
    command = [sys.executable, "-c", _RUN]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
    with subprocess.Popen(command, cwd=CHECKOUT, **pipes) as run:
        assert run.stdout is not None
        pids = [int(word) for word in run.stdout.readline().split()]
        assert len(pids) == 2 and all(map(alive, pids))
        run.send_signal(signal.SIGKILL)
    wait_for(lambda: not any(map(alive, pids)), "the end of all that it started")
