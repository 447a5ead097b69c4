"""``BufferClient``: queries the buffer of another node through an action."""

import threading
from typing import Any

import builtin_interfaces.msg
from geometry_msgs.msg import TransformStamped
from rclpy.action.client import ActionClient
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time
from tf2_msgs.action import LookupTransform
from tf2_py import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from tf2_ros.buffer_interface import BufferInterface

_EXCEPTIONS = {  # constants of tf2_msgs/msg/TF2Error
    1: LookupException,
    2: ConnectivityException,
    3: ExtrapolationException,
    4: InvalidArgumentException,
    5: TimeoutException,
}
_SUSPECT = "Something is likely wrong with the server."


class BufferClient(BufferInterface):
    """Looks up transforms in the buffer of a server, such as tf2_ros's ``buffer_server``.

    Another thread has to run the node's callbacks meanwhile.

    Args:
        node: the node of the action client.
        ns: the name of the action.
        check_frequency: as in the genuine client; an answer is noticed immediately.
        timeout_padding: how long to wait for an answer beyond the timeout of the look-up.
    """

    def __init__(
        self,
        node: Node,
        ns: str,
        check_frequency: float = 10.0,
        timeout_padding: Duration = Duration(seconds=2.0),  # noqa: B008
    ) -> None:
        super().__init__()
        self.node = node
        self.action_client = ActionClient(node, LookupTransform, action_name=ns)
        self.check_frequency = check_frequency
        self.timeout_padding = timeout_padding

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> TransformStamped:
        """Return the transform from the source frame to the target frame."""
        goal = LookupTransform.Goal()
        goal.target_frame, goal.source_frame = target_frame, source_frame
        goal.source_time, goal.timeout = _message(time), timeout.to_msg()
        return self._ask(goal)

    def lookup_transform_full(
        self,
        target_frame,
        target_time,
        source_frame,
        source_time,
        fixed_frame,
        timeout=Duration(),  # noqa: B008
    ) -> TransformStamped:
        """Return the transform between two times, through a frame that is fixed in between."""
        goal = LookupTransform.Goal()
        goal.target_frame, goal.source_frame = target_frame, source_frame
        goal.target_time, goal.source_time = _message(target_time), _message(source_time)
        goal.fixed_frame, goal.timeout, goal.advanced = fixed_frame, timeout.to_msg(), True
        return self._ask(goal)

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> bool:
        """Return whether there is a transform."""
        try:
            self.lookup_transform(target_frame, source_frame, time, timeout)
        except TransformException:
            return False
        return True

    def can_transform_full(
        self,
        target_frame,
        target_time,
        source_frame,
        source_time,
        fixed_frame,
        timeout=Duration(),  # noqa: B008
    ) -> bool:
        """Return whether there is a transform between two times."""
        arguments = target_frame, target_time, source_frame, source_time, fixed_frame
        try:
            self.lookup_transform_full(*arguments, timeout)
        except TransformException:
            return False
        return True

    def _ask(self, goal: Any) -> TransformStamped:
        if not self.action_client.server_is_ready():
            raise TimeoutException("The BufferServer is not ready.")
        answered = threading.Event()
        future = self.action_client.send_goal_async(goal)
        future.add_done_callback(lambda _: answered.set())
        padding_ns = getattr(self.timeout_padding, "nanoseconds", 0)
        patience = (Duration.from_msg(goal.timeout).nanoseconds + padding_ns) / 1e9
        # The genuine client looks for the answer once before it gives up, after one period.
        answered.wait(max(patience, 1.0 / self.check_frequency))
        unanswered = "The LookupTransform goal sent to the BufferServer did not come back"
        if not future.done():
            raise TimeoutException(f"{unanswered} in the specified time. {_SUSPECT}")
        handle = future.result()
        if not handle.accepted:
            raise TimeoutException(f"{unanswered} with accepted status. {_SUSPECT}")
        result = self.action_client._get_result(handle).result
        if result.error.error:
            kind = _EXCEPTIONS.get(result.error.error, TransformException)
            raise kind(result.error.error_string)
        return result.transform

    def destroy(self) -> None:
        """Destroy the action client."""
        self.action_client.destroy()


def _message(time: Any) -> Any:
    if isinstance(time, builtin_interfaces.msg.Time):  # the stamp of the data is a message, too
        return time
    if isinstance(time, Time):
        return time.to_msg()
    raise TypeError("Must pass a rclpy.time.Time object.")
