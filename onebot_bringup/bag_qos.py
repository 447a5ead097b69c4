"""How a bag recorder hears a topic: as reliably as all of its publishers offer, and no more."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

from onebot_bringup.bag.metadata import Qos

_DEPTH = 1000  # what may queue up while the disk is slow: 10 s at 100 Hz
_FOREVER = 2**63 - 1  # ns; how DDS says that there is no limit
_LIVELINESS = {
    LivelinessPolicy.AUTOMATIC: "automatic",
    LivelinessPolicy.MANUAL_BY_TOPIC: "manual_by_topic",
}


def offered_qos(profile: QoSProfile) -> Qos:
    """Return what a publisher offers in rosbag2's words; DDS does not tell its history."""
    reliable = profile.reliability == ReliabilityPolicy.RELIABLE
    latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return Qos(
        reliability="reliable" if reliable else "best_effort",
        durability="transient_local" if latched else "volatile",
        liveliness=_LIVELINESS.get(profile.liveliness, "automatic"),
        deadline=_limit(profile.deadline),
        lifespan=_limit(profile.lifespan),
        lease=_limit(profile.liveliness_lease_duration),
    )


def _limit(duration: Any) -> int | None:
    return int(duration.nanoseconds) if 0 < duration.nanoseconds < _FOREVER else None


@dataclass(frozen=True)
class Wish:
    """How a topic is heard.

    Attributes:
        type: of its messages.
        reliable: a message that is lost on the way is sent again.
        latched: late comers get the last message.
    """

    type: str
    reliable: bool = True
    latched: bool = False

    @classmethod
    def of(cls, kind: str, offers: Iterable[Qos]) -> "Wish":
        """Return how to hear all who offer this: who asks for more hears nothing of some."""
        known = list(offers)
        return cls(
            kind,
            all(offer.reliability == "reliable" for offer in known),
            all(offer.durability == "transient_local" for offer in known),
        )

    def asks_more_than(self, other: "Wish") -> bool:
        """Return whether a publisher that offers just what ``other`` asks for is not heard."""
        return (self.reliable and not other.reliable) or (self.latched and not other.latched)

    @property
    def profile(self) -> QoSProfile:
        """The same for a subscription."""
        reliable, latched = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
        return QoSProfile(
            depth=_DEPTH,
            reliability=reliable if self.reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=latched if self.latched else DurabilityPolicy.VOLATILE,
        )
