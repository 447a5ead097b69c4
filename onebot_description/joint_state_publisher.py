#!/usr/bin/env python3
"""joint_state_publisher: publishes joint states from YAML, and follows edits of the file.

Run it alone with
``python -m onebot_description.joint_state_publisher [FILE] --ros-args --params-file joints.yaml``;
FILE is a URDF or xacro file. Without it, the description is the parameter or the topic
robot_description.

Publishes:
    joint_states (sensor_msgs/msg/JointState, reliable, depth 10): positions in rad or m, velocities
        in rad/s or m/s, of all moving joints, in the order of the description.

Subscribes:
    robot_description (std_msgs/msg/String, reliable, transient local, depth 1): the URDF, unless
        FILE or the parameter gives it.
    each topic of source_list (sensor_msgs/msg/JointState, best effort, depth 10).

All parameters but robot_description can be changed while it runs; an invalid change is rejected
with the reason.
"""

if __name__ == "__main__":  # first: the imports take a second
    from onebot_description.ros.process_start import start_node

    start_node()

import sys
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from sensor_msgs.msg import JointState

from onebot_description.description import Description, parse_description
from onebot_description.description_files import DescriptionFiles, load_followed
from onebot_description.errors import OneBotError, listing
from onebot_description.file_watch import Reloader
from onebot_description.joints.config import JointsConfig
from onebot_description.joints.plan import Plan
from onebot_description.joints.source import JointStateSource
from onebot_description.parameters.files import LiveParameters, read_files
from onebot_description.parameters.reader import ConfigError, Problem, defaults, read
from onebot_description.parameters.values import plain
from onebot_description.ros.command_line import RosArguments
from onebot_description.ros.description_topic import GOES_ON, DescriptionTopic
from onebot_description.ros.node_parameters import (
    declare,
    follow_changes,
    ros_parameter,
    set_doubles,
)
from onebot_description.ros.run_node import full_name, run_described_node, steady_timer
from onebot_description.ros.topic_qos import ANY_PUBLISHER
from onebot_description.timing.throttled import Throttled


class JointStateParameters:
    """The node's parameters: declared, read from files, and checked against each other."""

    live: LiveParameters  # the files that they come from
    values: dict[str, Any]  # values at the start, by name
    config: JointsConfig  # the same values, checked

    def __init__(self, node: Node, arguments: RosArguments) -> None:
        """Declare every parameter that was set, and the others with their defaults.

        Raises:
            ConfigError: values are wrong; it names each of them.
        """
        self._node = node
        set_doubles(node, JointsConfig)
        name = node.get_fully_qualified_name()
        self.live = LiveParameters(arguments.files, name, JointsConfig)
        set_names = arguments.names_for(node.get_name())
        self.values = self._declare(set_names)
        self.live.pin(set_names, self.values)
        if self.live.warning:
            node.get_logger().warning(self.live.warning)
        try:
            self.config = self._checked(self.values)
        except ConfigError as error:
            raise error.located(self.live.places(self.values)) from None

    def _declare(self, given: Sequence[str]) -> dict[str, Any]:
        names = [*given, *self.live.file.values]
        usual = defaults(JointsConfig)
        declare(self._node, JointsConfig, {name: usual.get(name) for name in names})
        parameters = self._node.get_parameters_by_prefix("")
        return {n: plain(p.value) for n, p in parameters.items() if p.value is not None}

    def changed(
        self, values: Mapping[str, Any], parameters: Sequence[Parameter]
    ) -> tuple[dict[str, Any], JointsConfig]:
        """Return all ``values``, and their config, with ``parameters`` set (None: unset)."""
        changed = {**values, **{parameter.name: plain(parameter.value) for parameter in parameters}}
        changed = {name: value for name, value in changed.items() if value is not None}
        return changed, self._checked(changed)

    def _checked(self, values: Mapping[str, Any]) -> JointsConfig:
        """Check values, including names of topics, which JointsConfig cannot check."""
        config = read(JointsConfig, values)
        own_topic = self._node.resolve_topic_name("joint_states")
        for topic in config.source_list:
            try:
                is_own = full_name(self._node, topic) == own_topic
            except OneBotError as error:
                raise ConfigError([Problem("source_list", str(error))]) from None
            if is_own:
                text = f"{topic} is the topic this node publishes; name another one"
                raise ConfigError([Problem("source_list", text)])
        return config


@dataclass(frozen=True)
class JointsState:
    """Parameters and description; replaced as a whole, so that a rejected change has no effect."""

    values: Mapping[str, Any]  # the parameters, by name
    config: JointsConfig  # the same parameters, checked
    description: Description | None = None  # None until the robot is known
    source: JointStateSource | None = None  # moves the robot's joints
    plan: Plan | None = None  # a plan that is not yet applied to the source

    def describing(self, description: Description, *, tolerant: bool) -> "JointsState":
        """Return the state with another robot, whose joints continue from their positions.

        Args:
            description: the robot.
            tolerant: ignore parameters that do not match the robot, instead of raising.

        Raises:
            ConfigError: parameters do not match the robot.
        """
        source = JointStateSource(
            description.joints, self.config, previous=self.source, tolerant=tolerant
        )
        return replace(self, description=description, source=source, plan=None)


_POLL_EVERY = 0.05  # seconds


class JointFiles:
    """Watches parameter files and the description's files, and applies edits of them."""

    def __init__(self, node: "JointStatePublisher", live: LiveParameters) -> None:
        """Watch the parameter files as they are now."""
        self._node, self._log, self._live = node, node.get_logger(), live
        self.parameters = Reloader(live.read, live.files)
        self.description: DescriptionFiles | None = None
        steady_timer(node, _POLL_EVERY, self._poll)

    def reread_refused(self) -> None:
        """Read the parameter files again if their last edit was rejected."""
        if self.parameters.edited:
            self.parameters.read_soon()

    def _poll(self) -> None:
        self._poll_parameters()
        if self.description is not None and not self.parameters.is_reading:
            self._poll_description(self.description)  # only after the parameters

    def _poll_description(self, files: DescriptionFiles) -> None:
        try:
            if (description := files.poll()) is not None:
                self._node.replace(description)
                files.applied()
        except OneBotError as error:
            self._log.error(f"{files.edited} not applied, {GOES_ON}:\n{error}")

    def _poll_parameters(self) -> None:
        """Set every parameter to its value in the files, or to its default, after an edit."""
        live, last = self._live, self._live.file
        try:
            if (file := self.parameters.poll()) is None:
                return
            changes = live.changes(file, self._node.state.values)
            live.file = file
            self._node.set_all(changes, file.places)
        except OneBotError as error:
            live.file = last
            self._log.error(f"{self.parameters.edited} not applied, {GOES_ON}:\n{error}")
            return
        changed = f"changed: {listing(changes)}" if changes else "nothing changed"
        self._log.info(f"{self.parameters.edited}: applied, {changed}")
        if live.warning:
            self._log.warning(live.warning)
        self.parameters.applied()


_EMPTY = array("d")


class JointStatesOut:
    """Publishes the topic joint_states at a rate, once there is a robot."""

    def __init__(self, node: Node) -> None:
        """Create the publisher; ``use`` starts publishing."""
        self._node = node
        self._publisher = node.create_publisher(JointState, "joint_states", 10)
        self._message = JointState()
        self._source: JointStateSource | None = None
        self._config = JointsConfig()
        self._timer: Timer | None = None
        self._began: int | None = None

    def use(self, source: JointStateSource, config: JointsConfig) -> None:
        """Publish the joint states of ``source`` from now on, as ``config`` asks."""
        if source is not self._source:
            self._source, self._message = source, JointState(name=list(source.names))
        if self._timer is None or config.rate != self._config.rate:
            self._set_rate(config.rate)
        self._config = config

    def _set_rate(self, rate: float) -> None:
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        self._timer = self._node.create_timer(1.0 / rate, self.publish)

    def publish(self) -> None:
        """Publish the current joint states; nothing if no joint moves."""
        source, config = self._source, self._config
        if source is None or not source.names:
            return
        now = self._node.get_clock().now()
        # Counted from the first message on, because a float cannot hold nanoseconds since 1970.
        self._began = now.nanoseconds if self._began is None else self._began
        positions, velocities = source.sample((now.nanoseconds - self._began) * 1e-9)
        has_position, has_velocity, has_effort = source.received.kinds
        message = self._message
        shows_positions = config.publish_default_positions or config.moves or has_position
        message.position = array("d", positions.tobytes()) if shows_positions else _EMPTY
        moving = config.moves or source.moving or has_velocity
        shows_velocities = config.publish_default_velocities or moving
        message.velocity = array("d", velocities.tobytes()) if shows_velocities else _EMPTY
        shows_efforts = config.publish_default_efforts or has_effort
        message.effort = array("d", source.efforts().tobytes()) if shows_efforts else _EMPTY
        if shows_positions or shows_velocities or shows_efforts:
            message.header.stamp = now.to_msg()
            self._publisher.publish(message)


_NO_ARGUMENTS = RosArguments()


class JointStatePublisher(Node):
    """The node joint_state_publisher; the module's docstring lists its topics."""

    def __init__(
        self, description_file: str | None = None, arguments: RosArguments = _NO_ARGUMENTS
    ) -> None:
        """Start publishing as soon as the description is known.

        Args:
            description_file: URDF or xacro file; None for the parameter or topic.
            arguments: the command line's ROS arguments.

        Raises:
            OneBotError: the description or a parameter cannot be used.
        """
        super().__init__("joint_state_publisher", allow_undeclared_parameters=True)
        self._places: Mapping[str, str] = {}  # places of the parameters being applied
        self._reported: set[Problem] = set()
        self._warn = Throttled(self.get_logger().warning)
        self._settings = JointStateParameters(self, arguments)
        self.state = JointsState(self._settings.values, self._settings.config)
        self._output = JointStatesOut(self)
        self._sources: dict[str, Subscription] = {}  # topics whose values override all motions
        self._files = JointFiles(self, self._settings.live)
        self._start(description_file)
        follow_changes(self, self._check, lambda _: self._apply(self._next))

    def _start(self, description_file: str | None) -> None:
        """Apply the description that is already at hand, or wait for one on the topic."""
        text = self.state.values["robot_description"]
        if description_file:
            description, source = load_followed(description_file)
            self._use(description)
            self._files.description = DescriptionFiles(source)
        elif text:
            self._use(parse_description(text, "robot_description"))
        else:
            self._subscribe(self.state.config.source_list)
            DescriptionTopic(self, lambda: self.state.description, self.replace)

    # Parameters ------------------------------------------------------------------------------

    def _check(self, parameters: Sequence[Parameter]) -> None:
        """Check parameters against each other, the files and the robot; change nothing."""
        old = self.state
        try:
            values, config = self._settings.changed(old.values, parameters)
            plan = old.source.prepare(config) if old.source else None
            self._next = replace(old, values=values, config=config, plan=plan)
        except ConfigError as error:
            raise error.located(self._places) from None

    def set_all(self, changes: Mapping[str, Any], places: Mapping[str, str]) -> None:
        """Set all ``changes`` or none.

        Args:
            changes: values by name; None to unset.
            places: file and line of each, for errors.

        Raises:
            OneBotError: a change is rejected; nothing has changed.
        """
        if not changes:
            return
        self._places = places
        parameters = [ros_parameter(name, value) for name, value in changes.items()]
        result = self.set_parameters_atomically(parameters)
        self._places = {}
        if not result.successful:
            raise OneBotError(result.reason)

    # Applying parameters and descriptions ----------------------------------------------------

    def _use(self, description: Description) -> None:
        """Start with ``description``; raise ConfigError if parameters do not match it."""
        try:
            self._apply(self.state.describing(description, tolerant=False))
        except ConfigError as error:
            raise error.located(self._settings.live.places(self.state.values)) from None

    def replace(self, description: Description) -> None:
        """Change to another description, as all other nodes do.

        Parameters of joints that it lacks are reported and ignored.
        """
        self._apply(self.state.describing(description, tolerant=True))
        self._files.reread_refused()  # they may match this robot

    def _apply(self, state: JointsState) -> None:
        """Use ``state`` from now on; log which parameters exceed limits or do not match."""
        old, self.state = self.state, state
        if state.source is not None:
            if state.plan is not None:
                state.source.apply(state.plan)
            if state.source is not old.source:
                assert state.description is not None
                # robot_state_publisher logs the notices of descriptions that it publishes.
                for notice in state.description.notices if state.description.files else ():
                    self.get_logger().warning(notice)
                moved = listing(state.source.names) if state.source.names else ""
                joints = f"joints: {moved or 'no joint moves, nothing to publish'}"
                self.get_logger().info(f"robot description applied; {joints}")
            self._output.use(state.source, state.config)
            places = self._settings.live.places(state.values)
            for problem in state.source.reports:
                if problem not in self._reported:
                    self.get_logger().warning(problem.message(places))
            self._reported = set(state.source.reports)
        self._subscribe(state.config.source_list)

    # Messages --------------------------------------------------------------------------------

    def _subscribe(self, topics: Sequence[str]) -> None:
        """Subscribe to these topics of other nodes' joint states and no others."""
        for topic in set(self._sources).difference(topics):
            self.destroy_subscription(self._sources.pop(topic))
        for topic in set(topics).difference(self._sources):
            self._sources[topic] = self.create_subscription(
                JointState, topic, partial(self._on_joint_state, topic), ANY_PUBLISHER
            )

    def _on_joint_state(self, topic: str, message: JointState) -> None:
        if self.state.source is None:
            return
        ignored = self.state.source.received.receive(
            message.name, message.position, message.velocity, message.effort
        )
        if ignored:
            self._warn("ignored", f"message on {topic} ignored: {ignored}")


def main(args: list[str] | None = None) -> int:
    """Run the node; ``args`` are as in sys.argv. Return the exit code."""
    return run_described_node(
        "joint_state_publisher",
        __doc__,
        JointsConfig,
        JointStatePublisher,
        args=args,
        check_files=lambda files: read_files(files, "/joint_state_publisher", JointsConfig),
    )


if __name__ == "__main__":
    sys.exit(main())
