#!/usr/bin/env python3
"""Shows any robot in Rerun, in the place of RViz: in a browser, a window or a recording.

Subscribes:
    robot_description (std_msgs/String, latched): the URDF; a new one replaces the old live.
    /tf, /tf_static (tf2_msgs/TFMessage): where every frame stands; nothing is computed here.
    joint_states (sensor_msgs/JointState): plotted.
    what the displays of the view name (nav_msgs/Odometry, geometry_msgs/Twist, TwistStamped, ...).

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

import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import String
from std_srvs.srv import Trigger

from onebot_bringup.viewer.display_server import Display
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.settings import values, with_setting
from onebot_bringup.viewer.topics import TopicSubscriptions
from onebot_bringup.viewer.view_source import ViewSource
from onebot_description.description import Description
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.node import LATCHED, Throttled, run_node

# The parameters of the viewer's node that hold from its start to its end.

VIEWERS = ("web", "native", "none")

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


class ViewerParameters:
    """Reads and checks them."""

    def __init__(self, node: Node) -> None:
        """Declare them on ``node``."""
        self._node = node
        for name, (default, meaning) in _PARAMETERS.items():
            descriptor = ParameterDescriptor(description=meaning, read_only=True)
            node.declare_parameter(name, default, descriptor)

    def text(self, name: str) -> str:
        """Return a parameter's text."""
        return str(self._node.get_parameter(name).value)

    @property
    def viewer(self) -> str:
        """One of ``VIEWERS``; another is an OneBotError."""
        value = self.text("viewer")
        if value not in VIEWERS:
            known = did_you_mean(value, VIEWERS, "choices")
            raise OneBotError(f"viewer:={value}: there is no such viewer{known}")
        return value

    @property
    def save(self) -> Path | None:
        """The file to write, if any."""
        text = self.text("save")
        return Path(text).expanduser().absolute() if text else None

    @property
    def memory_limit(self) -> str:
        """As Rerun reads it; what it would not is an OneBotError."""
        text = self.text("memory_limit")
        if not re.fullmatch(r"\d+(\.\d+)?\s*(%|[kMGT]i?B|B)", text):
            raise OneBotError(f"memory_limit:={text}: write a size such as 256MB, 1GiB or 10%")
        return text

    def open_display(self) -> Display:
        """Open the recording and the viewer.

        Raises:
            OneBotError: a parameter is wrong, or it cannot be opened.
        """
        return Display(
            self.viewer,
            self.save,
            grpc_port=self._number("grpc_port"),
            web_port=self._number("web_port"),
            memory_limit=self.memory_limit,
            open_browser=bool(self._node.get_parameter("open_browser").value),
            log=self._node.get_logger(),
        )

    def _number(self, name: str) -> int:
        return int(self._node.get_parameter(name).value)


# The settings of the viewer's view as ROS parameters, changed and saved while it runs.

_FIXED_FRAME = "fixed_frame"
_SAVE_TO = "save_view_to"


class ViewParameters:
    """Keeps the node's parameters and its view equal, whichever of them changes."""

    def __init__(self, node: Node, source: ViewSource, changed: Callable[[], None]) -> None:
        """Declare the parameters, with the view's values where none are given.

        Args:
            node: whose parameters they are; it also serves ``~/save_view``.
            source: the view.
            changed: called after the user has changed a parameter.

        Raises:
            OneBotError: a parameter has a value that a view cannot have.
        """
        self._node = node
        self._source = source
        self._changed = changed
        self._mirroring = False
        self._names = frozenset(values(source.view))
        for name, value in values(source.view).items():
            self._declare(name, value)
        meaning = 'the file that ~/save_view writes; "" for the one that the view is from'
        node.declare_parameter(_SAVE_TO, "", ParameterDescriptor(description=meaning))
        self.mirror()
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._take)
        node.create_service(Trigger, "~/save_view", self._save)

    def _declare(self, name: str, value: Any) -> None:
        descriptor = ParameterDescriptor(description="as in the view file", dynamic_typing=True)
        given = _plain(self._node.declare_parameter(name, value, descriptor).value)
        if given == value or (name == _FIXED_FRAME and given == ""):
            return
        try:
            self._source.change(name, given)
        except ValueError as error:
            raise OneBotError(str(error)) from error

    def mirror(self) -> None:
        """Set the parameters to what the view says now."""
        wanted = values(self._source.view)
        stale = [
            Parameter(name, value=value)
            for name, value in wanted.items()
            if _plain(self._node.get_parameter(name).value) != value
        ]
        self._mirroring = True
        try:
            self._node.set_parameters(stale)
        finally:
            self._mirroring = False

    def _check(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        view = self._source.view
        for parameter in parameters:
            if parameter.name in self._names:
                try:
                    view = with_setting(view, parameter.name, _plain(parameter.value))
                except ValueError as error:
                    return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take(self, parameters: Sequence[Parameter]) -> None:
        ours = [parameter for parameter in parameters if parameter.name in self._names]
        if self._mirroring or not ours:
            return
        for parameter in ours:
            self._source.change(parameter.name, _plain(parameter.value))
        self._changed()

    def _save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        to = str(self._node.get_parameter(_SAVE_TO).value)
        try:
            path = self._source.save(Path(to) if to else None)
        except OneBotError as error:
            self._node.get_logger().warning(str(error))
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, f"saved as {path}"
        self._node.get_logger().info(f"the view was saved as {path}")
        return response


def _plain(value: Any) -> Any:
    """A parameter's value as a view file has it: arrays as lists."""
    return value if value is None or isinstance(value, (bool, int, float, str)) else list(value)


class ViewUpdates:
    """Applies each change of the view; a mistake is reported once, and changes nothing."""

    def __init__(
        self,
        source: ViewSource,
        parameters: ViewParameters,
        view: RobotView,
        topics: TopicSubscriptions,
        log: Any,
    ) -> None:
        """Begin with what is shown.

        Args:
            source: the view, from a file or by parameters.
            parameters: the settings of the view.
            view: shows it.
            topics: subscribed for it.
            log: has ``info`` and ``warning``.
        """
        self._source, self._parameters = source, parameters
        self._view, self._topics = view, topics
        self._log = log
        self._refused: set[Path] = set()  # files with a mistake

    def poll(self) -> None:
        """Apply what was edited; call it now and then."""
        for file in self._source.saved():
            mended = file in self._refused
            self._refused.discard(file)
            try:
                if file == self._source.layout:
                    self._view.use_blueprint(file)
                elif self._source.reload():
                    self._parameters.mirror()
                    self.apply()
                    self._log.info(f"{file} was edited: the view is up to date")
                    mended = False  # reported already
                if mended:
                    self._log.info(f"{file} is right again: it is in use")
            except OneBotError as error:
                self._refused.add(file)
                self._log.warning(f"keeping the view shown so far: {error}")

    def apply_view_of(self, robot: str) -> None:
        """Apply the view of the robot's description, if the user asks for no other one."""
        try:
            if self._source.set_robot(robot):
                self._parameters.mirror()
                self.apply()
                self._log.info(f"its view is {self._source.file or 'the usual one'}")
        except OneBotError as error:
            self._log.warning(f"keeping the view shown so far: {error}")

    def apply(self) -> None:
        """Show what the view says now."""
        for problem in self._view.set_view(self._source.view):
            self._log.warning(problem)
        try:
            self._topics.set_topics(self._view.topics)
        except OneBotError as error:
            self._log.warning(str(error))


TICK_PERIOD = 0.05  # seconds; one call into Rerun carries what came in meanwhile
POLL_PERIOD = 0.25  # seconds


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
        if parameters.viewer == "none" and parameters.save is None:
            self.get_logger().warning("viewer:=none and no save:=FILE.rrd: nothing will be shown")
            return
        source = ViewSource(parameters.text("view"))
        settings = ViewParameters(self, source, lambda: self._updates.apply())
        self._display = parameters.open_display()
        self._view = RobotView(
            self._display.stream,
            source.view,
            blueprint=source.layout,
            frame_prefix=parameters.text("frame_prefix"),
            resolve=self.resolve_topic_name,
            report=self._report,
        )
        self._robot: Description | None = None
        self._page_publisher = self.create_publisher(String, "~/page", LATCHED)
        self._published_page = ""
        self._topics = TopicSubscriptions(self, self._view.take)
        self._topics.set_topics(self._view.topics)
        self._updates = ViewUpdates(source, settings, self._view, self._topics, self.get_logger())
        # Not ROS time: it may stand still or run fast.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(TICK_PERIOD, self._tick, clock=steady)
        self.create_timer(POLL_PERIOD, self._poll, clock=steady)

    def _tick(self) -> None:
        for warning in self._view.tick(int(self.get_clock().now().nanoseconds)):
            self.get_logger().warning(warning)
        robot = self._view.robot
        if robot is not None and robot is not self._robot:
            self._robot = robot
            self.get_logger().info(f'showing "{robot.robot_name}" ({len(robot.link_names)} links)')
            self._updates.apply_view_of(robot.robot_name)

    def _poll(self) -> None:
        assert self._display is not None
        self._display.watch()
        address = self._display.page_address
        if address != self._published_page:
            self._published_page = address
            self._page_publisher.publish(String(data=address))
        try:
            self._topics.watch()
        except OneBotError as error:
            self._warn("topics", str(error), every=10.0)
        self._updates.poll()

    def _report(self, topic: str, error: Exception) -> None:
        """A bad message must not end the viewer."""
        if isinstance(error, OneBotError):
            self.get_logger().warning(f"keeping the robot shown so far: {error}")
        else:
            self._warn(topic, f"ignored a message of {topic}: {error}")

    def destroy_node(self) -> None:
        """Write out the recording, end the viewers and the node."""
        if self._display is not None:
            self._view.finish()
            self._display.close()
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Run the node until Ctrl-C."""
    return run_node(RerunViewer, args, events=True)


if __name__ == "__main__":
    sys.exit(main())
