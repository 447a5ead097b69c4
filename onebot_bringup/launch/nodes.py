"""The nodes of a bringup in a table: when each starts, with which parameters and policy.

Nodes get their parameters in ROS parameter files, which allow any text of any length.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml

from onebot_bringup.launcher.process import NodeProcess, OnExit
from onebot_control.conventions import DRIVE_CONTROLLER, MANAGER, WORLD_FRAME
from onebot_description.ros.names import absolute

if TYPE_CHECKING:
    from onebot_bringup.launch.robots import PlacedRobot
    from onebot_bringup.launch.settings import BringupSettings
    from onebot_description.description import Description
    from onebot_description.description_files import Source

# The steering page is the page to open, so its address is printed once its view is available.
AWAIT_VIEW = 15.0  # s at most
_MAP = "map"  # the frame of localization (REP-105)
_NAV2_TOPICS = "cmd_vel", "odom"  # topics for which Nav2 has names
# Parameters of joint_state_publisher without a file: Hz, and seconds for one swing.
_SWINGING = {"rate": 30.0, "swing": 8.0}

Parameters = dict[str, object]


@dataclass(frozen=True)
class Launch:
    """Makes the nodes of a bringup, or of one of its robots."""

    settings: BringupSettings
    description: Description  # the robot
    source: Source  # the files of the description
    ros_args: Sequence[str] = ()  # every node gets them, after its own
    robots: Sequence[PlacedRobot] = ()  # several robots in one world; empty for a single one
    robot: PlacedRobot | None = None  # the robot to make nodes for, if there are several
    folder: Path = Path()  # folder of the nodes' parameter files

    @property
    def params_files(self) -> list[Path]:
        """The controller's parameter files; later ones override."""
        robot_file = self.robot.params_file if self.robot else None
        return [*given_files(self.settings.params_file), *filter(None, [robot_file])]

    def nodes(self) -> list[NodeProcess]:
        """Return the nodes to start, in order."""
        return [self.node(row) for row in NODES if row.starts(self)]

    def node(self, row: NodeRow) -> NodeProcess:
        """Return the process to start for a row.

        If there are several robots, a row with ``each_robot`` is one process with a node for each.
        """
        words, name = row.words(self), self._name(row)
        parameters: Parameters = {"use_sim_time": self.settings.use_sim_time}
        if self.robots and row.each_robot:
            for robot in self.robots:
                launch = self._of_robot(robot)
                node_parameters = launch.parameters(row) | parameters
                files = row.files(launch)[1:]
                name = launch._name(row)
                words += ["--robot", *launch.ros_nodes.arguments(name, node_parameters, files)]
            parameters = {}  # each robot's node has its own
        else:
            parameters |= self.parameters(row)
        files = row.files(self)
        return self.ros_nodes.process(row, parameters, words=words, files=files, name=name)

    def _name(self, row: NodeRow) -> str:
        """Return the name of a row's node, which a control file may give."""
        return self.settings.controller if row.node == DRIVE_CONTROLLER else row.node

    def parameters(self, row: NodeRow) -> Parameters:
        """Return the parameters of a node, from the arguments and from its row."""
        return self.settings.parameters(row.node) | row.parameters(self)

    @property
    def ros_nodes(self) -> RosNodes:
        """The settings that the nodes share."""
        settings = self.settings
        ros_args = [*self._remappings(), *self.ros_args]
        return RosNodes(self.folder, settings.namespace, ros_args, settings.log_level)

    def _remappings(self) -> list[str]:
        """Return the remappings of ``nav2_topics`` and of a drive's name, per namespace.

        Other nodes expect the topics of velocity_controller.
        """
        drive, targets = self.settings.drive, dict[str, str]()
        topics = {"cmd_vel": drive.command, "odom": drive.odometry, "ground_truth": "ground_truth"}
        for topic, name in topics.items():
            full = f"{drive.name}/{name}"
            is_nav2 = self.settings.nav2_topics and topic in _NAV2_TOPICS
            targets[f"{DRIVE_CONTROLLER}/{topic}"] = targets[full] = topic if is_nav2 else full
        of_robots = [f"{robot.name}/" for robot in self.robots if self.robot is None]
        return [
            word
            for space in of_robots or [""]
            for topic, target in targets.items()
            if topic != target and not self.settings.stands
            for word in ("-r", f"{space}{topic}:={space}{target}")
        ]

    def _of_robot(self, robot: PlacedRobot) -> Launch:
        """Return a Launch for one robot of the fleet."""
        from onebot_control.control_files import drive_node

        folder = self.folder / robot.name
        folder.mkdir(exist_ok=True)
        namespace = f"{absolute(self.settings.namespace)}/{robot.name}"[1:]
        launch = replace(self, folder=folder, description=robot.description, robot=robot)
        settings = replace(
            self.settings,
            x=robot.x,
            y=robot.y,
            yaw=robot.yaw,
            namespace=namespace,
            frame_prefix=f"{namespace}/",
            log_level="",  # it is set for the whole process
            drive=drive_node(launch.params_files),
        )
        return replace(launch, settings=settings)


class NodeRow(NamedTuple):
    """One row of the table: a node of a bringup."""

    name: str
    module: str  # its last word is the node's name, unless the node is renamed
    parameters: Callable[[Launch], Parameters]  # the parameters besides those from arguments
    starts: Callable[[Launch], bool] = lambda _: True
    on_exit: OnExit = "shutdown"
    nice: int = 0
    words: Callable[[Launch], list[str]] = lambda _: []  # words before its ROS arguments
    each_robot: bool = False  # whether each of several robots has such a node
    files: Callable[[Launch], list[Path]] = lambda _: []  # files of its parameters
    parameters_of: str = ""  # the node in the process with the parameters, if not ``name``

    @property
    def node(self) -> str:
        """The name of the node with the parameters."""
        return self.parameters_of or self.name


def _controller_parameters(launch: Launch) -> Parameters:
    settings = launch.settings
    # All nodes of the robot use the same names of frames, also in a namespace.
    prefix = settings.frame_prefix
    parameters: Parameters = {
        # It would also come on the topic, but only once robot_state_publisher is up.
        "robot_description": launch.description.urdf,
        "tf_frame_prefix_enable": bool(prefix),
        "tf_frame_prefix": prefix,
    }
    if settings.world or launch.robot:
        parameters["world_frame_id"] = world_frame(settings, launch.params_files)
    return parameters


def given_files(file: str | Path | None) -> list[Path]:
    """Return the file that a launch argument names, if any."""
    return [Path(file).absolute()] if file else []


def world_frame(settings: BringupSettings, params_files: Sequence[Path]) -> str:
    """Return the frame that all robots of a world have in common, unless a file names one.

    It is world, or if the ground truth is not on TF, map, so that TF is one tree.
    """
    written = settings.written(params_files).values
    on_tf = settings.ground_truth_tf
    if on_tf is None:
        on_tf = written.get("ground_truth_tf", True)
    return str(written.get("world_frame_id") or (WORLD_FRAME if on_tf is True else _MAP))


def _navigator_parameters(launch: Launch) -> Parameters:
    """Return where the robot starts, so that the map's frame is the world's."""
    settings = launch.settings
    written = settings.written(launch.params_files).values
    starts = {name: getattr(settings, name) for name in ("x", "y", "yaw")}
    return {
        f"initial_pose.{name}": float(written.get(name, 0.0) if start is None else start)
        for name, start in starts.items()
    }


def _state_parameters(launch: Launch) -> Parameters:
    return {
        "robot_description": launch.description.urdf,
        "frame_prefix": launch.settings.frame_prefix,
        # Made-up joint states say nothing about where the robot is.
        "hold_floating_joints": _makes_joint_states(launch),
    }


def _makes_joint_states(launch: Launch) -> bool:
    return launch.settings.joint_states and not launch.settings.sim


def _followed_files(launch: Launch) -> list[str]:
    followed = launch.settings.reload and not launch.robots
    return ["--follow", launch.source.to_json()] if followed else []


def _joint_parameters(launch: Launch) -> Parameters:
    rate = launch.settings.rate
    swinging = {} if launch.settings.joints else _SWINGING
    return {**swinging, "rate": rate} if rate else {**swinging}


def _viewer_parameters(launch: Launch) -> Parameters:
    parameters: Parameters = {
        "frame_prefix": launch.settings.frame_prefix,
        "embedded": launch.settings.steer,
    }
    if launch.robots:
        parameters["robots"] = [robot.name for robot in launch.robots]
    return parameters


def _page_parameters(launch: Launch) -> Parameters:
    parameters: Parameters = {}
    if launch.settings.viewer == "web":
        parameters["await_view"] = AWAIT_VIEW
    if launch.robots:
        space = f"{launch.robots[0].name}/"
        parameters["topic"] = command_topic(launch.settings, space)
    return parameters


def command_topic(settings: BringupSettings, space: str) -> str:
    """Return the command topic of the robot in a namespace; ``space`` ends with /."""
    drive = settings.drive
    return f"{space}cmd_vel" if settings.nav2_topics else f"{space}{drive.name}/{drive.command}"


NODES = (
    # The recorder comes first, so that it misses as little as possible of the others.
    NodeRow(
        "bag_recorder",
        "onebot_bringup.bags.bag_recorder",
        lambda launch: {"folder": launch.settings.record},
        starts=lambda launch: bool(launch.settings.record),
        on_exit="ignore",
    ),
    NodeRow(
        "velocity_controller",
        "onebot_control.velocity_controller",
        _controller_parameters,
        starts=lambda launch: launch.settings.sim and not launch.settings.stands,
        each_robot=True,
        files=lambda launch: launch.params_files,
    ),
    NodeRow(
        "joint_trajectory_controller",
        "onebot_control.joint_trajectory_controller",
        _controller_parameters,
        starts=lambda launch: launch.settings.sim and launch.settings.stands,
        files=lambda launch: launch.params_files,
        parameters_of=MANAGER,
    ),
    NodeRow(
        "robot_state_publisher",
        "onebot_description.robot_state_publisher",
        _state_parameters,
        words=_followed_files,
        each_robot=True,
    ),
    NodeRow(
        "joint_state_publisher",
        "onebot_description.joint_state_publisher",
        _joint_parameters,
        starts=_makes_joint_states,
        files=lambda launch: given_files(launch.settings.joints),
    ),
    NodeRow(
        "navigator",
        "onebot_control.navigator",
        _navigator_parameters,
        starts=lambda launch: launch.settings.navigate,
        on_exit="ignore",
        each_robot=True,
    ),
    VIEWER := NodeRow(
        "rerun_viewer",
        "onebot_bringup.viewer.rerun_viewer",
        _viewer_parameters,
        starts=lambda launch: launch.settings.viewer != "none" or bool(launch.settings.save),
        on_exit="ignore",
        nice=5,  # on a busy computer, the robot takes precedence over its view (see nice(2))
    ),
    STEERING_PAGE := NodeRow(
        "steering_page",
        "onebot_bringup.steering.steering_page",
        _page_parameters,
        starts=lambda launch: launch.settings.steer,
        on_exit="ignore",
    ),
)

BRINGUPS = {
    "onebot_bringup": "onebot_bringup.launch.onebot_bringup",
    "mrm_bringup": "mrm_description.launch.mrm_bringup",
}
"""The modules of the bringup commands, by name."""


@dataclass(frozen=True)
class RosNodes:
    """The settings that the nodes of one launch share."""

    folder: Path  # folder of the nodes' parameter files
    namespace: str  # the nodes' namespace, with or without outer slashes
    ros_args: Sequence[str] = ()  # every node gets them, after its own
    log_level: str = ""  # the least severe messages shown; empty for the node's default

    def process(
        self,
        row: NodeRow,
        parameters: Mapping[str, object],
        *,
        words: Sequence[str] = (),
        files: Sequence[Path] = (),
        name: str = "",
    ) -> NodeProcess:
        """Return a node to start, and write its parameter file.

        Args:
            row: the node.
            parameters: its parameters, which override ``files``.
            words: words before its ROS arguments.
            files: further parameter files.
            name: name of the node with the parameters; "" for the row's.
        """
        rename = [] if row.module.endswith(f".{row.name}") else ["-r", f"__node:={row.name}"]
        ros_arguments = [*rename, *self.arguments(name or row.node, parameters, files)]
        words = [*words, "--ros-args", *ros_arguments]
        return NodeProcess(row.name, row.module, words, row.on_exit, row.nice)

    def arguments(
        self, name: str, parameters: Mapping[str, object], files: Sequence[Path] = ()
    ) -> list[str]:
        """Return a node's ROS arguments, and write its parameter file; see ``process``."""
        namespace = absolute(self.namespace)
        arguments = ["--log-level", self.log_level] if self.log_level else []
        if parameters:
            files = *files, write_parameters(self.folder, name, parameters, namespace)
        for file in files:
            arguments += ["--params-file", str(file)]  # later ones override
        if namespace:
            arguments += ["-r", f"__ns:={namespace}"]
        return [*arguments, *self.ros_args]


class _Quoting(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Quotes every string: to ROS, a bare 10 is an integer, and a bare on is true."""


def _quoted(dumper: Any, text: str) -> Any:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"')


_Quoting.add_representer(str, _quoted)


def write_parameters(
    folder: Path, node: str, parameters: Mapping[str, object], namespace: str = ""
) -> Path:
    """Write the parameter file ``<folder>/<node>.yaml`` and return its path.

    Args:
        folder: the folder.
        node: the name of the node.
        parameters: the node's parameters.
        namespace: the node's namespace, with or without outer slashes.
    """
    path = folder / f"{node}.yaml"
    content = {f"{absolute(namespace)}/{node}": {"ros__parameters": dict(parameters)}}
    path.write_text(yaml.dump(content, Dumper=_Quoting), encoding="ascii")
    return path
