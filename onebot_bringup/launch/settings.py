"""The arguments of the bringups, which the launcher reads into one checked dataclass."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from onebot_bringup.launch.arguments import (
    NAMESPACE,
    PACKAGES,
    DiscoverySettings,
    Settings,
    argument,
    field_of,
    parameter_of,
)
from onebot_bringup.steering.page_parameters import PageParameters
from onebot_bringup.viewer.core.settings import FrameSettings
from onebot_bringup.viewer.viewer_parameters import ViewerParameters
from onebot_control.conventions import DRIVE_CONTROLLER, MANAGER, DriveNode, namespace_prefix
from onebot_control.drive_kinds import ControlConfig
from onebot_control.navigation.parameters import NavigatorParameters
from onebot_control.simulation_parameters import SimulationConfig
from onebot_description.description.loading import shipped_worlds
from onebot_description.errors import UsageError
from onebot_description.parameters.reader import NO_PARAMETER
from onebot_description.ros.names import absolute
from onebot_description.state_parameters import StateParameters

if TYPE_CHECKING:
    from onebot_description.parameters.files import Parameters

_AS_IN_FILE = "default: from params_file"
_PACE = "if not simulated, rate of joint_states; default: from params_file or joints"
_LEVELS = ("debug", "info", "warn", "error", "fatal")
_STEERING_PAGE, _NAVIGATOR = "steering_page", "navigator"
_OF_SIMULATION = ("params_file", "nav2_topics", "robots")  # besides parameters of controllers
_OF_JOINTS = ("joints", "joint_states")
_OF_ONE_ROBOT = ("x", "y", "yaw", "frame_prefix", "reload")

# Parameters of nodes; those of the simulation have their defaults in a file.
_state = partial(parameter_of, ("robot_state_publisher",), StateParameters)
_viewer = partial(parameter_of, ("rerun_viewer",), ViewerParameters)
_page = partial(parameter_of, (_STEERING_PAGE,), PageParameters)
_navigator = partial(parameter_of, (_NAVIGATOR,), NavigatorParameters)
_simulation = partial(
    parameter_of, (DRIVE_CONTROLLER, MANAGER), SimulationConfig, default=None, note=_AS_IN_FILE
)
_drive = partial(parameter_of, (DRIVE_CONTROLLER,), ControlConfig, default=None, note=_AS_IN_FILE)


@dataclass(frozen=True)
class DescriptionSettings(Settings):
    """The arguments about the robot's description and its view."""

    model: str = argument("", "the robot: a URDF or xacro file, also as package://pkg/path")
    package_path: str = field_of(PACKAGES)
    joints: str = argument(
        "",
        "a YAML file of joint_state_publisher's parameters, reloaded when edited; "
        "empty: joints swing",
    )
    joint_states: bool = argument(True, "run joint_state_publisher; false: the robot has its own")
    viewer: str = _viewer("viewer")
    view: str = _viewer("view")
    fixed_frame: str = parameter_of(("rerun_viewer",), FrameSettings, "fixed_frame")
    save: str = _viewer("save")
    record: str = argument("", "record all topics to this new folder, a rosbag2 in MCAP")
    reload: bool = argument(True, "apply edits of the model while running")
    namespace: str = field_of(NAMESPACE)
    frame_prefix: str = argument(
        "", "prefix of the frames; not given: the namespace, such as r1/; empty: none"
    )
    publish_frequency: float = _state("publish_frequency")
    ignore_timestamp: bool = _state("ignore_timestamp")
    use_sim_time: bool = argument(False, "take the time from /clock")
    log_level: str = argument("info", "the least severe log messages shown", choices=_LEVELS)


@dataclass(frozen=True)
class BringupSettings(DiscoverySettings, DescriptionSettings):
    """The arguments of a bringup whose robot drives."""

    sim: bool = argument(True, "simulate it; false: joint_state_publisher moves its joints")
    robots: str = argument(
        "", "several robots in one world: how many, or a YAML file with their names and places"
    )
    steer: bool = argument(False, "a page to steer it from, beside its view")
    host: str = _page("host")
    port: int = _page("port")
    token: str = _page("token")
    params_file: Path | None = argument(None, "parameters of the controller, a YAML file")
    left_wheel: tuple[str, ...] | None = _drive("left_wheel_names")
    right_wheel: tuple[str, ...] | None = _drive("right_wheel_names")
    x: float | None = _simulation("x")
    y: float | None = _simulation("y")
    yaw: float | None = _simulation("yaw")
    world: str = _simulation("world", default="", examples=tuple(shipped_worlds()))
    sensors: str = _simulation("sensors", default="")
    ground_truth_tf: bool | None = _simulation("ground_truth_tf")
    navigate: bool = argument(False, "drive to goals with the lidar, around obstacles")
    map: str = _navigator("yaml_filename", note="for the navigator")
    nav2_topics: bool = argument(False, "use the topics that Nav2 expects, cmd_vel and odom")
    rate: float | None = _simulation("update_rate", note=_PACE)
    real_time_factor: float | None = _simulation("real_time_factor")
    paused: bool | None = _simulation("paused")
    # The node with the simulation's parameters, which a control file may name.
    drive: DriveNode = field(default=DriveNode(), metadata=NO_PARAMETER)

    @property
    def controller(self) -> str:
        """The name of the node with the simulation's parameters."""
        return self.drive.name

    def written(self, files: Sequence[Path]) -> "Parameters":
        """Return the parameters of that node in ``files``; later ones override."""
        from onebot_control.control_files import ControlFiles

        return ControlFiles(files, absolute(self.namespace), self.controller).parameters()

    @property
    def stands(self) -> bool:
        """Whether the robot's base is fixed, as an arm's."""
        return self.controller == MANAGER


@dataclass(frozen=True)
class StandingSettings(BringupSettings):
    """The arguments of a bringup whose robot stands, such as an arm; others have their defaults."""

    sim: bool = argument(False, "simulate it, with its joints commanded by trajectories")
    robots: str = ""
    params_file: Path | None = argument(None, "parameters of the controllers, a YAML file")
    left_wheel: tuple[str, ...] | None = None
    right_wheel: tuple[str, ...] | None = None
    ground_truth_tf: bool | None = None
    navigate: bool = False
    map: str = ""
    nav2_topics: bool = False
    drive: DriveNode = field(default=DriveNode(MANAGER), metadata=NO_PARAMETER)


def checked_settings(
    kind: type[BringupSettings], given: Mapping[str, str], **defaults: str
) -> BringupSettings:
    """Return checked values of all arguments; ``defaults`` are texts by name, where they differ.

    As several robots may publish to one /tf, frames are prefixed with the namespace, as in
    diff_drive_controller, unless ``frame_prefix`` is given (even if empty).
    """
    settings = kind.read(given, **defaults)
    if "frame_prefix" not in given:
        settings = replace(settings, frame_prefix=namespace_prefix(settings.namespace))
    prefix = settings.frame_prefix
    if settings.sim and prefix and not prefix.endswith("/"):
        raise UsageError(f"frame_prefix:={prefix} must end with /, as in frame_prefix:={prefix}/")
    _check_effect(settings, given)
    if settings.navigate and settings.ground_truth_tf is None:
        settings = replace(settings, ground_truth_tf=False)  # the navigator localizes the robot
    return settings


def _check_effect(settings: BringupSettings, given: Mapping[str, str]) -> None:
    """Reject arguments of features that are off, and of a single robot if there are several."""
    for declared in settings.arguments():
        name, nodes = declared.name, declared.nodes
        if name not in given:
            continue
        written, value = f"{name}:={given[name]}", getattr(settings, name)
        of_controller = DRIVE_CONTROLLER in nodes and name != "rate"
        if not settings.sim and (of_controller or name in _OF_SIMULATION):
            if value is not False and value not in (None, ""):
                raise UsageError(f"{written} is for the simulation: write sim:=true")
        elif settings.sim and name in _OF_JOINTS:
            text = "has no effect, since the simulation moves the joints: leave it out"
            raise UsageError(f"{written} {text}, or write sim:=false")
        elif not settings.steer and _STEERING_PAGE in nodes:
            raise UsageError(f"{written} is for the steering page: add steer:=true")
        elif not settings.navigate and _NAVIGATOR in nodes:
            raise UsageError(f"{written} is for the navigator: add navigate:=true")
        elif settings.robots and name in _OF_ONE_ROBOT and value is not False:
            raise UsageError(f"{written} is for one robot, not for robots:={settings.robots}")
