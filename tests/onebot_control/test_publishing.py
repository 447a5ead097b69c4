"""What the controller publishes arrives as it is, in every field."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Quaternion, TransformStamped, TwistStamped, Vector3
from geometry_msgs.msg import Twist as TwistMessage
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from onebot_control.controlled_robot import ControlledRobot, Snapshot
from onebot_control.nodes.publishing import Publishers
from onebot_control.physics.robot_body import MassVelocity
from onebot_control.runtime.frames import RobotFrames
from onebot_description.description import parse_description
from onebot_description.geometry.poses import PlanarPose
from onebot_description.parameters.reader import ConfigError
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.timing import NS_PER_S
from tests.onebot_control.control_support import IdealPlant, config, cycle, ideal_drive, robot
from tests.onebot_control.test_scene import part
from tests.ros_support import Peer
from tests.support import wait_for

Values = Sequence[float]


def header(stamp: int, frame: str) -> Header:
    sec, nanosec = divmod(stamp, NS_PER_S)
    return Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame)


def filled(kind: Any, values: Values) -> Any:
    """A message whose fields are these numbers."""
    return kind(**dict(zip(kind.get_fields_and_field_types(), values, strict=True)))


def twist_of(values: Values) -> TwistMessage:
    return TwistMessage(linear=filled(Vector3, values[:3]), angular=filled(Vector3, values[3:]))


def odometry(stamp: int, frame: str, child: str, pose: Values, twist: Values) -> Odometry:
    message = Odometry(header=header(stamp, frame), child_frame_id=child)
    message.pose.pose.position = filled(Point, pose[:3])
    message.pose.pose.orientation = filled(Quaternion, pose[3:])
    message.twist.twist = twist_of(twist)
    return message


def transform(stamp: int, parent: str, child: str, pose: Values) -> TFMessage:
    message = TransformStamped(header=header(stamp, parent), child_frame_id=child)
    message.transform.translation = filled(Vector3, pose[:3])
    message.transform.rotation = filled(Quaternion, pose[3:])
    return TFMessage(transforms=[message])


def joint_state(stamp: int, frame: str, joints: Sequence[str], *values: Values) -> JointState:
    arrays = dict(zip(("position", "velocity", "effort"), values, strict=True))
    return JointState(header=header(stamp, frame), name=list(joints), **arrays)


STAMP = 1_700_000_000_123_456_789
TOPICS = {
    "joint_states": JointState,
    "peer/odom": Odometry,
    "peer/ground_truth": Odometry,
    "/tf": TFMessage,
    "peer/cmd_vel_out": TwistStamped,
    "/clock": Clock,
}


class Subscriptions:
    """Publishers, and subscriptions of another node to all they publish."""

    def __init__(self, peer: Peer, listener: Peer) -> None:
        self.publishers = Publishers(peer.node, clock=True)
        # ~/cmd_vel_out is there because a robot's parameters want it
        self.use(driven()[0])
        self.received = {name: listener.hear(kind, name) for name, kind in TOPICS.items()}
        counts = [listener.node.count_publishers, peer.node.count_subscribers]
        for name, count in product(TOPICS, counts):
            wait_for(lambda name=name, count=count: count(name), f"{name} to be found")

    def use(self, drive: ControlledRobot) -> None:
        frames = RobotFrames.from_parameters(drive.config, drive.description, "/", in_scene=False)
        self.publishers.use(drive, frames)

    def last(self, drive: ControlledRobot, snapshot: Snapshot) -> dict[str, Any]:
        """What is received of ``snapshot``."""
        self.use(drive)
        before = {name: len(received) for name, received in self.received.items()}
        self.publishers.publish(snapshot, STAMP)
        for name, received in self.received.items():
            wait_for(lambda name=name, received=received: len(received) > before[name], name)
        return {name: received[-1] for name, received in self.received.items()}


@pytest.fixture
def subscriptions(peer: Peer, ros_domain: int) -> Iterator[Subscriptions]:
    with Peer(ros_domain, "listener") as listener:
        yield Subscriptions(peer, listener)


VARIANCES = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
PARAMETERS = {
    "pose_covariance_diagonal": VARIANCES,
    "twist_covariance_diagonal": VARIANCES[::-1],
    "publish_rate": 100.0,
    "publish_limited_velocity": True,
}


def driven(**parameters: Any) -> tuple[ControlledRobot, Snapshot]:
    """A robot on its way, and how it is."""
    drive = ideal_drive(IdealPlant(left=0.3, right=-0.7), **{**PARAMETERS, **parameters})
    drive.teleport(PlanarPose(1.0, -2.0, 0.5))
    drive.place_odometry(PlanarPose(0.25, 0.5, -3.0))
    for _ in range(5):
        drive.accept(0.3, 0.8)
        cycle(drive)
    velocity = MassVelocity((0.3, 1e-5, -2e-7), (1e-3, 4e-8, 0.8), (0.1, 0.0, 0.2))
    return drive, drive.begin()._replace(mass_velocity=velocity)


def same(received: Any, expected: Any) -> bool:
    """By repr, since NaN differs from itself."""
    return repr(received) == repr(expected)


def test_all_is_received_as_it_is(subscriptions: Subscriptions) -> None:
    drive, snapshot = driven()
    received = subscriptions.last(drive, snapshot)
    x, y, yaw = snapshot.drive.odometry
    pose = [x, y, 0.0, 0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)]
    twist = [snapshot.drive.twist.linear, 0.0, 0.0, 0.0, 0.0, snapshot.drive.twist.angular]
    expected = odometry(STAMP, "odom", "base_link", pose, twist)
    expected.pose.covariance = np.diag(VARIANCES).ravel()
    expected.twist.covariance = np.diag(VARIANCES[::-1]).ravel()
    assert same(received["peer/odom"], expected)
    assert same(received["/tf"], transform(STAMP, "odom", "base_link", pose))
    true = [*snapshot.pose.translation, *snapshot.pose.rotation]
    velocity = [*snapshot.velocity.linear, *snapshot.velocity.angular]
    truth = odometry(STAMP, "world", "base_link", true, velocity)
    assert same(received["peer/ground_truth"], truth)
    told = snapshot.drive.command
    command = [told.linear, 0.0, 0.0, 0.0, 0.0, told.angular]
    assert same(
        received["peer/cmd_vel_out"],
        TwistStamped(header=header(STAMP, "base_link"), twist=twist_of(command)),
    )
    assert same(received["/clock"], Clock(clock=header(STAMP, "").stamp))
    joints = joint_state(STAMP, "base_link", IdealPlant.joints, *map(list, snapshot.joints))
    assert same(received["joint_states"], joints)


def test_covariance_of_the_odometry(subscriptions: Subscriptions) -> None:
    """It is that of dead reckoning, unless a constant one is given; then also if that changes."""
    for variances in ([0.0] * 6, VARIANCES, [0.0] * 6):
        drive, snapshot = driven(pose_covariance_diagonal=variances)
        cycle(drive)
        snapshot = drive.begin()
        received = subscriptions.last(drive, snapshot)["peer/odom"]
        expected = np.diag(variances)
        if not any(variances):
            xx, xy, yy, xt, yt, tt = snapshot.drive.covariance
            expected[np.ix_([0, 1, 5], [0, 1, 5])] = [[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]
            expected[[2, 3, 4], [2, 3, 4]] = 1e-6
            assert tt > 0.0 and xt != 0.0
        np.testing.assert_array_equal(received.pose.covariance.reshape(6, 6), expected)
        twist = np.diag(VARIANCES[::-1])
        np.testing.assert_array_equal(received.twist.covariance.reshape(6, 6), twist)


def test_without_a_frame_of_the_world_the_truth_is_in_that_of_the_odometry(
    subscriptions: Subscriptions,
) -> None:
    """The wheels do not slip, so it is what the odometry says there."""
    drive, snapshot = driven(odom_frame_id="weg", base_frame_id="ärmel", world_frame_id="")
    received = subscriptions.last(drive, snapshot)
    odom, truth = received["peer/odom"], received["peer/ground_truth"]
    for message in (odom, truth):
        assert (message.header.frame_id, message.child_frame_id) == ("weg", "ärmel")
    assert truth.pose.pose.position.x == pytest.approx(odom.pose.pose.position.x)
    assert truth.pose.pose.orientation.z == pytest.approx(odom.pose.pose.orientation.z)


# Frames --------------------------------------------------------------------------------------


def frame_problems(
    values: Mapping[str, Any], others: Mapping[str, Mapping[str, Any]], scene: str
) -> list[str]:
    """What is wrong with the frames of a robot of the namespace /a, as messages."""
    around = parse_description(f'<robot name="w">{scene}</robot>', "w.urdf") if scene else None

    def frames(namespace: str, chosen: Mapping[str, Any]) -> RobotFrames:
        in_scene = around is not None
        return RobotFrames.from_parameters(config(**chosen), robot(), namespace, in_scene=in_scene)

    beside = {name: frames(name, chosen) for name, chosen in others.items()}
    own = frames("/a", values)
    try:
        own.check(own, beside, around)
    except ConfigError as error:
        return [problem.message() for problem in error.problems]
    return []


WALLED = '<link name="floor"/>' + part("wall").replace("world", "floor")
PLAIN = {"tf_frame_prefix_enable": False}


@pytest.mark.parametrize(
    ("values", "others", "scene"),
    [
        ({}, {}, ""),
        ({"world_frame_id": "map"}, {"/b": {"world_frame_id": "map"}, "/c": {}}, ""),
        ({"world_frame_id": ""}, {"/b": {"world_frame_id": "world"}}, WALLED),
        ({"world_frame_id": "floor"}, {}, WALLED),
    ],
)
def test_frames_of_which_each_has_a_name(
    values: dict[str, Any], others: dict[str, dict[str, Any]], scene: str
) -> None:
    """Robots may share a world's frame, which may be the root link of what stands around."""
    assert frame_problems(values, others, scene) == []


@pytest.mark.parametrize(
    ("values", "others", "scene", "said"),
    [
        ({"odom_frame_id": "base_link"}, {}, "", 'odom_frame_id: "a/base_link" is base_frame_id;'),
        ({"world_frame_id": "a/caster"}, {}, "", 'world_frame_id: "a/caster" is a link of the r'),
        ({"odom_frame_id": "world", **PLAIN}, {}, "", 'world_frame_id: "world" is odom_frame_id;'),
        (
            {"base_frame_id": "b", "odom_frame_id": "x", **PLAIN},
            {"/b": {"odom_frame_id": "b", **PLAIN}},
            "",
            'base_frame_id: "b" is odom_frame_id of /b; each frame needs a unique name',
        ),
        ({"world_frame_id": "wall"}, {}, WALLED, 'world_frame_id: "wall" is a link of the world'),
        (
            PLAIN,
            {},
            WALLED.replace("wall", "caster"),
            'w.urdf:1: link "caster": a frame of the robot has this name; rename the link',
        ),
    ],
)
def test_two_frames_of_one_name_are_refused(
    values: dict[str, Any], others: dict[str, dict[str, Any]], scene: str, said: str
) -> None:
    problems = frame_problems(values, others, scene)
    assert any(problem.startswith(said) for problem in problems), problems
