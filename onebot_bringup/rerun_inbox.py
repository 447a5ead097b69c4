"""Keeps the raw messages of /tf and joint_states until they are shown, and decodes them together.

A message that comes costs next to nothing; all of one publisher are decoded in one go.
"""

from collections.abc import Callable

from onebot_bringup.raw_messages import joint_state_batch, tf_batch
from onebot_bringup.viewer.live_view import LiveView

_STAMP = slice(4, 12)  # of a message that begins with a header
_NO_STAMP = bytes(8)


class Inbox:
    """What has come for a view since it was handed over last."""

    def __init__(
        self,
        live: LiveView,
        complain: Callable[[str, Exception], object],
        now_ns: Callable[[], int],
        joint_topic: str = "joint_states",
    ) -> None:
        """Hand over to ``live``.

        Args:
            live: the view.
            complain: is told of a message that is none: its topic, and what is wrong.
            now_ns: the time now, nanoseconds, for JointStates without one.
            joint_topic: how to name that topic.
        """
        self._live, self._complain, self._now_ns = live, complain, now_ns
        self._joint_topic = joint_topic
        self._tf: list[bytes] = []
        self._joints: list[bytes] = []
        self._came: dict[int, int] = {}  # place among the JointStates -> when, if it does not say

    def add_transforms(self, data: bytes) -> None:
        """Take in a serialized TFMessage of /tf."""
        self._tf.append(data)

    def add_joints(self, data: bytes) -> None:
        """Take in a serialized JointState."""
        if data[_STAMP] == _NO_STAMP:
            self._came[len(self._joints)] = self._now_ns()
        self._joints.append(data)

    def hand_over(self, *, joints: bool = True) -> None:
        """Give the view what has come; without ``joints`` those stay until the next time."""
        messages, self._tf = self._tf, []
        for transforms in tf_batch(messages, lambda error: self._complain("/tf", error)):
            if transforms is not None:
                self._live.add_transforms(transforms)
        if joints:
            self._hand_over_joints()

    def _hand_over_joints(self) -> None:
        messages, self._joints = self._joints, []
        came, self._came = self._came, {}
        states = joint_state_batch(messages, lambda error: self._complain(self._joint_topic, error))
        for at, state in enumerate(states):
            if state is not None:
                stamp = state.stamp_ns or came.get(at, 0) or self._now_ns()
                self._live.add_joints(stamp, state.names, state.positions, state.velocities)
