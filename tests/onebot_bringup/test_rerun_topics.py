"""The viewer of a robot that drives, fed over real DDS."""

import math
from collections import Counter

import numpy as np
from geometry_msgs.msg import Transform, TransformStamped, Twist, TwistStamped, Vector3
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from std_msgs.msg import String

from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.topics import ViewFeed
from onebot_bringup.viewer.view_config import parse_view
from onebot_description.errors import OneBotError
from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_bringup.drive_support import curve, strips, while_written
from tests.onebot_bringup.viewer_support import ARM, viewer_node
from tests.ros_support import LATCHED, Peer
from tests.support import wait_for

VIEW = """
fixed_frame: odom
axes: {visible: false}
grid: {visible: false}
camera: {eye: [-6.0, 2.0, 7.0], target: [0.0, 2.0, 0.0], follow: base}
joint_plot: {positions: false, velocities: false}
trails:
  odometry: {topic: wheels/odom, color: [0, 220, 60], width: 0.2}
  truth: {topic: wheels/truth, color: [230, 20, 200], width: 0.2}
speeds:
  lines:
    commanded: {topic: wheels/cmd_vel, color: [255, 255, 255]}
    measured: {topic: wheels/odom, type: Odometry, color: [255, 255, 255]}
"""


class Driver:
    """Publishes what a driving robot does: a circle of 2 m radius, 0.05 rad a step."""

    def __init__(self, peer: Peer) -> None:
        self._clock = peer.node.get_clock()
        self._tf = peer.publisher(TFMessage, "/tf")
        self._odom = peer.publisher(Odometry, "wheels/odom")
        self._truth = peer.publisher(Odometry, "wheels/truth")
        description = peer.publisher(String, "robot_description", LATCHED)
        description.publish(String(data=ARM))
        self.steps = 0

    def step(self) -> bool:
        """Go on; True after a quarter of the circle and more."""
        self.steps += 1
        angle = 0.05 * self.steps
        x, y = 2 * math.sin(angle), 2 - 2 * math.cos(angle)
        stamp = self._clock.now().to_msg()
        edges = []
        for parent, child, place in (("odom", "base", (x, y)), ("base", "tip", (0.0, 0.5))):
            edge = TransformStamped(child_frame_id=child)
            edge.header.frame_id, edge.header.stamp = parent, stamp
            edge.transform = Transform(translation=Vector3(x=place[0], y=place[1]))
            edges.append(edge)
        self._tf.publish(TFMessage(transforms=edges))
        for publisher, shift in ((self._odom, 0.0), (self._truth, 0.5)):
            message = Odometry(child_frame_id="base")
            message.header.frame_id, message.header.stamp = "odom", stamp
            message.pose.pose.position.x, message.pose.pose.position.y = x + shift, y
            message.twist.twist.linear.x, message.twist.twist.angular.z = 0.4, 0.2
            publisher.publish(message)
        return self.steps > 31


def test_the_file_has_trails_and_speeds(ros_domain, tmp_path):
    """The way that was driven, and each speed; of a command also once it is of another type."""
    file = tmp_path / "x.rrd"
    with viewer_node(tmp_path, VIEW) as node:
        with Peer(ros_domain) as peer:
            driver = Driver(peer)
            commands = peer.publisher(Twist, "wheels/cmd_vel")

            def drive() -> bool:
                commands.publish(Twist(linear=Vector3(x=0.5), angular=Vector3(z=0.3)))
                return driver.step()

            wait_for(drive, "the drive")
            wait_for(lambda: len(while_written(strips, file, "truth")) >= 30, "the trail")
        with Peer(ros_domain) as peer:
            commands = peer.publisher(TwistStamped, "wheels/cmd_vel")
            message = TwistStamped()
            message.twist.linear.x = 0.75

            def recorded() -> bool:
                commands.publish(message)
                return 0.75 in while_written(curve, file, "/speeds/linear/commanded")

            wait_for(recorded, "the other type")
        assert node.interrupt() == 0
    pieces = np.array(strips(file, "odometry"))
    np.testing.assert_allclose(np.hypot(pieces[..., 0], pieces[..., 1] - 2), 2.0, atol=1e-5)
    truth = np.array(strips(file, "truth"))
    np.testing.assert_allclose(np.hypot(truth[..., 0] - 0.5, truth[..., 1] - 2), 2.0, atol=1e-5)
    for name, speeds in (
        ("linear/commanded", {0.5, 0.75}),
        ("angular/commanded", {0.3, 0.0}),
        ("linear/measured", {0.4}),
        ("angular/measured", {0.2}),
    ):
        values = np.array(curve(file, f"/speeds/{name}"))
        assert len(values) > 5
        assert {*values[np.isfinite(values)]} == speeds


def test_a_type_that_is_not_installed_is_said_once(peer, monkeypatch, tmp_path):
    """Of a topic that nobody has asked for; another is named each time."""

    def message_class(name):
        raise OneBotError(f"no message type {name}")

    monkeypatch.setattr("onebot_bringup.viewer.topics.message_class", message_class)
    recording = open_recording(save=tmp_path / "x.rrd")
    view = RobotView(recording.stream, parse_view("trails: {a: {topic: /way}}"))
    peer.node.create_publisher(PathMessage, "/plan", 10)
    peer.node.create_publisher(Odometry, "/way", 10)
    feed = ViewFeed(peer.node, view)
    problems = Counter(problem for _ in range(3) for problem in feed.update())
    assert problems["no message type nav_msgs/msg/Path"] == 1
    assert problems["no message type nav_msgs/msg/Odometry"] == 3
    recording.close()
