"""Brings up a robot from a command line: checks the arguments, then starts a process per node."""

import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from onebot_bringup.launch.arguments import (
    OF_MODEL,
    Argument,
    Arguments,
    DiscoverySettings,
    model_arguments,
    model_values,
    refuse_positional,
    require_file,
    split,
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
from onebot_bringup.launcher.console import wants_color
from onebot_bringup.launcher.launcher import Launcher
from onebot_bringup.launcher.orphans import temporary_folder
from onebot_bringup.viewer.viewer_parameters import view_file
from onebot_control.conventions import prefixed
from onebot_description.atomic_write import refuse_unwritable, writing
from onebot_description.errors import OneBotError, UsageError
from onebot_description.ros.names import absolute
from onebot_description.ros.process_start import blas_variables
from onebot_description.ros.shared_memory import remove_stale_in_background
from onebot_description.ros.signals import KeyboardInterrupts

if TYPE_CHECKING:
    from onebot_bringup.launch.robots import PlacedRobot
    from onebot_bringup.launch.settings import BringupSettings
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

    @property
    def settings_class(self) -> type["BringupSettings"]:
        """The class of the command's arguments."""
        from onebot_bringup.launch.settings import BringupSettings, StandingSettings

        return BringupSettings if self.control else StandingSettings

    @property
    def defaults(self) -> dict[str, str]:
        """The defaults that differ between commands."""
        files = {"model": self.model, "joints": self.joints, "view": self.view}
        return {**files, "params_file": self.control}

    def arguments(self) -> list[Argument]:
        """Return the command's arguments, without those of the model."""
        return self.settings_class.arguments(**self.defaults)

    def model_arguments(self, given: Mapping[str, str]) -> tuple[list[Argument], bool]:
        """Return the model's xacro arguments, as ``model.NAME`` if the command has the same name.

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
    arguments = split(argv)
    given_values = _with_model(command, arguments)
    if arguments.help or arguments.show:
        of_model, _ = command.model_arguments(given_values)
        print(help_text(command, command.arguments(), of_model, complete=arguments.help))
        return 0
    os.environ.update(blas_variables())  # BLAS starts no threads, so xacro can run in forks
    settings = read_settings(command, given_values)
    launch = read_robots(command, settings, model_values(given_values, settings.given))
    return run(command, replace(launch, ros_args=arguments.ros_args))


def read_settings(command: Bringup, given: Mapping[str, str]) -> "BringupSettings":
    """Return the command's own arguments, checked; print warnings.

    From now on, packages are also looked for in the given ``package_path``.

    Args:
        command: the command.
        given: the arguments given on the command line, including those of the model.

    Raises:
        OneBotError: an argument, or a file that it names, is wrong.
    """
    from onebot_bringup.launch.settings import checked_settings

    model = given.get("model", command.model)
    if not model:
        raise UsageError(f"{command.program} needs a file, a URDF or xacro")
    names = {argument.name for argument in command.arguments()}
    own_values = {name: value for name, value in given.items() if name in names}
    take_package_path(given)  # the model's includes may need it
    if len(own_values) < len(given):
        _check_names(command, given, names)
    settings = checked_settings(command.settings_class, own_values, **command.defaults)
    find_spec("rclpy")  # if it is missing, one error here instead of one from each node
    _check_files(settings)
    return with_params_file(settings)


def read_robots(
    command: Bringup, settings: "BringupSettings", for_model: Mapping[str, str]
) -> Launch:
    """Read the robot, or all of them, and what depends on them; print warnings.

    Args:
        command: the command.
        settings: its arguments.
        for_model: the model's xacro arguments.

    Raises:
        OneBotError: a description, or a file of robots or parameters, is wrong.
    """
    from onebot_description.description_files import load_followed

    description, source = load_followed(settings.model, for_model)
    description.require_tree()
    settings = with_view(settings, command, description.root_link)
    if settings.navigate and settings.sim and not settings.sensors:
        _require_lidar(description)
    robots: list[PlacedRobot] = []
    if settings.robots:
        from onebot_bringup.launch.robots import placed_robots  # seldom needed, imports numpy

        robots = placed_robots(settings.robots, description)
    _check_sections(settings, description, robots)
    return Launch(settings, description, source, robots=robots)


def _require_lidar(description: "Description") -> None:
    from onebot_description.description.sensors.lidar import Lidar

    if not any(isinstance(sensor.model, Lidar) for sensor in description.sensors):
        raise UsageError(
            "navigate:=true needs a lidar, and the robot has none (OneBot has one with "
            "sensors_enabled:=true; sensors:=FILE adds those of another file)"
        )


def run(command: Bringup, launch: Launch) -> int:
    """Start the nodes, and return the exit code when they have ended."""
    from onebot_description.description.loading import PLACES, keep_places

    os.environ.update(environment(launch.settings, several=bool(launch.robots)))
    with (
        KeyboardInterrupts(),  # Ctrl-C leaves no folder and no process behind
        temporary_folder("launch") as folder,
    ):
        remove_stale_in_background()
        os.environ[PLACES] = folder
        descriptions = (launch.description, *(robot.description for robot in launch.robots))
        for item in {item.urdf: item for item in descriptions}.values():
            keep_places(item)
        nodes = replace(launch, folder=Path(folder)).nodes()
        return Launcher(command.program).run(nodes, started_message=summary_text(launch))


def _with_model(command: Bringup, arguments: Arguments) -> dict[str, str]:
    """Return the given arguments, with the command's file as ``model``."""
    if command.takes_file:
        return with_positional(arguments, "model", "file", command.program)
    refuse_positional(arguments.positional)
    return dict(arguments.given)


def _check_names(command: Bringup, given: Mapping[str, str], own_names: Iterable[str]) -> None:
    """Reject arguments that neither the command nor its model has, if all of the model's are known.

    Otherwise an included file was not found, and expanding the model reports the unknown ones.
    """
    of_model, is_complete = command.model_arguments(given)
    names = [*own_names, *(argument.name for argument in of_model)]
    prefixed_names = {f"{OF_MODEL}{name}" for name in names}
    problems = [unknown(name, names) for name in given if name not in (*names, *prefixed_names)]
    if problems and is_complete:
        raise UsageError("\n".join(problems))


def _check_files(settings: "BringupSettings") -> None:
    """Reject missing files, unwritable recordings, an invalid world or page address."""
    view_file(settings.view)
    for name, file in (("joints", settings.joints), ("params_file", settings.params_file)):
        if file:
            require_file(name, Path(file))
    if settings.map:
        from onebot_control.navigation.map_files import load_map

        load_map(Path(settings.map))
    if settings.save and Path(settings.save).suffix != ".rrd":
        raise OneBotError(f"save:={settings.save}: a recording's name must end in .rrd")
    for name, target in (("save", settings.save), ("record", settings.record)):
        if target:
            with writing(f"{name}:={target}"):
                refuse_unwritable(Path(target).absolute(), folder=name == "record")
    if settings.world:
        from onebot_description.description.loading import load_world

        load_world(settings.world)
    if settings.steer:
        from onebot_bringup.serving.ports import listen

        listen(settings.host, settings.port).close()


def _check_sections(
    settings: "BringupSettings", description: "Description", robots: Sequence["PlacedRobot"]
) -> None:
    """Check the names of nodes and parameters in the given parameter files; print warnings."""
    from onebot_control.control_files import unknown_by_node
    from onebot_description.joints.config import JointsConfig
    from onebot_description.parameters.files import check_sections, undeclared_warnings
    from onebot_description.parameters.reader import unknown_parameters

    space = absolute(settings.namespace)
    described = {f"{space}/{robot.name}": robot.description for robot in robots}
    described = described or {space: description}
    given = [settings.params_file] if "params_file" in settings.given else []
    files = [file for file in (*given, *(robot.params_file for robot in robots)) if file]
    nodes = unknown_by_node(settings.controller, files, described)
    if settings.joints and "joints" in settings.given:  # then it is not simulated
        files = [Path(settings.joints)]
        nodes = {"joint_state_publisher": partial(unknown_parameters, JointsConfig)}
        check_sections(files[0], [f"{space}/{node}" for node in nodes])
    warnings: dict[str, None] = {}  # each once, since robots may share a file
    for file in files:
        warnings |= dict.fromkeys(undeclared_warnings(file, nodes.values()))
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)


def with_params_file(settings: "BringupSettings") -> "BringupSettings":
    """Return the settings, updated for all nodes from the ``params_file``.

    All nodes have to agree on the controller's name, the frames' names and the clock. The file's
    settings apply unless they are given on the command line.
    """
    from onebot_control.control_files import drive_node
    from onebot_control.simulation_parameters import SimulationConfig
    from onebot_description.parameters.reader import read

    files = [settings.params_file] if settings.params_file else []
    if not settings.stands:
        settings = replace(settings, drive=drive_node(files))
    if not settings.sim:
        return settings
    written = settings.written(files)
    names = {*_FRAME_PREFIX, _FACTOR} & written.values.keys()
    config = read(SimulationConfig, {name: written.values[name] for name in names}, written.places)
    if names - {_FACTOR} and "frame_prefix" not in settings.given and not settings.robots:
        enabled, prefix = config.tf_frame_prefix_enable, config.tf_frame_prefix
        space = absolute(settings.namespace)
        settings = replace(settings, frame_prefix=prefixed("", enabled, prefix, space))
    sim_time = "use_sim_time" not in settings.given and written.values.get("use_sim_time") is True
    given_factor = settings.real_time_factor
    factor = config.real_time_factor if given_factor is None else given_factor
    # The simulation publishes /clock unless it runs in real time.
    return replace(settings, use_sim_time=settings.use_sim_time or sim_time or factor != 1.0)


def with_view(settings: "BringupSettings", command: Bringup, root_link: str) -> "BringupSettings":
    """Return the settings with the command's view of what is brought up.

    A view that is given on the command line decides everything itself.
    """
    view, frame = settings.view, ""
    if "view" in settings.given:
        return settings
    if command.sim_view and settings.sim:
        view = command.sim_view
    elif settings.world:
        view = command.world_view
        frame = world_frame(settings, given_files(settings.params_file))
    elif command.control and not settings.sim:
        frame = settings.frame_prefix + root_link  # there is no odom
    return replace(settings, view=view, fixed_frame=settings.fixed_frame or frame)


def environment(settings: DiscoverySettings, *, several: bool = False) -> dict[str, str]:
    """Return the environment variables of all nodes, in addition to this process's own.

    Args:
        settings: the launch arguments.
        several: whether a process may have nodes of several robots.
    """
    variables = settings.variables()
    if "RCUTILS_CONSOLE_OUTPUT_FORMAT" not in os.environ:
        # The launcher prefixes each line with the node's name, but not with the robot's.
        name = "[{name}] " if several else ""
        variables["RCUTILS_CONSOLE_OUTPUT_FORMAT"] = f"[{{severity}}] {name}{{message}}"
    if "RCUTILS_COLORIZED_OUTPUT" not in os.environ and wants_color(2):
        variables["RCUTILS_COLORIZED_OUTPUT"] = "1"  # the nodes see a pipe instead of a terminal
    return variables


def help_text(
    command: Bringup, declared: list[Argument], of_model: Sequence[Argument], *, complete: bool
) -> str:
    """Return the text of ``--show-args``, or with ``complete`` of ``--help``."""
    tables = f"Arguments and their defaults:\n{table(declared)}"
    if of_model:
        tables += f"\n\nArguments of the model:\n{table(of_model)}"
    if not complete:
        return tables
    file = " FILE" if command.takes_file else ""
    return (
        f"usage: {command.program}{file} [name:=value ...] [--ros-args ...]\n\n"
        f"{command.summary}\n\n{tables}\n\n"
        "If an argument is given twice, the last one counts. --ros-args goes to every node.\n"
        f"{command.program.split()[0]} --version shows the version.\n"
        "Ctrl-C stops everything. Exit codes: 0 stopped by the user, 1 a file is wrong or a\n"
        "node failed, 2 the command line is wrong."
    )


def summary_text(launch: Launch) -> str:
    """Return what is running, where to find it and how to stop it."""
    space = absolute(launch.settings.namespace)
    lines = _robots(launch, space) if launch.robots else _robot(launch, space)
    return "\n".join([*lines, f"  {UP}"])


def _robot(launch: Launch, space: str) -> list[str]:
    description, settings = launch.description, launch.settings
    moving = [joint for joint in description.joints if joint.kind != "fixed"]
    lines = [
        f'Robot "{description.robot_name}": {len(description.links)} links, '
        f"{len(moving)} of {len(description.joints)} joints can move",
        f"  model    {settings.model}",
        f"  topics   /tf /tf_static {space}/robot_description {space}/joint_states",
    ]
    if settings.frame_prefix:
        lines.append(f"  frames   begin with {settings.frame_prefix}")
    if settings.sim and settings.stands:
        joint = next((joint.name for joint in moving), "JOINT")
        lines.append(f"  move     onebot trajectory {joint}=0.5, or any client of its action")
    elif settings.sim:
        drive = command_topic(settings, f"{space}/")
        lines.append(
            f"  drive    onebot teleop{f' {drive}' if space else ''}, or a Twist on {drive}"
        )
    elif settings.joint_states:
        lines.append(f"  joints   {settings.joints or 'swing within their limits'}")
    else:
        lines.append(f"  joints   wait for {space}/joint_states")
    return lines


def _robots(launch: Launch, space: str) -> list[str]:
    first, last = launch.robots[0].name, launch.robots[-1].name
    drive = command_topic(launch.settings, f"{space}/{first}/")
    return [
        f"{len(launch.robots)} robots in one world, {first} to {last}",
        f"  topics   /tf /tf_static, and in each robot's namespace, such as "
        f"{space}/{first}/joint_states",
        f"  frames   of each robot begin with its namespace, such as {f'{space}/'[1:]}{first}/odom",
        f"  drive    onebot teleop {f'{space}/'[1:]}{first}, or a Twist on {drive}",
    ]
