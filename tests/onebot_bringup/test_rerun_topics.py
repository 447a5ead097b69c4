"""The viewer follows what is published on real DDS."""

from geometry_msgs.msg import Twist, TwistStamped, Vector3

from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.topics import ViewFeed
from onebot_bringup.viewer.view_config import parse_view
from tests.onebot_bringup.drive_support import curve, while_written
from tests.ros_support import Peer, node_here, spin_until


def test_a_topic_is_followed_that_changes_its_type(ros_domain, tmp_path):
    """As a command does, when another node gives it."""
    file = tmp_path / "x.rrd"
    recording = open_recording(save=file)
    view = RobotView(
        recording.stream, parse_view("speeds: {lines: {commanded: {topic: /cmd_vel}}}")
    )
    stamped = TwistStamped()
    stamped.twist.linear.x = 0.75
    with node_here("viewer") as node:
        feed = ViewFeed(node, view)
        for message, speed in ((Twist(linear=Vector3(x=0.5)), 0.5), (stamped, 0.75)):
            with Peer(ros_domain) as peer:
                publisher = peer.node.create_publisher(type(message), "/cmd_vel", 10)

                def drawn(publisher=publisher, message=message, speed=speed) -> bool:
                    publisher.publish(message)
                    assert feed.update() == []
                    feed.tick()
                    recording.stream.flush()
                    return speed in while_written(curve, file, "/speeds/linear/commanded")

                spin_until(node, drawn, f"{speed} m/s")
    recording.close()
