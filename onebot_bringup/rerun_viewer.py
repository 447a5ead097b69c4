#!/usr/bin/env python3
"""Shows any robot in Rerun, in the place of RViz: in a browser, a window or a recording.

Subscribes:
    robot_description (std_msgs/String, latched): the URDF; a new one replaces the old live.
    /tf, /tf_static (tf2_msgs/TFMessage): where every frame stands; nothing is computed here.
    joint_states (sensor_msgs/JointState): plotted.
    what the view names (nav_msgs/Odometry, geometry_msgs/Twist, TwistStamped): trails and speeds.

Publishes:
    ~/page (std_msgs/String, latched): the page's address, once it is up; it names the recording's
        server, too, so that another page can show the robot.

Serves:
    ~/save_view (std_srvs/Trigger): writes the settings of now into the view file.

Parameters:
    viewer (string, "web"): web, native (a window) or none.
    save (string, ""): a .rrd file to write the recording to, alone or beside the viewer.
    view (string, ""): a saved view: .yaml (see viewer/view_config.py), or .rbl, a layout saved in
        the viewer; "" for config/view.yaml of the package <robot name>_description, if there is
        one; "none" for none. Edits of the file are shown at once.
    save_view_to (string, ""): the file that ~/save_view writes; "" for the one the view is from.
    fixed_frame (string, ""): the frame to show everything in; "" for the view's, or else for the
        frame above the robot's root link (odom, say, where there is one; else the root link).
    axes.visible, collision, grid.spacing, ... : each setting of the view under its name there (not
        trails, covariance and speeds.lines); they can be changed while the viewer runs.
    frame_prefix (string, ""): as robot_state_publisher's parameter of that name.
    grpc_port (int, 9876), web_port (int, 9090): on 127.0.0.1; another if it is in use, 0 for any.
    open_browser (bool, true): open the page, if there is a display.
    memory_limit (string, "256MB"): what is kept for viewers that join later.
"""

import itertools
import sys

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_bringup.raw_messages import BAD_MESSAGE, tf_arrays
from onebot_bringup.rerun_inbox import Inbox
from onebot_bringup.rerun_parameters import ViewerParameters
from onebot_bringup.rerun_shown_view import ShownView
from onebot_bringup.rerun_topics import DriveTopics
from onebot_bringup.rerun_view_parameters import ViewParameters
from onebot_bringup.viewer.display import Display
from onebot_bringup.viewer.live_view import LiveView
from onebot_bringup.viewer.view_source import ViewSource
from onebot_description.errors import OneBotError
from onebot_description.qos import LATCHED, SENSOR, STATIC_TF
from onebot_description.ros import run_node
from onebot_description.tf.tf_message import TFMessage
from onebot_description.throttle import Throttled

FLUSH_PERIOD = 0.05  # seconds; one call into Rerun carries what came in meanwhile
CURVES_EVERY = 4  # flushes


class RerunViewer(Node):
    """The node; see the module's docstring."""

    def __init__(self) -> None:
        """Open the recording and the viewer, then subscribe.

        Raises:
            OneBotError: a parameter is wrong.
        """
        super().__init__("rerun_viewer")
        parameters = ViewerParameters(self)
        self._warn = Throttled(self.get_logger().warning)
        self._display: Display | None = None
        self._live: LiveView
        if parameters.viewer == "none" and parameters.save is None:
            self.get_logger().warning("viewer:=none and no save:=FILE.rrd: nothing will be shown")
            return
        source = ViewSource(parameters.text("view"))
        settings = ViewParameters(self, source, lambda: self._view.show())
        self._display = parameters.open_display()
        self._live = LiveView(
            self._display.stream,
            source.view,
            blueprint=source.layout,
            frame_prefix=parameters.text("frame_prefix"),
        )
        self._inbox = Inbox(
            self._live, self._ignore, self._now, self.resolve_topic_name("joint_states")
        )
        self._page_publisher = self.create_publisher(String, "~/page", LATCHED)
        self._page_told = ""
        self._ticks = itertools.count()
        self._subscribe()
        self._topics = DriveTopics(self, self._live, source.view, self._ignore)
        log = self.get_logger()
        self._view = ShownView(source, settings, self._live, self._topics, log.info, log.warning)

    # --- topics ---------------------------------------------------------------------------------

    def _subscribe(self) -> None:
        listen = self.create_subscription
        listen(String, "robot_description", self._on_description, LATCHED)
        listen(TFMessage, "/tf", self._inbox.add_transforms, 100, raw=True)
        listen(TFMessage, "/tf_static", self._on_tf_static, STATIC_TF, raw=True)
        listen(JointState, "joint_states", self._inbox.add_joints, SENSOR, raw=True)
        assert self._display is not None
        # Not ROS time: it may stand still or run fast.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(FLUSH_PERIOD, self._tick, clock=steady)
        self.create_timer(0.25, self._watch_display, clock=steady)
        self.create_timer(0.25, self._watch_topics, clock=steady)
        self.create_timer(0.25, lambda: self._view.watch(), clock=steady)

    def _tick(self) -> None:
        curves = next(self._ticks) % CURVES_EVERY == 0
        self._inbox.hand_over(joints=curves)
        for message in self._live.tick(self._now(), curves=curves):
            self.get_logger().warning(message)

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _watch_display(self) -> None:
        assert self._display is not None
        self._display.watch()
        address = self._display.page_address
        if address != self._page_told:
            self._page_told = address
            self._page_publisher.publish(String(data=address))

    def _watch_topics(self) -> None:
        try:
            self._topics.watch()
        except OneBotError as error:
            self._warn("topics", str(error), every=10.0)

    # --- messages -------------------------------------------------------------------------------

    def _on_description(self, message: String) -> None:
        try:
            problems = self._live.set_description(message.data)
        except OneBotError as error:
            self.get_logger().warning(f"keeping the robot shown so far: {error}")
            return
        for problem in problems:
            self.get_logger().warning(problem)
        robot = self._live.robot
        assert robot is not None
        self.get_logger().info(f'showing "{robot.name}" ({len(robot.links)} links)')
        self._view.take_view_of(robot.name)

    def _on_tf_static(self, data: bytes) -> None:
        try:
            self._live.add_transforms(tf_arrays(data), static=True)
        except BAD_MESSAGE as error:
            self._ignore("/tf_static", error)

    def _ignore(self, topic: str, error: Exception) -> None:
        """A strange message must not end the viewer."""
        self._warn(topic, f"ignored a message of {topic}: {error}")

    def destroy_node(self) -> None:
        """Write out the recording, end the viewers and the node."""
        if self._display is not None:
            self._inbox.hand_over()
            self._live.finish(self._now())
            self._display.close()
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Run the node until Ctrl-C."""
    return run_node(RerunViewer, args, events=True)


if __name__ == "__main__":
    sys.exit(main())
