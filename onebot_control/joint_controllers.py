"""The kinds of joint controllers, by the types that control files name. No ROS here."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from onebot_control.trajectories.config import (
    TrajectoryConfig,
    foreign_joints,
    joint_constraints,
    unknown_trajectory_parameters,
)
from onebot_control.trajectories.following import Outcome, TrajectoryFollower
from onebot_control.trajectories.forwarding import ForwardConfig, PositionForwarder
from onebot_control.trajectories.goal import FollowedJoint
from onebot_control.trajectories.gripping import (
    GripperCommandConfig,
    GripperConfig,
    GripperFollower,
)
from onebot_control.trajectories.trajectory import JointMotion
from onebot_description.errors import listing
from onebot_description.parameters.reader import (
    REQUIRED,
    ConfigError,
    Problem,
    leaves,
    read,
    unknown_parameters,
)


class JointFollower(Protocol):
    """Moves the joints of one controller, one control cycle at a time.

    Attributes:
        joints: the joints, with their limits.
        names: the names of these joints.
    """

    joints: tuple[FollowedJoint, ...]
    names: tuple[str, ...]

    def update(self, measured: JointMotion, now: int, period: float) -> list[Outcome]:
        """Run one control cycle; see ``TrajectoryFollower.update``."""

    def reference(self, ahead: float) -> Sequence[float]:
        """Return the positions to command ``ahead`` seconds after the last update, rad or m."""

    def abort(self, text: str) -> Outcome | None:
        """Hold the joints; abort an action goal with ``text`` as the reason; return its outcome."""

    def reset(self, positions: Sequence[float]) -> Outcome | None:
        """Hold ``positions``, rad or m, where the joints were put; abort an action goal."""


F = TypeVar("F", bound=JointFollower)


class JointController(ABC, Generic[F]):
    """A joint controller with its parameters from a control file; each kind is a subclass.

    Attributes:
        parameters: dataclass of this kind's parameters.
        joints_parameter: name of the parameter that names the joints.
        name: the name of its node.
        values: its parameters as given, dotted name to value.
        config: the same parameters, checked.
    """

    parameters: ClassVar[Any]
    joints_parameter: ClassVar[str] = "joints"
    config: Any

    def __init__(self, name: str, values: Mapping[str, Any] = MappingProxyType({})) -> None:
        """Check the parameters ``values`` of the controller ``name``.

        Raises:
            ConfigError: values are wrong; it names each of them.
        """
        self.name, self.values = name, values
        self.config = self._read(values)

    @classmethod
    def _read(cls, values: Mapping[str, Any]) -> Any:
        return read(cls.parameters, values)

    @classmethod
    def unknown(cls, names: Iterable[str]) -> list[Problem]:
        """Return a problem for each of ``names`` that is not a parameter of this kind."""
        return unknown_parameters(cls.parameters, names)

    @classmethod
    def lacks(cls, values: Mapping[str, Any]) -> str:
        """Return which parameter it cannot run without is not among ``values``; "" for none."""
        required = [leaf.name for leaf in leaves(cls.parameters) if leaf.default is REQUIRED]
        missing = [name for name in required if name not in values]
        return f"has no parameter {listing(missing)}" if missing else ""

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that its parameters name; empty for all joints that can be commanded."""
        named = getattr(self.config, self.joints_parameter)
        return (named,) if isinstance(named, str) else tuple(named)

    @property
    def enforces_limits(self) -> bool:
        """Whether it keeps commands within the joints' limits."""
        return True

    @property
    def interfaces(self) -> tuple[str, ...]:
        """The command interfaces that its parameters name."""
        return ("position",)

    def ignored(self, joints: Sequence[str]) -> list[Problem]:
        """Return parameters without effect on a controller of these joints, with the reason."""
        return []

    @abstractmethod
    def follower(self, joints: Sequence[FollowedJoint], positions: Sequence[float]) -> F:
        """Return a follower for ``joints``, which start at ``positions``, rad or m."""

    def configure(self, follower: F) -> None:
        """Apply its changed parameters to a follower; by default all are read at the start only."""


class TrajectoryController(JointController[TrajectoryFollower]):
    """A joint_trajectory_controller with its parameters: its joints follow trajectories."""

    parameters = TrajectoryConfig
    config: TrajectoryConfig

    @classmethod
    def _read(cls, values: Mapping[str, Any]) -> TrajectoryConfig:
        return TrajectoryConfig.from_parameters(values)

    @classmethod
    def unknown(cls, names: Iterable[str]) -> list[Problem]:
        """Return a problem for each unknown name, including parameters of single joints."""
        return unknown_trajectory_parameters(names)

    def follower(
        self, joints: Sequence[FollowedJoint], positions: Sequence[float]
    ) -> TrajectoryFollower:
        """Return a trajectory follower for ``joints``, which start at ``positions``, rad or m."""
        constraints = joint_constraints(self.values, [joint.name for joint in joints])
        return TrajectoryFollower(joints, self.config, constraints, positions)

    @property
    def enforces_limits(self) -> bool:
        """The parameter enforce_command_limits."""
        return self.config.enforce_command_limits

    @property
    def interfaces(self) -> tuple[str, ...]:
        """The parameter command_interfaces."""
        return self.config.command_interfaces

    def ignored(self, joints: Sequence[str]) -> list[Problem]:
        """Return the parameters of joints that are not among ``joints``."""
        return foreign_joints(self.values, joints)

    def configure(self, follower: TrajectoryFollower) -> None:
        """Apply its changed parameters to a follower.

        Raises:
            ConfigError: the parameters of single joints are wrong.
        """
        follower.configure(self.config, joint_constraints(self.values, follower.names))


class ForwardController(JointController[PositionForwarder]):
    """A forward_command_controller for positions, with its parameters."""

    parameters = ForwardConfig
    config: ForwardConfig

    @property
    def interfaces(self) -> tuple[str, ...]:
        """The parameter interface_name."""
        return (self.config.interface_name,)

    def follower(
        self, joints: Sequence[FollowedJoint], positions: Sequence[float]
    ) -> PositionForwarder:
        """Return a forwarder for ``joints``, which start at ``positions``, rad or m."""
        return PositionForwarder(joints, positions)


class GripperController(JointController[GripperFollower]):
    """A parallel_gripper_action_controller with its parameters: it moves one joint to goals."""

    parameters: ClassVar[Any] = GripperConfig
    joints_parameter = "joint"
    config: GripperCommandConfig

    def follower(
        self, joints: Sequence[FollowedJoint], positions: Sequence[float]
    ) -> GripperFollower:
        """Return a follower for its joint, which starts at the one of ``positions``, rad or m."""
        return GripperFollower(joints, self.config, positions)

    def configure(self, follower: GripperFollower) -> None:
        """Apply its changed parameters to the follower."""
        follower.configure(self.config)


class GripperCommandController(GripperController):
    """A gripper controller of the older kind, whose action is control_msgs/GripperCommand."""

    parameters = GripperCommandConfig


JOINT_CONTROLLERS: Mapping[str, type[JointController[Any]]] = {
    "joint_trajectory_controller/JointTrajectoryController": TrajectoryController,
    "forward_command_controller/ForwardCommandController": ForwardController,
    "position_controllers/JointGroupPositionController": ForwardController,
    "parallel_gripper_action_controller/GripperActionController": GripperController,
    "position_controllers/GripperActionController": GripperCommandController,
}
"""The supported kinds of joint controllers, by ros2_control type."""


@contextmanager
def named(name: str, places: Mapping[str, str] = MappingProxyType({})) -> Iterator[None]:
    """Prefix the parameters in ConfigErrors with their controller, as in arm_controller.joints.

    Args:
        name: name of the controller.
        places: file and line of parameters, by the prefixed name.
    """
    try:
        yield
    except ConfigError as error:
        problems = [Problem(f"{name}.{problem.key}", problem.text) for problem in error.problems]
        raise ConfigError(problems, places) from None
