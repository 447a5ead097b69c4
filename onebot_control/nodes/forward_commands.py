"""forward_command_controller's ROS interface: the topic of one controller."""

from collections.abc import Callable, Sequence
from typing import Any

from std_msgs.msg import Float64MultiArray

from onebot_control.nodes.controller_node import ControllerNode
from onebot_control.trajectories.forwarding import PositionForwarder
from onebot_description.errors import first_of


class ForwardCommands(ControllerNode[PositionForwarder]):
    """The ROS interface of a controller that forwards positions to joints: ~/commands."""

    def __init__(self, *arguments: Any) -> None:
        """Subscribe to the topic, and declare parameters; see ``ControllerNode``."""
        super().__init__(*arguments)
        self._subscribe(Float64MultiArray, "~/commands", self._prepare)

    def _prepare(self, message: Float64MultiArray) -> Callable[[], None] | None:
        arm, positions = self._arm, list(message.data)
        if problems := arm.problems(positions):
            self._error("refused", f"~/commands is ignored: {first_of(problems)}")
            return None
        return lambda: self._command(arm, positions)

    def _command(self, arm: PositionForwarder, positions: Sequence[float]) -> None:
        """Command checked positions; runs in the control thread."""
        if refused := self._refused():
            self._error("locked", f"~/commands is ignored: {refused}")
        else:
            arm.command(positions)
