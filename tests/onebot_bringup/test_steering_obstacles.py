"""How far the robot that is steered can go until it meets what its sensors see."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan, Range
from std_msgs.msg import String

from onebot_bringup.steering.followed_topics import FollowedTopics, RobotNamespace
from onebot_bringup.steering.obstacles import Footprint, Obstacles, Readings, described
from onebot_bringup.steering.odometry_topic import OdometryTopic
from onebot_bringup.steering.protocol import Velocity
from onebot_description.geometry.quaternions import from_rpy, to_matrix
from onebot_description.ros.wire.interfaces import TFMessage
from tests.ros_support import LATCHED, Peer
from tests.support import wait_for

ROBOT = """<robot name="box">
  <link name="base"><visual><geometry><box size="0.4 0.2 0.1"/></geometry></visual></link>
  <link name="lidar"/>
  <joint name="mount" type="fixed"><parent link="base"/><child link="lidar"/></joint>
</robot>"""


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0, *, pitch: float = 0.0, yaw: float = 0.0):
    """The pose (4, 4) of a sensor."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = to_matrix(from_rpy((0.0, pitch, yaw))), (x, y, z)
    return pose


def scan(angle: float, *ranges: float) -> Readings:
    """What a scanner sees, a ray each 0.1 rad."""
    message = LaserScan(angle_min=angle, angle_increment=0.1, range_max=9.0, ranges=ranges)
    return Readings.from_scan(message)


@pytest.fixture
def footprint() -> Footprint:
    return Footprint.from_description(described(ROBOT))


@pytest.mark.parametrize(
    ("point", "linear", "angular", "lateral", "clearance"),
    [
        ((1.0, 0.05), 0.3, 0.0, 0.0, 0.8),
        ((1.0, 0.05), -0.3, 0.0, 0.0, math.inf),  # it goes the other way
        ((-1.0, 0.05), -0.3, 0.0, 0.0, 0.8),
        ((1.0, 0.15), 0.3, 0.0, 0.0, math.inf),  # it passes
        ((1.0, 1.0), 0.5, 0.5, 0.0, math.pi / 2 - 0.2),  # a quarter of a circle of 1 m
        ((1.0, 0.05), 0.5, 0.5, 0.0, math.inf),  # it turns away
        ((-1.0, 1.0), -0.5, -0.5, 0.0, math.pi / 2 - 0.2),  # backward, to the left
        ((-1.0, 1.0), -0.5, 0.5, 0.0, math.inf),
        ((0.1, 0.0), 0.3, 0.0, 0.0, math.inf),  # a part of itself
        ((0.15, 1.0), 0.0, 0.0, 0.3, 0.9),  # sideways
        ((0.15, 1.0), 0.0, 0.0, -0.3, math.inf),
        ((0.25, -1.0), 0.0, 0.0, -0.3, math.inf),  # it passes
        ((-1.0, 1.0), 0.0, 0.5, 0.5, math.pi / 2 - 0.1),  # a quarter of a circle of 1 m
        ((1.0, 1.0), 0.3, 0.0, 0.3, math.sqrt(2.0) - 0.3 / math.sqrt(2.0)),  # by its corner
        ((1.0, 1.0), 0.3, 0.0, -0.3, math.inf),
    ],
)
def test_how_far_the_robot_can_go(footprint, point, linear, angular, lateral, clearance):
    """By a scanner that looks backwards."""
    seen = 0.1 - point[0], -point[1]  # by the scanner
    rays = scan(math.atan2(*reversed(seen)), math.hypot(*seen), math.inf, math.nan)
    points = footprint.obstacles(rays, at(0.1, 0.0, 0.0, yaw=math.pi))
    found = footprint.clearance(points, Velocity(linear, angular, lateral))
    assert found == pytest.approx(clearance, abs=1e-5)


@pytest.mark.parametrize(
    ("place", "distance", "counts"),
    [
        (at(0.21, z=0.02, pitch=math.pi / 2), 0.07, False),  # a cliff sensor, on the ground
        (at(0.2, z=0.1, pitch=0.3), 0.15 / math.sin(0.3) - 0.01, False),  # a tilted scanner
        (at(0.2, z=0.1, pitch=0.3), 0.2, True),  # it sees a box before that
        (at(0.2, z=-0.04), 1.0, True),  # a level scanner, one cm above the ground
        (at(0.2, z=0.5), 1.0, True),  # on a mast
        (at(0.2, z=0.1, pitch=-0.5), 1.0, False),  # the ceiling
    ],
)
def test_the_ground_and_the_ceiling_are_no_obstacles(footprint, place, distance, counts):
    """What stands in the way is, at whatever height its sensor is."""
    assert bool(len(footprint.obstacles(scan(0.0, distance), place))) is counts


def test_a_range_has_what_it_met_anywhere_on_its_cone(footprint):
    """A sonar, and a detector of a fixed distance (REP-117); +inf and nan say nothing."""
    message = Range(field_of_view=0.4, min_range=0.1, max_range=2.0, range=1.0)
    beside = at(0.2, 0.25)  # its axis passes the robot's side, its cone does not
    points = footprint.obstacles(Readings.from_range(message), beside)
    assert footprint.clearance(points, Velocity(0.3)) == pytest.approx(math.cos(0.2), abs=1e-6)
    message.field_of_view = 0.1
    points = footprint.obstacles(Readings.from_range(message), beside)
    assert footprint.clearance(points, Velocity(0.3)) == math.inf
    for nothing in (math.inf, math.nan, 0.05, 2.1):
        message.range = nothing
        assert not len(Readings.from_range(message).ranges)
    message.range, message.min_range = -math.inf, 2.0
    assert set(Readings.from_range(message).ranges) == {2.0}


def test_what_has_no_shapes_has_no_footprint():
    """A description may be no robot."""
    assert described("<robot") is None
    assert Footprint.from_description(described('<robot name="x"><link name="a"/></robot>')) is None


def mounted(child: str, pitch: float, yaw: float) -> TransformStamped:
    """A sensor in the robot's middle, turned."""
    found = TransformStamped(child_frame_id=child)
    found.header.frame_id, turn = "base", found.transform.rotation
    turn.x, turn.y, turn.z, turn.w = from_rpy((0.0, pitch, yaw)).tolist()
    return found


def test_every_sensor_counts_in_the_direction_driven(peer: Peer) -> None:
    """By its frame, and as long as it measures; a cliff sensor sees the ground, no obstacle."""
    node, command = peer.node, [Velocity()]
    topics = FollowedTopics(node)
    odometry = OdometryTopic(topics, "/odom")
    obstacles = Obstacles(topics, odometry, lambda: command[0])
    create = node.create_publisher
    create(String, "/robot_description", LATCHED).publish(String(data=ROBOT))
    frames = create(TFMessage, "/tf_static", LATCHED)
    mounts = ("front", 0.0, 0.0), ("rear", 0.0, math.pi), ("cliff", math.pi / 2, 0.0)
    frames.publish(TFMessage(transforms=[mounted(*mount) for mount in mounts]))
    messages = {
        "/odom": Odometry(child_frame_id="base"),
        "/front": LaserScan(angle_increment=0.1, range_max=9.0, ranges=[1.2]),
        "/rear": Range(field_of_view=0.02, max_range=9.0, range=2.2),
        "/cliff": LaserScan(angle_increment=0.1, range_max=9.0, ranges=[0.05]),
    }
    for topic in ("/front", "/rear", "/cliff"):
        messages[topic].header.frame_id = topic[1:]
    publishers = {topic: create(type(one), topic, 10) for topic, one in messages.items()}
    messages["/odom"].twist.twist.linear.x = -0.5

    def clearance() -> float | None:
        needed = obstacles.needed(RobotNamespace("", ()), watched=True)
        topics.update(needed | odometry.needed("/cmd_vel", ()))
        topics.update_transforms(True)
        for topic, publisher in publishers.items():
            publisher.publish(messages[topic])
        found = obstacles.clearance
        return found if found is None else round(found, 3)

    command[0] = Velocity(0.3, 0.0)
    wait_for(lambda: clearance() == 1.0, "the wall ahead")
    command[0] = Velocity(-0.3, 0.0)
    wait_for(lambda: clearance() == 2.0, "the wall behind")
    command[0] = Velocity()
    assert clearance() == 2.0, "it still rolls back"
    twist = messages["/odom"].twist.twist
    twist.linear.x, twist.linear.y = 0.0, -0.5
    wait_for(lambda: clearance() is None, "it to slide along the walls")
    twist.linear.x, twist.linear.y = -0.5, 0.0
    wait_for(lambda: clearance() == 2.0, "it to roll back again")
    del publishers["/rear"]
    wait_for(lambda: clearance() is None, "the end of what was measured")
