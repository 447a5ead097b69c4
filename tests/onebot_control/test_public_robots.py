"""A robot with the blocks of a public one publishes what its launch files take.

test_description_sensors.py reads the blocks of others. A topic that a bridge renames has the name
of its block here, or ours where the block has none.
"""

from pathlib import Path
from typing import Any

import pytest
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image, Imu, LaserScan, PointCloud2

from onebot_control import Simulation
from onebot_description.description import load_description
from tests.onebot_control.control_support import CASTER, SEPARATION, wheel

BLOCKS = Path(__file__).parents[1] / "robots" / "sensors"
BASE = """<link name="base_link"><inertial><mass value="3.5"/>
  <inertia ixx="0.03" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>"""

# The topics of turtlebot4, their types and the frames of their messages, as the bridges of it and
# of create3 have them: /world/.../rplidar/scan becomes scan.
TAKEN: dict[str, tuple[Any, str]] = {
    "scan": (LaserScan, "rplidar_link"),
    "camera/image_raw": (Image, "oakd_rgb_camera_frame"),
    "camera/depth/image_raw": (Image, "oakd_rgb_camera_frame"),
    "camera/points": (PointCloud2, "oakd_rgb_camera_frame"),
    "camera/camera_info": (CameraInfo, "oakd_rgb_camera_frame"),
    "imu": (Imu, "imu_link"),
    "cliff_side_left/scan": (LaserScan, "cliff_side_left"),
    "ir_intensity_left/scan": (LaserScan, "ir_intensity_left"),
}


@pytest.mark.usefixtures("ros_domain")
def test_a_public_robot_gives_what_its_launch_files_take(tmp_path: Path) -> None:
    """Each topic has that type alone, and messages in the frame of a link, which is in TF."""
    parts = BASE, wheel("left", SEPARATION / 2), wheel("right", -SEPARATION / 2), CASTER
    blocks = (BLOCKS / "turtlebot4.urdf").read_text()
    (tmp_path / "bot.urdf").write_text(blocks.replace('<link name="base_link"/>', "".join(parts)))
    links = load_description(tmp_path / "bot.urdf").link_names
    assert {frame for _, frame in TAKEN.values()} <= {*links}
    received: dict[str, list[Any]] = {topic: [] for topic in TAKEN}
    with Simulation(tmp_path / "bot.urdf") as simulation, simulation.ros() as ros:
        node = Node("bridge")
        for topic, (kind, _) in TAKEN.items():
            node.create_subscription(kind, topic, received[topic].append, 1)
        ros.add(node)
        simulation.run(until=lambda: all(received.values()), timeout=5.0)
        types = dict(node.get_topic_names_and_types())
    for topic, (kind, frame) in TAKEN.items():
        assert types[f"/{topic}"] == [f"sensor_msgs/msg/{kind.__name__}"]
        assert received[topic][-1].header.frame_id == frame, topic
