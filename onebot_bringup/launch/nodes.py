"""The nodes of a launch, as processes to start: their arguments and parameters.

What is too long, or too delicate, for a command line comes from ROS parameter files.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from onebot_bringup.launcher.process import NodeProcess, OnExit, python_node
from onebot_control.poses import WORLD_FRAME

if TYPE_CHECKING:
    from onebot_bringup.launch.robots import PlacedRobot
    from onebot_description.description import Description
    from onebot_description.description_files import Source

# Where processors are short, the robot comes before what shows it (see nice(2)).
NICE_VIEWER = 5
# The address of the steering page is the one to open: it is printed when the page's view is there.
AWAIT_VIEW = 15.0  # s at most
# Of joint_state_publisher without a file: Hz, and seconds for one swing.
_SWINGING: Mapping[str, object] = {"rate": 30.0, "swing": 8.0}
# Launch arguments that are parameters of the controller.
_OF_CONTROLLER = {"x": "x", "y": "y", "yaw": "yaw", "rate": "update_rate"}
_WHEELS = {"left_wheel": "left_wheel_names", "right_wheel": "right_wheel_names"}


@dataclass(frozen=True)
class NodeFactory:
    """Makes the nodes of a bringup from the values of its launch arguments."""

    folder: Path  # where the nodes' parameter files are written
    values: Mapping[str, str]  # of the launch arguments
    description: Description  # of the robot
    ros_args: Sequence[str]  # for every node, after its own
    source: Source  # what the description was read from
    robots: Sequence[PlacedRobot] = ()  # in one world; none for a single one

    @property
    def steered(self) -> bool:
        """There is to be a page to steer from."""
        return self.values.get("steer") == "true"

    def robot_state_publisher(self) -> NodeProcess:
        """Return the node that publishes the robot's transforms; nothing works without it.

        Of several robots it is one process, of a node for each.
        """
        module = "onebot_description.robot_state_publisher"
        if self.robots:
            return self._of_robots("robot_state_publisher", module, NodeFactory._state_parameters)
        followed = self.values["reload"] == "true"
        words = ["--follow", self.source.to_json()] if followed else []
        return self._node("robot_state_publisher", module, self._state_parameters(), words)

    def _state_parameters(self) -> dict[str, object]:
        return {
            "robot_description": self.description.urdf,
            "frame_prefix": self.values["frame_prefix"],
            "publish_frequency": float(self.values["publish_frequency"]),
            "ignore_timestamp": self._flag("ignore_timestamp"),
        }

    def joint_state_publisher(self) -> NodeProcess:
        """Return the node that moves the joints, by the YAML file or else within their limits."""
        module = "onebot_description.joint_state_publisher"
        file = self.values["joints"]
        parameters = {"config_file": file} if file else _SWINGING
        return self._node("joint_state_publisher", module, parameters)

    def velocity_controller(self) -> NodeProcess:
        """Return the simulation with its controller, which drives the robot.

        Of several robots it is one process with one world, of a node for each.
        """
        name, module = "velocity_controller", "onebot_control.velocity_controller"
        files = [self._params_file]
        if self.robots:
            return self._of_robots(name, module, NodeFactory._drive_parameters, files)
        return self._node(name, module, self._drive_parameters(), files=files)

    @property
    def _params_file(self) -> Path:
        return Path(self.values["params_file"]).absolute()

    def _drive_parameters(self) -> dict[str, object]:
        # All nodes of the robot name its frames alike, in a namespace too.
        prefix = self.values["frame_prefix"]
        parameters: dict[str, object] = {
            # It would come on the topic, too, but only when robot_state_publisher is up.
            "robot_description": self.description.urdf,
            "tf_frame_prefix_enable": bool(prefix),
            "tf_frame_prefix": prefix,
        }
        for argument, name in _OF_CONTROLLER.items():
            if self.values[argument]:  # else as params_file has it
                parameters[name] = float(self.values[argument])
        for argument, name in _WHEELS.items():
            if self.values[argument]:
                parameters[name] = [each.strip() for each in self.values[argument].split(",")]
        if self.values["sensors"]:
            parameters["sensors"] = self.values["sensors"]
        if self.values["world"]:
            parameters["world"], parameters["world_frame_id"] = self.values["world"], WORLD_FRAME
        return parameters

    def rerun_viewer(self) -> NodeProcess:
        """Return the viewer, whose end stops nothing else."""
        parameters: dict[str, object] = {
            "viewer": self.values["viewer"],
            "save": self.values["save"],
            "view": self.values["view"],
            "fixed_frame": self._fixed_frame(),
            "frame_prefix": self.values["frame_prefix"],
            "embedded": self.steered,  # in the steering page
        }
        if self.robots:
            parameters["robots"] = [robot.name for robot in self.robots]
        module = "onebot_bringup.viewer.rerun_viewer"
        return self._node("rerun_viewer", module, parameters, on_exit="ignore", nice=NICE_VIEWER)

    def steering_page(self) -> NodeProcess:
        """Return the page to steer from; its crash does not affect the robot.

        Its port and its token are chosen here, so that open pages find it again after a crash.

        Raises:
            OneBotError: the page cannot be served where it should be.
        """
        from onebot_bringup.steering.access import choose_bind_address  # few need it

        bind_address = choose_bind_address(
            self.values["host"], int(self.values["port"]), self.values["token"]
        )
        if bind_address.warning:
            print(f"warning: {bind_address.warning}", file=sys.stderr)
        module = "onebot_bringup.steering.steering_page"
        parameters: dict[str, object] = dict(bind_address.parameters)
        if self.values["viewer"] == "web":
            parameters["await_view"] = AWAIT_VIEW
        if self.robots:
            parameters["topic"] = f"{self.robots[0].name}/velocity_controller/cmd_vel"
        return self._node("steering_page", module, parameters, on_exit="restart")

    def bag_recorder(self) -> NodeProcess:
        """Return the recorder, whose end stops nothing else."""
        parameters = {"folder": str(output_path(self.values["record"]))}
        module = "onebot_bringup.bags.bag_recorder"
        return self._node("bag_recorder", module, parameters, on_exit="ignore")

    def _of_robots(
        self,
        name: str,
        module: str,
        parameters: Callable[[NodeFactory], dict[str, object]],
        files: Sequence[Path] = (),
    ) -> NodeProcess:
        """Return a process with a node for each robot, with ``parameters`` of its own."""
        words: list[str] = []
        for robot in self.robots:
            own = self._of_robot(robot)
            found = {**parameters(own), "use_sim_time": self._flag("use_sim_time")}
            more = [robot.params_file] if files and robot.params_file else []
            if files:
                frame = _world_frame([*files, *more], own.values["namespace"])
                found.setdefault("world_frame_id", frame)
            words += ["--robot", *own._nodes().ros_arguments(name, found, more)]
        return self._node(name, module, {}, words, files=files)

    def _of_robot(self, robot: PlacedRobot) -> NodeFactory:
        """Return what makes the nodes of one of several robots."""
        folder = self.folder / robot.name
        folder.mkdir(exist_ok=True)
        namespace = f"{self.values['namespace'].strip('/')}/{robot.name}".strip("/")
        values = {
            **self.values,
            **{name: repr(getattr(robot, name)) for name in ("x", "y", "yaw")},
            "namespace": namespace,
            "frame_prefix": f"{namespace}/",
            "log_level": "",  # of the process
        }
        return replace(self, folder=folder, values=values, description=robot.description, robots=())

    def _nodes(self) -> RosNodes:
        values = self.values
        return RosNodes(self.folder, values["namespace"], self.ros_args, values["log_level"])

    def _node(
        self,
        name: str,
        module: str,
        parameters: Mapping[str, object],
        words: Sequence[str] = (),
        on_exit: OnExit = "shutdown",
        files: Sequence[Path] = (),
        nice: int = 0,
    ) -> NodeProcess:
        return self._nodes().node(
            name,
            module,
            {**parameters, "use_sim_time": self._flag("use_sim_time")},
            words=words,
            on_exit=on_exit,
            files=files,
            nice=nice,
        )

    def _fixed_frame(self) -> str:
        """The frame asked for; a robot that is not simulated, but could be, has no odom."""
        if not self.values["fixed_frame"] and self.values.get("sim") == "false":
            return self.values["frame_prefix"] + self.description.root_link
        return self.values["fixed_frame"]

    def _flag(self, name: str) -> bool:
        return self.values[name] == "true"


def output_path(text: str) -> Path:
    """Return the path of a file or folder to write; shells leave the ~ of ``name:=~/x`` to us."""
    return Path(text).expanduser().absolute()


@dataclass(frozen=True)
class RosNodes:
    """What the nodes of one launch share."""

    folder: Path  # where the nodes' parameter files are written
    namespace: str  # of all nodes; outer slashes do not matter
    ros_args: Sequence[str] = ()  # for every node, after its own
    log_level: str = ""  # the least severe messages shown; empty for the node's default

    def node(
        self,
        name: str,
        module: str,
        parameters: Mapping[str, object],
        *,
        words: Sequence[str] = (),
        on_exit: OnExit = "shutdown",
        files: Sequence[Path] = (),
        renamed: bool = False,
        nice: int = 0,
    ) -> NodeProcess:
        """Return a node to start, and write its parameters.

        Args:
            name: of the node.
            module: that it is run from.
            parameters: of its own; as for ``write_parameters``.
            words: before its ROS arguments.
            on_exit: what happens when it ends although nobody asked it to.
            files: further parameter files; ``parameters`` override them.
            renamed: its module calls it otherwise. Not for a module with several nodes, which
                would all get the name.
            nice: as ``NodeProcess.nice``.
        """
        own = self.ros_arguments(name, parameters, files, renamed=renamed)
        arguments = [*words, "--ros-args", *own]
        return python_node(name, module, arguments, on_exit=on_exit, nice=nice)

    def ros_arguments(
        self,
        name: str,
        parameters: Mapping[str, object],
        files: Sequence[Path] = (),
        *,
        renamed: bool = False,
    ) -> list[str]:
        """Return a node's ROS arguments, and write its parameters; see ``node``."""
        namespace = self.namespace.strip("/")
        file = write_parameters(self.folder, name, parameters, namespace)
        ros_args = ["--log-level", self.log_level] if self.log_level else []
        for each in (*files, file):  # the later one overrides
            ros_args += ["--params-file", str(each)]
        if renamed:
            ros_args += ["-r", f"__node:={name}"]
        if namespace:
            ros_args += ["-r", f"__ns:=/{namespace}"]
        return [*ros_args, *self.ros_args]


def _world_frame(files: Sequence[Path], namespace: str) -> str:
    """Return the frame that all robots of a world have in common, world unless ``files`` name one.

    Raises:
        OneBotError: a file is wrong.
    """
    from onebot_control.parameters import read_control_files

    found = read_control_files(files, f"/{namespace}", "velocity_controller")
    return str(found.values.get("world_frame_id") or WORLD_FRAME)


def write_parameters(
    folder: Path, node: str, parameters: Mapping[str, object], namespace: str = ""
) -> Path:
    """Write ``<folder>/<node>.yaml`` and return its path.

    Args:
        folder: an existing folder.
        node: name of the node.
        parameters: names to values (bool, int, float, str, list of str), or to nested maps of such.
        namespace: of the node, without outer slashes.
    """
    full_name = f"/{namespace}/{node}" if namespace else f"/{node}"
    path = folder / f"{node}.yaml"
    lines = [f"{_text(full_name)}:", "  ros__parameters:", *_lines(parameters, "    ")]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


def _lines(parameters: Mapping[str, object], indent: str) -> list[str]:
    lines = []
    for name, value in parameters.items():
        if isinstance(value, Mapping):
            lines += [f"{indent}{_text(name)}:", *_lines(value, indent + "  ")]
        else:
            lines.append(f"{indent}{_text(name)}: {_scalar(value)}")
    return lines


def _scalar(value: object) -> str:
    """Write a value so that ROS reads the same type: doubles always with a decimal point."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return f"{value:.9f}"
    if isinstance(value, list):
        return f"[{', '.join(map(_scalar, value))}]"
    return _text(str(value))


def _text(value: str) -> str:
    """Return ``value`` as a double-quoted YAML scalar in ASCII (YAML 1.1, section 5.7)."""
    return '"' + "".join(_character(character) for character in value) + '"'


def _character(character: str) -> str:
    if character in '"\\':
        return "\\" + character
    if character == "\n":
        return "\\n"
    code = ord(character)
    if 0x20 <= code < 0x7F:
        return character
    return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"
