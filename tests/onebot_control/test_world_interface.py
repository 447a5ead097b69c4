"""onebot_control.nodes.world_interface: what is left where its start is interrupted."""

import threading
from typing import Any

import pytest
import rclpy

from onebot_control.conventions import MANAGER
from onebot_control.nodes import world_interface
from onebot_control.simulation_parameters import SimulationConfig
from onebot_control.velocity_controller import simulation_nodes
from tests.onebot_control.arm_models import MRM


def test_ctrl_c_while_it_starts_leaves_no_thread(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python would abort at its exit if one returned from rclpy then."""
    running: set[str] = set()

    def interrupt(*_: Any) -> None:
        running.update(thread.name for thread in threading.enumerate())
        raise KeyboardInterrupt

    monkeypatch.setattr(world_interface, "SimulationServices", interrupt)
    rclpy.init(domain_id=ros_domain)
    try:
        with pytest.raises(KeyboardInterrupt):
            simulation_nodes(MANAGER, SimulationConfig, file=MRM)
        left = {thread.name for thread in threading.enumerate()}
        assert {"control", "controllers"} <= running
        assert not {"control", "controllers", "sensing"} & left
    finally:
        rclpy.try_shutdown()
