"""Several robots in one process of velocity_controller, on real DDS."""

from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_srvs.srv import SetBool, Trigger

from tests.onebot_control.control_support import urdf
from tests.onebot_control.node_support import driving
from tests.ros_support import Peer, ros_args
from tests.support import wait_for


def robots(**values: dict[str, Any]) -> list[str]:
    """The arguments of three robots, each with further parameters of its own."""
    words = []
    for number, name in enumerate("abc"):
        words += ["--robot", "-r", f"__ns:=/{name}"]
        for key, value in {"x": float(number), **values.get(name, {})}.items():
            words += ["-p", f"{key}:={value}"]
    return words


@pytest.mark.slow
def test_the_clock_of_one_world_is_shared(peer: Peer, tmp_path: Path) -> None:
    """It is paused, stepped and sped up by any robot; a pace that is not reached is reported."""
    with driving(tmp_path, urdf(), *robots(), *ros_args(use_sim_time=True)) as node:
        assert peer.call(SetBool, "/a/velocity_controller/pause", data=True).success
        assert peer.call(Trigger, "/b/velocity_controller/step").success
        assert peer.call(SetBool, "/c/velocity_controller/pause", data=False).success
        assert "driving 3 robots in one world" in node.output
        # No computer is as fast as that.
        assert peer.set_parameters("/b/velocity_controller", real_time_factor=1e6)[0].successful
        assert peer.parameter("/c/velocity_controller", "real_time_factor") == 1e6
        wait_for(lambda: "slow motion: real-time factor" in node.output, "the log")
        diagnostics = peer.hear(DiagnosticArray, "/diagnostics")
        [status] = wait_for(lambda: diagnostics, "diagnostics")[0].status
        assert status.level == DiagnosticStatus.WARN
        assert status.name == "a/velocity_controller: real-time factor"
        factor, missed = [float(each.value) for each in status.values]
        assert 0.0 < factor < 9e5 and missed > 100.0
