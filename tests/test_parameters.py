"""What the nodes publish about their parameters: descriptions, ranges, read-only flags."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_bringup.bags.bag_recorder import BagRecorder
from onebot_bringup.steering.steering_page import SteeringPage
from onebot_bringup.viewer.rerun_viewer import RerunViewer
from onebot_control.control_files import default_control_file
from onebot_control.drive_kinds import ControlConfig
from onebot_control.runtime import control_loop
from onebot_control.velocity_controller import simulation_nodes
from onebot_description.description import load_description
from onebot_description.joint_state_publisher import JointStatePublisher
from onebot_description.parameters.reader import leaves
from onebot_description.robot_state_publisher import RobotStatePublisher
from onebot_description.ros.command_line import RosArguments
from tests.readme_tables import PARAMETERS

# rclpy's own, of every node.
OTHERS = ("use_sim_time", "start_type_description_service", "qos_overrides.")
ONEBOT = Path("onebot_description/urdf/onebot.urdf.xacro")
MRM = Path("mrm_description/urdf/mrm.xacro")


def described(node: Node) -> dict[str, Any]:
    """The descriptor of each parameter; each has a description, and a row in the README."""
    names = sorted(n for n in node.get_parameters_by_prefix("") if not n.startswith(OTHERS))
    rows = [leaf.name for kind in PARAMETERS[node.get_name()] for leaf in leaves(kind)]
    assert {row for row in rows if "<" not in row} <= set(names)
    patterns = "|".join(re.sub("<.*?>", ".*", re.escape(row)) for row in rows)
    assert [name for name in names if not re.fullmatch(patterns, name)] == []
    descriptors = dict(zip(names, node.describe_parameters(names), strict=True))
    assert [name for name, one in descriptors.items() if not one.description] == []
    return descriptors


def float_range(descriptor: Any) -> tuple[float, float]:
    """The least and the greatest value."""
    (one,) = descriptor.floating_point_range
    return one.from_value, one.to_value


def refused(node: Node, name: str) -> str:
    """What the node answers to a change of a parameter that it does not have."""
    request = SetParameters.Request(parameters=[Parameter(name, value=1).to_parameter_msg()])
    [result] = node._parameter_service._set_parameters_callback(
        request, SetParameters.Response()
    ).results
    assert not result.successful and not node.has_parameter(name)
    return str(result.reason)


def test_robot_state_publisher(start_node: Callable[..., Node]) -> None:
    """All four can be changed while it runs; 50 is as good as 50.0."""
    node = start_node(lambda: RobotStatePublisher(load_description(MRM)), publish_frequency=50)
    descriptors = described(node)
    assert float_range(descriptors["publish_frequency"]) == (0.0, 1000.0)
    assert not any(one.read_only for one in descriptors.values())
    assert node.get_parameter("robot_description").value.startswith("<")
    assert 'frame_prefx: no such parameter (did you mean "frame_prefix"?' in refused(
        node, "frame_prefx"
    )


def test_joint_state_publisher(start_node: Callable[..., Node]) -> None:
    """Those with names of the user's own are described as well."""
    joint = "base_link__link_01"
    motion = {f"motions.{joint}.type": "constant", f"motions.{joint}.position": 0.5}
    node = start_node(
        lambda: JointStatePublisher(
            str(MRM), RosArguments((), names=[("", name) for name in motion])
        ),
        **motion,
    )
    descriptors = described(node)
    assert float_range(descriptors["rate"]) == (0.001, 1000.0)
    assert "from 0.001" in descriptors["rate"].additional_constraints
    assert "hold" in descriptors[f"motions.{joint}.position"].description
    assert node.get_parameter("source_list").value == []


def test_velocity_controller(
    start_node: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is read at the start only is read-only; no range where NaN is "no limit"."""
    arguments = RosArguments((default_control_file(),))
    node = start_node(
        lambda: simulation_nodes("velocity_controller", ControlConfig, (), str(ONEBOT), arguments)[
            0
        ],
        x=1,
    )
    descriptors = described(node)
    read_only = {name for name, one in descriptors.items() if one.read_only}
    names = {"left_wheel_names", "right_wheel_names", "robot_description", "world", "x", "y", "yaw"}
    assert read_only == {*names, "update_rate", "paused"}
    assert float_range(descriptors["publish_rate"]) == (0.0, 10_000.0)
    (window,) = descriptors["velocity_rolling_window_size"].integer_range
    assert window.from_value == 1
    assert not descriptors["linear.x.max_velocity"].floating_point_range
    assert ".nan for no limit" in descriptors["linear.x.max_velocity"].additional_constraints
    assert node.get_parameter("left_wheel_names").value == []
    assert node.get_parameter("x").value == 1
    assert 'wheel_raduis: no such parameter (did you mean "wheel_radius"?' in refused(
        node, "wheel_raduis"
    )
    assert refused(node, "linear.x") == "linear.x: no such parameter"
    # A control loop that does not answer is a warning, and no error in the node's callback.
    node.interface.stop()
    monkeypatch.setattr(control_loop, "_PATIENCE", 0.0)
    assert node.set_parameters([Parameter("cmd_vel_timeout", value=0.7)])[0].successful


def test_steering_page(start_node: Callable[..., Node]) -> None:
    """All are read when it starts; a rate of 20 is as good as 20.0."""
    node = start_node(SteeringPage, port=0, open_browser="false", rate=20)
    descriptors = described(node)
    assert "no such parameter" in refused(node, "odom_topc")
    assert all(one.read_only for one in descriptors.values())
    assert float_range(descriptors["rate"]) == (5.0, 100.0)
    (port,) = descriptors["port"].integer_range
    assert (port.from_value, port.to_value) == (0, 65535)


def test_bag_recorder(start_node: Callable[..., Node], tmp_path: Path) -> None:
    """All are read when it starts."""
    node = start_node(BagRecorder, folder=tmp_path / "run")
    descriptors = described(node)
    assert "no such parameter" in refused(node, "compresion")
    assert set(descriptors) == {"folder", "topics", "regex", "exclude_regex", "compression"}
    assert all(one.read_only for one in descriptors.values())


def test_rerun_viewer(start_node: Callable[..., Node], tmp_path: Path) -> None:
    """Its own are read at the start, the view's settings can be changed."""
    node = start_node(RerunViewer, viewer="none", save=tmp_path / "x.rrd", **{"axes.length": 2})
    descriptors = described(node)
    own = {"viewer", "save", "view", "frame_prefix", "grpc_port", "web_port", "open_browser"}
    assert {name for name, one in descriptors.items() if one.read_only} == {
        *own,
        "embedded",
        "memory_limit",
        "robots",
    }
    assert float_range(descriptors["axes.length"])[0] == 0.0
    assert "one of hidden" in descriptors["panels.top"].additional_constraints
    assert node.get_parameter("camera.eye").value == []
    changed = [Parameter("camera.eye", value=[1, 2, 3])]
    assert node.set_parameters(changed)[0].successful
    assert described(node)["camera.eye"].description
    assert "axes.lenght: no such parameter" in refused(node, "axes.lenght")
