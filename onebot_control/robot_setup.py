"""The robots of a Simulation; reads their models, worlds and parameters."""

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from onebot_control.control_files import ControlFiles, default_control_file
from onebot_control.conventions import DRIVE_CONTROLLER
from onebot_control.drive.wheels.finding import RunningGear
from onebot_control.drive_kinds import DRIVES, found_drive, named_drive, suited
from onebot_control.joint_controllers import named
from onebot_control.prepared_robot import Member
from onebot_control.simulation_parameters import SimulationConfig
from onebot_description.description import Description, load_description
from onebot_description.description.loading import XacroValues, load_world
from onebot_description.description.xacro import xacro_arguments
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.file_watch import FileState, file_states
from onebot_description.parameters.arguments import checked_methods
from onebot_description.parameters.reader import ConfigError, Problem, leaves, read
from onebot_description.parameters.values import Rule, plain

_SENSORS = "sensors_enabled"  # the xacro argument of optional sensors
# Parameters of velocity_controller that do not apply to a Simulation.
_WITHOUT_EFFECT = {
    *("x", "y", "yaw", "world", "sensors", "sensor_noise", "robot_description"),
    *("real_time_factor", "paused", "step_topics", "step_timeout"),
}

Model = Annotated[str | Path | Description, Rule(write="a URDF or xacro file, or a Description")]
Parameters = Annotated[Mapping[str, Any], Rule(write="a dict of values by their ROS names")]


@checked_methods()
@dataclass(frozen=True)
class RobotSetup:
    """Model, start pose and parameters of one of several robots in a ``Simulation``.

    Attributes:
        x: start position in the world, m.
        y: start position in the world, m.
        yaw: start heading, rad.
        model: a URDF or xacro file, or a Description; None for the Simulation's model.
        parameters: parameters of its controller, by ROS names; they override the Simulation's.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    model: Model | None = None
    parameters: Parameters = field(default_factory=dict)


def read_robot_and_scene(
    model: str | Path | Description,
    arguments: XacroValues,
    world: str | Path | Description,
    *,
    optional: bool,
) -> tuple[Description, Description | None]:
    """Return the robot and its scene; their files are read in parallel, by two processes.

    Args:
        model: the robot.
        arguments: xacro arguments of the model, by name.
        world: the scene: a name, a file or a Description; "" for bare ground.
        optional: enable the robot's optional sensors, if it has any.

    Raises:
        OneBotError: one of them cannot be read.
    """
    with ThreadPoolExecutor(1) as executor:
        reading = executor.submit(read_scene, world)
        description = _described(model, arguments, optional)
    return description, reading.result()


def fleet_members(
    setups: Mapping[str, RobotSetup],
    default: Description,
    parameters: Mapping[str, Any],
    *,
    optional: bool,
) -> tuple[list[Member], list[dict[str, Any]]]:
    """Return the robots as members of a fleet, and the parameters of their controllers, by name.

    Args:
        setups: the robots' setups, by name; the name of a single robot is "".
        default: the description of robots whose setup has no model.
        parameters: parameters of all controllers, by ROS names. They override OneBot's
            control.yaml, and those of a setup override them.
        optional: enable the optional sensors of models, if they have any.

    Raises:
        OneBotError: a model or a parameter cannot be used.
    """
    defaults = ControlFiles([default_control_file()], "/", DRIVE_CONTROLLER).parameters().values
    members, values = [], []
    for name, setup in setups.items():
        description = default if setup.model is None else _described(setup.model, {}, optional)
        own_values = given_parameters({**parameters, **setup.parameters})
        with named(f"robots.{name}") if name else nullcontext():
            kind = _named_drive(own_values) or _found_kind(description)
            place = {"x": setup.x, "y": setup.y, "yaw": setup.yaw}
            values.append({**suited(defaults, kind), **own_values, **place})
            config = read(kind, values[-1])
        members.append(Member(description, config, name))
    return members, values


def _found_kind(description: Description) -> type[SimulationConfig]:
    """Return the parameters that suit a description, without a drive's if the robot stands."""
    drives = RunningGear.of(description).drives
    return found_drive(description) if drives else SimulationConfig


def _named_drive(given: dict[str, Any]) -> type[SimulationConfig] | None:
    """Return the parameters of the drive that a robot's parameters name; None if they name none.

    The drive is given by ``type``, which is removed, or found by ``named_drive``.

    Raises:
        ConfigError: there is no such type.
    """
    if "type" in given:
        kind = given.pop("type")
        if kind not in DRIVES:
            text = f'no drive has the type "{kind}"{did_you_mean(str(kind), DRIVES)}'
            raise ConfigError([Problem("type", text)])
        return DRIVES[kind]
    return named_drive(given)


def given_parameters(
    parameters: Mapping[str, Any], running: type[SimulationConfig] | None = None
) -> dict[str, Any]:
    """Return given parameters as plain Python values.

    Args:
        parameters: the values, by ROS names.
        running: dataclass of the parameters of a robot whose simulation has started.

    Raises:
        ConfigError: one has no effect in a Simulation, or none after the start.
    """
    _refuse(
        [name for name in parameters if name in _WITHOUT_EFFECT],
        "has no effect here; use the arguments of Simulation",
    )
    if running:
        fixed = {leaf.name for leaf in leaves(running) if leaf.type.rule.read_only}
        _refuse(
            [name for name in parameters if name in fixed],
            "is read at the start; give it to Simulation(parameters=...)",
        )
    return {name: plain(value) for name, value in parameters.items()}


def _refuse(names: Sequence[str], text: str) -> None:
    if names:
        raise ConfigError([Problem(name, text) for name in names])


def _described(
    model: str | Path | Description, arguments: XacroValues, optional: bool
) -> Description:
    if isinstance(model, Description):
        if arguments:
            raise OneBotError("arguments are for a xacro file; a Description has been expanded")
        return model
    if optional:
        names = [argument.name for argument in xacro_arguments(str(model)).arguments]
        arguments = {_SENSORS: "true", **arguments} if _SENSORS in names else arguments
    values = [f"{name}:={value}" for name, value in arguments.items()]
    return _read_once(lambda: load_description(model, arguments), "model", str(model), *values)


def read_scene(world: str | Path | Description) -> Description | None:
    """Return a scene; None for bare ground.

    Args:
        world: a name, a file or a Description; "" for bare ground.

    Raises:
        OneBotError: it cannot be read.
    """
    if isinstance(world, Description):
        return world
    name = str(world)
    return _read_once(lambda: load_world(name), "world", name) if name else None


_KEPT = 32  # descriptions
_kept: dict[tuple[object, ...], tuple[Description | None, Mapping[Path, FileState]]] = {}


def _read_once(read: Callable[[], Description], *key: str) -> Description:
    """Return the result of ``read``, cached while no file changes.

    Expanding xacro takes longer than building the world. It can depend on the environment.
    """
    source = (*key, os.getcwd(), *os.environ.items())
    description, states = _kept.pop(source, (None, {}))
    if description is None or states != file_states(description.files):
        description = read()
        states = file_states(description.files)
    _kept[source] = description, states  # the least recently used is dropped first
    for oldest in [*_kept][:-_KEPT]:
        del _kept[oldest]
    return description
