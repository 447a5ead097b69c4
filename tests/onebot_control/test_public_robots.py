"""A robot with the blocks of a public one publishes what its launch files take, on real DDS.

test_description_sensors.py reads the blocks of others. A topic that a bridge renames has the name
of its block here, or ours where the block has none.
"""

from pathlib import Path
from typing import Any

import pytest
from sensor_msgs.msg import CameraInfo, Image, Imu, LaserScan, PointCloud2

from onebot_description.description import load_description
from tests.onebot_control.control_support import CASTER, SEPARATION, wheel
from tests.onebot_control.node_support import MODULE
from tests.ros_support import NodeProcess, Peer, ros_args
from tests.support import wait_for

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


@pytest.mark.slow
def test_a_public_robot_gives_what_its_launch_files_take(ros_domain: int, tmp_path: Path) -> None:
    """Each topic has that type alone, and messages in the frame of a link, which is in TF."""
    parts = BASE, wheel("left", SEPARATION / 2), wheel("right", -SEPARATION / 2), CASTER
    blocks = (BLOCKS / "turtlebot4.urdf").read_text()
    (tmp_path / "bot.urdf").write_text(blocks.replace('<link name="base_link"/>', "".join(parts)))
    links = load_description(tmp_path / "bot.urdf").link_names
    assert {frame for _, frame in TAKEN.values()} <= {*links}
    arguments = ros_args(use_sim_time=True)
    with Peer(ros_domain) as peer, NodeProcess(MODULE, str(tmp_path / "bot.urdf"), *arguments):
        heard = {topic: peer.hear(kind, f"/{topic}", 1) for topic, (kind, _) in TAKEN.items()}
        wait_for(lambda: all(heard.values()), f"all of {', '.join(TAKEN)}")
        types = dict(peer.node.get_topic_names_and_types())
    for topic, (kind, frame) in TAKEN.items():
        assert types[f"/{topic}"] == [f"sensor_msgs/msg/{kind.__name__}"]
        assert heard[topic][-1].header.frame_id == frame, topic
