"""Controllers that move joints, by the types that control files give them. No ROS here."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from onebot_control.trajectories.config import (
    TrajectoryConfig,
    joint_constraints,
    unknown_trajectory_parameters,
)
from onebot_control.trajectories.following import Outcome, TrajectoryFollower
from onebot_control.trajectories.forwarding import ForwardConfig, PositionForwarder
from onebot_control.trajectories.goal import FollowedJoint
from onebot_control.trajectories.gripping import GripperConfig, GripperFollower
from onebot_control.trajectories.trajectory import JointMotion
from onebot_description.ros.parameters.reader import (
    ConfigError,
    Problem,
    read,
    unknown_parameters,
)


class JointFollower(Protocol):
    """What moves the joints of a controller, one control cycle after the other.

    Attributes:
        joints: with their limits.
        names: of the joints.
    """

    joints: tuple[FollowedJoint, ...]
    names: tuple[str, ...]

    def update(self, measured: JointMotion, now: int, period: float) -> list[Outcome]:
        """Do a control cycle; see ``TrajectoryFollower.update``."""

    def reference(self, ahead: float) -> Sequence[float]:
        """Return the positions to command ``ahead`` seconds after the last update, rad or m."""

    def abort(self, text: str) -> Outcome | None:
        """Hold the joints; end an action goal for the reason ``text``, and return its outcome."""

    def reset(self, positions: Sequence[float]) -> Outcome | None:
        """Hold ``positions``, rad or m, to which the joints were moved; end an action goal."""


F = TypeVar("F", bound=JointFollower)


class JointController(ABC, Generic[F]):
    """A controller of joints as a control file has it; each kind is a subclass.

    Attributes:
        parameters: the dataclass of the kind's parameters.
        joints_parameter: that of them which names joints.
        name: of its node.
        values: its parameters as they are given, dotted name to value.
        config: the same, checked.
    """

    parameters: ClassVar[Any]
    joints_parameter: ClassVar[str] = "joints"
    config: Any

    def __init__(self, name: str, values: Mapping[str, Any] = MappingProxyType({})) -> None:
        """Check parameters.

        Raises:
            ConfigError: with every problem.
        """
        self.name, self.values = name, values
        self.config = self._read(values)

    @classmethod
    def _read(cls, values: Mapping[str, Any]) -> Any:
        return read(cls.parameters, values)

    @classmethod
    def unknown(cls, names: Iterable[str]) -> list[Problem]:
        """Return a problem for each of ``names`` that is no parameter of this kind."""
        return unknown_parameters(cls.parameters, names)

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that its parameters name; empty: all that can be commanded."""
        return tuple(self.config.joints)

    @abstractmethod
    def follower(self, joints: Sequence[FollowedJoint], positions: Sequence[float]) -> F:
        """Return what moves ``joints``, which are at ``positions``, rad or m."""

    @abstractmethod
    def configure(self, follower: F) -> None:
        """Apply its parameters to a follower that had others."""


class TrajectoryController(JointController[TrajectoryFollower]):
    """joint_trajectory_controller."""

    parameters = TrajectoryConfig
    config: TrajectoryConfig

    @classmethod
    def _read(cls, values: Mapping[str, Any]) -> TrajectoryConfig:
        return TrajectoryConfig.from_parameters(values)

    @classmethod
    def unknown(cls, names: Iterable[str]) -> list[Problem]:
        """Return a problem for each of ``names`` that is no parameter, of single joints too."""
        return unknown_trajectory_parameters(names)

    def follower(
        self, joints: Sequence[FollowedJoint], positions: Sequence[float]
    ) -> TrajectoryFollower:
        """Return what follows trajectories of ``joints``, which are at ``positions``, rad or m."""
        constraints = joint_constraints(self.values, [joint.name for joint in joints])
        return TrajectoryFollower(joints, self.config, constraints, positions)

    def configure(self, follower: TrajectoryFollower) -> None:
        """Apply its parameters to a follower that had others.

        Raises:
            ConfigError: those of single joints are wrong.
        """
        follower.configure(self.config, joint_constraints(self.values, follower.names))


class ForwardController(JointController[PositionForwarder]):
    """forward_command_controller for positions."""

    parameters = ForwardConfig
    config: ForwardConfig

    def follower(
        self, joints: Sequence[FollowedJoint], positions: Sequence[float]
    ) -> PositionForwarder:
        """Return what holds ``joints`` where they are commanded; they are at ``positions``."""
        return PositionForwarder(joints, positions)

    def configure(self, follower: PositionForwarder) -> None:
        """Do nothing: what its parameters have is read at the start."""


class GripperController(JointController[GripperFollower]):
    """parallel_gripper_action_controller."""

    parameters = GripperConfig
    joints_parameter = "joint"
    config: GripperConfig

    @property
    def joints(self) -> tuple[str, ...]:
        """Its only joint."""
        return (self.config.joint,)

    def follower(
        self, joints: Sequence[FollowedJoint], positions: Sequence[float]
    ) -> GripperFollower:
        """Return what moves its joint to goals; it is at the only one of ``positions``."""
        return GripperFollower(joints, self.config, positions)

    def configure(self, follower: GripperFollower) -> None:
        """Apply its parameters to a follower that had others."""
        follower.configure(self.config)


JOINT_CONTROLLERS: Mapping[str, type[JointController[Any]]] = {
    "joint_trajectory_controller/JointTrajectoryController": TrajectoryController,
    "forward_command_controller/ForwardCommandController": ForwardController,
    "position_controllers/JointGroupPositionController": ForwardController,
    "parallel_gripper_action_controller/GripperActionController": GripperController,
}
"""The kinds of controllers by their types."""


@contextmanager
def named(name: str, places: Mapping[str, str] = MappingProxyType({})) -> Iterator[None]:
    """Have errors about parameters name their controller, as in arm_controller.joints.

    ``places`` are files and lines of the parameters, by such names.
    """
    try:
        yield
    except ConfigError as error:
        problems = [Problem(f"{name}.{each.key}", each.text) for each in error.problems]
        raise ConfigError(problems, places) from None
