"""Forwards positions to joints, like forward_command_controller. It does not use ROS.

Example:
    >>> from onebot_control.trajectories.forwarding import ForwardConfig, PositionForwarder
    >>> from onebot_control.trajectories.goal import FollowedJoint
    >>> forwarder = PositionForwarder([FollowedJoint("elbow")], ForwardConfig(("elbow",)), [0.0])
    >>> forwarder.command([0.5])  # a jump; the motor moves there at its velocity limit
    >>> forwarder.reference(0.0)
    [0.5]
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from onebot_control.trajectories.config import JointControllerConfig
from onebot_control.trajectories.following import RESET, JointFollower, Outcome
from onebot_control.trajectories.goal import field_problems
from onebot_control.trajectories.trajectory import JointMotion
from onebot_description.geometry.poses import clamp
from onebot_description.parameters.reader import REQUIRED, parameter


@dataclass(frozen=True)
class ForwardConfig(JointControllerConfig):
    """forward_command_controller's parameters; only positions are commanded."""

    joints: tuple[str, ...] = parameter(
        REQUIRED,
        "joints to move, in the order of the values",
        not_empty=True,
        unique=True,
        read_only=True,
    )
    interface_name: str = parameter(
        "position", "commanded interface; only position has an effect", read_only=True
    )

    @property
    def interfaces(self) -> tuple[str, ...]:
        """The parameter interface_name."""
        return (self.interface_name,)


class PositionForwarder(JointFollower):
    """Holds joints at the last commanded positions, within their limits."""

    parameters: ClassVar[type[JointControllerConfig]] = ForwardConfig
    field = "data"  # name of the message field with the positions, for errors

    def problems(self, positions: Sequence[float]) -> list[str]:
        """Return why ``positions``, rad or m, are rejected, one line per reason."""
        limits = {joint.name: joint for joint in self.joints}
        return [*field_problems(self.field, self.names, positions, limits)]

    def command(self, positions: Sequence[float]) -> None:
        """Hold ``positions``, rad or m; ``problems`` must have found none."""
        self._stopping = False
        self._commanded = [
            clamp(position, joint.lower, joint.upper)
            for joint, position in zip(self.joints, positions, strict=True)
        ]

    def stop(self) -> None:
        """Hold the measured positions of the next update."""
        self._stopping = True

    def cancel(self) -> None:
        """Cancel the goal, and stop."""
        self.active = None
        self.stop()

    def abort(self, text: str) -> Outcome | None:
        """Abort a goal, and stop, as if deactivated and activated again."""
        self.stop()
        return self._ended(text)

    def reset(self, positions: Sequence[float]) -> Outcome | None:
        """Hold ``positions``, rad or m, to which the joints were set; abort a goal."""
        self.command(positions)
        return self._ended(RESET)

    def update(self, measured: JointMotion, now: int, period: float) -> list[Outcome]:
        """Run one control cycle; see ``TrajectoryFollower.update``."""
        if self._stopping:
            self.command(measured.positions)
        return []

    def reference(self, ahead: float) -> Sequence[float]:
        """Return the positions to command, rad or m, which do not depend on ``ahead``."""
        return self._commanded
