"""Warns if stamps come from a wrong clock, such as another computer's."""

from collections.abc import Callable

from rclpy.node import Node

from onebot_description.ros.wire.cdr import HEADER, SYSTEM_TIME_NS, stamp_at
from onebot_description.timing import NS_PER_S
from onebot_description.timing.throttled import Throttled

# Time between two samples; a check between them costs a tenth of a microsecond.
_PERIOD_NS = NS_PER_S
_SAMPLES = 5
_LIMIT_NS = NS_PER_S // 2  # a larger difference means a wrong clock
_STEADY_NS = NS_PER_S // 2  # samples of one clock differ by less
_EVERY = 60.0  # s between two warnings


class StampCheck:
    """Compares the stamps of one topic with the time when they are received."""

    def __init__(
        self, topic: str, log: Callable[[str], object], is_simulated: Callable[[], bool]
    ) -> None:
        """Compare the stamps of ``topic``, and log differences.

        Args:
            topic: the topic, for the message.
            log: logs a warning.
            is_simulated: returns whether time is simulated, so that stamps are not compared.
        """
        self._topic, self._is_simulated = topic, is_simulated
        self._warn = Throttled(log, _EVERY)
        self._sampled_ns = 0
        self._ahead: list[int] = []  # how far stamps are ahead, ns

    @classmethod
    def from_topic(cls, node: Node, topic: str) -> "StampCheck":
        """Return a StampCheck for a topic that a node subscribes to."""

        def is_simulated() -> bool:
            simulated = node.get_parameter("use_sim_time").value
            return bool(simulated or node.count_publishers("/clock"))

        return cls(node.resolve_topic_name(topic), node.get_logger().warning, is_simulated)

    def take_bytes(self, data: bytes, now_ns: int, at: int = HEADER) -> None:
        """Check a serialized message, received at ``now_ns``, whose stamp is at byte ``at``."""
        if abs(now_ns - self._sampled_ns) >= _PERIOD_NS:
            self._sample(stamp_at(data, at), now_ns)

    def take(self, stamp_ns: int, now_ns: int) -> None:
        """Check a message with this stamp, received at ``now_ns``."""
        if abs(now_ns - self._sampled_ns) >= _PERIOD_NS:
            self._sample(stamp_ns, now_ns)

    def _sample(self, stamp_ns: int, now_ns: int) -> None:
        self._sampled_ns = now_ns
        if min(stamp_ns, now_ns) < SYSTEM_TIME_NS:
            return
        self._ahead.append(stamp_ns - now_ns)
        if len(self._ahead) < _SAMPLES:
            return
        samples, self._ahead = self._ahead, []
        offset = min(samples, key=abs)
        steady = max(samples) - min(samples) <= _STEADY_NS
        if abs(offset) > _LIMIT_NS and steady and not self._is_simulated():
            self._warn("offset", self._text(offset))

    def _text(self, ahead_ns: int) -> str:
        side = "ahead of" if ahead_ns > 0 else "behind"
        return (
            f"stamps of {self._topic} are {abs(ahead_ns) / NS_PER_S:.1f} s {side} this computer's "
            "clock: synchronize the clocks of all computers with chrony or NTP"
        )
