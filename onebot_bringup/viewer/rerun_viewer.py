#!/usr/bin/env python3
"""Shows robots in Rerun instead of RViz: in a browser, a window or a recording.

Subscribes, in the namespace of each robot:
    robot_description (std_msgs/String, latched): the URDF; a new one replaces the old live.
    joint_states (sensor_msgs/JointState): plotted.
    topics that the view names (nav_msgs/Odometry, geometry_msgs/Twist, TwistStamped, ...).
    every topic of a type that has a display (nav_msgs/Path, ...), up to a limit: see the parameters
        automatic, hidden and shown.
    /tf, /tf_static (tf2_msgs/TFMessage): the transforms of all frames; nothing is computed here.
    /world_description (std_msgs/String, latched): the URDF of the robots' surroundings.
    ~/page_cameras (std_msgs/String, latched): in JSON, the topics of pictures (cameras) that a page
        around the view shows itself; the view leaves them out, and has its plots in a tab.

Publishes:
    ~/page (std_msgs/String, latched): the page's address, once it is up; it also names the
        recording's server, so that another page can show the robot.
    ~/displays (std_msgs/String, latched): in JSON, the topics that could be shown, with their type
        and whether they are visible (the parameters hidden and shown change that); and a legend
        with the kind, name and color of each trail and covariance.

Serves:
    ~/save_view (std_srvs/Trigger): writes the current settings into the view file.

Its parameters are ``ViewerParameters``, which are read at the start, and the settings of the view
(``ViewConfig``), such as axes.visible, which can be changed while it runs.
"""

if __name__ == "__main__":  # first: the imports take a second
    from onebot_description.ros.process_start import start_node

    start_node()

import json
import sys

from rclpy.node import Node
from std_msgs.msg import String

from onebot_bringup.viewer.display_server import DisplayServer
from onebot_bringup.viewer.live_view import LiveView
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.topics import ViewFeed
from onebot_bringup.viewer.viewer_parameters import ViewerParameters
from onebot_description.description import Description
from onebot_description.errors import printable
from onebot_description.parameters.reader import read
from onebot_description.ros.description_topic import warn_of_two_robots
from onebot_description.ros.node_parameters import declare
from onebot_description.ros.run_node import ends_node, run_node, steady_timer
from onebot_description.ros.topic_qos import LATCHED
from onebot_description.timing.throttled import Throttled

TICK_PERIOD = 0.05  # seconds; one call into Rerun logs all messages that came meanwhile
POLL_PERIOD = 0.25  # seconds


class RerunViewer(Node):
    """The node; see the module's docstring."""

    def __init__(self) -> None:
        """Open the recording and the viewer, then subscribe."""
        super().__init__("rerun_viewer")
        parameters = read(ViewerParameters, declare(self, ViewerParameters))
        self._warn = Throttled(self.get_logger().warning)
        self._server: DisplayServer | None = None
        if parameters.viewer == "none" and parameters.recording is None:
            self.get_logger().warning("viewer:=none and no save:=FILE.rrd: nothing will be shown")
            return
        self._live_view = LiveView(self, parameters, self._apply_view)
        robots = parameters.robots_to_show(self.resolve_topic_name)
        self._server = DisplayServer(parameters, self.get_logger())
        self._view = RobotView(
            self._server.stream,
            self._live_view.source.view,
            robots=robots,
            resolve=self.resolve_topic_name,
            report=self._report,
            live=True,
        )
        self._server.replace_file()
        self._robots: dict[str, Description] = {}
        self._page_publisher = self.create_publisher(String, "~/page", LATCHED)
        self._published_page = ""
        self._displays_publisher = self.create_publisher(String, "~/displays", LATCHED)
        self._published_displays = ""
        self._feed = ViewFeed(self, self._view)
        self._page_cameras = PageCameras(self)
        self._update_feed()
        steady_timer(self, TICK_PERIOD, self._tick)
        steady_timer(self, POLL_PERIOD, self._poll)
        warn_of_two_robots(self, own=False)

    def _tick(self) -> None:
        for warning in self._feed.tick():
            self.get_logger().warning(warning)
        robots = self._view.robots
        previous, self._robots = self._robots, robots
        new = [space for space, robot in robots.items() if robot is not previous.get(space)]
        for space in new:
            name, links = printable(robots[space].robot_name), len(robots[space].link_names)
            where = f" in {space}" if space != "/" else ""
            self.get_logger().info(f'showing "{name}" ({links} links){where}')
        if new:
            self._live_view.set_robot(next(iter(robots.values())).robot_name)

    def _apply_view(self) -> None:
        for problem in self._view.set_view(self._live_view.source.view):
            self.get_logger().warning(problem)
        self._update_feed()

    def _update_feed(self) -> None:
        """Update the subscriptions to what is published now, and publish which topics are shown."""
        for problem in self._feed.update():
            self._warn(problem, problem, every=60.0)
        offered = [topic._asdict() for topic in self._view.offered]
        legend = [entry._asdict() for entry in self._view.legend]
        displays = json.dumps({"shown": offered, "legend": legend})
        if displays != self._published_displays:
            self._published_displays = displays
            self._displays_publisher.publish(String(data=displays))

    @ends_node
    def _poll(self) -> None:
        assert self._server is not None
        self._server.watch()
        address = self._server.page_address
        if address != self._published_page:
            self._published_page = address
            self._page_publisher.publish(String(data=address))
        self._view.page_cameras = self._page_cameras.topics
        self._update_feed()
        self._live_view.poll()

    def _report(self, topic: str, error: Exception) -> None:
        """Report a bad message, which must not end the viewer."""
        self._warn(topic, f"ignored a message of {topic}: {error}")

    def destroy_node(self) -> None:
        """Write out the recording, end the viewers and the node.

        Raises:
            OneBotError: the recording was not written to its end.
        """
        server, self._server = self._server, None
        try:
            if server is not None:
                self._view.finish()
                server.close()
        finally:
            super().destroy_node()


class PageCameras:
    """Follows which cameras' pictures the page around the view shows itself."""

    def __init__(self, node: Node) -> None:
        self._node, self._topics = node, frozenset[str]()
        self._subscription = node.create_subscription(
            String, "~/page_cameras", self._receive, LATCHED
        )

    def _receive(self, message: String) -> None:
        self._topics = camera_topics(message.data)

    @property
    def topics(self) -> frozenset[str] | None:
        """The topics of the pictures; None without a page."""
        name = self._subscription.topic_name
        return self._topics if self._node.count_publishers(name) else None


def camera_topics(data: str) -> frozenset[str]:
    """Parse the topics in a message of ~/page_cameras; empty if it is invalid."""
    try:
        return frozenset(str(topic) for topic in json.loads(data)["cameras"])
    except (ValueError, LookupError, TypeError, RecursionError):
        return frozenset()


def main(args: list[str] | None = None) -> int:
    """Run the node until Ctrl-C."""
    return run_node(RerunViewer, args, whole_graph=True)


if __name__ == "__main__":
    sys.exit(main())
