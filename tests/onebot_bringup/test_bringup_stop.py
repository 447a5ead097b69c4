"""Every node of a bringup heeds the first Ctrl-C, whenever it comes, and ends without a word."""

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from tests.onebot_bringup.launcher_support import alive
from tests.support import RunningProcess, wait_for


def nodes_of(launcher: int) -> dict[str, int]:
    """Return the nodes that a launcher runs now: module to process id."""
    interpreter, found = "onebot_bringup.launcher.interpreter", {}
    for process in psutil.Process(launcher).children():
        with suppress(psutil.Error):  # it ended while we looked
            words = process.cmdline()
            if interpreter in words:
                found[words[words.index(interpreter) + 1]] = process.pid
    return found


def stop_by_first_signal(running: RunningProcess) -> None:
    """Press Ctrl-C and check that every node heeds it, however long the machine takes.

    The launcher stands still meanwhile: on a slow machine it would go on to the next signal. When
    it goes on, it finds its own SIGINT waiting, and all nodes gone.
    """
    nodes = nodes_of(running.process.pid)
    running.process.send_signal(signal.SIGSTOP)
    running.process.send_signal(signal.SIGINT)
    for pid in nodes.values():
        os.kill(pid, signal.SIGINT)
    try:
        for name, pid in nodes.items():
            wait_for(lambda pid=pid: not alive(pid), f"{name} to heed SIGINT")
    finally:
        running.process.send_signal(signal.SIGCONT)
    assert running.wait() == 0
    assert "Traceback" not in running.out + running.err
    assert "has not stopped yet" not in running.err
    assert "stopped with an error" not in running.err


@pytest.mark.slow
def test_nodes_that_are_up_heed_ctrl_c(tmp_path: Path, ros_domain: int) -> None:
    """The viewer, too, which ends its page, its recording and itself.

    Of nodes that are being made, test_lone_nodes has the first moments.
    """
    words = [sys.executable, "-m", "onebot_bringup.launch.onebot_bringup", "viewer:=web"]
    with RunningProcess(words, tmp_path) as running:
        running.says("open http://127.0.0.1:")
        assert len(nodes_of(running.process.pid)) == 3
        stop_by_first_signal(running)
