"""Every node of a bringup heeds the first Ctrl-C, whenever it comes, and ends without a word."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from tests.onebot_bringup.launcher_support import alive
from tests.support import RunningProcess, wait_for

ONEBOT = "onebot_bringup.launch.onebot_bringup"
MRM = "mrm_description.launch.mrm_bringup"


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


@pytest.fixture
def running(
    request: pytest.FixtureRequest, tmp_path: Path, ros_domain: int
) -> Iterator[RunningProcess]:
    """A bringup whose nodes have just been started as processes."""
    viewer, nodes = {ONEBOT: ("viewer:=web", 3), MRM: ("viewer:=none", 2)}[request.param]
    with RunningProcess([sys.executable, "-m", request.param, viewer], tmp_path) as command:
        command.says("Ctrl-C")
        wait_for(lambda: len(nodes_of(command.process.pid)) == nodes, f"{nodes} nodes")
        yield command


@pytest.mark.parametrize("running", [MRM], indirect=True)
def test_nodes_that_have_just_begun_heed_ctrl_c(running: RunningProcess) -> None:
    """They are importing; none has a handler for signals yet."""
    stop_by_first_signal(running)


@pytest.mark.slow
@pytest.mark.parametrize("running", [ONEBOT], indirect=True)
@pytest.mark.parametrize("up", ["driving robot", "open http://127.0.0.1:"])
def test_nodes_that_are_up_or_being_made_heed_ctrl_c(running: RunningProcess, up: str) -> None:
    """What moves the robot is up, and the viewer, which takes longest, is starting; or it runs.

    Then it has most to put away: it ends its page, its recording and itself.
    """
    running.says(up)
    stop_by_first_signal(running)
