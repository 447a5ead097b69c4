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
import re
import sys
from collections.abc import Callable
from pathlib import Path

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_bringup.raw_messages import joint_state_arrays, tf_arrays
from onebot_bringup.rerun_topics import SENSOR, DriveTopics
from onebot_bringup.rerun_view_parameters import ViewParameters
from onebot_bringup.viewer.display import Display
from onebot_bringup.viewer.live_view import LiveView
from onebot_bringup.viewer.view_source import ViewSource
from onebot_description.errors import OneBotError
from onebot_description.ros import run_node
from onebot_description.text import did_you_mean
from onebot_description.tf.tf_message import TFMessage

VIEWERS = ("web", "native", "none")
FLUSH_PERIOD = 0.05  # seconds; one call into Rerun carries what came in meanwhile
CURVES_EVERY = 4  # flushes
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STATIC_TF = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

_PARAMETERS: dict[str, tuple[str | int | bool, str]] = {
    "viewer": ("web", "web, native or none"),
    "save": ("", "a .rrd file to write the recording to"),
    "view": ("", 'a saved view, .yaml or .rbl; "" for the robot\'s own, "none" for none'),
    "frame_prefix": ("", "put before link names, as robot_state_publisher does"),
    "grpc_port": (9876, "port on 127.0.0.1 for viewers; 0 for any"),
    "web_port": (9090, "port on 127.0.0.1 for the page; 0 for any"),
    "open_browser": (True, "open the page, if there is a display"),
    "memory_limit": ("256MB", "what is kept for viewers that join later"),
}


class RerunViewer(Node):
    """The node; see the module's docstring."""

    def __init__(self) -> None:
        """Open the recording and the viewer, then subscribe.

        Raises:
            OneBotError: a parameter is wrong.
        """
        super().__init__("rerun_viewer")
        for name, (default, meaning) in _PARAMETERS.items():
            descriptor = ParameterDescriptor(description=meaning, read_only=True)
            self.declare_parameter(name, default, descriptor)
        self._display: Display | None = None
        self._live: LiveView
        viewer = self._one_of("viewer", VIEWERS)
        save = self._path("save")
        if viewer == "none" and save is None:
            self.get_logger().warning("viewer:=none and no save:=FILE.rrd: nothing will be shown")
            return
        self._source = ViewSource(self._text("view"))
        self._settings = ViewParameters(self, self._source, self._show_view)
        self._display = self._open(viewer, save)
        self._live = LiveView(
            self._display.stream,
            self._source.view,
            blueprint=self._source.layout,
            frame_prefix=self._text("frame_prefix"),
        )
        self._page_publisher = self.create_publisher(String, "~/page", LATCHED)
        self._page_told = ""
        self._ticks = itertools.count()
        self._subscribe()
        self._drive = DriveTopics(self, self._live, self._source.view)

    # --- parameters -----------------------------------------------------------------------------

    def _text(self, name: str) -> str:
        return str(self.get_parameter(name).value)

    def _number(self, name: str) -> int:
        return int(self.get_parameter(name).value)

    def _one_of(self, name: str, choices: tuple[str, ...]) -> str:
        value = self._text(name)
        if value not in choices:
            known = did_you_mean(value, choices, "choices")
            raise OneBotError(f"{name}:={value}: there is no such {name}{known}")
        return value

    def _path(self, name: str) -> Path | None:
        text = self._text(name)
        return Path(text).expanduser().absolute() if text else None

    def _memory_limit(self) -> str:
        text = self._text("memory_limit")
        if not re.fullmatch(r"\d+(\.\d+)?\s*(%|[kMGT]i?B|B)", text):
            raise OneBotError(f"memory_limit:={text}: write a size such as 256MB, 1GiB or 10%")
        return text

    def _open(self, viewer: str, save: Path | None) -> Display:
        return Display(
            viewer,
            save,
            grpc_port=self._number("grpc_port"),
            web_port=self._number("web_port"),
            memory_limit=self._memory_limit(),
            open_browser=bool(self.get_parameter("open_browser").value),
            log=self.get_logger(),
        )

    # --- topics ---------------------------------------------------------------------------------

    def _subscribe(self) -> None:
        listen = self.create_subscription
        listen(String, "robot_description", self._on_description, LATCHED)
        listen(TFMessage, "/tf", self._on_tf, 100, raw=True)
        listen(TFMessage, "/tf_static", self._on_tf_static, STATIC_TF, raw=True)
        listen(JointState, "joint_states", self._on_joints, SENSOR, raw=True)
        assert self._display is not None
        # Not ROS time: it may stand still or run fast.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(FLUSH_PERIOD, self._tick, clock=steady)
        self.create_timer(0.25, self._watch_display, clock=steady)
        self.create_timer(0.25, self._watch_topics, clock=steady)
        self.create_timer(0.25, self._watch_view, clock=steady)

    def _tick(self) -> None:
        curves = next(self._ticks) % CURVES_EVERY == 0
        for message in self._live.tick(self.get_clock().now().nanoseconds, curves=curves):
            self.get_logger().warning(message)

    def _watch_display(self) -> None:
        assert self._display is not None
        self._display.watch()
        address = self._display.page_address
        if address != self._page_told:
            self._page_told = address
            self._page_publisher.publish(String(data=address))

    def _watch_topics(self) -> None:
        try:
            self._drive.watch()
        except OneBotError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=10.0)

    # --- the view -------------------------------------------------------------------------------

    def _watch_view(self) -> None:
        """Show what the user has edited; a mistake is said once, and changes nothing."""
        for file in self._source.saved():
            try:
                if file == self._source.layout:
                    self._live.use_blueprint(file)
                elif self._source.reload():
                    self._settings.mirror()
                    self._show_view()
                    self.get_logger().info(f"{file} was edited: the view is up to date")
            except OneBotError as error:
                self.get_logger().warning(f"keeping the view shown so far: {error}")

    def _take_view_of(self, robot: str) -> None:
        """Look at the robot as its own description says, if the user asks for no other view."""
        try:
            if self._source.set_robot(robot):
                self._settings.mirror()
                self._show_view()
                self.get_logger().info(f"its view is {self._source.file or 'the usual one'}")
        except OneBotError as error:
            self.get_logger().warning(f"keeping the view shown so far: {error}")

    def _show_view(self) -> None:
        view = self._source.view
        for problem in self._live.set_view(view):
            self.get_logger().warning(problem)
        try:
            self._drive.set_view(view)
        except OneBotError as error:
            self.get_logger().warning(str(error))

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
        self._take_view_of(robot.name)

    def _on_tf(self, data: bytes) -> None:
        self._guard(lambda: self._live.add_transforms(tf_arrays(data)))

    def _on_tf_static(self, data: bytes) -> None:
        self._guard(lambda: self._live.add_transforms(tf_arrays(data), static=True))

    def _on_joints(self, data: bytes) -> None:
        def take() -> None:
            state = joint_state_arrays(data)
            stamp = state.stamp_ns or self.get_clock().now().nanoseconds
            self._live.add_joints(stamp, state.names, state.positions, state.velocities)

        self._guard(take)

    def _guard(self, action: Callable[[], None]) -> None:
        """A strange message must not end the viewer."""
        try:
            action()
        except (ValueError, IndexError) as error:
            self.get_logger().warning(f"ignored a message: {error}", throttle_duration_sec=5.0)

    def destroy_node(self) -> None:
        """Write out the recording, end the viewers and the node."""
        if self._display is not None:
            self._live.finish(self.get_clock().now().nanoseconds)
            self._display.close()
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Run the node until Ctrl-C."""
    return run_node(RerunViewer, args, events=True)


if __name__ == "__main__":
    sys.exit(main())
