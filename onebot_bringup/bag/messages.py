"""What a recording holds, whatever the format of its files."""

from dataclasses import dataclass, field
from typing import NamedTuple


class BagMessage(NamedTuple):
    """A recorded message.

    Attributes:
        topic: its name.
        type: ``package/msg/Type``.
        time: when it was received, nanoseconds.
        data: CDR, as on the wire.
    """

    topic: str
    type: str
    time: int
    data: bytes


@dataclass(frozen=True)
class Contents:
    """The topics of a file with their types, and the number of messages (0: not known)."""

    topics: dict[str, str] = field(default_factory=dict)
    count: int = 0
