"""A robot before it enters a world: its simulated model, and the joints of its controllers."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

from onebot_control.drive.wheels.geometry import Wheels
from onebot_control.joint_controllers import DEFAULT_CONTROLLER, JointController
from onebot_control.physics.simulated_model import (
    commandable,
    simulated_model,
    without_limits,
)
from onebot_control.simulation_parameters import SimulationConfig
from onebot_description.description import Description
from onebot_description.errors import OneBotError, listing, unknown_names
from onebot_description.parameters.reader import ConfigError, Problem


class Member(NamedTuple):
    """One robot of a fleet: its description, parameters and controllers.

    It starts at the x, y and yaw of its config.
    """

    description: Description
    config: SimulationConfig  # includes the drive's parameters, if it has a drive
    name: str = ""  # prefix of error messages; empty if there is no other robot
    places: Mapping[str, str] = MappingProxyType({})  # file and line of each of its parameters
    controllers: Sequence[JointController[Any]] = ()  # default: one for all joints but wheels

    @contextmanager
    def located(self) -> Iterator[None]:
        """Add its name, and the file and line of its parameters, to errors raised inside."""
        try:
            yield
        except OneBotError as error:
            placed = error.located(self.places) if isinstance(error, ConfigError) else error
            if not self.name:
                raise placed from None
            raise OneBotError(f"{self.name}: {placed}") from None


class PreparedRobot:
    """The parts of a robot to simulate and to control.

    Attributes:
        member: the robot as given.
        wheels: its driven wheels; none if its base is fixed.
        spawn: the model that the world loads.
        controllers: the active controllers of its other joints, by name.
        controlled: joints of each controller, by the controller's name.
        ignored: controllers that are inactive, and parameters without effect.
    """

    def __init__(self, member: Member) -> None:
        """Prepare a robot for a world.

        Raises:
            OneBotError: config and description do not match.
        """
        self.member, config = member, member.config
        description, interfaces = member.description, member.description.interfaces
        if faults := [fault for listed in interfaces.values() for fault in listed.faults]:
            raise OneBotError("\n".join(faults))
        description = description.independent()
        self.wheels = wheels = wheels_of(config, description)
        if config.drive is not None:
            config.drive.fitted(wheels)
        candidates = member.controllers or [DEFAULT_CONTROLLER]
        joints = {item.name: joints_of(item, description, wheels) for item in candidates}
        candidates = [item for item in candidates if joints[item.name]]
        inactive = _inactive(description, wheels, candidates, joints)
        names = {problem.key for problem in inactive}
        self.controllers = {item.name: item for item in candidates if item.name not in names}
        self.controlled = {name: joints[name] for name in self.controllers}
        commanded = tuple([joint for joints in self.controlled.values() for joint in joints])
        if fault := description.interface_fault(commanded, stands=not wheels.names):
            raise OneBotError(fault)
        unlimited = [
            joint
            for name, controller in self.controllers.items()
            if not controller.config.enforce_command_limits
            for joint in self.controlled[name]
        ]
        description = without_limits(description, unlimited)
        spawn = simulated_model(description, wheels, commanded, config.initial_positions)
        if member.name:
            source = f"{member.name}: {spawn.description.source}"
            spawn = spawn._replace(description=replace(spawn.description, source=source))
        self.spawn = spawn._replace(start=config.start, name=member.name)
        self.ignored = inactive + [
            Problem(f"{name}.{problem.key}", problem.text)
            for name, controller in self.controllers.items()
            for problem in controller.config.ignored(self.controlled[name])
        ]


def wheels_of(config: SimulationConfig, description: Description) -> Wheels:
    """Return the driven wheels of a robot; none if its base is fixed.

    Raises:
        OneBotError: see ``DriveParameters.wheels``.
    """
    return config.drive.wheels(description) if config.drive else Wheels(description)


def joints_of(
    controller: JointController[Any], description: Description, wheels: Wheels
) -> Sequence[str]:
    """Return the joints that a controller commands: those it names, or all commandable ones."""
    return controller.config.joint_names or commandable(description, wheels)


def _inactive(
    description: Description,
    wheels: Wheels,
    controllers: Sequence[JointController[Any]],
    joints: Mapping[str, Sequence[str]],
) -> list[Problem]:
    """Return why controllers are inactive.

    The robot has none of their joints, or other controllers or joints move them.

    Raises:
        ConfigError: only some joints of a controller move, or it is the only one and none moves.
    """
    owners = dict.fromkeys(wheels.joints, "the controller of the wheels")
    moving = [joint.name for joint in description.moving_joints]
    mimics = {joint.name for joint in description.moving_joints if joint.mimic}
    inactive, problems = list[Problem](), list[Problem]()
    for controller in controllers:
        names = joints[controller.name]
        missing = [*unknown_names(names, moving)]
        shared = [joint for joint in names if joint in owners]
        following = [joint for joint in names if joint in mimics]
        if missing and (len(missing) < len(names) or len(controllers) == 1):
            key = f"{controller.name}.{controller.config.joints_parameter}"
            problems += [
                Problem(key, f'joint "{name}" does not move{hint}') for name, hint in missing
            ]
            continue
        if missing:
            reason = f"the robot has no joint {listing(names)}"
        elif shared:
            reason = f"{owners[shared[0]]} comes first, and moves {listing(shared)}"
        elif following and len(controllers) > 1:
            reason = f"<mimic> moves {listing(following)}"
        else:
            owners.update(dict.fromkeys(names, controller.name))
            continue
        inactive.append(Problem(controller.name, f"is inactive: {reason}"))
    if problems:
        raise ConfigError(problems)
    return inactive
