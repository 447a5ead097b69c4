"""The QoS of topics: which subscriptions receive from which publishers."""

from collections.abc import Iterable

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

DEPTH = 10
"""ROS's default depth; an integer as QoS means reliable and volatile, as for drivers."""

# QoS of topics whose last message late subscribers also receive, such as robot_description.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def make_qos(depth: int, *, reliable: bool, latched: bool) -> QoSProfile:
    """Return a QoS; ``latched``: late subscribers also get the last ``depth`` messages."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


ANY_PUBLISHER = make_qos(DEPTH, reliable=False, latched=False)
"""QoS of a subscription that matches any publisher, like SystemDefaultsQoS with Fast DDS."""


def compatible_qos(offers: Iterable[QoSProfile], depth: int) -> QoSProfile:
    """Return the strictest QoS that receives from all publishers.

    A request that is stricter than an offer excludes its publisher, so the result is reliable only
    if all offers are, and transient local only if all offers are. Without offers, it is ROS's
    default, reliable and volatile.
    """
    offers = list(offers)
    reliable = all(map(is_reliable, offers))
    latched = bool(offers) and all(map(is_transient_local, offers))
    return make_qos(depth, reliable=reliable, latched=latched)


def exceeds(qos: QoSProfile, other: QoSProfile) -> bool:
    """Return whether ``qos`` excludes publishers that offer no more than ``other``."""
    return (is_reliable(qos) and not is_reliable(other)) or (
        is_transient_local(qos) and not is_transient_local(other)
    )


def is_reliable(qos: QoSProfile) -> bool:
    """Return whether lost messages are sent again."""
    return bool(qos.reliability == ReliabilityPolicy.RELIABLE)


def is_transient_local(qos: QoSProfile) -> bool:
    """Return whether late subscribers get the last messages."""
    return bool(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL)
