"""Every node of a bringup heeds the first Ctrl-C, whenever it comes, and ends without a word."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.onebot_bringup.bringup_support import nodes_of, stop_by_first_signal
from tests.onebot_bringup.launcher_support import RunningCommand
from tests.support import wait_for

BRINGUPS = {
    "onebot_bringup.launch.onebot_bringup": "driving robot",
    "mrm_description.launch.mrm_bringup": "robot description applied",
}
NODES = 3


@pytest.fixture(params=BRINGUPS)
def running(
    request: pytest.FixtureRequest, tmp_path: Path, ros_domain: int
) -> Iterator[RunningCommand]:
    """A bringup whose nodes have just been started as processes."""
    command = RunningCommand(tmp_path, [sys.executable, "-m", request.param, "viewer:=web"])
    command.says("Ctrl-C")
    wait_for(lambda: len(nodes_of(command.process.pid)) == NODES, f"{NODES} nodes")
    yield command
    command.close()


def test_nodes_that_have_just_begun_heed_ctrl_c(running: RunningCommand) -> None:
    """They are importing; none has a handler for signals yet."""
    stop_by_first_signal(running)


def test_nodes_that_are_being_made_heed_ctrl_c(running: RunningCommand) -> None:
    """One is up, and the viewer, which takes longest, is starting."""
    wait_for(lambda: any(said in running.err for said in BRINGUPS.values()), "the first node")
    stop_by_first_signal(running)


def test_nodes_that_run_heed_ctrl_c(running: RunningCommand) -> None:
    """The viewer, which has most to put away, ends its page, its recording and itself."""
    wait_for(lambda: "open http://127.0.0.1:" in running.err, "the viewer's page")
    stop_by_first_signal(running)
