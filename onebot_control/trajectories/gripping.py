"""Moves a gripper, like parallel_gripper_action_controller. It does not use ROS.

Example:
    >>> from onebot_control.trajectories.goal import FollowedJoint
    >>> from onebot_control.trajectories.gripping import GripperConfig, GripperFollower, GripperGoal
    >>> from onebot_control.trajectories.trajectory import JointMotion
    >>> gripper = GripperFollower([FollowedJoint("finger")], GripperConfig("finger"), [0.04])
    >>> gripper.start(GripperGoal((0.0,)), token="mine")
    >>> measured = JointMotion((0.0005,), (0.0,), ())  # m, m/s
    >>> [outcome] = gripper.update(measured, now=0, period=0.01)  # once per control cycle
    >>> outcome.text
    'Reached the goal'
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from onebot_control.trajectories.config import JointControllerConfig
from onebot_control.trajectories.following import (
    GOAL_TOLERANCE_VIOLATED,
    PREEMPTED,
    ROUNDING,
    SUCCESSFUL,
    Outcome,
)
from onebot_control.trajectories.forwarding import PositionForwarder
from onebot_control.trajectories.goal import MotorLimits
from onebot_control.trajectories.trajectory import JointMotion
from onebot_description.parameters.reader import REQUIRED, ignored, parameter
from onebot_description.parameters.values import LARGEST

_AT_ONCE = "the limits of the motor are set directly"


@dataclass(frozen=True)
class GripperCommandConfig(JointControllerConfig):
    """gripper_controllers' parameters."""

    joints_parameter = "joint"

    joint: str = parameter(REQUIRED, "joint to move", not_empty=True, read_only=True)
    goal_tolerance: float = parameter(
        0.01, "the goal is reached below this position error, rad or m", at_least=0.0
    )
    allow_stalling: bool = parameter(False, "whether a goal also succeeds if the joint stalls")
    stall_velocity_threshold: float = parameter(
        0.001, "up to this velocity, the joint stands still, rad/s or m/s"
    )
    stall_timeout: float = parameter(
        1.0, "time of standing still after which the joint stalls, s", at_least=0.0
    )
    action_monitor_rate: float = parameter(
        20.0, "rate of the action's feedback, Hz", at_least=0.1, read_only=True
    )
    max_effort: float = parameter(
        0.0, "maximum effort of goals without an effort, N or Nm; 0: from <limit>", at_least=0.0
    )


@dataclass(frozen=True)
class GripperConfig(GripperCommandConfig):
    """parallel_gripper_action_controller's parameters."""

    max_velocity: float = parameter(
        0.0, "maximum velocity of goals without one, m/s or rad/s; 0: from <limit>", at_least=0.0
    )
    state_interfaces: tuple[str, ...] = ignored(
        ("position", "velocity"), "position, velocity and effort are measured"
    )
    max_effort_interface: str = ignored("", _AT_ONCE)
    max_velocity_interface: str = ignored("", _AT_ONCE)


class GripperGoal(NamedTuple):
    """A goal of a gripper, as sent by a client."""

    positions: Sequence[float]  # one position, rad or m
    effort: float = 0.0  # maximum effort, Nm or N; 0: from the parameter
    velocity: float = 0.0  # maximum velocity, rad/s or m/s; 0: from the parameter


class GripperFollower(PositionForwarder):
    """Moves one joint to the position of a goal, until it is reached or the joint stalls.

    In both cases, the position remains commanded, so that a gripped object is held.

    Attributes:
        reached: whether the last goal was reached.
        stalled: whether the joint stalled before the last goal.
    """

    parameters: ClassVar[type[JointControllerConfig]] = GripperConfig
    field = "command.position"
    reached = stalled = False
    _config: GripperCommandConfig
    _goal = GripperGoal(())

    @property
    def motor_limits(self) -> MotorLimits:
        """The limits of the goal, or else of the parameters."""
        return MotorLimits(
            self._goal.effort or self._config.max_effort,
            self._goal.velocity or getattr(self._config, "max_velocity", 0.0),
        )

    def goal_problems(self, goal: GripperGoal) -> list[str]:
        """Return why a goal is rejected, one line per reason."""
        return self.problems(goal.positions) + [
            f"command.{name}: {value:g} is not a number from 0 to {LARGEST:g}"
            for name, value in (("effort", goal.effort), ("velocity", goal.velocity))
            if not 0.0 <= value <= LARGEST
        ]

    def start(self, goal: GripperGoal, token: object) -> Outcome | None:
        """Move to a position; return the outcome of the preempted goal.

        Args:
            goal: the goal; ``goal_problems`` must have found none.
            token: identifies the goal in ``active`` and in its outcome.
        """
        preempted = self._ended(PREEMPTED)
        self._goal = goal
        self.command(goal.positions)
        self.active = token
        self.reached = self.stalled = False
        self._still = 0.0  # s for which the joint has stood still
        return preempted

    def abort(self, text: str) -> Outcome | None:
        """Abort the goal, and stop; without a goal, continue to hold a gripped object."""
        return None if self.active is None else super().abort(text)

    def update(self, measured: JointMotion, now: int, period: float) -> list[Outcome]:
        """Run one control cycle; see ``TrajectoryFollower.update``."""
        super().update(measured, now, period)
        if self.active is None:
            return []
        [goal], [position], [velocity] = self._commanded, measured.positions, measured.velocities
        if abs(goal - position) < self._config.goal_tolerance:
            self.reached = True
            return self._judged(SUCCESSFUL, "Reached the goal", position)
        if abs(velocity) > self._config.stall_velocity_threshold:
            self._still = 0.0
        elif self._still > self._config.stall_timeout + ROUNDING:
            self.stalled = True
            code = SUCCESSFUL if self._config.allow_stalling else GOAL_TOLERANCE_VIOLATED
            return self._judged(code, "Stalled on the way to the goal", position)
        self._still += period
        return []

    def _judged(self, code: int, text: str, position: float) -> list[Outcome]:
        """End the goal; the position remains commanded."""
        token, self.active = self.active, None
        detail = f"{self.names[0]}: position {position:.6g}, goal {self._commanded[0]:.6g}"
        return [Outcome(token, code, text, detail)]


class GripperCommandFollower(GripperFollower):
    """The same with the parameters of gripper_controllers, which have the older action."""

    parameters = GripperCommandConfig
