"""Every node of a bringup heeds the first Ctrl-C, whenever it comes, and ends without a word."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.onebot_bringup.bringup_support import nodes_of, stop_by_first_signal
from tests.onebot_bringup.launcher_support import RunningCommand
from tests.support import wait_for

ONEBOT = "onebot_bringup.launch.onebot_bringup"
MRM = "mrm_description.launch.mrm_bringup"


@pytest.fixture
def running(
    request: pytest.FixtureRequest, tmp_path: Path, ros_domain: int
) -> Iterator[RunningCommand]:
    """A bringup whose nodes have just been started as processes."""
    viewer, nodes = {ONEBOT: ("viewer:=web", 3), MRM: ("viewer:=none", 2)}[request.param]
    command = RunningCommand(tmp_path, [sys.executable, "-m", request.param, viewer])
    command.says("Ctrl-C")
    wait_for(lambda: len(nodes_of(command.process.pid)) == nodes, f"{nodes} nodes")
    yield command
    command.close()


@pytest.mark.parametrize("running", [MRM], indirect=True)
def test_nodes_that_have_just_begun_heed_ctrl_c(running: RunningCommand) -> None:
    """They are importing; none has a handler for signals yet."""
    stop_by_first_signal(running)


@pytest.mark.parametrize("running", [ONEBOT], indirect=True)
@pytest.mark.parametrize("up", ["driving robot", "open http://127.0.0.1:"])
def test_nodes_that_are_up_or_being_made_heed_ctrl_c(running: RunningCommand, up: str) -> None:
    """What moves the robot is up, and the viewer, which takes longest, is starting; or it runs.

    Then it has most to put away: it ends its page, its recording and itself.
    """
    running.says(up)
    stop_by_first_signal(running)
