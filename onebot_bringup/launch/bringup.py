"""Brings up a robot from a command line: checks the arguments, then starts a process a node."""

import errno
import os
import re
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from onebot_bringup.launch.arguments import (
    Argument,
    Arguments,
    UsageError,
    checked_values,
    description_arguments,
    refuse_positional,
    simulation_arguments,
    split,
    table,
    take_package_path,
    unknown,
)
from onebot_bringup.launch.nodes import NodeFactory, output_path
from onebot_bringup.launcher.console import wants_colour
from onebot_bringup.launcher.launcher import Launcher
from onebot_bringup.launcher.process import NodeProcess
from onebot_control.poses import prefixed
from onebot_description.discovery import discovery_variables
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.shared_memory import remove_stale_in_background
from onebot_description.signals import KeyboardInterrupts

if TYPE_CHECKING:
    from onebot_bringup.launch.robots import PlacedRobot
    from onebot_description.description import Description


# Parameters of the controller that name the frames, and those that concern all nodes.
_FRAME_PREFIX = ("tf_frame_prefix_enable", "tf_frame_prefix")
_OF_ALL_NODES = (*_FRAME_PREFIX, "use_sim_time", "robot_description")
_TURNING = ("continuous", "revolute")  # kinds of joints
_LONG = 100_000  # bytes of a parameter file
_COMMENT = re.compile(rb"(?:^|(?<=\s))#.*", re.MULTILINE)  # in YAML


class ModelArguments(NamedTuple):
    """The arguments of a model's xacro."""

    arguments: list[Argument]
    complete: bool  # all that the model includes was found; if not, there may be more


class Bringup(NamedTuple):
    """A bringup command, and its defaults."""

    program: str  # the command's name
    summary: str  # what it does, for --help
    model: str = ""  # URDF or xacro file of the robot
    joints: str = ""  # parameters of joint_state_publisher; empty: joints swing within their limits
    view: str = ""  # the viewer's settings; empty: the viewer's own
    world_view: str = ""  # likewise, for a robot in a world
    control: str = ""  # parameters of the controller; empty: the robot cannot be simulated
    takes_file: bool = False  # the model is the command's first word instead

    def arguments(self) -> list[Argument]:
        """Return its arguments, whatever the model."""
        declared = description_arguments(self.model, self.joints, self.view)
        return declared + simulation_arguments(self.control) if self.control else declared

    def model_arguments(self, given: Mapping[str, str]) -> "ModelArguments":
        """Return those of the model, but what has the name of one of the command's own.

        Args:
            given: on the command line; ``package_path`` is used from now on.
        """
        from onebot_description.description.xacro import xacro_arguments

        take_package_path(given)  # the model's includes may need it
        found = xacro_arguments(given.get("model", self.model))
        own = {argument.name for argument in self.arguments()}
        visible = [Argument(*each) for each in found.arguments if each.name not in own]
        return ModelArguments(visible, found.complete)


def bring_up(command: Bringup, argv: Sequence[str]) -> int:
    """Bring a robot up, with the launch arguments in ``argv``, until Ctrl-C.

    No node is started before the description and all arguments have been found right.

    Returns:
        The exit code: 0 when stopped by the user, 1 when a node that matters has failed.

    Raises:
        UsageError: the command line is wrong.
        OneBotError: a file is.
    """
    from onebot_description.description import load_description
    from onebot_description.description.loading import load_sensors
    from onebot_description.description.places import PLACES, keep_places
    from onebot_description.description.worlds import load_world
    from onebot_description.description_files import Source

    arguments = split(argv)
    given = _with_model(command, arguments)
    declared, of_model = command.arguments(), command.model_arguments(given)
    model = given.get("model", command.model)
    if arguments.help or arguments.show:
        print(help_text(command, declared, of_model.arguments, complete=arguments.help))
        return 0
    if not model:
        raise UsageError(f"{command.program} needs a file, a URDF or xacro")
    own, for_xacro = _divide(given, declared, of_model)
    values = checked_values(declared, own)
    find_spec("rclpy")  # one error here if it is missing, rather than one of each node
    # No matrix of a node is large enough for threads; without them xacro can run in a fork here.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _check_files(values, own)
    values = with_params_file(values, own)
    read_ns = time.time_ns()
    description = load_description(model, for_xacro)
    description.require_tree()
    robots = _placed(values.get("robots", ""), description)
    if values.get("sim") == "true":
        _check_sections(values, own, robots)
        if not robots:
            check_wheels(description, values)
    if values.get("world"):
        values["world"] = load_world(values["world"]).source  # checked
        values["view"] = own.get("view", command.world_view)
    if values.get("sensors"):  # likewise
        values["sensors"] = str(load_sensors(values["sensors"], description.link_names).files[0])
    source = Source(model, for_xacro, tuple(map(str, description.files)), read_ns)
    os.environ.update(environment(values, forced="discovery" in own))
    with (
        KeyboardInterrupts(),  # which leave no folder and no process behind
        tempfile.TemporaryDirectory(prefix="onebot-") as folder,
        Launcher(command.program) as launcher,
    ):
        remove_stale_in_background()
        os.environ[PLACES] = folder
        for each in (description, *(robot.description for robot in robots)):
            keep_places(each)
        make = NodeFactory(Path(folder), values, description, arguments.ros_args, source, robots)
        return launcher.run(
            nodes_to_start(make),
            started_message=summary_text(description, values, robots),
            temporary=[Path(folder)],
        )


def _placed(robots: str, description: "Description") -> list["PlacedRobot"]:
    """Return the robots of ``robots:=``; none where there is a single one, without the argument."""
    if not robots:
        return []
    from onebot_bringup.launch.robots import placed_robots  # few need it, and numpy

    return placed_robots(robots, description)


def nodes_to_start(make: NodeFactory) -> list[NodeProcess]:
    """Return the nodes to start, the first one first."""
    values = make.values
    # The recorder first, so that it misses as little of the others as can be.
    nodes = [make.bag_recorder()] if values["record"] else []
    if values.get("sim") == "true":
        nodes.append(make.velocity_controller())
    nodes.append(make.robot_state_publisher())
    if _moves_joints(values):
        nodes.append(make.joint_state_publisher())
    if values["viewer"] != "none" or values["save"]:
        nodes.append(make.rerun_viewer())
    if make.steered:
        nodes.append(make.steering_page())
    return nodes


def _moves_joints(values: Mapping[str, str]) -> bool:
    """Whether joint_state_publisher is what moves the joints."""
    return values.get("sim") != "true" and values["joint_states"] == "true"


def _with_model(command: Bringup, arguments: Arguments) -> dict[str, str]:
    """Return the arguments given, the command's file among them as ``model``."""
    if not command.takes_file:
        refuse_positional(arguments.positional)
        return dict(arguments.given)
    refuse_positional(arguments.positional[1:])
    if arguments.positional and "model" in arguments.given:
        raise UsageError(f"write the file or model:=, not both, for {command.program}")
    return {**dict(zip(["model"], arguments.positional, strict=False)), **arguments.given}


def _divide(
    given: Mapping[str, str], declared: list[Argument], of_model: ModelArguments
) -> tuple[dict[str, str], dict[str, str]]:
    """Sort the arguments given into those of the launcher and those of the model's xacro."""
    ours = {argument.name for argument in declared}
    known = [*ours, *(argument.name for argument in of_model.arguments)]
    problems = [unknown(name, known) for name in given if name not in known]
    if problems and of_model.complete:  # else expanding it shows whether they exist
        raise UsageError("\n".join(problems))
    own = {name: value for name, value in given.items() if name in ours}
    return own, {name: value for name, value in given.items() if name not in ours}


def _check_files(values: Mapping[str, str], given: Mapping[str, str]) -> None:
    """Refuse files that do not exist, or are wrong, before anything starts.

    Args:
        values: of the launch arguments.
        given: those on the command line.
    """
    for name in ("joints", "view", "params_file"):
        path = Path(values.get(name, ""))
        nothing = name == "view" and values[name] == "none"
        if values.get(name) and not nothing and not path.is_file():
            there = [entry.name for entry in path.parent.glob("*.y*ml")]
            raise OneBotError(
                f"{name}:={path}: no such file{did_you_mean(path.name, there, 'there')}"
            )
    if values["joints"] and (_moves_joints(values) or "joints" in given):
        _check_joints(Path(values["joints"]), values["namespace"].strip("/"))
    _check_outputs(values)


def _check_outputs(values: Mapping[str, str]) -> None:
    """Refuse recordings that could not be written."""
    for name in ("save", "record"):
        path = output_path(values[name])
        if values[name] and not path.parent.is_dir():
            raise OneBotError(f"{name}:={values[name]}: the folder {path.parent} does not exist")
    if values["save"] and output_path(values["save"]).suffix != ".rrd":
        raise OneBotError(f"save:={values['save']}: a recording's name must end in .rrd")
    if values["record"] and output_path(values["record"]).exists():
        raise OneBotError(f"record:={values['record']} exists already: name a new folder")
    for name, make in (("save", _make_file), ("record", _make_folder)):
        try:
            if values[name]:
                make(output_path(values[name]))
        except OSError as error:
            raise OneBotError(f"{name}:={values[name]}: {error.strerror}") from error


def _make_file(path: Path) -> None:
    """Open a file to be written, and leave things as they were."""
    _check_space(path.parent)
    is_new = not os.path.lexists(path)
    path.open("ab").close()
    if is_new:
        path.unlink()


def _make_folder(path: Path) -> None:
    """Make a folder that is to be made later, and remove it again."""
    _check_space(path.parent)
    path.mkdir()
    path.rmdir()


def _check_space(folder: Path) -> None:
    space = os.statvfs(folder)
    if space.f_blocks and not space.f_bavail:  # a file system without blocks reports none
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _check_joints(file: Path, namespace: str) -> None:
    from onebot_description.joints.config import JointsConfig
    from onebot_description.parameters.files import read_files, refuse_other_sections
    from onebot_description.parameters.reader import ConfigError

    node = f"/{namespace}/joint_state_publisher" if namespace else "/joint_state_publisher"
    parameters = read_files([file], node, JointsConfig)
    try:
        JointsConfig.from_parameters(parameters.values)
    except ConfigError as error:
        raise error.located(parameters.places) from None
    refuse_other_sections(file, [node])


def _check_sections(
    values: Mapping[str, str], given: Mapping[str, str], robots: Sequence["PlacedRobot"]
) -> None:
    """Refuse parameter files that hold something for no controller that gets them."""
    space = values["namespace"].strip("/")
    names = [f"{space}/{robot.name}" for robot in robots] or [space]
    files = [(Path(values["params_file"]), names)] if "params_file" in given else []
    for robot, name in zip(robots, names, strict=False):
        files += [(robot.params_file, [name])] if robot.params_file else []
    for file, spaces in files:
        from onebot_control.parameters import BROADCASTER
        from onebot_description.parameters.files import refuse_other_sections

        nodes = ("velocity_controller", BROADCASTER, "controller_manager")
        own = [f"/{each.strip('/')}".rstrip("/") for each in spaces]
        refuse_other_sections(file, [f"{space}/{node}" for node in nodes for space in own])


def with_params_file(values: Mapping[str, str], given: Mapping[str, str]) -> dict[str, str]:
    """Return the launch arguments, with what the controller's ``params_file`` has for all nodes.

    They name the robot's frames alike, and take the time from the same clock. What the file has of
    these counts unless the command line gives it.

    Args:
        values: of the launch arguments.
        given: those on the command line.

    Raises:
        OneBotError: the file is wrong.
    """
    found = dict(values)
    if values.get("sim") != "true" or not _mentions(Path(values["params_file"]), _OF_ALL_NODES):
        return found
    from onebot_control.parameters import ControlConfig, read_control_files
    from onebot_description.parameters.reader import ConfigError, replaced

    space = "/" + values["namespace"].strip("/")
    written = read_control_files([Path(values["params_file"])], space, "velocity_controller")
    config, frames = ControlConfig(), [n for n in _FRAME_PREFIX if n in written.values]
    try:
        for name in frames:
            config = replaced(config, name, written.values[name])
    except ConfigError as error:
        raise error.located(written.places) from None
    if frames and "frame_prefix" not in given and not values.get("robots"):
        enabled, prefix = config.tf_frame_prefix_enable, config.tf_frame_prefix
        found["frame_prefix"] = prefixed("", enabled, prefix, space)
    if "use_sim_time" not in given and written.values.get("use_sim_time") is True:
        found["use_sim_time"] = "true"
    if place := written.places.get("robot_description"):
        text = "robot_description is not used by a bringup; write model:=FILE"
        print(f"warning: {place}: {text}", file=sys.stderr)
    return found


def check_wheels(description: "Description", values: Mapping[str, str]) -> None:
    """Refuse a robot that cannot have wheels, or has not those that are named.

    Finding the wheels takes numpy, and reading meshes: that is left to the controller, except for
    an error that is certain without.

    Args:
        description: of the robot.
        values: of the launch arguments.

    Raises:
        OneBotError: naming the joints that there are.
    """
    left, right = (
        [each.strip() for each in values[side].split(",") if each.strip()]
        for side in ("left_wheel", "right_wheel")
    )
    turning = [joint.name for joint in description.joints if joint.kind in _TURNING]
    endless = [joint for joint in description.joints if joint.kind == "continuous"]
    if left or right:
        possible = {*left, *right} <= {*turning}
    else:
        possible = len(endless) > 1 or _mentions(Path(values["params_file"]), ("wheel_names",))
    if not possible:
        from onebot_control.wheels.geometry import Wheels

        Wheels(description, left, right)


def _mentions(file: Path, names: Sequence[str]) -> bool:
    """Whether a file may give one of ``names``; most give none, and reading YAML is slow."""
    try:
        with file.open("rb") as opened:
            text = opened.read(_LONG)
    except OSError as error:
        raise OneBotError(f"{file}: cannot be read: {error.strerror}") from None
    written = _COMMENT.sub(b"", text)
    return len(text) == _LONG or any(name.encode() in written for name in names)


def environment(values: Mapping[str, str], *, forced: bool) -> dict[str, str]:
    """Return the variables that all nodes get, in addition to this process's own.

    Args:
        values: of the launch arguments.
        forced: ``discovery`` was given, and so overrides the environment's setting.

    Raises:
        OneBotError: ``discovery`` names a host or a port that does not exist.
    """
    variables = discovery_variables(values, forced=forced)
    if "RCUTILS_CONSOLE_OUTPUT_FORMAT" not in os.environ:
        # The launcher puts the node's name in front of each line, but not which robot's it is.
        name = "[{name}] " if values.get("robots") else ""
        variables["RCUTILS_CONSOLE_OUTPUT_FORMAT"] = f"[{{severity}}] {name}{{message}}"
    if "RCUTILS_COLORIZED_OUTPUT" not in os.environ and wants_colour(2):
        variables["RCUTILS_COLORIZED_OUTPUT"] = "1"  # to the nodes, the pipe is no terminal
    return variables


def help_text(
    command: Bringup, declared: list[Argument], of_model: Sequence[Argument], *, complete: bool
) -> str:
    """Return the answer to ``--show-args``, or (``complete``) to ``--help``."""
    parts = []
    if complete:
        file = " FILE" if command.takes_file else ""
        parts.append(f"usage: {command.program}{file} [name:=value ...] [--ros-args ...]")
        parts.append(command.summary)
    parts.append(f"Arguments and their defaults:\n{table(declared)}")
    if of_model:
        parts.append(f"Arguments of the model:\n{table(of_model)}")
    if complete:
        parts.append(
            "An argument given twice: the last one counts. --ros-args goes to every node.\n"
            "Ctrl-C stops everything. Exit codes: 0 stopped by the user, 1 a file is wrong or a\n"
            "node failed, 2 the command line is wrong."
        )
    return "\n\n".join(parts)


def summary_text(
    description: "Description", values: Mapping[str, str], robots: Sequence["PlacedRobot"] = ()
) -> str:
    """Return what is running, where to find it and how to stop it."""
    space = f"/{values['namespace'].strip('/')}".rstrip("/")
    lines = _robots(robots, space) if robots else _robot(description, values, space)
    if values.get("world"):
        lines.insert(1, f"  world    {values['world']}")
    if values.get("steer") == "true":
        nobody = "" if values["sim"] == "true" else "; nothing simulated listens to it"
        lines.append(f"  steer    in the browser; steering_page prints its address{nobody}")
    lines.append(f"  viewer   {_viewer_hint(values)}")
    if values["record"]:
        lines.append(f"  record   all topics to {values['record']}")
    lines.append("  Ctrl-C stops everything")
    return "\n".join(lines)


def _robot(description: "Description", values: Mapping[str, str], space: str) -> list[str]:
    moving = [joint for joint in description.joints if joint.kind != "fixed"]
    lines = [
        f'Robot "{description.robot_name}": {len(description.links)} links, '
        f"{len(moving)} of {len(description.joints)} joints can move",
        f"  model    {values['model']}",
        f"  topics   /tf /tf_static {space}/robot_description {space}/joint_states",
    ]
    if values["frame_prefix"]:
        lines.append(f"  frames   begin with {values['frame_prefix']}")
    if values.get("sim") == "true":
        drive = f"{space}/velocity_controller/cmd_vel"
        lines.append(
            f"  drive    onebot teleop{f' {drive}' if space else ''}, or a Twist on {drive}"
        )
    elif values["joint_states"] == "true":
        lines.append(f"  joints   {values['joints'] or 'swing within their limits'}")
    else:
        lines.append(f"  joints   wait for {space}/joint_states")
    return lines


def _robots(robots: Sequence["PlacedRobot"], space: str) -> list[str]:
    first, last = robots[0].name, robots[-1].name
    drive = f"{space}/{first}/velocity_controller/cmd_vel"
    return [
        f"{len(robots)} robots in one world, {first} to {last}",
        f"  topics   /tf /tf_static, and in each robot's namespace, such as "
        f"{space}/{first}/joint_states",
        f"  frames   of each robot begin with its namespace, such as {f'{space}/'[1:]}{first}/odom",
        f"  drive    onebot teleop {f'{space}/'[1:]}{first}, or a Twist on {drive}",
    ]


def _viewer_hint(values: Mapping[str, str]) -> str:
    steered = values.get("steer") == "true"
    hints = {
        "web": "on that page" if steered else "in the browser; rerun_viewer prints its address",
        "native": "in a window of its own",
        "none": "none",
    }
    saved = f"; recorded to {values['save']}" if values["save"] else ""
    return hints[values["viewer"]] + saved
