"""OneBot, brought up as a user brings it up, and driven over real DDS."""

import os
import re
import uuid

import pytest
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_description.ros.shared_memory import FOLDER
from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_control.control_support import urdf
from tests.ros_support import LATCHED, NodeProcess
from tests.support import PATIENCE, wait_for

MODULE = "onebot_bringup.launch.onebot_bringup"
CMD_VEL = "/velocity_controller/cmd_vel"
ODOM = "/velocity_controller/odom"


def _seconds(message):
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def _position(message):
    position = message.pose.pose.position
    return position.x, position.y


def test_a_twist_drives_it_where_the_command_says(peer, tmp_path):
    """Joint states, transforms, odometry and truth agree, and it brakes when commands stop.

    record:= makes a folder that rosbags reads, with the topics of the robot.
    """
    folder, published = tmp_path / "run", 0
    with NodeProcess(MODULE, "viewer:=none", f"record:={folder}") as node:
        odom, truth = (
            peer.hear(Odometry, ODOM),
            peer.hear(Odometry, "/velocity_controller/ground_truth"),
        )
        tf, joints = peer.hear(TFMessage, "/tf"), peer.hear(JointState, "/joint_states")
        described = peer.hear(String, "/robot_description", LATCHED)
        # It keeps all of them for a subscriber that discovers it late.
        publisher = peer.publisher(Twist, CMD_VEL, 1000, subscribers=2)
        wait_for(lambda: odom and truth and joints and described, "all topics")
        assert _position(odom[0]) == pytest.approx((0.0, 0.0), abs=1e-6)
        command = Twist()
        command.linear.x = 0.2

        def far_enough():
            nonlocal published
            publisher.publish(command)
            published += 1
            return odom[-1].pose.pose.position.x > 0.4

        wait_for(far_enough, "0.4 m of driving")
        assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE))
        wait_for(lambda: abs(odom[-1].twist.twist.linear.x) < 1e-3, "braking after the timeout")
        moving = [m for m in odom if m.twist.twist.linear.x > 0.199]
        assert moving and max(m.twist.twist.linear.x for m in odom) < 0.2005
        last = odom[-1]
        for topic in (truth, joints):
            wait_for(lambda t=topic: _seconds(t[-1]) >= _seconds(last), "the same at that time")
        assert _position(truth[-1]) == pytest.approx(_position(odom[-1]), abs=2e-3)
        assert abs(last.pose.pose.position.y) < 2e-3
        assert last.header.frame_id == "odom" and last.child_frame_id == "base_link"
        turned = dict(zip(joints[-1].name, joints[-1].position, strict=True))
        assert turned["left_wheel_joint"] * 0.06 == pytest.approx(
            last.pose.pose.position.x, abs=2e-3
        )
        edges = {(e.header.frame_id, e.child_frame_id) for m in tf for e in m.transforms}
        assert ("odom", "base_link") in edges and ("base_link", "left_wheel") in edges
        assert node.interrupt() == 0
    with AnyReader([folder]) as reader:
        count = {connection.topic: connection.msgcount for connection in reader.connections}
    topics = ("/tf", "/tf_static", "/joint_states", "/robot_description", ODOM, CMD_VEL)
    assert {topic: count.get(topic, 0) for topic in topics if not count.get(topic)} == {}
    assert count[CMD_VEL] == published


def test_namespace_and_params_file(peer, tmp_path):
    """The namespace names topics and frames; y overrides that of params_file, which has x.

    What a killed process left in shared memory goes when a robot starts.
    """
    left = FOLDER / f"fastrtps_{uuid.uuid4().hex[:16]}"
    left.touch()
    os.utime(left, (0, 0))
    words = ["namespace:=left", "y:=0.5", "viewer:=none"]
    file = tmp_path / "control.yaml"
    # rcl would take y of the last section that this file has, whatever later files have.
    file.write_text("""\
/left/velocity_controller:
  ros__parameters: {x: 2.0, y: 9.0, world_frame_id: world}
/**/velocity_controller:
  ros__parameters:
    left_wheel_names: [left_wheel_joint]
    right_wheel_names: [right_wheel_joint]
    y: 7.0
""")
    with NodeProcess(MODULE, f"params_file:={file}", *words):
        joints = peer.hear(JointState, "/left/joint_states")
        truth = peer.hear(Odometry, "/left/velocity_controller/ground_truth")
        wait_for(lambda: truth, "the truth")
        assert _position(truth[0]) == pytest.approx((2.0, 0.5), abs=1e-3)
        frames = truth[0].header.frame_id, truth[0].child_frame_id
        assert frames == ("world", "left/base_link")
        wait_for(lambda: joints, "joint states in the namespace")
        assert peer.node.count_subscribers("/left/velocity_controller/cmd_vel")
        wait_for(lambda: not left.exists(), "the removal of a killed process's shared memory")


NAMED = """\
/**:
  controller_manager:
    ros__parameters:
      imu_broadcaster: {type: imu_sensor_broadcaster/IMUSensorBroadcaster}
      base: {type: diff_drive_controller/DiffDriveController}
  base:
    ros__parameters: {use_stamped_vel: false, publish_cmd: true, base_frame_id: base_link}
driver:
  ros__parameters: {rate: 3}
"""


def test_the_control_file_names_the_drive(peer, tmp_path):
    """Its node and topics have that name for all nodes; what is skipped is a line each."""
    file = tmp_path / "control.yaml"
    file.write_text(NAMED)
    words = [f"params_file:={file}", "viewer:=none", f"record:={tmp_path / 'run'}"]
    with NodeProcess(MODULE, *words) as node:
        odom = peer.hear(Odometry, "/base/odom")
        publisher = peer.publisher(Twist, "/base/cmd_vel", subscribers=1)
        wait_for(lambda: odom, "the odometry")
        command = Twist()
        command.linear.x = 0.3

        def has_moved():
            publisher.publish(command)
            return _position(odom[-1])[0] > 0.05

        wait_for(has_moved, "a motion")
        command.linear.y = float("nan")
        ignored = "~/cmd_vel is ignored: not finite: linear.x 0.3, linear.y nan"
        wait_for(lambda: publisher.publish(command) or ignored in node.output, "a warning")
        wait_for(lambda: peer.node.count_subscribers("/base/odom") > 1, "the recorder")
        assert "a Twist on /base/cmd_vel" in node.output
        for text in (
            f"{file}:4: imu_broadcaster: imu_sensor_broadcaster/IMUSensorBroadcaster does not run",
            f"{file}:7: publish_cmd: no such parameter (did you mean ",
            f'{file}:9: section "/driver" matches no node, so it is skipped',
        ):
            assert node.output.count(text) == 1


def test_warnings_name_the_files_line_and_have_a_level(ros_domain, tmp_path):
    """Though the nodes get the text alone; also what the simulation logs, which knows no ROS."""
    model = tmp_path / "low.urdf"
    low = '<collision><origin xyz="0 0 -0.02"/><geometry><box size="0.1 0.1 0.1"/></geometry>'
    part = f'<link name="part">{low}</collision><visual/></link>'
    joint = '<joint name="j" type="fixed"><parent link="base_link"/><child link="part"/></joint>'
    model.write_text(urdf().replace("</robot>", f"\n{part}{joint}</robot>"))
    line = len(model.read_text().splitlines())
    with NodeProcess(MODULE, f"model:={model}", "viewer:=none") as node:
        for name, found in (
            ("robot_state_publisher", f'low.urdf:{line}: link "part" <visual>'),
            ("velocity_controller", f"low.urdf:{line}: "),
        ):
            warning = re.escape(f"[{name}] [WARN] ") + ".*" + re.escape(found)
            wait_for(lambda text=warning: re.search(text, node.output), found)
