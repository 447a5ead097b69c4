"""``BufferClient``: queries the buffer of another node through an action."""

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.action.client import ActionClient
from rclpy.duration import Duration
from tf2_msgs.action import LookupTransform
from tf2_py import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from tf2_ros.buffer_interface import NO_TIMEOUT, BufferInterface

_EXCEPTIONS = {  # constants of tf2_msgs/msg/TF2Error
    1: LookupException,
    2: ConnectivityException,
    3: ExtrapolationException,
    4: InvalidArgumentException,
    5: TimeoutException,
}
_PADDING = Duration(seconds=2.0)
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

    def __init__(self, node, ns, check_frequency=10.0, timeout_padding=_PADDING) -> None:
        super().__init__()
        self.node = node
        self.action_client = ActionClient(node, LookupTransform, action_name=ns)
        self.check_frequency = check_frequency
        self.timeout_padding = timeout_padding

    def lookup_transform(
        self, target_frame, source_frame, time, timeout=NO_TIMEOUT
    ) -> TransformStamped:
        """Return the transform from the source frame to the target frame."""
        goal = LookupTransform.Goal(target_frame=target_frame, source_frame=source_frame)
        goal.source_time, goal.timeout = _message(time), timeout.to_msg()
        return self._ask(goal)

    def lookup_transform_full(
        self, target_frame, target_time, source_frame, source_time, fixed_frame, timeout=NO_TIMEOUT
    ) -> TransformStamped:
        """Return the transform between two times, through a frame that is fixed in between."""
        goal = LookupTransform.Goal(target_frame=target_frame, source_frame=source_frame)
        goal.target_time, goal.source_time = _message(target_time), _message(source_time)
        goal.fixed_frame, goal.timeout, goal.advanced = fixed_frame, timeout.to_msg(), True
        return self._ask(goal)

    def can_transform(self, *args: Any, **kwargs: Any) -> bool:
        """Return whether there is a transform; the arguments are those of lookup_transform."""
        return _succeeds(self.lookup_transform, *args, **kwargs)

    def can_transform_full(self, *args: Any, **kwargs: Any) -> bool:
        """Return whether there is a transform between two times; see lookup_transform_full."""
        return _succeeds(self.lookup_transform_full, *args, **kwargs)

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


def _succeeds(lookup: Callable[..., Any], *args: Any, **kwargs: Any) -> bool:
    with suppress(TransformException):
        lookup(*args, **kwargs)
        return True
    return False


def _message(time: Any) -> Any:
    return time.to_msg() if hasattr(time, "to_msg") else time  # the stamp of the data is a message
