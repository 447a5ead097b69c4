"""Reads control files, in ros2_control's format: the parameters of several nodes in one file.

Entries that cannot be used are skipped with a warning: controllers of other types or with other
command interfaces, sections of other nodes, and unknown parameters.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from onebot_control.conventions import (
    BROADCASTER,
    DEFAULT_JOINT_CONTROLLER,
    DRIVE_CONTROLLER,
    MANAGER,
    DriveNode,
)
from onebot_control.drive_kinds import (
    DEFAULT_DRIVE,
    DRIVES,
    ControlConfig,
    found_drive,
    named_drive,
    suited,
    topics_of,
)
from onebot_control.joint_controllers import (
    DEFAULT_CONTROLLER,
    JOINT_CONTROLLERS,
    JointController,
    named,
)
from onebot_control.simulation_parameters import (
    BroadcasterConfig,
    ManagerConfig,
    SimulationConfig,
)
from onebot_control.trajectories.following import JointFollower, TrajectoryFollower
from onebot_description.elements.packages import package_share
from onebot_description.errors import did_you_mean, listing
from onebot_description.parameters.files import (
    Parameters,
    Unknown,
    read_parameters,
    read_sections,
    read_text,
    section_matches,
)
from onebot_description.parameters.reader import (
    ConfigError,
    Problem,
    is_of_every_node,
    is_parameter,
    read,
    unknown_parameters,
)

if TYPE_CHECKING:
    from onebot_description.description import Description

BROADCASTER_TYPE = "joint_state_broadcaster/JointStateBroadcaster"
_OTHER_DRIVES = "swerve_drive_controller", "four_wheel_steering_controller"
_TYPE, _FILE = ".type", ".params_file"
# Suffixes of controller_manager's parameters for each controller.
_OF_CONTROLLERS = (_TYPE, _FILE, ".fallback_controllers", ".node_options_args")
# Parameters of controller_manager, or their first words, that have no effect in a simulation.
_WITHOUT_EFFECT = {
    *("cpu_affinity", "defaults", "diagnostics", "handle_exceptions", "lock_memory", "overruns"),
    *("hardware_components_initial_state", "thread_priority"),
}
_ENFORCED = "enforce_command_limits"


def default_control_file() -> Path:
    """Return the path of OneBot's control.yaml."""
    return package_share("onebot_control") / "config" / "control.yaml"


def drive_node(files: Iterable[Path]) -> DriveNode:
    """Return the node of the first drive in control files, for any namespace.

    Raises:
        ConfigError: a file is broken.
    """
    for file in files:
        for section, parameters in read_sections(read_text(file), str(file)).items():
            for name, value in parameters.values.items():
                if isinstance(value, str) and value in DRIVES:
                    section_name = section.rpartition("/")[2]
                    node = section_name if name == "type" else name.removesuffix(_TYPE)
                    return DriveNode(node, *topics_of(DRIVES[value]))
    return DriveNode()


class JointControllers(NamedTuple):
    """The joint controllers that parameter files name."""

    controllers: Sequence[JointController[Any]]
    places: Mapping[str, str]  # file and line by controller, and by parameter, such as arm.joints
    warnings: Sequence[str] = ()  # a line for each controller or parameter that is skipped


def unknown_by_node(
    controller: str,
    files: Sequence[Path] = (),
    robots: "Mapping[str, Description | None]" = MappingProxyType({"/": None}),
) -> dict[str, Unknown]:
    """Return the nodes of control files, each with a check for unknown parameters.

    Args:
        controller: as for ``ControlFiles``.
        files: control files; the joint controllers that they name are included.
        robots: namespaces of the nodes, each with the description of its robot, if known.

    Returns:
        The checks by the nodes' names; the name of ``controller`` includes its namespace.
    """
    kinds: dict[str, type[JointFollower]] = {DEFAULT_JOINT_CONTROLLER: TrajectoryFollower}
    drives = dict[str, Unknown]()
    for namespace, description in robots.items():
        kinds.update(ControlFiles(files, namespace).kinds)
        if controller != MANAGER:
            node = f"{namespace.rstrip('/')}/{controller}"
            drives[node] = partial(_unknown_of_drive, files, namespace, controller, description)
    return {
        **{name: partial(unknown_parameters, kind.parameters) for name, kind in kinds.items()},
        **drives,
        MANAGER: _unknown_of_manager,
        BROADCASTER: partial(unknown_parameters, BroadcasterConfig),
    }


class ControlFiles:
    """Control files, and the controllers that they name, for the nodes of one robot.

    Attributes:
        types: type, and file and line, of each controller by name, in the files' order.
        kinds: kind of each joint controller by name; the default controller if there is none.
        broadcaster: name of the first joint_state_broadcaster.
    """

    def __init__(
        self,
        files: Sequence[Path],
        namespace: str,
        controller: str = MANAGER,
        found: type[SimulationConfig] = ControlConfig,
    ) -> None:
        """Read the names and types of the controllers.

        Args:
            files: YAML files; later ones override earlier ones.
            namespace: namespace of the nodes, such as "/".
            controller: name of the drive's node, such as "velocity_controller"; controller_manager
                for a robot with a fixed base.
            found: dataclass of the drive's parameters, unless the files name the drive's type.

        Raises:
            ConfigError: a file is broken.
        """
        self._controller, self._found = controller, found
        self._texts = {file: read_text(file) for file in files}
        self._space = namespace.rstrip("/")
        manager = self._parameters(MANAGER)
        self.types = {
            name.removesuffix(_TYPE): (str(value), manager.places[name])
            for name, value in manager.values.items()
            if name.endswith(_TYPE)
        }
        for _, section, parameters in self._sections():
            name, value = section.rpartition("/")[2], parameters.values.get("type")
            if value is not None and section_matches(section, f"{self._space}/{name}"):
                self.types.setdefault(name, (str(value), parameters.places["type"]))
        if found is not ControlConfig and any(map(_is_own, files)):
            self.types.pop(DRIVE_CONTROLLER, None)  # OneBot's own file is for other drives, too
        self._files = {
            name.removesuffix(_FILE): [
                str(file) for file in (value if isinstance(value, list) else [value]) if file
            ]
            for name, value in manager.values.items()
            if name.endswith(_FILE)
        }
        broadcasters = [n for n, (kind, _) in self.types.items() if kind == BROADCASTER_TYPE]
        self.broadcaster = next(iter(broadcasters), BROADCASTER)
        self.kinds: Mapping[str, type[JointFollower]] = {
            name: JOINT_CONTROLLERS[kind]
            for name, (kind, _) in self.types.items()
            if kind in JOINT_CONTROLLERS
        } or {DEFAULT_JOINT_CONTROLLER: TrajectoryFollower}

    @property
    def declared(self) -> type[SimulationConfig]:
        """The dataclass of the parameters of the robot's node."""
        kind, _ = self.types.get(self._controller, ("", ""))
        if self._controller == MANAGER or kind in DRIVES:
            return DRIVES.get(kind, SimulationConfig)
        return named_drive(self._parameters(self._controller).values) or self._found

    def parameters(self) -> Parameters:
        """Return the parameters of the robot's node, the simulation and the broadcaster.

        Names of the broadcaster's parameters begin with ``joint_state_broadcaster.``.

        Raises:
            ConfigError: values are wrong, or the robot has another kind of drive; it names file and
                line.
        """
        manager, declared = self._manager, self.declared
        drive = manager if self._controller == MANAGER else self._drive()
        broadcaster = self._section(
            self.broadcaster, partial(unknown_parameters, BroadcasterConfig)
        )
        warnings = [*manager.warnings, *broadcaster.warnings]
        drive.warnings += [warning for warning in warnings if warning not in drive.warnings]
        # The controller's own section overrides the others.
        for section, prefix in ((manager, ""), (broadcaster, f"{BROADCASTER}.")):
            for name, value in section.values.items():
                own_name = prefix + name
                if own_name not in drive.values and is_parameter(declared, own_name):
                    drive.values[own_name] = value
                    drive.places[own_name] = section.places[name]
        for name in [*drive.values]:
            if not is_parameter(declared, name) and not is_of_every_node(name):
                drive.drop(name)
        return drive

    def joint_controllers(self) -> JointControllers:
        """Return the joint controllers that run here; the default one if the files name none.

        Raises:
            ConfigError: values are wrong; it names all of them in a section, with their lines.
        """
        enforced = self._manager.values.get(_ENFORCED)
        controllers, places, warnings = [], dict[str, str](), self._skipped()
        for name, kind in self.kinds.items():
            section = self._section(name, partial(unknown_parameters, kind.parameters))
            warnings += section.warnings
            places |= {f"{name}.{key}": place for key, place in section.places.items()}
            if name in self.types:
                places[name] = self.types[name][1]
            if enforced is not None and kind is TrajectoryFollower:
                section.values.setdefault(_ENFORCED, enforced)
            if reason := kind.parameters.lacks(section.values):
                warnings.append(self._skips(name, reason))
                continue
            with named(name, places):
                described = JointController(kind, name, section.values)
            interfaces = described.config.interfaces
            if "position" in interfaces:
                controllers.append(described)
            else:
                text = f"commands {listing(interfaces)}, which is not simulated yet"
                warnings.append(self._skips(name, text))
        return JointControllers(controllers or [DEFAULT_CONTROLLER], places, warnings)

    def foreign_sections(self) -> dict[tuple[Path, str], str]:
        """Return a warning for each section that matches no node, by file and section."""
        names = {MANAGER, self._controller, self.broadcaster, *self.types, *self.kinds}
        nodes = [f"{self._space}/{name}" for name in names]
        warnings = {}
        for file, section, parameters in self._sections():
            if not any(section_matches(section, node) for node in nodes):
                place = next(iter(parameters.places.values()), str(file))
                text = f'section "{section}" matches no node, so it is skipped'
                hint = did_you_mean(section, nodes, "nodes")
                warnings[file, section] = f"{place}: {text}{hint}"
        return warnings

    def _sections(self) -> Iterator[tuple[Path, str, Parameters]]:
        """Yield each section, with its file and its parameters."""
        for file, text in self._texts.items():
            for section, parameters in read_sections(text, str(file)).items():
                yield file, section, parameters

    def _section(self, node: str, unknown: Unknown) -> Parameters:
        """Return a node's parameters; unknown ones are dropped, with a warning for each."""
        parameters = self._parameters(node)
        parameters.drop("type")
        parameters.drop_shared(unknown)
        for problem in unknown(parameters.values):
            parameters.warnings.append(f"{problem.message(parameters.places)}; it is ignored")
            parameters.drop(problem.key)
        return parameters

    @property
    def _manager(self) -> Parameters:
        """controller_manager's parameters; those that no other node has are checked."""
        manager = self._section(MANAGER, _unknown_of_manager)
        own_values = {n: v for n, v in manager.values.items() if is_parameter(ManagerConfig, n)}
        read(ManagerConfig, own_values, manager.places)
        return manager

    def _drive(self) -> Parameters:
        """Return the parameters in the section of the robot's drive."""
        kinds = {kind for kind, _ in self.types.values()}
        for name, (kind, place) in self.types.items():
            if kind.partition("/")[0] in _OTHER_DRIVES and kinds.isdisjoint(DRIVES):
                text = f"{kind} cannot be simulated yet, and another drive would move the robot "
                text += f"incorrectly; supported types are {listing(DRIVES)}"
                raise ConfigError([Problem(f"{name}{_TYPE}", text)], {f"{name}{_TYPE}": place})
        if self.types.get(self._controller, (DEFAULT_DRIVE,))[0] not in DRIVES:
            return Parameters()  # the section belongs to another controller
        return self._section(self._controller, partial(unknown_parameters, self.declared))

    def _skipped(self) -> list[str]:
        """Return a warning for each controller whose type does not run here."""
        used = {self.broadcaster: (BROADCASTER_TYPE,), self._controller: DRIVES}
        return [
            self._skips(name, _reason(kind))
            for name, (kind, _) in self.types.items()
            if kind not in JOINT_CONTROLLERS and kind not in used.get(name, ())
        ]

    def _skips(self, name: str, reason: str) -> str:
        """Return the warning that a controller does not run, with its reason."""
        _, place = self.types.get(name, ("", ""))
        return ": ".join(filter(None, (place, name, f"{reason}, so it is skipped")))

    def _parameters(self, node: str) -> Parameters:
        """Return all parameters of a node, including those in its own params_file."""
        parameters = Parameters()
        texts = {**self._texts}
        if node != MANAGER:
            texts |= {Path(file): read_text(Path(file)) for file in self._files.get(node, ())}
        for file, text in texts.items():
            of_file = read_parameters(text, str(file), f"{self._space}/{node}")
            if node == DRIVE_CONTROLLER and self._found is not ControlConfig and _is_own(file):
                of_file.values = suited(of_file.values, self._found)
                of_file.places = suited(of_file.places, self._found)
            parameters.update(of_file)
        return parameters


def _is_own(file: Path) -> bool:
    """Return whether a file is OneBot's control.yaml, which is the default for all robots."""
    return file.absolute() == default_control_file().absolute()


def _reason(kind: str) -> str:
    """Return why a controller of a type does not run."""
    if kind in DRIVES:
        return f"is a second {kind.partition('/')[0]}, or the robot has a fixed base"
    if kind == BROADCASTER_TYPE:
        return "is a second joint_state_broadcaster"
    halves = {*kind.split("/")}
    alike = [name for name in JOINT_CONTROLLERS if not halves.isdisjoint(name.split("/"))]
    return f"{kind} does not run here" + (f" (did you mean {alike[0]}?)" if alike else "")


def _unknown_of_manager(names: Iterable[str]) -> list[Problem]:
    own = [name for name in names if name.partition(".")[0] not in _WITHOUT_EFFECT]
    return unknown_parameters(ManagerConfig, [n for n in own if not n.endswith(_OF_CONTROLLERS)])


def _unknown_of_drive(
    files: Sequence[Path],
    namespace: str,
    controller: str,
    description: "Description | None",
    names: Iterable[str],
) -> list[Problem]:
    """Return a problem for each name that the drive of the described robot does not declare."""
    kind = found_drive(description) if description and names else ControlConfig
    return unknown_parameters(ControlFiles(files, namespace, controller, kind).declared, names)
