"""onebot_control.nodes.world_interface: how it starts, and what an interrupted start leaves."""

import threading
from typing import Any

import pytest
import rclpy

from onebot_control.conventions import DRIVE_CONTROLLER, MANAGER
from onebot_control.drive_kinds import ControlConfig
from onebot_control.nodes import world_interface
from onebot_control.simulation_parameters import SimulationConfig
from onebot_control.velocity_controller import simulation_nodes
from tests.onebot_control.arm_models import MRM
from tests.onebot_control.drive_models import mecanum


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


def test_a_description_on_the_command_line_says_which_drive_it_is(ros_domain: int) -> None:
    """As a file does."""
    rclpy.init(domain_id=ros_domain)
    try:
        words = ["-p", f"robot_description:={mecanum().urdf}"]
        [node] = simulation_nodes(DRIVE_CONTROLLER, ControlConfig, [words])
        assert node.has_parameter("linear.y.max_velocity")
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
