"""Every node of a bringup heeds the first Ctrl-C, whenever it comes, and ends without a word."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.onebot_bringup.bringup_support import nodes_of, stop_by_first_signal
from tests.onebot_bringup.launcher_support import RunningCommand
from tests.support import wait_for

ONEBOT = "onebot_bringup.launch.onebot_bringup"
# With which viewer, how many nodes, and what one of them logs when it is up.
BRINGUPS = {
    ONEBOT: ("viewer:=web", 3, "driving robot"),
    "mrm_description.launch.mrm_bringup": ("viewer:=none", 2, "robot description applied"),
}


@pytest.fixture(params=BRINGUPS)
def running(
    request: pytest.FixtureRequest, tmp_path: Path, ros_domain: int
) -> Iterator[RunningCommand]:
    """A bringup whose nodes have just been started as processes."""
    viewer, nodes, _ = BRINGUPS[request.param]
    command = RunningCommand(tmp_path, [sys.executable, "-m", request.param, viewer])
    command.says("Ctrl-C")
    wait_for(lambda: len(nodes_of(command.process.pid)) == nodes, f"{nodes} nodes")
    yield command
    command.close()


def test_nodes_that_have_just_begun_heed_ctrl_c(running: RunningCommand) -> None:
    """They are importing; none has a handler for signals yet."""
    stop_by_first_signal(running)


def test_nodes_that_are_up_or_being_made_heed_ctrl_c(running: RunningCommand) -> None:
    """Those that move the robot are up; the viewer, which takes longest, is starting."""
    logged = [text for _, _, text in BRINGUPS.values()]
    wait_for(lambda: any(text in running.err for text in logged), "the first node")
    stop_by_first_signal(running)


@pytest.mark.parametrize("running", [ONEBOT], indirect=True)
def test_a_viewer_that_runs_heeds_ctrl_c(running: RunningCommand) -> None:
    """It has most to put away: it ends its page, its recording and itself."""
    running.says("open http://127.0.0.1:")
    stop_by_first_signal(running)
