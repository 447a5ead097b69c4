"""The kinds of joint controllers, by the types that control files name. No ROS here."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, Generic, TypeVar

from onebot_control.conventions import DEFAULT_JOINT_CONTROLLER
from onebot_control.trajectories.following import JointFollower, TrajectoryFollower
from onebot_control.trajectories.forwarding import PositionForwarder
from onebot_control.trajectories.gripping import GripperCommandFollower, GripperFollower
from onebot_description.parameters.reader import ConfigError, Problem, read

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
        self.config: Any = read(kind.parameters, values)


JOINT_CONTROLLERS: Mapping[str, type[JointFollower]] = {
    "joint_trajectory_controller/JointTrajectoryController": TrajectoryFollower,
    "forward_command_controller/ForwardCommandController": PositionForwarder,
    "position_controllers/JointGroupPositionController": PositionForwarder,
    "parallel_gripper_action_controller/GripperActionController": GripperFollower,
    "position_controllers/GripperActionController": GripperCommandFollower,
}
"""The supported kinds of joint controllers, by ros2_control type."""


DEFAULT_CONTROLLER = JointController(TrajectoryFollower, DEFAULT_JOINT_CONTROLLER)
"""The joint controller that is used if the control file names none."""


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
