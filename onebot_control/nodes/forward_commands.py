"""The ROS interface of forward_command_controller: the topic of one controller."""

from collections.abc import Callable, Sequence

from std_msgs.msg import Float64MultiArray

from onebot_control.nodes.controller_node import ControllerNode, ControllerPlace
from onebot_control.trajectories.forwarding import PositionForwarder
from onebot_description.errors import first_of


class ForwardCommands:
    """The ROS interface of a controller that forwards positions to joints: ~/commands."""

    def __init__(self, place: ControllerPlace) -> None:
        """Subscribe to the topic, and declare parameters."""
        self._host = ControllerNode[PositionForwarder](place)
        self._host.subscribe(Float64MultiArray, "~/commands", self._prepare)

    def _prepare(self, message: Float64MultiArray) -> Callable[[], None] | None:
        follower, positions = self._host.follower, list(message.data)
        if problems := follower.problems(positions):
            self._host.error("refused", f"~/commands is ignored: {first_of(problems)}")
            return None
        return lambda: self._command(follower, positions)

    def _command(self, follower: PositionForwarder, positions: Sequence[float]) -> None:
        """Command checked positions; runs in the control thread."""
        if refused := self._host.place.refused():
            self._host.error("locked", f"~/commands is ignored: {refused}")
        else:
            follower.command(positions)
