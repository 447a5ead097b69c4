#!/usr/bin/env python3
"""joint_state_publisher: joint states from YAML, moving as soon as the file is saved.

Run it alone with ``joint_state_publisher [FILE] --ros-args --params-file joints.yaml``; FILE
is a URDF or xacro file. Without it, the description is the parameter or the topic
robot_description.

Publishes:
    joint_states (sensor_msgs/msg/JointState, reliable, depth 10): positions in rad or m, velocities
        in rad/s or m/s, of all joints that move, in the order of the description.

Subscribes:
    robot_description (std_msgs/msg/String, reliable, transient local, depth 1): the URDF, unless
        FILE or the parameter gives it.
    each topic of source_list (sensor_msgs/msg/JointState, best effort, depth 10).

Parameters (all can be changed while it runs; a change takes effect or is refused with the reason):
    rate (double or integer, Hz, default 10): above 0 and up to 1000.
    publish_default_positions (bool, default true): for joints that nothing moves.
    publish_default_velocities (bool, default false): also when nothing moves.
    publish_default_efforts (bool, default false): zeros.
    use_mimic_tags (bool, default true): joints with a mimic tag follow the joint it names.
    use_smallest_joint_limits (bool, default true): keep to the limits of safety_controller too.
    source_list (string[], default []): topics whose values count more than all of the below.
    zeros.<joint> (double, default 0, or mid-range if 0 is out of range): where it rests.
    dependent_joints.<joint>.parent (string), .factor (double, 1.0), .offset (double, 0.0).
    poses.<pose>.<joint> (double): named poses.
    pose (string, default ""): the pose to hold, over all motions; empty for none.
    motions.<joint>.type (string): constant (.position), sine (.amplitude .frequency .phase
        .offset), keyframes (.times, .positions or .poses, .blend, .loop) or pose (.pose).
    sequence.poses (string[]), .durations (double[], s), .blend (string, minimum_jerk), .loop
        (bool, true): poses to go through, for the joints without a motion of their own.
    delta (double, default 0.0): step per message of joints that nothing else moves.
    robot_description (string, default ""): the URDF, or the path of a URDF or xacro file.
    config_file (string, default ""): a parameter file to read and watch as --params-file is.
"""

import argparse
import sys
from array import array
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.validate_topic_name import validate_topic_name
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_description.description import Description, load_description, parse_description
from onebot_description.errors import DescriptionError, OneBotError
from onebot_description.joints.config import DEFAULTS, JointsConfig
from onebot_description.joints.live_parameters import LiveParameters
from onebot_description.joints.parameter_files import read_files
from onebot_description.joints.plan import Plan
from onebot_description.joints.problems import ConfigError, Problem
from onebot_description.joints.source import JointStateSource
from onebot_description.joints.watch import FileWatch
from onebot_description.ros import run_node
from onebot_description.ros_arguments import RosArguments, ros_arguments
from onebot_description.text import listing

_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Takes what sensors publish best effort as well as what is published reliably.
_ANY_SENDER = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
_LOOK_EVERY = 0.05  # seconds between looks at the files
_PATIENCE = 2.0  # seconds without a description before saying so
_WARN_EVERY = 5.0  # seconds
_NO_ARGUMENTS = RosArguments()


@dataclass(frozen=True)
class _State:
    """All that follows from the parameters; replaced as a whole, so that a refusal changes nothing.

    ``source`` and ``plan`` are None until the description is known.
    """

    values: dict[str, Any]
    config: JointsConfig
    description: Description | None = None
    source: JointStateSource | None = None
    plan: Plan | None = None


class JointStatePublisher(Node):
    """See the module's docstring for what it publishes, subscribes and takes."""

    def __init__(
        self, description_file: str | None = None, arguments: RosArguments = _NO_ARGUMENTS
    ) -> None:
        """Start publishing as soon as the description is known.

        Args:
            description_file: URDF or xacro file; None to take the parameter or the topic.
            arguments: the parameter files to watch and the parameters set on the command line.

        Raises:
            OneBotError: the parameters or the description cannot be used.
        """
        super().__init__("joint_state_publisher", allow_undeclared_parameters=True)
        self._description_file = description_file
        self._message = JointState()
        self._timer: Timer | None = None
        self._sources: dict[str, Subscription] = {}
        self._said: set[Problem] = set()
        self._broken: set[str] = set()
        self._refused: Description | None = None
        self._unread = False
        self._began: int | None = None
        self._places: Mapping[str, str] = {}  # of the file being taken up
        self._live = LiveParameters(arguments.files, self.get_fully_qualified_name())
        self._state = self._declare(
            [name for node, name in arguments.names if node in ("", self.get_name())]
        )
        self._publisher = self.create_publisher(JointState, "joint_states", 10)
        self._start()
        self.add_on_set_parameters_callback(self._validate)
        self.add_post_set_parameters_callback(self._accept)
        self._watch = FileWatch(self._watched())
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_LOOK_EVERY, self._look, clock=steady)
        self._impatience = self.create_timer(_PATIENCE, self._say_waiting, clock=steady)

    # Parameters ------------------------------------------------------------------------------

    def _declare(self, given: Sequence[str]) -> _State:
        """Declare every parameter that anybody set, and the rest with its default.

        Types are left open, so that 10 and 10.0 are both right and the checks are all ours.
        """
        defaults = {**DEFAULTS, "robot_description": "", "config_file": ""}
        for name in dict.fromkeys([*defaults, *self._live.file.values, *given]):
            if not self.has_parameter(name):
                default = defaults.get(name) or None
                self.declare_parameter(name, default, ParameterDescriptor(dynamic_typing=True))
        unset = [name for name in defaults if self.get_parameter(name).value is None]
        self.set_parameters([_parameter(name, defaults[name]) for name in unset])
        values = self._current_values()
        config_file = values["config_file"]
        if isinstance(config_file, str) and config_file:
            self._live.add(config_file)
            written = self._live.file.values
            self.set_parameters([_parameter(name, value) for name, value in written.items()])
            values = self._current_values()
        self._live.pin(given, values)
        if self._live.remark:
            self.get_logger().warning(self._live.remark)
        try:
            config = JointsConfig.from_parameters(values)
            self._check_rest(config, values)
        except ConfigError as error:
            raise error.located(self._live.places(values)) from None
        return _State(values, config)

    def _current_values(self) -> dict[str, Any]:
        parameters = self.get_parameters_by_prefix("")
        return {n: _plain(p.value) for n, p in parameters.items() if p.value is not None}

    def _validate(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        values = dict(self._state.values)
        for parameter in parameters:
            values[parameter.name] = _plain(parameter.value)
            if parameter.value is None:
                del values[parameter.name]
        try:
            self._next = self._prepare(values)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error.located(self._places)))
        except OneBotError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _prepare(self, values: dict[str, Any]) -> _State:
        """Check parameters against each other, the files and the robot; change nothing."""
        old = self._state
        config = JointsConfig.from_parameters(values)
        self._check_rest(config, values)
        config_file = values.get("config_file")
        if config_file and config_file != old.values.get("config_file"):
            read_files([Path(config_file)], self.get_fully_qualified_name())
        text = values.get("robot_description")
        if text and text != old.values.get("robot_description"):
            description = _load(text)
            source = JointStateSource.from_description(description, config, previous=old.source)
            return _State(values, config, description, source)
        if self._refused is not None:
            # A joint renamed in both files: the description waited for these parameters.
            with suppress(ConfigError):
                source = JointStateSource.from_description(
                    self._refused, config, previous=old.source
                )
                return _State(values, config, self._refused, source)
        plan = old.source.prepare(config) if old.source else None
        return _State(values, config, old.description, old.source, plan)

    def _accept(self, parameters: Sequence[Parameter]) -> None:
        self._take_up(self._next)
        if any(parameter.name == "config_file" for parameter in parameters):
            # What it says cannot be set from within this callback.
            self._live.add(self._state.values.get("config_file", ""))
            self._unread = True

    def _check_rest(self, config: JointsConfig, values: Mapping[str, Any]) -> None:
        """Check what JointsConfig cannot: topic names, and the parameters of the node itself."""
        problems = [
            Problem(name, f"{values[name]} is no text; write a path in quotes")
            for name in ("robot_description", "config_file")
            if not isinstance(values.get(name, ""), str)
        ]
        own = self.resolve_topic_name("joint_states")
        for topic in config.source_list:
            try:
                validate_topic_name(topic)
                same = self.resolve_topic_name(topic) == own
            except InvalidTopicNameException as error:
                problems.append(Problem("source_list", " ".join(str(error).split())))
                continue
            if same:
                text = f"{topic} is the topic this node publishes; name another one"
                problems.append(Problem("source_list", text))
        if problems:
            raise ConfigError(problems)

    # Taking up parameters and descriptions ---------------------------------------------------

    def _start(self) -> None:
        """Take up the description that is already at hand, or wait for one on the topic."""
        text = self._state.values["robot_description"]
        if self._description_file:
            self._use(load_description(self._description_file))
        elif text:
            self._use(_load(text))
        else:
            self._listen_to(self._state.config.source_list)
            self.create_subscription(String, "robot_description", self._on_description, _LATCHED)

    def _use(self, description: Description) -> None:
        """Go over to ``description``.

        Raises:
            ConfigError: the parameters do not suit it.
        """
        old = self._state
        try:
            source = JointStateSource.from_description(description, old.config, previous=old.source)
        except ConfigError as error:
            raise error.located(self._live.places(old.values)) from None
        self._take_up(_State(old.values, old.config, description, source))

    def _offer(self, description: Description) -> None:
        """Go over to ``description`` if the parameters suit it, and say why if they do not.

        Raises:
            ConfigError: they do not, and there is no description so far.
        """
        try:
            self._use(description)
        except ConfigError as error:
            if self._state.source is None:
                raise
            self._refused = description
            if self._live.names in self._broken:
                self._reload_parameters()
            if self._refused is not None:
                self._keep("the new robot description", error)

    def _take_up(self, state: _State) -> None:
        old, self._state = self._state, state
        if state.source is not None:
            if state.plan is not None:
                state.source.apply(state.plan)
            if state.source is not old.source:
                self._refused = None
                self._introduce(state.source)
            self._report(state)
            if self._timer is None or state.config.rate != old.config.rate:
                self._set_rate(state.config.rate)
        self._listen_to(state.config.source_list)

    def _introduce(self, source: JointStateSource) -> None:
        self._message = JointState(name=list(source.names))
        moved = listing(source.names) if source.names else "no joint moves, nothing to publish"
        self.get_logger().info(f"robot description taken up; joints: {moved}")

    def _report(self, state: _State) -> None:
        """Say once what the parameters ask in excess of limits."""
        assert state.source is not None
        places = self._live.places(state.values)
        for problem in state.source.reports:
            if problem not in self._said:
                self.get_logger().warning(problem.message(places))
        self._said = set(state.source.reports)

    def _set_rate(self, rate: float) -> None:
        if self._timer is not None:
            self.destroy_timer(self._timer)
        self._timer = self.create_timer(1.0 / rate, self._publish)

    def _listen_to(self, topics: Sequence[str]) -> None:
        for topic in set(self._sources).difference(topics):
            self.destroy_subscription(self._sources.pop(topic))
        for topic in set(topics).difference(self._sources):
            self._sources[topic] = self.create_subscription(
                JointState, topic, lambda message, t=topic: self._on_source(t, message), _ANY_SENDER
            )

    # Messages --------------------------------------------------------------------------------

    def _on_description(self, message: String) -> None:
        known = self._state.description
        if known is not None and message.data == known.urdf:
            return
        try:
            description = parse_description(message.data, "robot_description")
        except DescriptionError as error:
            self._keep("the robot description", error)
        else:
            self._offer(description)

    def _on_source(self, topic: str, message: JointState) -> None:
        if self._state.source is None:
            return
        ignored = self._state.source.feedback.hear(
            message.name, message.position, message.velocity, message.effort
        )
        if ignored:
            self.get_logger().warning(
                f"message on {topic} ignored: {ignored}", throttle_duration_sec=_WARN_EVERY
            )

    def _publish(self) -> None:
        source, config = self._state.source, self._state.config
        if source is None or not source.names:
            return
        now = self.get_clock().now()
        # Counted from the first message on, because a float cannot hold nanoseconds since 1970.
        self._began = now.nanoseconds if self._began is None else self._began
        positions, velocities = source.sample((now.nanoseconds - self._began) * 1e-9)
        heard, message = source.feedback, self._message
        empty = array("d")
        shows_positions = config.publish_default_positions or config.moves or heard.any
        message.position = array("d", positions.tobytes()) if shows_positions else empty
        shows_velocities = (
            config.publish_default_velocities or config.moves or source.moving or heard.any_velocity
        )
        message.velocity = array("d", velocities.tobytes()) if shows_velocities else empty
        shows_efforts = config.publish_default_efforts or heard.any_effort
        message.effort = array("d", source.efforts().tobytes()) if shows_efforts else empty
        if shows_positions or shows_velocities or shows_efforts:
            message.header.stamp = now.to_msg()
            self._publisher.publish(message)

    def _say_waiting(self) -> None:
        self._impatience.cancel()
        if self._state.source is None:
            topic = self.resolve_topic_name("robot_description")
            self.get_logger().warning(
                f"waiting for the robot description on {topic}; is robot_state_publisher running?"
            )

    # Files -----------------------------------------------------------------------------------

    def _watched(self) -> list[Path]:
        description = self._state.description
        from_file = self._description_file or _is_path(self._state.values)
        return [*self._live.files, *(description.files if description and from_file else ())]

    def _look(self) -> None:
        """Take up what was saved since the last look."""
        self._watch.watch(self._watched())
        saved = self._watch.saved()
        if self._unread or any(file in saved for file in self._live.files):
            self._unread = False
            self._reload_parameters()
        if any(file not in self._live.files for file in saved):
            self._reload_description()

    def _reload_parameters(self) -> None:
        """Set every parameter as the files say; what they do not name goes back to its default."""
        names, before = self._live.names, self._live.file
        try:
            file = self._live.read()
            overruled = self._live.overruled(file)
            changes = self._live.changes(file, self._state.values)
            self._live.file = file
            self._set_all(changes, file.places)
        except OneBotError as error:
            self._live.file = before
            self._keep(names, error)
            return
        mended = "mended, " if names in self._broken else ""
        self._broken.discard(names)
        said = f"applied, changed: {listing(changes)}" if changes else "applied, nothing changed"
        self.get_logger().info(f"{names}: {mended}{said}")
        for name in overruled:
            self.get_logger().warning(f"{name} is set on the command line, which comes first")
        if self._live.remark:
            self.get_logger().warning(self._live.remark)

    def _set_all(self, changes: Mapping[str, Any], places: Mapping[str, str]) -> None:
        """Set all parameters or none.

        Raises:
            OneBotError: they were refused.
        """
        if not changes:
            return
        self._places = places
        try:
            parameters = [_parameter(name, value) for name, value in changes.items()]
            result = self.set_parameters_atomically(parameters)
        finally:
            self._places = {}
        if not result.successful:
            raise OneBotError(result.reason)

    def _reload_description(self) -> None:
        path = self._description_file or self._state.values["robot_description"]
        try:
            description = load_description(path)
        except DescriptionError as error:
            self._keep(str(path), error)
        else:
            self._offer(description)

    def _keep(self, what: str, error: OneBotError) -> None:
        """Say why something new was not taken up."""
        self._broken.add(what)
        self.get_logger().error(f"{what} not applied, the robot goes on as before:\n{error}")


def _load(text: str) -> Description:
    """Take the parameter robot_description as URDF, or as the path of a file."""
    return parse_description(text, "robot_description") if "<" in text else load_description(text)


def _is_path(values: Mapping[str, Any]) -> bool:
    text = values.get("robot_description", "")
    return bool(text) and "<" not in text


def _plain(value: Any) -> Any:
    """Parameter arrays come as array.array or lists; compare them all as lists."""
    return list(value) if isinstance(value, array | tuple | list) else value


def _parameter(name: str, value: Any) -> Parameter:
    if value == []:
        return Parameter(name, Parameter.Type.STRING_ARRAY, [])
    return Parameter(name, value=value)


def main(args: list[str] | None = None) -> int:
    """Run the node; ``args`` are as in sys.argv. Return the exit code."""
    arguments = sys.argv if args is None else args
    parser = argparse.ArgumentParser(
        prog="joint_state_publisher",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("description", nargs="?", metavar="FILE", help="URDF or xacro file")
    ros = ros_arguments(arguments)
    chosen = parser.parse_args(ros.others)
    try:
        # rcl would refuse a broken file too, but say neither where nor what to write.
        read_files(ros.files, "/joint_state_publisher")
    except OneBotError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return 1
    return run_node(lambda: JointStatePublisher(chosen.description, ros), arguments)


if __name__ == "__main__":
    sys.exit(main())
