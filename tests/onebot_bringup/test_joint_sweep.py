"""A generated motion keeps within the limits of every joint."""

import math
from pathlib import Path

from onebot_bringup.launch.nodes import sweep_parameters
from onebot_description.description import load_description
from onebot_description.joints.config import JointsConfig

ROBOT = """<robot name="r">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/>
  <link name="d"/><link name="e"/>
  <joint name="elbow.1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
    <limit lower="-0.5" upper="2.5" effort="1" velocity="0.2"/></joint>
  <joint name="wheel" type="continuous"><parent link="a"/><child link="b"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="slide" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.1" effort="1" velocity="10"/></joint>
  <joint name="twin" type="revolute"><parent link="c"/><child link="d"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/><mimic joint="elbow.1"/></joint>
  <joint name="weld" type="fixed"><parent link="d"/><child link="e"/></joint>
</robot>"""


def test_every_joint_swings_within_its_limits(tmp_path: Path) -> None:
    """Position and speed stay within the limits; fixed and mimic joints are left alone."""
    (tmp_path / "r.urdf").write_text(ROBOT)
    description = load_description(tmp_path / "r.urdf")
    parameters = sweep_parameters(description)
    motions = parameters["motions"]
    assert isinstance(motions, dict) and set(motions) == {"elbow.1", "wheel", "slide"}
    for joint in description.joints:
        if joint.name in motions and joint.kind != "continuous":
            swing = motions[joint.name]
            assert joint.lower is not None and joint.upper is not None and joint.velocity
            assert joint.lower <= swing["offset"] - swing["amplitude"]
            assert swing["offset"] + swing["amplitude"] <= joint.upper
            assert math.tau * swing["frequency"] * swing["amplitude"] <= joint.velocity
            assert swing["amplitude"] > 0.0
    assert len({swing["phase"] for swing in motions.values()}) == 3


def test_the_publisher_accepts_it(tmp_path: Path) -> None:
    """The parameters are right for joint_state_publisher, without a remark."""
    (tmp_path / "r.urdf").write_text(ROBOT)
    parameters = sweep_parameters(load_description(tmp_path / "r.urdf"))
    config = JointsConfig.from_parameters(parameters)
    assert set(config.motions) == {"elbow.1", "wheel", "slide"} and not config.notes


def test_a_robot_without_joints_needs_no_motion(tmp_path: Path) -> None:
    """A single link is a robot too."""
    (tmp_path / "r.urdf").write_text('<robot name="r"><link name="base"/></robot>')
    assert "motions" not in sweep_parameters(load_description(tmp_path / "r.urdf"))
