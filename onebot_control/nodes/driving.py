"""The ROS interface of velocity_controller: commands, parameters and services of a control loop."""

import gc
import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from onebot_control.driven_robot import DrivenRobot, Snapshot, joints_of, wheels_of
from onebot_control.fleet import Divider, Fleet, Member, located
from onebot_control.joint_controllers import (
    ForwardController,
    GripperController,
    JointController,
    TrajectoryController,
)
from onebot_control.nodes.commands import Command, CommandLock, CommandSubscription, Warn
from onebot_control.nodes.control_loop import ControlLoop
from onebot_control.nodes.localization import FramesTransform, Localizer, TransformsOf, TransformTap
from onebot_control.nodes.publishing import Frames, Publishers, ScenePublisher
from onebot_control.nodes.real_time import Pace, PaceMeter
from onebot_control.nodes.robot_sensors import RobotSensors
from onebot_control.nodes.sensing import Channel, Sensing, SensingThread
from onebot_control.nodes.simulation_services import SimulationServices
from onebot_control.nodes.spinning import NodeThread
from onebot_control.parameters import ControlConfig, ControlParameters
from onebot_control.physics.engine import logger as simulation_log
from onebot_control.physics.scene_bodies import load_scene
from onebot_control.poses import PlanarPose, yaw_of
from onebot_control.sensing.instruments import Sensors
from onebot_control.sensing.surroundings import SensedRobot
from onebot_description.description import Description, load_description, parse_description
from onebot_description.description.loading import load_sensors
from onebot_description.errors import OneBotError, did_you_mean, listing, printable
from onebot_description.ros.command_line import RosArguments
from onebot_description.ros.description_topic import DescriptionTopic, described_by, is_path
from onebot_description.ros.message_age import boot_time
from onebot_description.ros.parameters.reader import ConfigError, Problem, refuse_undeclared
from onebot_description.ros.throttled import Throttled
from onebot_description.ros.wire.cdr import NANO

if TYPE_CHECKING:
    from onebot_control.nodes.controller_node import ControllerNode

_DEPTH = 10  # ROS's system default
_POLL_PERIOD = 0.1  # s between polls of who publishes commands
_FARTHEST_POSE = 1e9  # m of a pose; odometry farther away would not be exact to the micrometre

_GOES_ON = "the robot goes on as before"
_LOCKED_EVERY = 60.0  # s between two warnings that a command is ignored because of the lock

GetLoop = Callable[[], ControlLoop | None]  # None as long as there is no robot

# Parameters of the world, with one value for all robots.
_WORLD_PARAMETERS = ("update_rate", "real_time_factor", "use_sim_time", "world", "paused")


class Driving:
    """Runs the control loop for all robots of a world once every description is known.

    Each robot has its own node with commands, parameters and services. ~/pause and ~/step of any of
    them are the world's, and so is real_time_factor: set for one, it is set for all.

    Attributes:
        nodes: one for each robot.
        robots: the ROS interface of each robot.
        loop: the control loop; None until every robot is known.
        simulated: whether stamps are simulated time.
        factor: the real_time_factor of all robots.
        scene: what stands around the robots; None on bare ground.
        seed: of the sensors' noise.
        sensing: measures with the robots' sensors; None until there is a loop.
    """

    def __init__(
        self,
        nodes: Sequence[Node],
        settings: Sequence[ControlParameters],
        scene: Description | None,
        *,
        simulated: bool,
        seed: int = 0,
    ) -> None:
        """Offer topics, parameters and services; afterwards call ``start``, or use ``described``.

        Args:
            nodes: the node of each robot, in the robot's namespace.
            settings: the parameters of each node.
            scene: what stands around the robots; None on bare ground.
            simulated: whether stamps are simulated time.
            seed: of the sensors' noise.
        """
        self.loop: ControlLoop | None = None
        self.sensing: Sensing | None = None
        self._services: SimulationServices | None = None
        self._arms_thread: NodeThread | None = None
        self._scene_publisher: ScenePublisher | None = None
        self.nodes, self._node = nodes, nodes[0]
        self._failure: BaseException | None = None
        self._diagnostics = self._node.create_publisher(DiagnosticArray, "/diagnostics", _DEPTH)
        self._warn = Throttled(self._node.get_logger().warning)
        self._transforms = TransformTap(self._node)
        self._of_odom = TransformsOf(())
        simulation_log.handlers = [NodeLog(self._node)]
        self.simulated, self.scene, self.seed = simulated, scene, seed
        self.factor = settings[0].config.real_time_factor
        self.robots = [
            RobotDriving(self, row, node, settings[row]) for row, node in enumerate(nodes)
        ]

    @classmethod
    def described(
        cls, nodes: Sequence[Node], file: str | None, arguments: Sequence[RosArguments]
    ) -> "Driving":
        """Return a Driving that starts in real time as soon as all descriptions are known.

        Args:
            nodes: the node of each robot, in the robot's namespace.
            file: URDF or xacro file; None to use each node's parameter or topic.
            arguments: the ROS arguments of each node.

        Raises:
            OneBotError: a parameter, the world or a given description cannot be used.
        """
        settings = list(map(ControlParameters, nodes, arguments))
        scene = load_scene(settings[0].config.world)
        driving = cls(nodes, settings, scene, simulated=_is_simulated(nodes, settings))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        nodes[0].create_timer(_POLL_PERIOD, driving.poll, clock=steady)
        # Last, when all attributes exist: from here on, ``stop`` may be called at any time.
        for robot in driving.robots:
            robot.describe(file)
        return driving

    def stop(self) -> None:
        """Stop the control loop, and with it the robots."""
        if self.loop is not None:
            self.loop.stop()
        if self._services is not None:
            self._services.stop()
        if self._arms_thread is not None:
            self._arms_thread.stop()
        if self.sensing is not None:
            self.sensing.stop()

    def start_described(self) -> None:
        """Start the control loop if all robots are described."""
        members = [robot.member() for robot in self.robots if robot.description is not None]
        if len(members) < len(self.robots):
            return
        for robot, member in zip(self.robots, members, strict=True):
            with located(member):
                robot.check_frames()
        fleet = Fleet.of(members, scene=self.scene)
        warn = self._node.get_logger().warning
        sensors = Sensors(self.scene, fleet.rate, fleet.world.settings.gravity)
        # Measurements are dropped only in real time.
        sensing = SensingThread(
            sensors, warn, self._fail, lambda: self.simulated and self.factor != 1.0
        )
        loop = ControlLoop(
            fleet,
            self.publish,
            simulated=self.simulated,
            meter=PaceMeter(self._publish_pace, self._log_pace),
            measured=sensing.flush,
            missing=self._missing,
            failed=self._fail,
        )
        # Exclude long-lived objects from garbage collection.
        gc.freeze()
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # sends results while paused, too
        self.start(loop, sensing, steady)
        if arms := self.arm_nodes:
            self._arms_thread = NodeThread(arms, "arms", self._fail)
        # After the start, because rclpy's first log call takes 20 ms.
        warnings = [*self.scene.notices] if self.scene else []
        warnings += [text for robot in self.robots for text in robot.warnings]
        for warning in dict.fromkeys(warnings):
            self._node.get_logger().warning(warning)
        self._node.get_logger().info(_moved_text(fleet))
        self._services = SimulationServices(self._node, loop, self.restart, self._fail)

    @property
    def arm_nodes(self) -> list[Node]:
        """The nodes of all joint controllers; whoever starts the loop has to spin them."""
        return [arm.node for robot in self.robots for arm in robot.arms.values()]

    def start(self, loop: ControlLoop, sensing: Sensing, clock: Clock | None = None) -> None:
        """Start a loop that moves the robots, all of which are described.

        Args:
            loop: the control loop.
            sensing: measures with the robots' sensors.
            clock: of the actions' timers; None for each node's own clock.
        """
        fleet = loop.fleet
        for robot, driven in zip(self.robots, fleet.robots, strict=True):
            robot.publishing.use(driven)
        if fleet.world.scene is not None:
            first = fleet.robots[0]
            rate = Divider(first.config.publish_rate, first.config.update_rate)
            self._scene_publisher = ScenePublisher(
                self._node, fleet.world.scene, first.world_frame, rate
            )
        self.sensing = sensing
        for robot, driven in zip(self.robots, fleet.robots, strict=True):
            robot.sense(self.sensing, driven, robot.channels(driven.config))
        self.sensing.start()
        self.loop = loop
        for robot, driven in zip(self.robots, fleet.robots, strict=True):
            robot.control_joints(driven, loop, clock)
        self.loop.start()

    def set_factor(self, factor: float) -> None:
        """Set real_time_factor of all robots."""
        self.factor = factor
        for robot in self.robots:
            robot.set_factor(factor)

    def restart(self) -> None:
        """Go back to the start, including simulated time; call it in the control thread."""
        assert self.loop is not None and self.sensing is not None
        self.loop.fleet.restart()
        self.sensing.restart(self.seed)
        for robot, driven in zip(self.robots, self.loop.fleet.robots, strict=True):
            robot.publishing.use(driven)
            robot.asked = robot.answered = 0

    def _missing(self) -> str:
        """Return what a step has to wait for, as the beginning of a sentence; "" for nothing."""
        return next(filter(None, (robot.missing() for robot in self.robots)), "")

    def publish(self, snapshots: Sequence[Snapshot], stamp: int) -> None:
        """Publish the robots' states in a control cycle, and make due measurements.

        Args:
            snapshots: of the robots.
            stamp: of the cycle, ns.
        """
        sensing, world = self.sensing, self.loop.fleet.world if self.loop else None
        assert sensing is not None and world is not None
        sensed = sensing.due(snapshots[0].tick)
        for row, (robot, snapshot) in enumerate(zip(self.robots, snapshots, strict=True)):
            if robot.awaited and not robot.awaited.isdisjoint(sensing.asked(row)):
                robot.asked = stamp
            robot.publishing.publish(snapshot, stamp, sensed=row in sensed)
            if robot.arms:
                robot.publish_arms(stamp)
        if self._scene_publisher is not None:
            self._scene_publisher.publish(stamp)
        sensing.take(stamp, snapshots, world.scene.poses if world.scene else ())

    def poll(self) -> None:
        """Look for publishers of commands and localizers; call it several times a second."""
        if self._failure is not None:
            raise self._failure
        for robot in self.robots:
            if robot.commands is not None:
                robot.commands.follow()
                robot.report_drift()
            robot.sensors.poll()
        if self.loop is not None:
            self._follow_localizers()

    def _follow_localizers(self) -> None:
        """Stop publishing the parent of odom while another node does."""
        robots = {
            robot.publishing.odom_frame: robot
            for robot in self.robots
            if robot.publishing.world_frame and robot.commands is not None
        }
        if not robots:
            self._transforms.close()
            return
        if self._of_odom.children != robots.keys():
            self._of_odom = TransformsOf(robots)
        now = time.monotonic_ns()
        for message in self._transforms.poll(self.nodes, now):
            for transform in self._of_odom.find(message):
                robots[transform.child].receive_transform(transform, now)
        changes = [robot.follow_localizer(self._transforms.nodes, now) for robot in self.robots]
        if any(changes):
            self._transforms.close()  # subscribe again, to receive latched transforms of others

    def _fail(self, error: BaseException) -> None:
        self._failure = error

    def _publish_pace(self, pace: Pace, is_slow: bool) -> None:
        """Publish the real-time factor of the last second, from the control thread."""
        values = {
            "real_time_factor": f"{pace.factor:.3f}",
            "wanted real_time_factor": f"{self.factor:g}",
            "control cycles": str(pace.cycles),
            "missed control cycles": str(pace.missed),
        }
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if is_slow else DiagnosticStatus.OK,
            name=f"{_full_name(self._node)[1:]}: real-time factor",
            message=str(pace),
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _log_pace(self, text: str, is_slow: bool) -> None:
        if is_slow:
            self._node.get_logger().warning(
                f"{text}; the CPU is overloaded, or the process was stopped"
            )
        else:
            self._node.get_logger().info(text)


def controller_nodes() -> Mapping[type[JointController[Any]], "type[ControllerNode[Any]]"]:
    """Return the class of the ROS interface for each kind of joint controller."""
    # Imported late: actions take 0.1 s, and most robots have only wheels.
    from onebot_control.nodes.forward_commands import ForwardCommands
    from onebot_control.nodes.gripper_actions import GripperActions
    from onebot_control.nodes.joint_trajectories import JointTrajectories

    return {
        TrajectoryController: JointTrajectories,
        ForwardController: ForwardCommands,
        GripperController: GripperActions,
    }


class NodeLog(logging.Handler):
    """A logging handler that passes the simulation's warnings to a node's logger."""

    def __init__(self, node: Node) -> None:
        """Pass on warnings and errors."""
        super().__init__(logging.WARNING)
        self._logger = node.get_logger()

    def emit(self, record: logging.LogRecord) -> None:
        self._logger.warning(record.getMessage())


def _is_simulated(nodes: Sequence[Node], settings: Sequence[ControlParameters]) -> bool:
    """Return whether the world runs on simulated time.

    Raises:
        ConfigError: the nodes differ in a parameter of the world.
    """
    for name in _WORLD_PARAMETERS:
        first, *other_values = [node.get_parameter(name).value for node in nodes]
        for node, value in zip(nodes[1:], other_values, strict=True):
            if value != first:
                text = f"{value}, but {first} of {_full_name(nodes[0])}"
                problem = f"{text}; it is the same for all robots of a world"
                raise ConfigError([Problem(f"{_full_name(node)}: {name}", problem)])
    factor = settings[0].config.real_time_factor
    return bool(nodes[0].get_parameter("use_sim_time").value) or factor != 1.0


def _full_name(node: Node) -> str:
    return str(node.get_fully_qualified_name())


def _moved_text(fleet: Fleet) -> str:
    """Return a line for the log about the robots and joints that are moved."""
    if len(fleet.robots) > 1:
        return f"driving {len(fleet.robots)} robots in one world"
    robot, parts = fleet.robots[0], []
    if robot.wheels is not None:
        separation, radius = robot.geometry
        parts.append(f"wheels {separation:g} m apart, of radius {radius:g} m")
    for name, arm in robot.arms.items():
        parts.append(f"{name} moves {listing(arm.names)}")
    verb = "driving" if robot.wheels is not None else "moving"
    moved = "; ".join(parts) or "no joint of it moves"
    return f'{verb} robot "{printable(robot.description.robot_name)}": {moved}'


class RobotDriving:
    """The ROS interface of one robot: its node's topics, parameters and services.

    Attributes:
        description: of the robot; None until it is known.
        publishing: publishes its state.
        commands: the subscription to ~/cmd_vel; None for a robot that stands.
        arms: ROS interfaces of its joint controllers, by name.
        lock: this robot's ~/cmd_vel_lock.
        sensors: its simulated sensors.
        awaited: sensor topics whose messages a command has to answer before a step ends.
        asked: stamp of the newest such message, ns.
        answered: stamp of the newest command, ns.
    """

    def __init__(self, driving: Driving, row: int, node: Node, settings: ControlParameters) -> None:
        """Subscribe, and offer the services; ``row`` is the robot's index in its fleet."""
        self._driving, self._row, self._node, self._settings = driving, row, node, settings
        self.description: Description | None = None
        self._warn = Throttled(node.get_logger().warning)
        self._refuse = Throttled(lambda text: node.get_logger().error(text))
        stands = settings.stands
        clock = driving.simulated and row == 0
        self.publishing = Publishers(node, clock=clock, stands=stands)
        self._localizer = Localizer("")
        self.sensors = RobotSensors(node, self._sense_again, driving.seed)
        self.answered = 0
        self._await(settings.config)
        choice = settings.config.cmd_vel_type
        # Created before the commands: an unlock sent with a command is then received first.
        self.lock = CommandLock(node, self._brake)
        self.commands: CommandSubscription | None = None
        if not stands:
            self.commands = CommandSubscription(node, choice, self._on_command, self._warn)
        self.arms: dict[str, ControllerNode[Any]] = {}
        odom = None if stands else lambda: self.publishing.odom_frame
        Requests(node, lambda: driving.loop, row, odom, self._warn)
        refuse_undeclared(node, settings.declared)
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._apply)

    def describe(self, file: str | None) -> None:
        """Use the description of a file or the parameter, or wait for the topic."""
        text = self._settings.values["robot_description"]
        if file:
            self._start(load_description(file))
        elif text:
            self._start(described_by(text))
        if not file and not is_path(text):
            DescriptionTopic(self._node, self._on_description, lambda: self.description is not None)

    def member(self) -> Member:
        """Return the robot as a member of the fleet."""
        assert self.description is not None
        name = "" if len(self._driving.nodes) == 1 else _full_name(self._node)
        settings = self._settings
        return Member(
            self.description,
            settings.config,
            name,
            {**settings.places, **settings.joints.places},
            settings.joints.controllers,
            stands=settings.stands,
        )

    def control_joints(self, robot: DrivenRobot, loop: ControlLoop, clock: Clock | None) -> None:
        """Create the node of each joint controller, with its topics, action and service."""
        robot.finished.clear()  # goals of earlier nodes, whose clients have gone
        kinds = controller_nodes() if robot.controllers else {}
        for name, controller in robot.controllers.items():
            node = Node(name, context=self._node.context, namespace=self._node.get_namespace())
            self.arms[name] = kinds[type(controller)](
                node,
                controller,
                lambda: loop.fleet.robots[self._row],
                loop,
                lambda: str(self.lock) if self.lock.locked else "",
                clock or node.get_clock(),
            )

    def publish_arms(self, stamp: int) -> None:
        """Publish the state of the joint controllers, and pass on goals that have ended."""
        assert self._driving.loop is not None
        robot = self._driving.loop.fleet.robots[self._row]
        for arm in self.arms.values():
            arm.publish(stamp)
        for name, outcome in robot.finished:
            self.arms[name].finish(outcome)
        robot.finished.clear()

    def check_frames(
        self, config: ControlConfig | None = None, description: Description | None = None
    ) -> None:
        """Check the frames that the robot would have with another config or description.

        All robots must be described.

        Raises:
            ConfigError: two frames share a name, or the frame of a scene would change.
        """
        other_frames = {
            _full_name(robot._node): robot._frames()
            for robot in self._driving.robots
            if robot is not self
        }
        frames, world = self._frames(config, description), self._frames().world
        problems = [*frames.problems(other_frames, self._driving.scene)]
        if self._driving.scene is not None and frames.world != world:
            # The frames of the scene are published once.
            text = f'the frames of the world are in "{world}"; restart the node to change it'
            problems.append(Problem("world_frame_id", text))
        if problems:
            raise ConfigError(problems)

    def _frames(
        self, config: ControlConfig | None = None, description: Description | None = None
    ) -> Frames:
        robot = description or self.description
        assert robot is not None
        namespace, in_scene = self._node.get_namespace(), self._driving.scene is not None
        return Frames.of(
            config or self._settings.config,
            robot,
            namespace,
            in_scene=in_scene,
            stands=self._settings.stands,
        )

    @property
    def warnings(self) -> list[str]:
        """Warnings about the description and the parameters."""
        assert self.description is not None
        # robot_state_publisher has logged the notices of its description.
        notices = self.description.notices if self.description.files else ()
        return [*notices, *self._settings.warnings]

    def _await(self, config: ControlConfig) -> None:
        names = map(self._node.resolve_topic_name, config.step_topics)
        self.awaited, self.asked = frozenset(names), 0

    def missing(self) -> str:
        """Return what a step of the simulation has to wait for; "" for nothing.

        Raises:
            OneBotError: step_topics names a topic that no sensor publishes.
        """
        for topic in sorted(self.awaited):
            if not (publisher := self.sensors.publisher(topic)):
                hint = did_you_mean(topic, self.sensors.topics, "of sensors")
                raise OneBotError(f'step_topics: "{topic}" is no topic of a sensor{hint}')
            if not publisher.get_subscription_count():
                return f"nobody subscribed to {topic}"
        if self.commands is None:
            return ""
        if self.awaited and not self.commands.connected:
            return f"nobody offered commands on {self._cmd_vel}"
        if self.asked <= self.answered:
            return ""
        kind = "" if self.commands.kind == "TwistStamped" else "; a Twist has none"
        stamp = f"{self.asked / NANO:.3f} s"
        return f"no command with the stamp {stamp} or a later one came on {self._cmd_vel}{kind},"

    @property
    def _cmd_vel(self) -> str:
        return str(self._node.resolve_topic_name("~/cmd_vel"))

    def report_drift(self) -> None:
        """Warn once if the robot's odometry and the truth drift apart."""
        if (loop := self._driving.loop) and (text := loop.fleet.robots[self._row].drift.warning):
            self._warn(text, text, every=math.inf)

    def receive_transform(self, transform: FramesTransform, now: int) -> None:
        """Pass a transform of odom on TF to the localizer check; ``now`` in ns, steady clock."""
        publishing = self.publishing
        if self._localizer.odom != publishing.odom_frame:
            self._localizer = Localizer(publishing.odom_frame)
        self._localizer.receive(transform, publishing.truths, now)

    def follow_localizer(self, nodes: Set[str], now: int) -> bool:
        """Stop or resume publishing the truth on TF; return whether it was resumed.

        Args:
            nodes: the other nodes that publish TF.
            now: ns, by a steady clock.
        """
        localizer, publishing = self._localizer, self.publishing
        parent = localizer.parent
        localizer.expire(nodes, now)
        if publishing.localized == bool(localizer.parent):
            return False
        publishing.localized = bool(localizer.parent)
        own = f"{publishing.world_frame} -> {publishing.odom_frame}"
        if publishing.localized:
            text = f"another node publishes {localizer.parent} -> {localizer.odom} on TF, so {own} "
            text += "is not published; set ground_truth_tf to false where that is always so"
        else:
            text = f"nobody publishes {parent} -> {localizer.odom} any more: {own} is published"
        if publishing.publishes_truth:
            self._node.get_logger().info(text)
        return not publishing.localized

    def set_factor(self, factor: float) -> None:
        """Set real_time_factor."""
        if self._settings.config.real_time_factor != factor:
            self._node.set_parameters([Parameter("real_time_factor", value=factor)])

    def _start(self, description: Description) -> None:
        """Use the first description; start if all robots have one."""
        self.description = description
        try:
            self._driving.start_described()
        except OneBotError:
            self.description = None
            raise

    def _on_description(self, urdf: str) -> None:
        loop, previous = self._driving.loop, self.description
        if previous is not None and previous.urdf == urdf:
            return
        try:
            description = parse_description(urdf, "robot_description")
            if loop is None:
                self._start(description)
            elif previous is not None and description.urdf != previous.urdf:
                if (description.links, description.joints) != (previous.links, previous.joints):
                    self.check_frames(description=description)
                    loop.call(lambda: self._replace(loop, description))
                self.description = description
                self._sense_again()
                self._node.get_logger().info("now driving by the changed robot description")
        except OneBotError as error:
            places = self._settings.places
            reason = error.located(places) if isinstance(error, ConfigError) else error
            goes_on = "still waiting for one" if loop is None else _GOES_ON
            self._refuse("description", f"robot_description not applied, {goes_on}:\n{reason}")

    def _replace(self, loop: ControlLoop, description: Description) -> None:
        self._check_joints(loop.fleet.robots[self._row], description)
        loop.fleet.replace(self._row, description)
        driven = loop.fleet.robots[self._row]
        self.publishing.use(driven)
        if self._driving.sensing is not None:
            self.sense(self._driving.sensing, driven)

    def _check_joints(self, robot: DrivenRobot, description: Description) -> None:
        """Raise OneBotError if a joint controller would have no joint in another description."""
        wheels = wheels_of(description, robot.config) if robot.wheels else None
        for name, controller in robot.controllers.items():
            if not joints_of(controller, description, wheels):
                raise OneBotError(f"{name} would have no joint to move; restart the node")

    def channels(self, config: ControlConfig) -> list[Channel]:
        """Return the sensors of the description and of the parameter ``sensors``."""
        assert self.description is not None
        return self.sensors.update(self._row, self.description, config)

    def sense(self, sensing: Sensing, robot: DrivenRobot, channels: Sequence[Channel] = ()) -> None:
        """Use these sensors; call it in the control thread, or before that starts."""
        sensed = SensedRobot(robot.description, robot.joints, robot.held)
        sensing.enter(self._row, sensed, channels)

    def _sense_again(self) -> None:
        """Apply changes of the sensors."""
        loop, sensing = self._driving.loop, self._driving.sensing
        if loop is None or sensing is None:
            return
        try:
            channels = self.channels(self._settings.config)
            loop.call(lambda: self.sense(sensing, loop.fleet.robots[self._row], channels))
        except OneBotError as error:
            self._refuse("sensors", f"sensors not applied: {error}")

    def _on_command(self, command: Command) -> None:
        loop, now = self._driving.loop, boot_time()
        if loop is None:
            return
        if command.stamp == 0:
            text = "~/cmd_vel has stamp 0, which is taken as when it was sent (logged once)"
            self._warn("stamp", text, every=math.inf)
        if self.lock.locked:
            if command.linear or command.angular:
                self._warn("locked", f"~/cmd_vel is ignored: {self.lock}", every=_LOCKED_EVERY)
            return
        # From here on, age it by a clock that nobody can set.
        given = now - command.age.least
        if command.stamp and not loop.simulated:
            given = now - (time.time_ns() - command.stamp) / NANO
        loop.post(lambda: self._command(loop, command, given, now - command.age.most))

    def _command(self, loop: ControlLoop, command: Command, given: float, sent: float) -> None:
        self.answered = max(self.answered, command.stamp or 0)
        if sent < loop.wake.check():
            refused: str | None = "it was sent before this process woke from a stop"
        else:
            robot = loop.fleet.robots[self._row]
            age = _age(loop, command, given)
            refused = robot.accept(command.linear, command.angular, age)
        if refused:
            self._warn("command", f"~/cmd_vel is ignored: {refused}")

    def _brake(self) -> None:
        if (loop := self._driving.loop) is not None:
            loop.post(lambda: self._stop(loop.fleet.robots[self._row]))

    def _stop(self, robot: DrivenRobot) -> None:
        robot.accept(0.0, 0.0, age=0.0)
        robot.hold_arms("Current goal cancelled: the robot is locked.")

    def _validate(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        loop = self._driving.loop
        try:
            config = self._settings.changed(parameters, self._driving.simulated)
            self._check_effect(config)
            if loop is not None:
                robot = loop.fleet.robots[self._row]
                robot.fitted(config)
                if config.sensors and config.sensors != self._settings.config.sensors:
                    load_sensors(config.sensors, robot.description)
                self.check_frames(config)
        except OneBotError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _check_effect(self, config: ControlConfig) -> None:
        """Refuse changes of TF parameters that would have no effect.

        Raises:
            ConfigError: with the reason.
        """
        previous, in_scene = self._settings.config, self._driving.scene is not None
        if in_scene and not config.world_frame_id and previous.world_frame_id:
            text = "the frames of a world need a parent; ground_truth_tf: false takes odom off it"
            raise ConfigError([Problem("world_frame_id", text)])
        if config.ground_truth_tf and not previous.ground_truth_tf:
            localizer = self._localizer
            if not config.world_frame(in_scene=in_scene):
                text = "there is no frame to publish odom in; set world_frame_id first"
                raise ConfigError([Problem("ground_truth_tf", text)])
            if localizer.parent:
                text = f"another node publishes {localizer.parent} -> {localizer.odom}"
                raise ConfigError([Problem("ground_truth_tf", text)])

    def _apply(self, parameters: Sequence[Parameter]) -> None:
        previous_config, warned = self._settings.config, self._settings.warnings
        self._settings.accept(parameters)
        for warning in self._settings.warnings:
            if warning not in warned:
                self._node.get_logger().warning(warning)
        config, loop = self._settings.config, self._driving.loop
        if config == previous_config:
            return
        self._await(config)
        if self.commands is not None and config.cmd_vel_type != previous_config.cmd_vel_type:
            self.commands.choose(config.cmd_vel_type)
        if loop is not None:
            # When many robots follow one, do not wait for a cycle each.
            follows = config == replace(previous_config, real_time_factor=self._driving.factor)
            run = loop.post if follows else loop.call
            try:
                run(lambda: self._configure(loop, config))
            except OneBotError as error:  # raised from this callback, it would end the process
                self._refuse("parameters", f"parameters not applied, {_GOES_ON}: {error}")
        if config.real_time_factor != self._driving.factor:
            self._driving.set_factor(config.real_time_factor)
        if replace(config, real_time_factor=previous_config.real_time_factor) != previous_config:
            self._sense_again()

    def _configure(self, loop: ControlLoop, config: ControlConfig) -> None:
        robot = loop.fleet.robots[self._row]
        robot.configure(config)
        loop.set_factor(config.real_time_factor)
        self.publishing.use(robot)


def _age(loop: ControlLoop, command: Command, given: float) -> float | None:
    """Return the age of a command, s, when it takes effect; None if it is not known.

    It includes the time that the command waits in this process.
    """
    if loop.simulated:
        return (loop.now_ns() - command.stamp) / NANO if command.stamp else None
    return boot_time() - given + (loop.left if command.stamp else 0.0)


class Requests:
    """Topics and services that move a robot and its odometry, and pause its world.

    The topics ~/teleport and ~/set_odometry and the services ~/reset and ~/reset_odometry apply to
    the robot, the services ~/pause and ~/step to its world.
    """

    def __init__(
        self, node: Node, loop: GetLoop, row: int, odom_frame: Callable[[], str] | None, warn: Warn
    ) -> None:
        """Subscribe, and offer the services.

        Args:
            node: of the robot.
            loop: returns the control loop, if there is one.
            row: index of the robot in its fleet.
            odom_frame: returns the frame of the odometry; None for a robot without odometry, which
                has no ~/set_odometry and ~/reset_odometry.
            warn: logs a warning, given a key and a text.
        """
        self._loop, self._row = loop, row
        self._odom_frame, self._warn = odom_frame or (lambda: ""), warn
        topics = [("teleport", self._teleport), ("set_odometry", self._place_odometry)]
        for topic, use in topics if odom_frame else topics[:1]:
            received = partial(self._on_pose, topic, use)
            node.create_subscription(PoseStamped, f"~/{topic}", received, _DEPTH)
        services: dict[str, Callable[[ControlLoop], object]] = {
            "reset": lambda loop: self._robot(loop).reset(),
            "step": ControlLoop.step,
        }
        if odom_frame:
            services["reset_odometry"] = lambda loop: self._robot(loop).place_odometry(PlanarPose())
        for service, action in services.items():
            node.create_service(Trigger, f"~/{service}", partial(self._on_trigger, action))
        node.create_service(SetBool, "~/pause", self._on_pause)

    def _robot(self, loop: ControlLoop) -> DrivenRobot:
        return loop.fleet.robots[self._row]

    def _on_pose(
        self,
        topic: str,
        use: Callable[[DrivenRobot, str, PlanarPose], None],
        message: PoseStamped,
    ) -> None:
        loop, pose = self._loop(), planar_pose(message)
        if loop is None:
            self._warn(topic, f"~/{topic} is ignored: there is no robot yet")
        elif not all(abs(value) <= _FARTHEST_POSE for value in pose):
            text = "the pose is not finite, too far away, or its orientation no unit quaternion"
            self._warn(topic, f"~/{topic} is ignored: {text}")
        else:
            try:
                loop.call(lambda: use(self._robot(loop), message.header.frame_id, pose))
            except (OneBotError, ValueError) as error:
                self._warn(topic, f"~/{topic} is ignored: {error}")

    def _teleport(self, robot: DrivenRobot, frame: str, pose: PlanarPose) -> None:
        world, odom = robot.world_frame, self._odom_frame()
        if frame == odom or not (frame or world):
            pose = robot.odom_in_world.compose(pose)
        elif frame not in ("", world):
            raise OneBotError(f'no frame "{frame}" here; write {world or odom} or {odom}')
        robot.teleport(pose)

    def _place_odometry(self, robot: DrivenRobot, frame: str, pose: PlanarPose) -> None:
        odom = self._odom_frame()
        if frame not in ("", odom):
            raise OneBotError(f'the odometry\'s frame is "{odom}", not "{frame}"')
        robot.place_odometry(pose)

    def _on_pause(self, request: SetBool.Request, answer: SetBool.Response) -> SetBool.Response:
        return self._on_trigger(lambda loop: loop.pause(request.data), request, answer)

    def _on_trigger(
        self,
        action: Callable[[ControlLoop], object],
        _: Trigger.Request | SetBool.Request,
        answer: Trigger.Response | SetBool.Response,
    ) -> Trigger.Response | SetBool.Response:
        loop = self._loop()
        try:
            if loop is None:
                raise OneBotError("there is no robot yet")
            loop.call(lambda: action(loop))
            answer.success = True
        except OneBotError as error:
            answer.success, answer.message = False, str(error)
        return answer


def planar_pose(message: PoseStamped) -> PlanarPose:
    """Return a pose seen from above; yaw is NaN if the quaternion is not of unit length."""
    p, q = message.pose.position, message.pose.orientation
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    yaw = yaw_of(q.x, q.y, q.z, q.w) if 0.98 < norm < 1.02 else math.nan
    return PlanarPose(p.x, p.y, yaw)
