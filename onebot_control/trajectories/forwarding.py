"""Forwards positions to joints as forward_command_controller does. No ROS here.

forwarder = PositionForwarder([FollowedJoint("elbow")], [0.0])
forwarder.command([0.5])  # the motors' limits of velocity make a run of this jump
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from onebot_control.drive.speed_limiter import clamp
from onebot_control.trajectories.following import Outcome
from onebot_control.trajectories.goal import FollowedJoint, field_problems
from onebot_control.trajectories.trajectory import JointMotion
from onebot_description.ros.parameters.reader import REQUIRED, Problem, parameter


@dataclass(frozen=True)
class ForwardConfig:
    """forward_command_controller's parameters; only positions are commanded."""

    joints: tuple[str, ...] = parameter(
        REQUIRED,
        "the joints it moves, in the order of the values",
        not_empty=True,
        unique=True,
        read_only=True,
    )
    interface_name: str = parameter("position", "what is commanded: position", read_only=True)

    def check(self) -> Iterator[Problem]:
        """Report what forward_command_controller can do and this one cannot."""
        if self.interface_name != "position":
            text = "only position, no other kind of command; write position"
            yield Problem("interface_name", text)


class PositionForwarder:
    """Holds joints at the positions that were commanded last, within their limits.

    Attributes:
        joints: with their limits.
        names: of the joints.
    """

    field = "data"  # of the message that has the positions

    def __init__(self, joints: Sequence[FollowedJoint], positions: Sequence[float]) -> None:
        """Hold ``positions``, rad or m."""
        self.joints = tuple(joints)
        self.names = tuple(joint.name for joint in joints)
        self.command(positions)

    def problems(self, positions: Sequence[float]) -> list[str]:
        """Return why ``positions`` are refused, a line for each reason."""
        limits = {joint.name: joint for joint in self.joints}
        return [*field_problems(self.field, self.names, positions, limits)]

    def command(self, positions: Sequence[float]) -> None:
        """Hold ``positions``, rad or m, which have no problems."""
        self._stopping = False
        self._commanded = [
            clamp(position, joint.lower, joint.upper)
            for joint, position in zip(self.joints, positions, strict=True)
        ]

    def stop(self) -> None:
        """Hold the positions that are measured at the next update."""
        self._stopping = True

    def abort(self, text: str) -> Outcome | None:
        """Stop, as if deactivated and activated again."""
        self.stop()
        return None

    def reset(self, positions: Sequence[float]) -> Outcome | None:
        """Hold ``positions``, rad or m, to which the joints were moved."""
        self.command(positions)
        return None

    def update(self, measured: JointMotion, now: int, period: float) -> list[Outcome]:
        """Do one control cycle; see ``TrajectoryFollower.update``."""
        if self._stopping:
            self.command(measured.positions)
        return []

    def reference(self, ahead: float) -> Sequence[float]:
        """Return the positions to command, rad or m, whichever time is ``ahead``."""
        return self._commanded
