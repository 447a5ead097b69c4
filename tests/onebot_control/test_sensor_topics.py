"""Sensors of velocity_controller on their topics: what is published, when, and in which frames."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image, Imu, LaserScan, PointCloud, PointCloud2, Range
from std_msgs.msg import String

from onebot_control import RobotSetup
from onebot_description.description import parse_description
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import TFMessage, load_interface
from tests.onebot_control.control_support import CASTER, SEPARATION, urdf, wheel
from tests.onebot_control.node_support import (
    MODULE,
    NODE,
    Driver,
    RosSimulation,
    Stepped,
    speed,
    twist,
)
from tests.ros_support import NodeProcess, Peer, ros_args
from tests.support import wait_for

HALF = 2.0  # of the room, m
AHEAD = 0.1  # where the laser is on the robot

FRAMES = """
  <link name="laser_link"/>
  <joint name="laser" type="fixed"><parent link="base_link"/><child link="laser_link"/>
    <origin xyz="0.1 0 0.2"/></joint>
  <link name="camera_link"/>
  <joint name="camera" type="fixed"><parent link="base_link"/><child link="camera_link"/>
    <origin xyz="0.1 0 0.2"/></joint>
  <link name="optical"/>
  <joint name="to_optical" type="fixed"><parent link="camera_link"/><child link="optical"/>
    <origin rpy="-1.5707963267948966 0 -1.5707963267948966"/></joint>"""


def laser(samples: int = 181, rate: float = 10.0, far: float = 10.0) -> str:
    return f"""
  <gazebo reference="laser_link"><sensor name="laser" type="gpu_lidar">
    <update_rate>{rate}</update_rate>
    <lidar>
      <scan><horizontal><samples>{samples}</samples><min_angle>-1.5</min_angle>
        <max_angle>1.5</max_angle></horizontal></scan>
      <range><min>0.05</min><max>{far}</max></range>
      <noise><type>gaussian</type><stddev>0.01</stddev></noise>
    </lidar></sensor></gazebo>"""


IMU = """
  <gazebo reference="base_link"><sensor name="imu" type="imu"><update_rate>50</update_rate>
    <topic>imu/data</topic><imu><angular_velocity><z><noise type="gaussian">
    <stddev>0.01</stddev></noise></z></angular_velocity></imu></sensor></gazebo>"""
BLIND_IMU = (
    IMU.replace('name="imu"', 'name="none"')
    .replace("imu/data", "none")
    .replace("<imu>", "<imu><enable_orientation>false</enable_orientation>")
)
CAMERA = """
  <gazebo reference="camera_link"><sensor name="cam" type="rgbd_camera">
    <update_rate>20</update_rate>
    <camera><optical_frame_id>optical</optical_frame_id><horizontal_fov>1.0</horizontal_fov>
      <image><width>64</width><height>48</height></image></camera></sensor></gazebo>"""


def bot(*blocks: str) -> str:
    sides = SEPARATION / 2
    return urdf(wheel("left", sides), wheel("right", -sides), CASTER, FRAMES, *blocks)


def box(name: str, size: str, xyz: str) -> str:
    shape = f'<geometry><box size="{size}"/></geometry>'
    return (
        f'<link name="{name}"><visual>{shape}</visual><collision>{shape}</collision></link>'
        f'<joint name="to_{name}" type="fixed">'
        f'<parent link="floor"/><child link="{name}"/><origin xyz="{xyz}"/></joint>'
    )


def room(folder: Path) -> str:
    """A world of four walls; its path."""
    walls = [
        box(f"wall{n}", size, f"{x} {y} 0.5")
        for n, (size, x, y) in enumerate(
            (("0.2 5 1", 2.1, 0), ("0.2 5 1", -2.1, 0), ("5 0.2 1", 0, 2.1), ("5 0.2 1", 0, -2.1))
        )
    ]
    file = folder / "room.urdf"
    links = f'<link name="floor"/>{"".join(walls)}'
    file.write_text(f'<robot name="room">{links}</robot>')
    return str(file)


def in_room(angles: np.ndarray, x: float, y: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    """The ranges to the walls from there."""
    with np.errstate(divide="ignore"):
        to_x = (HALF * np.sign(np.cos(angles + yaw)) - x) / np.cos(angles + yaw)
        to_y = (HALF * np.sign(np.sin(angles + yaw)) - y) / np.sin(angles + yaw)
    return np.minimum(to_x, to_y)


def angles_of(scan: LaserScan) -> np.ndarray:
    return scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))


def stamps(messages: Sequence[Any]) -> list[int]:
    return [nanoseconds(each.header.stamp) for each in messages]


def image(message: Image) -> np.ndarray:
    kind, shape = (np.uint8, (-1, 3)) if message.encoding == "rgb8" else (np.float32, (-1,))
    return np.frombuffer(message.data, kind).reshape(message.height, message.width, *shape[1:])


def test_a_robot_senses_its_room(ros_simulation: RosSimulation, tmp_path: Path) -> None:
    """Ranges, frames, stamps with transforms of that time, the camera's four topics, the IMU."""
    stepped = Stepped(
        ros_simulation(
            parse_description(bot(laser(), IMU, BLIND_IMU, CAMERA)),
            world=room(tmp_path),
            x=-0.5,
            noise=False,
            parameters={"publish_rate": 7.0},
        )
    )
    tf, inertia = stepped.hear(TFMessage, "/tf"), stepped.hear(Imu, "/imu/data")
    without_orientation = stepped.hear(Imu, "/none")
    scans = stepped.hear(LaserScan, "/scan")
    (end,) = stepped.client.get_publishers_info_by_topic("/scan")
    assert end.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert end.qos_profile.durability == DurabilityPolicy.VOLATILE
    stepped.simulation.run(2.0)
    scan = scans[-1]
    assert scan.header.frame_id == "laser_link" and len(scan.ranges) == 181
    # Karto's count of the rays, from single precision.
    assert round((scan.angle_max - scan.angle_min) / scan.angle_increment) + 1 == 181
    assert (scan.range_min, scan.range_max) == (pytest.approx(0.05), 10.0)
    np.testing.assert_allclose(scan.ranges, in_room(angles_of(scan), -0.4), atol=1e-3)
    # Each tenth cycle, and odom -> base_link at that very time, though odom is slower.
    assert stamps(scans) == [10_000_000 + 100_000_000 * count for count in range(20)]
    for child in ("base_link", "odom"):
        transforms = (each for message in tf for each in message.transforms)
        known = {
            nanoseconds(each.header.stamp) for each in transforms if each.child_frame_id == child
        }
        assert known >= {*stamps(scans)}, child
    rest = inertia[-1]
    assert rest.header.frame_id == "base_link"
    assert rest.linear_acceleration.z == pytest.approx(9.81, abs=0.05)
    assert rest.angular_velocity_covariance[8] == pytest.approx(1e-4)
    assert rest.orientation.w == pytest.approx(1.0, abs=1e-2)
    assert rest.orientation_covariance[0] == 0.0
    assert without_orientation[-1].orientation_covariance[0] == -1.0
    info = stepped.hear(CameraInfo, "/camera/camera_info")
    colors = stepped.hear(Image, "/camera/image_raw")
    depths = stepped.hear(Image, "/camera/depth/image_raw")
    points = stepped.hear(PointCloud2, "/camera/points")
    stepped.simulation.run(0.1)
    focal = 64 / (2 * math.tan(0.5))
    assert info[0].k[0] == info[0].k[4] == info[0].p[0] == pytest.approx(focal)
    assert (info[0].k[2], info[0].k[5], info[0].distortion_model) == (32.0, 24.0, "plumb_bob")
    assert {each[-1].header.frame_id for each in (info, colors, depths, points)} == {"optical"}
    assert colors[0].encoding == "rgb8" and image(colors[0]).shape == (48, 64, 3)
    assert depths[0].encoding == "32FC1"
    np.testing.assert_allclose(image(depths[-1])[20:24], HALF + 0.4, atol=2e-3)
    cloud = points[-1]
    fields = {each.name: each.offset for each in cloud.fields}
    assert fields == {"x": 0, "y": 4, "z": 8, "rgb": 16}
    floats = np.frombuffer(cloud.data, np.float32).reshape(48, 64, cloud.point_step // 4)
    middle = floats[24, 32, :3]  # right ahead: z of the optical frame
    np.testing.assert_allclose(middle, [0, 0, HALF + 0.4], atol=2e-3)


BUMPER = """
  <link name="bumper"><collision><geometry><box size="0.02 0.2 0.04"/></geometry></collision></link>
  <joint name="to_bumper" type="fixed"><parent link="base_link"/><child link="bumper"/>
    <origin xyz="0.3 0 0.1" rpy="0 0 0.5"/></joint>
  <gazebo reference="bumper"><sensor name="bump" type="contact"><update_rate>20</update_rate>
    <contact><collision>bumper_collision</collision><topic>/bumped</topic></contact>
    </sensor></gazebo>"""


def test_a_bumper_measures_what_it_touches(ros_simulation: RosSimulation, tmp_path: Path) -> None:
    """Where, along which normal, by which force, in its own frame, turned; nothing once away."""
    kind = load_interface("ros_gz_interfaces/msg/Contacts")
    simulation = ros_simulation(
        parse_description(bot(BUMPER)), world=room(tmp_path), x=1.4, noise=False
    )
    stepped = Stepped(simulation)
    messages, robot = stepped.hear(kind, "/bumped"), stepped.simulation.robot
    robot.drive(0.3)
    stepped.simulation.run(0.2)
    assert len(messages) == 4 and not any(message.contacts for message in messages)
    stepped.simulation.run(until=lambda: messages[-1].contacts)
    assert robot.collided and messages[-1].header.frame_id == "bumper"
    [contact] = messages[-1].contacts
    names = contact.collision1.name, contact.collision2.name
    assert names == ("bumper", "world::wall0") and contact.collision1.type == 3
    assert len(contact.positions) == len(contact.normals) == len(contact.wrenches) > 0
    for place, normal, wrench in zip(
        contact.positions, contact.normals, contact.wrenches, strict=True
    ):
        # The front right edge, since the bumper is turned to the left.
        assert (place.x, place.y) == pytest.approx((0.01, -0.1), abs=5e-3)
        assert (normal.x, normal.y) == pytest.approx((-math.cos(0.5), math.sin(0.5)), abs=0.05)
        action, reaction = wrench.body_1_wrench.force, wrench.body_2_wrench.force
        assert action.x == -reaction.x == pytest.approx(normal.x / normal.y * action.y)
        assert action.x < 0.0
        assert wrench.header.frame_id == "bumper" and wrench.body_2_name.data == names[1]
    robot.drive(-0.3)
    stepped.simulation.run(2.0)
    assert messages[-1].contacts == []


def plugin(name: str, kind: str, to: str, inside: str = "") -> str:
    return f"""<plugin name="{name}" filename="libgazebo_ros_ray_sensor.so">
      <ros><namespace>ray</namespace><remapping>~/out:={to}</remapping></ros>
      <output_type>sensor_msgs/{kind}</output_type>{inside}</plugin>"""


PLUGINS = (
    plugin("p1", "LaserScan", "scan")
    + plugin("p2", "PointCloud2", "/cloud", "<frame_name>base_link</frame_name>")
    + plugin("p3", "PointCloud", "cloud")
    + plugin("p4", "Range", "range", "<radiation_type>ultrasound</radiation_type>")
    + """<plugin name="p5" filename="libgazebo_ros_velodyne_laser.so"><topicName>near</topicName>
      <min_range>2.41</min_range><organize_cloud>false</organize_cloud></plugin>"""
)
ROWS = f"""
  <gazebo reference="laser_link"><sensor name="rows" type="ray"><update_rate>10</update_rate>
    <ray><scan><horizontal><samples>5</samples><min_angle>-0.2</min_angle>
        <max_angle>0.2</max_angle></horizontal><vertical><samples>3</samples>
        <min_angle>-0.1</min_angle><max_angle>0.1</max_angle></vertical></scan>
      <range><min>0.05</min><max>10</max></range></ray>{PLUGINS}</sensor></gazebo>"""


DEPTH_PLUGIN = """
  <gazebo reference="camera_link"><sensor name="cam" type="depth"><update_rate>20</update_rate>
    <camera><horizontal_fov>1.0</horizontal_fov>
      <image><width>64</width><height>48</height></image></camera>
    <plugin name="p" filename="libgazebo_ros_camera.so">
      <ros><namespace>left</namespace><remapping>eye/points:=/points</remapping></ros>
      <camera_name>eye</camera_name><frame_name>optical</frame_name>
      <min_depth>1.0</min_depth><max_depth>2.0</max_depth><hack_baseline>0.07</hack_baseline>
    </plugin></sensor></gazebo>"""


def test_each_plugin_of_a_sensor_publishes_the_type_it_asks_for(
    ros_simulation: RosSimulation, tmp_path: Path
) -> None:
    """The wall is 2.4 m ahead; relative topics are in the robot's namespace, absolute ones not.

    A depth camera has its plugin's limits and baseline.
    """
    model = parse_description(bot(ROWS, DEPTH_PLUGIN))
    robots = {"a": RobotSetup(x=-0.5)}
    stepped = Stepped(ros_simulation(model, world=room(tmp_path), robots=robots, noise=False))
    scans = stepped.hear(LaserScan, "/a/ray/scan")
    clouds = stepped.hear(PointCloud2, "/cloud")
    points = stepped.hear(PointCloud, "/a/ray/cloud")
    distances = stepped.hear(Range, "/a/ray/range")
    met = stepped.hear(PointCloud2, "/a/near")
    depths = stepped.hear(Image, "/a/left/eye/depth/image_raw")
    camera_clouds = stepped.hear(PointCloud2, "/points")
    infos = stepped.hear(CameraInfo, "/a/left/eye/depth/camera_info")
    stepped.simulation.run(0.1)
    across, up = np.array([-0.2, -0.1, 0.0, 0.1, 0.2]), np.array([[-0.1], [0.0], [0.1]])
    true = 2.4 / np.cos(across) / np.cos(up)
    scan, distance = scans[-1], distances[-1]
    assert (len(scan.ranges), scan.header.frame_id) == (5, "a/laser_link")
    np.testing.assert_allclose(scan.ranges, true[1], atol=1e-3)  # the row in the middle
    assert distance.range == pytest.approx(2.4, abs=1e-3)  # the nearest ray
    assert distance.field_of_view == pytest.approx(0.4)
    assert (distance.min_range, distance.max_range) == (pytest.approx(0.05), 10.0)
    assert distance.radiation_type == Range.ULTRASOUND
    assert distance.header.frame_id == "a/laser_link"
    cloud = clouds[-1]
    assert (cloud.height, cloud.width, cloud.header.frame_id) == (3, 5, "a/base_link")
    xyz = np.frombuffer(cloud.data, np.float32).reshape(15, -1)[:, :3]
    ahead = 2.4 * np.ones((3, 1)) @ np.tan(across)[None]
    np.testing.assert_allclose(xyz[:, 0], 2.4 + AHEAD, atol=1e-3)
    np.testing.assert_allclose(xyz[:, 1], ahead.ravel(), atol=1e-3)
    old = points[-1]
    assert old.header.frame_id == "a/laser_link" and len(old.points) == 15
    np.testing.assert_allclose([each.x for each in old.points], 2.4, atol=1e-3)
    np.testing.assert_allclose([each.y for each in old.points], ahead.ravel(), atol=1e-3)
    (channel,) = old.channels
    assert (channel.name, list(channel.values)) == ("intensity", [0.0] * 15)
    far = int((true >= 2.41).sum())
    assert (met[-1].height, met[-1].width) == (1, far) and 0 < far < 15
    check_depths(image(depths[-1]), camera_clouds[-1])
    assert infos[-1].p[3] == pytest.approx(-0.07 * 64 / (2 * math.tan(0.5)))
    assert infos[-1].header.frame_id == "a/optical"


def check_depths(depth: np.ndarray, cloud: PointCloud2) -> None:
    """The ground is nearer than 1 m in the lowest rows, the wall ahead farther than 2 m."""
    assert (depth[:24] == np.inf).all() and (depth[-1] == -np.inf).all()
    between = np.isfinite(depth)
    assert between.any() and depth[between].min() >= 1.0 and depth[between].max() <= 2.0
    floats = np.frombuffer(cloud.data, np.float32).reshape(48, 64, -1)[..., :3]
    assert np.isnan(floats[~between]).all() and not cloud.is_dense
    np.testing.assert_allclose(floats[between][:, 2], depth[between], atol=1e-3)


@pytest.mark.slow
def test_blocks_are_edited_while_the_robot_drives(peer: Peer, tmp_path: Path) -> None:
    """A good edit changes the sensor, a bad one leaves the last good one; also in a file."""
    file = tmp_path / "sensors.urdf"
    file.write_text(f"<robot>{IMU}</robot>")
    every = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    arguments = ros_args(use_sim_time=True, sensors=str(file), cmd_vel_timeout=9.0)
    with NodeProcess(MODULE, *arguments) as node:
        described = peer.node.create_publisher(String, "/robot_description", every)
        described.publish(String(data=bot(laser(far=1.5))))
        scans = peer.hear(LaserScan, "/scan")
        inertia, odom = peer.hear(Imu, "/imu/data"), peer.hear(Odometry, f"{NODE}/odom", 1000)
        wait_for(lambda: scans and inertia, "both sensors")
        Driver(peer, twist(0.2))
        wait_for(lambda: speed(odom[-1]) > 0.19, "the robot to drive")
        driving = len(odom)
        assert len(scans[-1].ranges) == 181 and math.isinf(scans[-1].ranges[0])
        described.publish(String(data=bot(laser(samples=0))))
        wait_for(lambda: 'sensor "laser" was not changed' in node.output, "the fault")
        before = len(scans)
        wait_for(lambda: len(scans) > before + 3, "more scans")
        assert len(scans[-1].ranges) == 181
        described.publish(String(data=bot(laser(samples=91))))
        wait_for(lambda: len(scans[-1].ranges) == 91, "other scans")
        assert min(map(speed, odom[driving:])) > 0.1  # it never stopped
        file.write_text(f"<robot>{IMU.replace('imu/data', 'imu/raw')}</robot>")
        raw = peer.hear(Imu, "/imu/raw")
        wait_for(lambda: raw, "the IMU's other topic")
        file.write_text("<robot>")
        wait_for(lambda: "The sensors are not changed" in node.output, "the file's fault")
        before = len(raw)
        wait_for(lambda: len(raw) > before + 3, "the IMU to stay")
        (result,) = peer.set_parameters(NODE, sensors=str(tmp_path / "none.urdf"))
        assert not result.successful and "no such file" in result.reason
        (result,) = peer.set_parameters(NODE, sensors="")
        assert result.successful
        wait_for(lambda: not peer.node.get_publishers_info_by_topic("/imu/raw"), "it to be gone")
