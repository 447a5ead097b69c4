"""From the command line of a bringup to its processes: joint states, transforms, the viewer."""

import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from onebot_bringup.bringup_arguments import (
    checked_values,
    description_arguments,
    simulation_arguments,
)
from onebot_bringup.bringup_nodes import NodeFactory, output_path
from onebot_bringup.bringup_text import help_text, summary_text
from onebot_bringup.description_files import Known, signatures
from onebot_bringup.launch_environment import environment
from onebot_bringup.launcher.arguments import (
    Argument,
    Arguments,
    UsageError,
    refuse_positional,
    split,
    unknown,
)
from onebot_bringup.launcher.launcher import Launcher
from onebot_bringup.launcher.node import Node
from onebot_bringup.launcher.standby import Standby
from onebot_bringup.robot import Robot
from onebot_bringup.xacro_arguments import XacroArguments, included_files, xacro_arguments
from onebot_description.description import load_description, published_urdf
from onebot_description.errors import OneBotError
from onebot_description.text import did_you_mean


def start(robot: Robot, argv: Sequence[str], standby: Standby) -> int:
    """Do as ``onebot_bringup.bringup.bring_up`` says.

    Args:
        robot: what to bring up.
        argv: the launch arguments.
        standby: interpreters for its nodes.
    """
    arguments = split(argv)
    given = _with_model(robot, arguments)
    declared = description_arguments(robot.model, robot.joints, robot.view)
    if robot.control:
        declared += simulation_arguments(robot.control)
    model = given.get("model", robot.model)
    of_model = _not_hidden(xacro_arguments(model), declared)
    if arguments.help or arguments.show:
        print(help_text(robot, declared, of_model.arguments, complete=arguments.help))
        return 0
    if not model:
        raise UsageError(f"{robot.program} needs a file, a URDF or xacro")
    own, for_xacro = _divide(given, declared, of_model)
    values = checked_values(declared, own)
    _check_files(values, own)
    before = signatures(included_files(model))
    description = load_description(model, for_xacro)
    urdf = published_urdf(description)
    known = Known.of(urdf, description.files, before)
    os.environ.update(environment(values, forced="discovery" in own))
    with tempfile.TemporaryDirectory(prefix="onebot-") as folder:
        make = NodeFactory(
            Path(folder), values, description, urdf, for_xacro, arguments.ros_args, known
        )
        return Launcher(
            _nodes(make),
            name=robot.program,
            started_message=summary_text(description, values),
            temporary=[Path(folder)],
            standby=standby,
        ).run()


def _nodes(make: NodeFactory) -> list[Node]:
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
    if values["reload"] == "true":
        nodes.append(make.description_watcher())
    return nodes


def _moves_joints(values: Mapping[str, str]) -> bool:
    """Whether joint_state_publisher is what moves the joints."""
    return values.get("sim") != "true" and values["joint_states"] == "true"


def _with_model(robot: Robot, arguments: Arguments) -> dict[str, str]:
    """Return the arguments given, the command's file among them as ``model``."""
    if not robot.takes_file:
        refuse_positional(arguments.positional)
        return dict(arguments.given)
    refuse_positional(arguments.positional[1:])
    if arguments.positional and "model" in arguments.given:
        raise UsageError(f"write the file or model:=, not both, for {robot.program}")
    return {**dict(zip(["model"], arguments.positional, strict=False)), **arguments.given}


def _not_hidden(of_model: XacroArguments, declared: list[Argument]) -> XacroArguments:
    """Leave out what the model declares under the name of a launch argument."""
    names = {argument.name for argument in declared}
    visible = (argument for argument in of_model.arguments if argument.name not in names)
    return replace(of_model, arguments=tuple(visible))


def _divide(
    given: Mapping[str, str], declared: list[Argument], of_model: XacroArguments
) -> tuple[dict[str, str], dict[str, str]]:
    """Sort the arguments given into those of the launcher and those of the model's xacro."""
    ours = {argument.name for argument in declared}
    known = [*ours, *(argument.name for argument in of_model.arguments)]
    problems = [unknown(name, known) for name in given if name not in known]
    if problems and of_model.complete:  # else expanding it tells whether they exist
        raise UsageError("\n".join(problems))
    own = {name: value for name, value in given.items() if name in ours}
    return own, {name: value for name, value in given.items() if name not in ours}


def _check_files(values: Mapping[str, str], given: Mapping[str, str]) -> None:
    """Complain about files that do not exist, or are wrong, before anything starts.

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
    """Complain about recordings that could not be written."""
    for name in ("save", "record"):
        path = output_path(values[name])
        if values[name] and not path.parent.is_dir():
            raise OneBotError(f"{name}:={values[name]}: the folder {path.parent} does not exist")
    if values["save"] and output_path(values["save"]).suffix != ".rrd":
        raise OneBotError(f"save:={values['save']}: a recording's name must end in .rrd")
    if values["record"] and output_path(values["record"]).exists():
        raise OneBotError(f"record:={values['record']} exists already: name a new folder")


def _check_joints(file: Path, namespace: str) -> None:
    from onebot_description.joints.config import JointsConfig
    from onebot_description.joints.parameter_files import read_files, silence
    from onebot_description.joints.problems import ConfigError

    node = f"/{namespace}/joint_state_publisher" if namespace else "/joint_state_publisher"
    parameters = read_files([file], node)
    try:
        JointsConfig.from_parameters(parameters.values)
    except ConfigError as error:
        raise error.located(parameters.places) from None
    remark = silence(parameters, [file], node)
    if remark:
        remedy = "; write /**/joint_state_publisher: for any namespace" if namespace else ""
        print(f"warning: {remark}{remedy}", file=sys.stderr)
