"""The ROS interface of a world: the nodes of its robots, and the control loop that moves them."""

import gc
import logging
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_control.control_files import ControlFiles
from onebot_control.controlled_robot import Snapshot
from onebot_control.drive.parameters import DriveParameters
from onebot_control.drive_kinds import found_drive
from onebot_control.fleet import Fleet
from onebot_control.nodes.control_parameters import ControlParameters
from onebot_control.nodes.foreign_localizer import LocalizerWatch
from onebot_control.nodes.publishing import ScenePublisher
from onebot_control.nodes.robot_interface import RobotInterface
from onebot_control.nodes.simulation_services import SimulationServices
from onebot_control.nodes.spinning import NodeThread
from onebot_control.physics.engine import logger as simulation_log
from onebot_control.physics.scene import load_scene
from onebot_control.runtime.control_loop import ControlLoop
from onebot_control.runtime.frames import RobotFrames
from onebot_control.runtime.pacing import Divider, Pace, PaceMeter
from onebot_control.runtime.sensing import Sensing, SensingThread
from onebot_control.sensing.sensors import Sensors
from onebot_control.simulation_parameters import DescriptionConfig, SimulationConfig
from onebot_description.description import Description, load_description, parse_description
from onebot_description.errors import listing, printable
from onebot_description.parameters.reader import read
from onebot_description.ros.command_line import RosArguments
from onebot_description.ros.node_parameters import declare
from onebot_description.ros.run_node import steady_timer
from onebot_description.ros.topic_qos import DEPTH

_POLL_PERIOD = 0.1  # s between polls for publishers of commands


class WorldInterface:
    """Runs the control loop for all robots of a world once every description is known.

    Each robot has its own node with commands, parameters and services. ~/pause and ~/step of any
    robot act on the whole world, and real_time_factor of any robot is set for all.

    Attributes:
        robots: the ROS interface of each robot.
        loop: the control loop; None until every robot is known.
        controller_nodes: the nodes of all joint controllers, to be spun by the caller of ``start``.
        simulated: whether stamps are simulated time.
        factor: the real_time_factor of all robots.
        scene: the scene around the robots; None on bare ground.
        seed: seed of the sensors' noise.
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
        """Offer topics, parameters and services; afterwards call ``start``.

        ``from_descriptions`` does both.

        Args:
            nodes: the node of each robot, in the robot's namespace.
            settings: the parameters of each node.
            scene: the scene around the robots; None on bare ground.
            simulated: whether stamps are simulated time.
            seed: seed of the sensors' noise.
        """
        self.loop: ControlLoop | None = None
        self.controller_nodes: list[Node] = []
        self._sensing: Sensing | None = None
        self._services: SimulationServices | None = None
        self._controllers_thread: NodeThread | None = None
        self._scene_publisher: ScenePublisher | None = None
        self._node = nodes[0]  # has the topics, services and log of the world
        self._failure: BaseException | None = None
        self._diagnostics = self._node.create_publisher(DiagnosticArray, "/diagnostics", DEPTH)
        simulation_log.handlers = [NodeLog(self._node)]
        self.simulated, self.scene, self.seed = simulated, scene, seed
        self.factor = settings[0].config.real_time_factor
        self.robots = [
            RobotInterface(self, row, node, settings[row]) for row, node in enumerate(nodes)
        ]
        self._localizers = LocalizerWatch(nodes, [robot.publishing for robot in self.robots])

    @classmethod
    def from_descriptions(
        cls,
        nodes: Sequence[Node],
        parameters: type[SimulationConfig],
        file: str | None,
        arguments: Sequence[RosArguments],
    ) -> "WorldInterface":
        """Return a WorldInterface that starts in real time when all descriptions are known.

        Args:
            nodes: the node of each robot, in the robot's namespace.
            parameters: dataclass of the nodes' parameters.
            file: URDF or xacro file; None to use each node's parameter or topic.
            arguments: the ROS arguments of each node.

        Raises:
            OneBotError: a parameter, the world or a given description is not valid.
        """
        described = [
            _described(file, node, node_arguments)
            for node, node_arguments in zip(nodes, arguments, strict=True)
        ]
        settings = [
            ControlParameters(node, node_arguments, _declared(parameters, description))
            for node, node_arguments, description in zip(nodes, arguments, described, strict=True)
        ]
        config = settings[0].config  # the first robot's config applies to the world
        simulated = nodes[0].get_parameter("use_sim_time").value or config.real_time_factor != 1.0
        interface = cls(nodes, settings, load_scene(config.world), simulated=bool(simulated))
        steady_timer(nodes[0], _POLL_PERIOD, interface.poll)
        try:
            # Last, as ``stop`` may be called at any time from here on and needs all attributes.
            for robot, description in zip(interface.robots, described, strict=True):
                robot.describe(description, follow=file is None)
        except BaseException:  # also Ctrl-C: Python aborts at exit if threads are running
            interface.stop()
            raise
        return interface

    def stop(self) -> None:
        """Stop the control loop, and with it the robots' motion."""
        for part in (self.loop, self._services, self._controllers_thread, self._sensing):
            if part is not None:
                part.stop()

    def start_described(self) -> None:
        """Start the control loop if the descriptions of all robots are known."""
        if any(robot.description is None for robot in self.robots):
            return
        fleet = self._fleet()
        # In real time, late measurements are dropped; else the loop waits for them.
        sensing = SensingThread(
            Sensors(self.scene, fleet.rate, fleet.world.settings.gravity),
            self._node.get_logger().warning,
            self._fail,
            lambda: self.simulated and self.factor != 1.0,
        )
        loop = ControlLoop(
            fleet,
            self.publish,
            simulated=self.simulated,
            meter=PaceMeter(self._report_pace),
            measured=sensing.flush,
            missing=self._missing,
            failed=self._fail,
        )
        # Exclude long-lived objects from garbage collection.
        gc.freeze()
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # results are sent while paused, too
        self.start(loop, sensing, steady)
        if self.controller_nodes:
            self._controllers_thread = NodeThread(self.controller_nodes, "controllers", self._fail)
        # After the start, because rclpy's first log call takes 20 ms.
        warnings = [*self.scene.notices] if self.scene else []
        warnings += [warning for robot in self.robots for warning in robot.warnings]
        foreign = [robot.settings.foreign_sections for robot in self.robots]
        warnings += [
            text for key, text in foreign[0].items() if all(key in sections for sections in foreign)
        ]
        for warning in dict.fromkeys(warnings):
            self._node.get_logger().warning(warning)
        self._node.get_logger().info(_moved_text(fleet))
        self._services = SimulationServices(self._node, loop, self.restart, self._fail)

    def _fleet(self) -> Fleet:
        """Return the robots, whose descriptions are known, in a new world."""
        several = len(self.robots) > 1
        members = [robot.member(robot.name if several else "") for robot in self.robots]
        for robot, member in zip(self.robots, members, strict=True):
            with member.located():
                self.check_frames(robot.slot.row, robot.frames())
        return Fleet.from_members(members, scene=self.scene)

    def check_frames(self, row: int, frames: RobotFrames) -> None:
        """Check new frames of the robot in ``row``; all descriptions must be known.

        Raises:
            ConfigError: see ``RobotFrames.check``.
        """
        robot = self.robots[row]
        other_frames = {item.name: item.frames() for item in self.robots if item is not robot}
        frames.check(robot.frames(), other_frames, self.scene)

    def start(self, loop: ControlLoop, sensing: Sensing, clock: Clock | None = None) -> None:
        """Start a loop that moves the robots, whose descriptions must be known.

        Args:
            loop: the control loop.
            sensing: simulates the robots' sensors.
            clock: clock of the actions' timers; None for each node's own clock.
        """
        self._sensing, fleet = sensing, loop.fleet
        for interface, robot in zip(self.robots, fleet.robots, strict=True):
            interface.prepare(robot, sensing)
        if fleet.world.scene is not None:
            first = fleet.robots[0]
            rate = Divider(first.config.publish_rate, first.config.update_rate)
            self._scene_publisher = ScenePublisher(
                self._node, fleet.world.scene, first.world_frame, rate
            )
        sensing.start()
        self.loop = loop
        for interface in self.robots:
            self.controller_nodes += interface.control_joints(loop, clock)
        loop.start()
        self.set_factor(self.factor)  # the first robot's factor

    def set_factor(self, factor: float) -> None:
        """Set the real_time_factor of all robots."""
        self.factor = factor
        for robot in self.robots:
            if robot.settings.config.real_time_factor != factor:
                robot.node.set_parameters([Parameter("real_time_factor", value=factor)])

    def restart(self) -> None:
        """Reset the world to the start, including simulated time; call it in the control thread."""
        assert self.loop is not None and self._sensing is not None
        self.loop.fleet.restart()
        self._sensing.restart(self.seed)
        for robot in self.robots:
            robot.restart()

    def _missing(self) -> str:
        """Return what a step must wait for, as the start of a sentence; "" for nothing."""
        return next(filter(None, (robot.missing() for robot in self.robots)), "")

    def publish(self, snapshots: Sequence[Snapshot], stamp: int) -> None:
        """Publish the robots' states in a control cycle, and make due measurements.

        Args:
            snapshots: snapshots of the robots.
            stamp: stamp of the cycle, ns.
        """
        sensing, world = self._sensing, self.loop.fleet.world if self.loop else None
        assert sensing is not None and world is not None
        sensed = sensing.due(snapshots[0].tick)
        for row, (robot, snapshot) in enumerate(zip(self.robots, snapshots, strict=True)):
            robot.measured(sensing.asked(row), stamp)
            robot.publishing.publish(snapshot, stamp, sensed=row in sensed)
            robot.publish_controllers(stamp)
        poses = world.scene.poses if world.scene else ()
        if self._scene_publisher is not None:
            self._scene_publisher.publish(stamp, poses)
        sensing.take(stamp, snapshots, poses, lambda row: world.contacts.contacts(row))

    def poll(self) -> None:
        """Look for publishers of commands and localizers; call it several times per second.

        It raises the error that ended a thread of the simulation.
        """
        if self._failure is not None:
            raise self._failure
        for robot in self.robots:
            robot.poll()
        if self.loop is not None:
            self._localizers.poll()

    def _report_pace(self, pace: Pace, is_slow: bool, line: str) -> None:
        """Publish the pace of the last second, and log a line; see ``PaceMeter``."""
        values = {"real_time_factor": f"{pace.factor:.3f}", "missed control cycles": pace.missed}
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if is_slow else DiagnosticStatus.OK,
            name=f"{self._node.get_fully_qualified_name()[1:]}: real-time factor",
            message=str(pace),
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(message)
        if line and is_slow:  # rclpy allows only one severity per line of code
            self._node.get_logger().warning(line)
        elif line:
            self._node.get_logger().info(line)

    def _fail(self, error: BaseException) -> None:
        self._failure = self._failure or error  # later ones are consequences


class NodeLog(logging.Handler):
    """A logging handler that passes the simulation's warnings to a node's logger."""

    def __init__(self, node: Node) -> None:
        """Pass on warnings and errors."""
        super().__init__(logging.WARNING)
        self._logger = node.get_logger()

    def emit(self, record: logging.LogRecord) -> None:
        self._logger.warning(record.getMessage())


def _described(file: str | None, node: Node, arguments: RosArguments) -> Description | None:
    """Return the description from a file or a node's parameters; None if it comes from a topic."""
    if file is not None:
        return load_description(file)
    key, name = "robot_description", node.get_name()
    values = ControlFiles(arguments.files, node.get_namespace(), name).parameters().values
    written = {key: values[key]} if key in values.keys() - arguments.names_for(name) else {}
    text = read(
        DescriptionConfig, declare(node, DescriptionConfig, fixed=written)
    ).robot_description
    return parse_description(text, key) if text else None


def _declared(
    parameters: type[SimulationConfig], description: Description | None
) -> type[SimulationConfig]:
    """Return the parameters of a robot's node, for the drive in its description."""
    if description is None or not issubclass(parameters, DriveParameters):
        return parameters
    return found_drive(description)


def _moved_text(fleet: Fleet) -> str:
    """Return a log line about the moved robots and joints."""
    if len(fleet.robots) > 1:
        return f"driving {len(fleet.robots)} robots in one world"
    robot, parts = fleet.robots[0], []
    if robot.drive is not None:
        parts.append(str(robot.drive.geometry))
    for name, follower in robot.followers.items():
        parts.append(f"{name} moves {listing(follower.names)}")
    verb = "driving" if robot.drive is not None else "moving"
    moved = "; ".join(parts) or "no joint moves"
    return f'{verb} robot "{printable(robot.description.robot_name)}": {moved}'
