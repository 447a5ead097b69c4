"""The kinds of joint controllers, by the types that control files name. No ROS here."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from onebot_control.trajectories.config import JointControllerConfig
from onebot_control.trajectories.following import Outcome, TrajectoryFollower
from onebot_control.trajectories.forwarding import PositionForwarder
from onebot_control.trajectories.goal import FollowedJoint, MotorLimits
from onebot_control.trajectories.gripping import GripperCommandFollower, GripperFollower
from onebot_control.trajectories.trajectory import JointMotion
from onebot_description.parameters.reader import ConfigError, Problem


class JointFollower(Protocol):
    """Moves the joints of one controller, one control cycle at a time; each kind has a class.

    Attributes:
        parameters: dataclass of this kind's parameters.
        joints: the joints, with their limits.
        names: the names of these joints.
    """

    parameters: ClassVar[type[JointControllerConfig]]
    joints: tuple[FollowedJoint, ...]
    names: tuple[str, ...]

    def __init__(
        self, joints: Sequence[FollowedJoint], config: Any, positions: Sequence[float]
    ) -> None:
        """Hold the joints at ``positions``, rad or m; ``config`` is one of ``parameters``."""

    def configure(self, config: Any) -> None:
        """Apply changed parameters."""

    @property
    def motor_limits(self) -> MotorLimits | None:
        """Further limits of the joints' motors from the last update on; None for none."""

    def update(self, measured: JointMotion, now: int, period: float) -> list[Outcome]:
        """Run one control cycle; see ``TrajectoryFollower.update``."""

    def reference(self, ahead: float) -> Sequence[float]:
        """Return the positions to command ``ahead`` seconds after the last update, rad or m."""

    def abort(self, text: str) -> Outcome | None:
        """Hold the joints; abort an action goal with ``text`` as the reason; return its outcome."""

    def reset(self, positions: Sequence[float]) -> Outcome | None:
        """Hold ``positions``, rad or m, where the joints were put; abort an action goal."""


F = TypeVar("F", bound=JointFollower)


class JointController(Generic[F]):
    """A joint controller as control files describe it.

    Attributes:
        kind: the class that moves its joints.
        name: the name of its node.
        values: its parameters as given, dotted name to value.
        config: the same parameters, checked.
    """

    def __init__(
        self, kind: type[F], name: str, values: Mapping[str, Any] = MappingProxyType({})
    ) -> None:
        """Check the parameters ``values`` of the controller ``name``.

        Raises:
            ConfigError: values are wrong; it names each of them.
        """
        self.kind, self.name, self.values = kind, name, values
        self.config: Any = kind.parameters.from_parameters(values)


JOINT_CONTROLLERS: Mapping[str, type[JointFollower]] = {
    "joint_trajectory_controller/JointTrajectoryController": TrajectoryFollower,
    "forward_command_controller/ForwardCommandController": PositionForwarder,
    "position_controllers/JointGroupPositionController": PositionForwarder,
    "parallel_gripper_action_controller/GripperActionController": GripperFollower,
    "position_controllers/GripperActionController": GripperCommandFollower,
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
