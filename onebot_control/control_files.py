"""Reads control files, in ros2_control's form: the parameters of several nodes in one file."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from onebot_control.controller_names import BROADCASTER, DEFAULT_JOINT_CONTROLLER, MANAGER
from onebot_control.drive.parameters import BroadcasterConfig, ControlConfig, SimulationConfig
from onebot_control.joint_controllers import (
    JOINT_CONTROLLERS,
    JointController,
    TrajectoryController,
    named,
)
from onebot_description.elements.packages import package_share
from onebot_description.ros.parameters.files import (
    Parameters,
    Unknown,
    read_parameters,
    read_sections,
    read_text,
)
from onebot_description.ros.parameters.reader import (
    ConfigError,
    Problem,
    is_parameter,
    unknown_parameters,
)

CONTROLLER_TYPE = "diff_drive_controller/DiffDriveController"
BROADCASTER_TYPE = "joint_state_broadcaster/JointStateBroadcaster"
_TYPE = ".type"  # suffix of the parameters that name a controller's type
_IGNORED = "enforce_command_limits"  # controller_manager's; limits are always enforced


def default_control_file() -> Path:
    """Return the path of OneBot's control.yaml."""
    return package_share("onebot_control") / "config" / "control.yaml"


def read_control_files(files: Sequence[Path], namespace: str, controller: str) -> Parameters:
    """Read the parameters of controller_manager, joint_state_broadcaster and a controller.

    Args:
        files: YAML files; later ones override earlier ones.
        namespace: namespace of the nodes, such as "/".
        controller: name of the controller's node, such as "velocity_controller".

    Returns:
        The parameters; those of the broadcaster begin with ``joint_state_broadcaster.``.

    Raises:
        ConfigError: values are wrong; it names all in a section, with their lines.
    """
    texts = {file: read_text(file) for file in files}
    unknown = unknown_by_node(controller)
    manager = _section(texts, namespace, MANAGER, unknown[MANAGER])
    drive = manager
    if controller != MANAGER:
        drive = _section(texts, namespace, controller, unknown[controller])
    broadcaster = _section(texts, namespace, BROADCASTER, unknown[BROADCASTER])
    undeclared = {key: manager.values.pop(key) for key in [*manager.values] if _is_undeclared(key)}
    if problems := _wrong_types(undeclared, controller):
        raise ConfigError(problems, manager.places)
    for name in undeclared:
        del manager.places[name]
    # The controller's own section overrides the others.
    for section, prefix in ((manager, ""), (broadcaster, f"{BROADCASTER}.")):
        for name, value in section.values.items():
            own_name = prefix + name
            if own_name not in drive.values and is_parameter(ControlConfig, own_name):
                drive.values[own_name] = value
                drive.places[own_name] = section.places[name]
    return drive


class JointControllers(NamedTuple):
    """The joint controllers that parameter files name."""

    controllers: Sequence[JointController[Any]]
    places: Mapping[str, str]  # file and line by parameter, such as arm_controller.joints


def read_joint_controllers(files: Sequence[Path], namespace: str) -> JointControllers:
    """Read the joint controllers that the section controller_manager names.

    If it names none, there is one controller, joint_trajectory_controller.

    Args:
        files: YAML files; later ones override earlier ones.
        namespace: namespace of the nodes, such as "/".

    Raises:
        ConfigError: values are wrong; it names all in a section, with their lines.
    """
    texts = {file: read_text(file) for file in files}
    manager = _section(texts, namespace, MANAGER, lambda names: [])
    kinds = joint_controllers(manager.values) or {DEFAULT_JOINT_CONTROLLER: TrajectoryController}
    controllers, places = [], dict[str, str]()
    for name, kind in kinds.items():
        section = _section(texts, namespace, name, kind.unknown)
        places |= {f"{name}.{key}": place for key, place in section.places.items()}
        with named(name, places):
            controllers.append(kind(name, section.values))
    return JointControllers(controllers, places)


def joint_controllers(values: Mapping[str, Any]) -> dict[str, type[JointController[Any]]]:
    """Return the kind of each joint controller that controller_manager's parameters name."""
    return {
        name.removesuffix(_TYPE): JOINT_CONTROLLERS[str(value)]
        for name, value in values.items()
        if name.endswith(_TYPE) and str(value) in JOINT_CONTROLLERS
    }


def _section(texts: Mapping[Path, str], namespace: str, node: str, unknown: Unknown) -> Parameters:
    """Return a node's parameters from the texts of files, without those that only others have.

    Raises:
        ConfigError: a file is broken, or has names that ``unknown`` reports.
    """
    parameters = Parameters()
    for file, text in texts.items():
        parameters.update(read_parameters(text, str(file), f"{namespace.rstrip('/')}/{node}"))
    parameters.drop_shared(unknown)
    if problems := unknown(parameters.values):
        raise ConfigError(problems, parameters.places)
    return parameters


def unknown_by_node(controller: str, files: Sequence[Path] = ()) -> dict[str, Unknown]:
    """Return the nodes that a control file is for, each with a check for unknown parameters.

    Args:
        controller: name of the controller's node.
        files: control files; the joint controllers that they name are included.
    """
    declared = SimulationConfig if controller == MANAGER else ControlConfig
    kinds: dict[str, type[JointController[Any]]] = {DEFAULT_JOINT_CONTROLLER: TrajectoryController}
    for file in files:
        kinds.update(joint_controllers(_manager_values(file)))
    return {
        **{name: kind.unknown for name, kind in kinds.items()},
        controller: partial(unknown_parameters, declared),
        MANAGER: _unknown_of_manager,
        BROADCASTER: partial(unknown_parameters, BroadcasterConfig),
    }


def _manager_values(file: Path) -> Mapping[str, Any]:
    """Return the parameters of controller_manager in a file, whatever its namespace."""
    sections = read_sections(read_text(file), str(file))
    values: dict[str, Any] = {}
    for section, parameters in sections.items():
        if section.rpartition("/")[2] == MANAGER:
            values.update(parameters.values)
    return values


def _is_undeclared(name: str) -> bool:
    """Return whether a parameter of controller_manager is right, but no node here declares it."""
    return name.endswith(_TYPE) or name == _IGNORED


def _unknown_of_manager(written: Iterable[str]) -> list[Problem]:
    names = [name for name in written if not _is_undeclared(name)]
    return unknown_parameters(SimulationConfig, names)


def _wrong_types(values: Mapping[str, Any], controller: str) -> list[Problem]:
    """Report controllers of types that this node cannot run.

    Args:
        values: controller_manager's parameters that no node here declares.
        controller: name of the controller's node.
    """
    own_types = {f"{controller}{_TYPE}": CONTROLLER_TYPE, f"{BROADCASTER}{_TYPE}": BROADCASTER_TYPE}
    problems = []
    for name, value in values.items():
        if not name.endswith(_TYPE):
            continue
        types = [own_types[name]] if name in own_types else [*JOINT_CONTROLLERS]
        if value not in types:
            hint = f'; of diff drives the one that is named "{controller}" runs'
            hint = hint if value == CONTROLLER_TYPE and controller != MANAGER else ""
            text = f"{value} is not what runs here; write {' or '.join(types)}{hint}"
            problems.append(Problem(name, text))
    return problems
