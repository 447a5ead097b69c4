"""The ROS interface of one robot: its node's topics and services, and its description."""

from collections.abc import Sequence, Set
from dataclasses import replace
from typing import Protocol

from rclpy.clock import Clock
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_control.controlled_robot import ControlledRobot
from onebot_control.nodes.commands import CommandGate
from onebot_control.nodes.control_parameters import ControlParameters
from onebot_control.nodes.joint_controller_nodes import JointControllerNodes
from onebot_control.nodes.publishing import Publishers
from onebot_control.nodes.robot_sensors import RobotSensors
from onebot_control.nodes.robot_services import RobotServices
from onebot_control.prepared_robot import Member, joints_of, wheels_of
from onebot_control.runtime.control_loop import ControlLoop, LoopSlot
from onebot_control.runtime.frames import RobotFrames
from onebot_control.runtime.sensing import Channel, Sensing
from onebot_control.sensing.surroundings import SensedRobot
from onebot_control.simulation_parameters import SimulationConfig
from onebot_description.description import Description
from onebot_description.description.loading import load_sensors
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import ConfigError, Problem
from onebot_description.ros.description_topic import GOES_ON, DescriptionTopic
from onebot_description.ros.node_parameters import follow_changes, refuse_undeclared
from onebot_description.timing import NS_PER_S
from onebot_description.timing.throttled import Throttled

_RADIUS = "minimum_turning_radius"  # a parameter that other nodes read


class SharedWorld(Protocol):
    """The shared part of the robots of a world.

    Attributes:
        scene: the scene around the robots; None on bare ground.
        simulated: whether stamps are simulated time.
        seed: seed of the sensors' noise.
        factor: the real_time_factor of all robots.
    """

    scene: Description | None
    simulated: bool
    seed: int
    factor: float

    def start_described(self) -> None:
        """Start the control loop if the descriptions of all robots are known."""

    def check_frames(self, row: int, frames: RobotFrames) -> None:
        """Check new frames of the robot in ``row``, with ``RobotFrames.check``."""

    def set_factor(self, factor: float) -> None:
        """Set the real_time_factor of all robots."""


class RobotInterface:
    """The ROS interface of one robot.

    Attributes:
        node: the robot's node.
        settings: its parameters.
        description: description of the robot; None until it is known.
        slot: the robot's place in the control loop.
        publishing: publishes its state.
        commands: receives ~/cmd_vel and its lock.
        sensors: its simulated sensors.
    """

    def __init__(
        self, world: SharedWorld, row: int, node: Node, settings: ControlParameters
    ) -> None:
        """Subscribe, and offer the services.

        Args:
            world: the world, shared with other robots.
            row: the robot's index in its fleet.
            node: node of the robot.
            settings: its parameters.
        """
        self._world, self.node, self.settings = world, node, settings
        self.description: Description | None = None
        self._sensing: Sensing | None = None
        self._controllers: JointControllerNodes | None = None
        self._warn = Throttled(node.get_logger().warning)
        self._refuse = Throttled(lambda text: node.get_logger().error(text))
        self.slot, config = LoopSlot(row), settings.config
        drives, (command, odometry) = config.drive is not None, settings.topics
        self.publishing = Publishers(
            node, clock=world.simulated and row == 0, odometry=odometry if drives else None
        )
        self.sensors = RobotSensors(node, self.sense_again, world.seed)
        self.commands = CommandGate(node, self.slot, self._warn, command, config.drive)
        self._asked = 0  # stamp of the latest message on step_topics, ns
        odom = (lambda: self.publishing.odom_frame) if drives else None
        RobotServices(node, self.slot, odom, self._warn)
        refuse_undeclared(node, settings.declared)
        follow_changes(node, self._check, self._apply)

    @property
    def name(self) -> str:
        """The full name of the robot's node."""
        return str(self.node.get_fully_qualified_name())

    def frames(
        self, config: SimulationConfig | None = None, description: Description | None = None
    ) -> RobotFrames:
        """Return the robot's frames, with the current or another config or description."""
        robot = description or self.description
        assert robot is not None
        return RobotFrames.from_parameters(
            config or self.settings.config,
            robot,
            self.node.get_namespace(),
            in_scene=self._world.scene is not None,
        )

    def member(self, name: str) -> Member:
        """Return the robot as a member of the fleet; ``name`` is a prefix for errors."""
        assert self.description is not None
        settings = self.settings
        return Member(
            self.description,
            settings.config,
            name,
            {**settings.places, **settings.joints.places},
            settings.joints.controllers,
        )

    @property
    def warnings(self) -> list[str]:
        """Warnings about the parameters, and about the description."""
        assert self.description is not None
        # robot_state_publisher has logged the notices of its description.
        notices = self.description.notices if self.description.files else ()
        return [*notices, *self.settings.warnings]

    # The control loop --------------------------------------------------------------------------

    def prepare(self, robot: ControlledRobot, sensing: Sensing) -> None:
        """Publish ``robot`` and measure with its sensors once the control loop starts."""
        self._sensing = sensing
        self.use(robot)
        self._sense(robot, self._channels())

    def use(self, robot: ControlledRobot) -> None:
        """Publish ``robot`` from now on, with its current parameters."""
        self.publishing.use(robot, self.frames(robot.config, robot.description))

    def control_joints(self, loop: ControlLoop, clock: Clock | None) -> Sequence[Node]:
        """Use a loop that is about to start; return the new nodes of the joint controllers.

        Args:
            loop: the control loop.
            clock: clock of the actions' timers; None for each node's own clock.
        """
        self.slot.loop = loop
        has_joints = bool(self.slot.robot.joint_controllers)
        lock = self.commands.joint_lock if has_joints else self.commands.lock
        self._controllers = JointControllerNodes(self.node, self.slot, lock, clock)
        return self._controllers.nodes

    def publish_controllers(self, stamp: int) -> None:
        """Publish the joint controllers' states in the control cycle of a ``stamp``, ns."""
        if self._controllers is not None:
            self._controllers.publish(stamp)

    def restart(self) -> None:
        """Restart with the loop's fleet, which has been reset to the start."""
        self.use(self.slot.robot)
        self._asked = self.slot.answered = 0

    @property
    def _step_topics(self) -> list[str]:
        return [*map(self.node.resolve_topic_name, self.settings.config.step_topics)]

    def measured(self, topics: Set[str], stamp: int) -> None:
        """Record that messages with ``stamp``, ns, are published on ``topics``."""
        if topics and not topics.isdisjoint(self._step_topics):
            self._asked = stamp

    def missing(self) -> str:
        """Return what a step must wait for, as the start of a sentence; "" for nothing.

        Raises:
            OneBotError: step_topics contains a topic that no sensor publishes.
        """
        topics, commands = self._step_topics, self.commands.subscription
        for topic in topics:
            if not (publisher := self.sensors.publisher(topic)):
                raise OneBotError(f'step_topics: "{topic}" is not the topic of a sensor')
            if not publisher.get_subscription_count():
                return f"no node subscribed to {topic}"
        if not topics or commands is None:
            return ""
        cmd_vel = self.node.resolve_topic_name(self.commands.topic)
        if not commands.connected:
            return f"no node offered commands on {cmd_vel}"
        if self._asked <= self.slot.answered:
            return ""
        stamp = f"{self._asked / NS_PER_S:.3f} s"
        return f"no command with the stamp {stamp} or a later one arrived on {cmd_vel}"

    def poll(self) -> None:
        """Look for publishers of commands, drift and edited files, several times per second."""
        if self.commands.subscription is not None:
            self.commands.subscription.follow()
        drive = self.slot.robot.drive if self.slot.loop is not None else None
        if drive is not None:
            for warning in filter(None, (drive.drift.warning, drive.notice)):
                self._warn.once(warning)
            radius = self.settings.values.get(_RADIUS)
            if radius is not None and radius != drive.geometry.minimum_radius:
                self.node.set_parameters([Parameter(_RADIUS, value=drive.geometry.minimum_radius)])
        if self._controllers is not None and self.slot.running.paused:
            # While paused, no cycle passes on goals that were ended by a lock or a reset.
            self.slot.running.post(self._controllers.finish)
        self.sensors.poll()

    # The description ---------------------------------------------------------------------------

    def describe(self, description: Description | None, *, follow: bool) -> None:
        """Use a description, if it is known, and wait for others on the topic if ``follow``."""
        if description is not None:
            self._start(description)
        if follow:
            places = self.settings.places
            DescriptionTopic(self.node, lambda: self.description, self._use, places)

    def _start(self, description: Description) -> None:
        """Use the first description; start if all robots have one."""
        self.description = description
        try:
            self._world.start_described()
        except OneBotError:
            self.description = None
            raise

    def _use(self, description: Description) -> None:
        """Start with a published description, or change to it."""
        previous = self.description
        if self.slot.loop is None:
            self._start(description)
        elif previous is not None:
            self._change(description, previous)
            self.node.get_logger().info("now using the changed robot description")

    def _change(self, description: Description, previous: Description) -> None:
        if (description.links, description.joints) != (previous.links, previous.joints):
            self._world.check_frames(self.slot.row, self.frames(description=description))
            self.slot.running.call(lambda: self._replace(description))
        self.description = description
        self.sense_again()

    def _replace(self, description: Description) -> None:
        """Replace the robot in the loop, in the control thread."""
        _check_joints(self.slot.robot, description)
        self.slot.running.fleet.replace(self.slot.row, description)
        robot = self.slot.robot
        self.use(robot)
        self._sense(robot)

    # Parameters --------------------------------------------------------------------------------

    def _check(self, parameters: Sequence[Parameter]) -> None:
        """Raise OneBotError if changes of parameters cannot be applied."""
        config = self.settings.changed(parameters, self._world.simulated)
        self._check_effect(config)
        if self.slot.loop is not None:
            self.slot.robot.fitted(config)
            if config.sensors and config.sensors != self.settings.config.sensors:
                load_sensors(config.sensors, self.slot.robot.description)
            self._world.check_frames(self.slot.row, self.frames(config))

    def _check_effect(self, config: SimulationConfig) -> None:
        """Raise ConfigError if a change of TF parameters would have no effect."""
        previous, in_scene = self.settings.config, self._world.scene is not None
        frame = config.world_frame(in_scene=in_scene)
        if in_scene and previous.world_frame_id and not config.world_frame_id:
            text = "a world needs a parent frame; ground_truth_tf: false removes odom from it"
            raise ConfigError([Problem("world_frame_id", text)])
        if config.ground_truth_tf and not (previous.ground_truth_tf or frame):
            text = "there is no frame to publish odom in; set world_frame_id first"
            raise ConfigError([Problem("ground_truth_tf", text)])

    def _apply(self, parameters: Sequence[Parameter]) -> None:
        """Apply changes that ``_check`` has accepted."""
        previous = self.settings.config
        self.settings.accept(parameters)
        config = self.settings.config
        if config == previous:
            return
        if self.slot.loop is not None and (
            fault := self.slot.fault(lambda: self._configure(config))
        ):
            self._refuse("parameters", f"parameters not applied, {GOES_ON}: {fault}")
        if config.real_time_factor != self._world.factor:
            self._world.set_factor(config.real_time_factor)
        if replace(config, real_time_factor=previous.real_time_factor) != previous:
            self.sense_again()

    def _configure(self, config: SimulationConfig) -> None:
        """Apply parameters in the control thread."""
        self.slot.robot.configure(config)
        self.slot.running.set_factor(config.real_time_factor)
        self.use(self.slot.robot)

    # Sensors -----------------------------------------------------------------------------------

    def sense_again(self) -> None:
        """Apply changes of the sensors."""
        loop = self.slot.loop
        if loop is None:
            return
        try:
            channels = self._channels()
            loop.call(lambda: self._sense(self.slot.robot, channels))
        except OneBotError as error:
            self._refuse("sensors", f"sensors not applied: {error}")

    def _channels(self) -> Sequence[Channel]:
        """Return the sensors of the description and of the parameter ``sensors``."""
        assert self.description is not None
        return self.sensors.update(self.slot.row, self.description, self.settings.config)

    def _sense(self, robot: ControlledRobot, channels: Sequence[Channel] = ()) -> None:
        """Use these sensors; call it in the control thread, or before it starts."""
        assert self._sensing is not None
        sensed = SensedRobot(robot.description, robot.joints, robot.held)
        self._sensing.enter(self.slot.row, sensed, channels)


def _check_joints(robot: ControlledRobot, description: Description) -> None:
    """Raise OneBotError if a joint controller would have no joints in another description."""
    wheels = wheels_of(robot.config, description)
    for name, controller in robot.joint_controllers.items():
        if not joints_of(controller, description, wheels):
            raise OneBotError(f"{name} would have no joint to move; restart the node")
