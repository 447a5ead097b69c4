"""Brings up a robot from a command line: checks the arguments, then starts a process per node."""

import os
import sys
from collections.abc import Mapping, Sequence, Set
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from onebot_bringup.launch.arguments import (
    OF_MODEL,
    Argument,
    Arguments,
    checked_values,
    description_arguments,
    model_arguments,
    model_values,
    refuse_positional,
    require_file,
    simulation_arguments,
    split,
    standing_arguments,
    table,
    take_package_path,
    unknown,
    with_positional,
)
from onebot_bringup.launch.nodes import (
    Launch,
    command_topic,
    given_files,
    world_frame,
)
from onebot_bringup.launcher.console import wants_colour
from onebot_bringup.launcher.launcher import Launcher
from onebot_bringup.launcher.orphans import temporary_folder
from onebot_bringup.viewer.viewer_parameters import view_file
from onebot_control.conventions import DRIVE_CONTROLLER, MANAGER, prefixed
from onebot_description.atomic_write import refuse_unwritable
from onebot_description.errors import OneBotError, UsageError
from onebot_description.ros.discovery import discovery_variables
from onebot_description.ros.names import absolute
from onebot_description.ros.process_start import blas_variables
from onebot_description.ros.shared_memory import remove_stale_in_background
from onebot_description.ros.signals import KeyboardInterrupts

if TYPE_CHECKING:
    from onebot_bringup.launch.robots import PlacedRobot
    from onebot_description.description import Description


UP = "Ctrl-C stops everything"  # the last line that a bringup prints when it is up
# Parameters of the controller that determine the names of frames.
_FRAME_PREFIX = ("tf_frame_prefix_enable", "tf_frame_prefix")
_FACTOR = "real_time_factor"


class Bringup(NamedTuple):
    """A bringup command with its defaults."""

    program: str  # the command's name
    summary: str  # one sentence for --help
    model: str = ""  # URDF or xacro file of the robot
    joints: str = ""  # parameters of joint_state_publisher; empty: joints swing within their limits
    view: str = ""  # the viewer's settings; empty: the viewer's own
    world_view: str = ""  # likewise, for a robot in a world
    sim_view: str = ""  # likewise, for a robot that is simulated with a fixed base
    control: str = ""  # parameters of the controller; empty: its base is fixed
    takes_file: bool = False  # whether the model is the command's first word instead

    def arguments(self) -> list[Argument]:
        """Return the command's arguments, without those of the model."""
        declared = description_arguments(self.model, self.joints, self.view)
        declared += simulation_arguments(self.control) if self.control else standing_arguments()
        return declared

    def controller(self, params_file: str) -> str:
        """Return the name of the node with the simulation's parameters."""
        from onebot_control.control_files import drive_name

        return drive_name([Path(params_file)] if params_file else []) if self.control else MANAGER

    def model_arguments(self, given: Mapping[str, str]) -> tuple[list[Argument], bool]:
        """Return the model's xacro arguments; those that the command has, too, as ``model.NAME``.

        From now on, packages are also looked for in the given ``package_path``.

        Args:
            given: the arguments given on the command line.

        Returns:
            The arguments, and whether they are complete: every included file was found.
        """
        from onebot_description.description.xacro import xacro_arguments

        take_package_path(given)  # the model's includes may need it
        declared = xacro_arguments(given.get("model", self.model))
        names = {argument.name for argument in self.arguments()}
        return model_arguments(declared.arguments, names), declared.complete


def bring_up(command: Bringup, argv: Sequence[str]) -> int:
    """Bring a robot up, with the launch arguments in ``argv``, until Ctrl-C.

    No node is started before the description and all arguments have been checked.

    Returns:
        The exit code: 0 when stopped by the user, 1 when a node that matters has failed.
    """
    from onebot_description.description.loading import PLACES, keep_places
    from onebot_description.description_files import load_followed

    arguments = split(argv)
    assignments = _with_model(command, arguments)
    declared = command.arguments()
    model = assignments.get("model", command.model)
    if arguments.help or arguments.show:
        of_model, _ = command.model_arguments(assignments)
        print(help_text(command, declared, of_model, complete=arguments.help))
        return 0
    if not model:
        raise UsageError(f"{command.program} needs a file, a URDF or xacro")
    own_names = {argument.name for argument in declared}
    command_arguments = {name: value for name, value in assignments.items() if name in own_names}
    for_xacro = model_values(assignments, own_names)
    take_package_path(assignments)  # the model's includes may need it
    if for_xacro:
        _check_names(command, assignments, own_names)
    if not model.endswith(".urdf"):
        _warn_of_shadowed(command, assignments, command_arguments)
    values = checked_values(declared, command_arguments)
    find_spec("rclpy")  # if it is missing, one error here instead of one from each node
    os.environ.update(blas_variables())  # BLAS starts no threads, so xacro can run in a fork here
    _check_files(values)
    controller = command.controller(values["params_file"])
    values = with_params_file(values, command_arguments, controller)
    description, source = load_followed(model, for_xacro)
    description.require_tree()
    values = with_view(values, command_arguments, command, description.root_link, controller)
    robots: list[PlacedRobot] = []
    if values.get("robots"):
        from onebot_bringup.launch.robots import placed_robots  # seldom needed, imports numpy

        robots = placed_robots(values["robots"], description)
    _check_sections(values, command_arguments, robots, controller)
    os.environ.update(environment(values, forced="discovery" in command_arguments))
    with (
        KeyboardInterrupts(),  # Ctrl-C leaves no folder and no process behind
        temporary_folder("launch") as folder,
    ):
        remove_stale_in_background()
        os.environ[PLACES] = folder
        descriptions = (description, *(robot.description for robot in robots))
        for item in {item.urdf: item for item in descriptions}.values():
            keep_places(item)
        launch = Launch(
            Path(folder),
            values,
            description,
            arguments.ros_args,
            source,
            declared,
            robots,
            controller=controller,
        )
        summary = summary_text(description, values, robots, controller)
        return Launcher(command.program).run(launch.nodes(), started_message=summary)


def _with_model(command: Bringup, arguments: Arguments) -> dict[str, str]:
    """Return the given arguments, with the command's file as ``model``."""
    if command.takes_file:
        return with_positional(arguments, "model", "file", command.program)
    refuse_positional(arguments.positional)
    return dict(arguments.given)


def _check_names(command: Bringup, given: Mapping[str, str], own_names: Set[str]) -> None:
    """Reject arguments that neither the command nor its model has, if all of the model's are known.

    Otherwise an included file was not found, and expanding the model reports the unknown ones.
    """
    of_model, is_complete = command.model_arguments(given)
    names = [*own_names, *(argument.name for argument in of_model)]
    prefixed_names = {f"{OF_MODEL}{name}" for name in names}
    problems = [unknown(name, names) for name in given if name not in (*names, *prefixed_names)]
    if problems and is_complete:
        raise UsageError("\n".join(problems))


def _warn_of_shadowed(command: Bringup, given: Mapping[str, str], own: Mapping[str, str]) -> None:
    """Print which of the command's ``own`` arguments the model declares, too."""
    of_model = {argument.name for argument in command.model_arguments(given)[0]} if own else ()
    for name in own:
        other = f"{OF_MODEL}{name}"
        if name != "model" and other in of_model and other not in given:
            text = f"{name}:= is an argument of {command.program}; the model's is {other}:="
            print(f"warning: {text}", file=sys.stderr)


def _check_files(values: Mapping[str, str]) -> None:
    """Reject missing files, recordings that cannot be written, an invalid world or page address."""
    view_file(values["view"])
    for name in ("joints", "params_file"):
        if values.get(name):
            require_file(name, Path(values[name]))
    if values["save"] and Path(values["save"]).suffix != ".rrd":
        raise OneBotError(f"save:={values['save']}: a recording's name must end in .rrd")
    for name in ("save", "record"):
        if values[name]:
            try:
                refuse_unwritable(Path(values[name]).absolute(), folder=name == "record")
            except OSError as error:
                text = f"{name}:={values[name]} cannot be written: {error.strerror}"
                raise OneBotError(text) from None
    if values.get("world"):
        from onebot_description.description.loading import load_world

        load_world(values["world"])
    if values["steer"] == "true":
        from onebot_bringup.serving.ports import listen

        listen(values["host"], int(values["port"])).close()


def _check_sections(
    values: Mapping[str, str],
    given: Mapping[str, str],
    robots: Sequence["PlacedRobot"],
    controller: str,
) -> None:
    """Check the names of nodes and parameters in the given parameter files; print warnings."""
    from onebot_control.control_files import unknown_by_node
    from onebot_description.joints.config import JointsConfig
    from onebot_description.parameters.files import check_sections, undeclared_warnings
    from onebot_description.parameters.reader import unknown_parameters

    space = absolute(values["namespace"])
    spaces = [f"{space}/{robot.name}" for robot in robots] or [space]
    # Each file, and the namespaces of the nodes that get it.
    files = [(Path(values["params_file"]), spaces)] if given.get("params_file") else []
    for robot, name in zip(robots, spaces, strict=False):
        if robot.params_file:
            files.append((robot.params_file, [name]))
    nodes = unknown_by_node(controller, [file for file, _ in files], spaces)
    if given.get("joints"):  # then it is not simulated
        files = [(Path(values["joints"]), [space])]
        nodes = {"joint_state_publisher": partial(unknown_parameters, JointsConfig)}
        check_sections(files[0][0], [f"{space}/{node}" for node in nodes])
    warnings: dict[str, None] = {}  # each once, since robots may share a file
    for file, _ in files:
        warnings |= dict.fromkeys(undeclared_warnings(file, nodes.values()))
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)


def with_params_file(
    values: Mapping[str, str], given: Mapping[str, str], controller: str = DRIVE_CONTROLLER
) -> dict[str, str]:
    """Return the launch arguments, updated with settings for all nodes from the ``params_file``.

    All nodes have to agree on the names of frames and on the clock. The file's settings apply
    unless they are ``given`` on the command line.
    """
    values = dict(values)
    if values.get("sim") == "true":
        factor = _apply_params_file(values, given, controller) if values["params_file"] else 1.0
        if float(values[_FACTOR] or factor) != 1.0:
            values["use_sim_time"] = "true"  # the simulation then publishes /clock
    return values


def with_view(
    values: Mapping[str, str],
    given: Mapping[str, str],
    command: Bringup,
    root_link: str,
    controller: str = DRIVE_CONTROLLER,
) -> dict[str, str]:
    """Return the launch arguments with the command's view of what is brought up.

    A view that is ``given`` on the command line decides everything itself.
    """
    values = dict(values)
    if "view" in given:
        return values
    frame = ""
    if command.sim_view and values["sim"] == "true":
        values["view"] = command.sim_view
    elif values.get("world"):
        values["view"] = command.world_view
        frame = world_frame(values, given_files(values), controller)
    elif command.control and values["sim"] == "false":
        frame = values["frame_prefix"] + root_link  # there is no odom
    values["fixed_frame"] = values["fixed_frame"] or frame
    return values


def _apply_params_file(values: dict[str, str], given: Mapping[str, str], controller: str) -> float:
    """Update the launch arguments from the ``params_file``; return its real_time_factor."""
    from onebot_control.control_files import read_control_files
    from onebot_control.simulation_parameters import SimulationConfig
    from onebot_description.parameters.reader import read

    space = absolute(values["namespace"])
    written = read_control_files([Path(values["params_file"])], space, controller)
    names = {*_FRAME_PREFIX, _FACTOR} & written.values.keys()
    config = read(SimulationConfig, {name: written.values[name] for name in names}, written.places)
    if names - {_FACTOR} and "frame_prefix" not in given and not values.get("robots"):
        enabled, prefix = config.tf_frame_prefix_enable, config.tf_frame_prefix
        values["frame_prefix"] = prefixed("", enabled, prefix, space)
    if "use_sim_time" not in given and written.values.get("use_sim_time") is True:
        values["use_sim_time"] = "true"
    return config.real_time_factor


def environment(values: Mapping[str, str], *, forced: bool) -> dict[str, str]:
    """Return the environment variables of all nodes, in addition to this process's own.

    Args:
        values: the launch arguments.
        forced: ``discovery`` was given, so it overrides the environment's setting.
    """
    variables = discovery_variables(values, forced=forced)
    if "RCUTILS_CONSOLE_OUTPUT_FORMAT" not in os.environ:
        # The launcher prefixes each line with the node's name, but not with the robot's.
        name = "[{name}] " if values.get("robots") else ""
        variables["RCUTILS_CONSOLE_OUTPUT_FORMAT"] = f"[{{severity}}] {name}{{message}}"
    if "RCUTILS_COLORIZED_OUTPUT" not in os.environ and wants_colour(2):
        variables["RCUTILS_COLORIZED_OUTPUT"] = "1"  # the nodes see a pipe instead of a terminal
    return variables


def help_text(
    command: Bringup, declared: list[Argument], of_model: Sequence[Argument], *, complete: bool
) -> str:
    """Return the text of ``--show-args``, or with ``complete`` of ``--help``."""
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
            f"{command.program.split()[0]} --version shows the version.\n"
            "Ctrl-C stops everything. Exit codes: 0 stopped by the user, 1 a file is wrong or a\n"
            "node failed, 2 the command line is wrong."
        )
    return "\n\n".join(parts)


def summary_text(
    description: "Description",
    values: Mapping[str, str],
    robots: Sequence["PlacedRobot"] = (),
    controller: str = DRIVE_CONTROLLER,
) -> str:
    """Return what is running, where to find it and how to stop it."""
    space = absolute(values["namespace"])
    if robots:
        lines = _robots(robots, values, space, controller)
    else:
        lines = _robot(description, values, space, controller)
    return "\n".join([*lines, f"  {UP}"])


def _robot(
    description: "Description", values: Mapping[str, str], space: str, controller: str
) -> list[str]:
    moving = [joint for joint in description.joints if joint.kind != "fixed"]
    lines = [
        f'Robot "{description.robot_name}": {len(description.links)} links, '
        f"{len(moving)} of {len(description.joints)} joints can move",
        f"  model    {values['model']}",
        f"  topics   /tf /tf_static {space}/robot_description {space}/joint_states",
    ]
    if values["frame_prefix"]:
        lines.append(f"  frames   begin with {values['frame_prefix']}")
    if values.get("sim") == "true" and "robots" not in values:  # a standing robot
        joint = next((joint.name for joint in moving), "JOINT")
        lines.append(f"  move     onebot trajectory {joint}=0.5, or any client of its action")
    elif values.get("sim") == "true":
        drive = command_topic(values, f"{space}/", controller)
        lines.append(
            f"  drive    onebot teleop{f' {drive}' if space else ''}, or a Twist on {drive}"
        )
    elif values["joint_states"] == "true":
        lines.append(f"  joints   {values['joints'] or 'swing within their limits'}")
    else:
        lines.append(f"  joints   wait for {space}/joint_states")
    return lines


def _robots(
    robots: Sequence["PlacedRobot"], values: Mapping[str, str], space: str, controller: str
) -> list[str]:
    first, last = robots[0].name, robots[-1].name
    drive = command_topic(values, f"{space}/{first}/", controller)
    return [
        f"{len(robots)} robots in one world, {first} to {last}",
        f"  topics   /tf /tf_static, and in each robot's namespace, such as "
        f"{space}/{first}/joint_states",
        f"  frames   of each robot begin with its namespace, such as {f'{space}/'[1:]}{first}/odom",
        f"  drive    onebot teleop {f'{space}/'[1:]}{first}, or a Twist on {drive}",
    ]
