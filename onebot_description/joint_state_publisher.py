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

import sys
from collections.abc import Sequence

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from onebot_description.description import Description, load_description, parse_description
from onebot_description.errors import DescriptionError, OneBotError
from onebot_description.joints.parameter_files import read_files
from onebot_description.joints.problems import ConfigError, Problem
from onebot_description.joints.state import JointsState
from onebot_description.node_main import run_described_node
from onebot_description.ros_arguments import RosArguments
from onebot_description.ros_description import DescriptionTopic, described_by
from onebot_description.ros_joint_files import JointFiles
from onebot_description.ros_joint_parameters import JointParameters
from onebot_description.ros_joint_topics import JointStatesIn, JointStatesOut
from onebot_description.text import listing
from onebot_description.throttle import Throttled

_NO_ARGUMENTS = RosArguments()


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
        self._said: set[Problem] = set()
        self._refused: Description | None = None
        self._warn = Throttled(self.get_logger().warning)
        self._settings = JointParameters(self, arguments)
        self._state = JointsState(self._settings.values, self._settings.config)
        self._output = JointStatesOut(self)
        self._input = JointStatesIn(self, self._on_joint_state)
        self._files = JointFiles(
            self, description_file, self._settings, lambda: self._state, self._offer
        )
        self._start(description_file)
        self.add_on_set_parameters_callback(self._validate)
        self.add_post_set_parameters_callback(self._accept)
        self._files.watch()

    def _start(self, description_file: str | None) -> None:
        """Take up the description that is already at hand, or wait for one on the topic."""
        text = self._state.values["robot_description"]
        if description_file:
            self._use(load_description(description_file))
        elif text:
            self._use(described_by(text))
        else:
            self._input.listen_to(self._state.config.source_list)
            DescriptionTopic(self, self._on_description, lambda: self._state.source is not None)

    # Parameters ------------------------------------------------------------------------------

    def _validate(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        try:
            self._next = self._prepare(parameters)
        except ConfigError as error:
            reason = str(self._settings.located(error))
            return SetParametersResult(successful=False, reason=reason)
        except OneBotError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _prepare(self, parameters: Sequence[Parameter]) -> JointsState:
        """Check parameters against each other, the files and the robot; change nothing."""
        old = self._state
        values, config = self._settings.changed(old.values, parameters)
        text = values.get("robot_description")
        new = described_by(text) if text and text != old.values.get("robot_description") else None
        return old.with_parameters(values, config, new, self._refused)

    def _accept(self, parameters: Sequence[Parameter]) -> None:
        self._take_up(self._next)
        if any(parameter.name == "config_file" for parameter in parameters):
            # What it says cannot be set from within this callback.
            self._settings.live.add(self._state.values.get("config_file", ""))
            self._files.read_soon()

    # Taking up parameters and descriptions ---------------------------------------------------

    def _use(self, description: Description) -> None:
        """Go over to ``description``.

        Raises:
            ConfigError: the parameters do not suit it.
        """
        old = self._state
        try:
            self._take_up(old.describing(description))
        except ConfigError as error:
            raise error.located(self._settings.live.places(old.values)) from None

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
            self._files.read_broken()
            if self._refused is not None:
                self._files.keep("the new robot description", error)

    def _take_up(self, state: JointsState) -> None:
        old, self._state = self._state, state
        if state.source is not None:
            if state.plan is not None:
                state.source.apply(state.plan)
            if state.source is not old.source:
                self._refused = None
                moved = listing(state.source.names) if state.source.names else ""
                said = f"joints: {moved or 'no joint moves, nothing to publish'}"
                self.get_logger().info(f"robot description taken up; {said}")
            self._report(state)
            self._output.use(state.source, state.config)
        self._input.listen_to(state.config.source_list)

    def _report(self, state: JointsState) -> None:
        """Say once what the parameters ask in excess of limits."""
        assert state.source is not None
        places = self._settings.live.places(state.values)
        for problem in state.source.reports:
            if problem not in self._said:
                self.get_logger().warning(problem.message(places))
        self._said = set(state.source.reports)

    # Messages --------------------------------------------------------------------------------

    def _on_description(self, urdf: str) -> None:
        known = self._state.description
        if known is not None and urdf == known.urdf:
            return
        try:
            description = parse_description(urdf, "robot_description")
        except DescriptionError as error:
            self._files.keep("the robot description", error)
        else:
            self._offer(description)

    def _on_joint_state(self, topic: str, message: JointState) -> None:
        if self._state.source is None:
            return
        ignored = self._state.source.feedback.hear(
            message.name, message.position, message.velocity, message.effort
        )
        if ignored:
            self._warn("ignored", f"message on {topic} ignored: {ignored}")


def main(args: list[str] | None = None) -> int:
    """Run the node; ``args`` are as in sys.argv. Return the exit code."""
    return run_described_node(
        "joint_state_publisher",
        __doc__,
        JointStatePublisher,
        lambda files: read_files(files, "/joint_state_publisher"),
        args,
    )


if __name__ == "__main__":
    sys.exit(main())
