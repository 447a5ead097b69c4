"""Which nodes publish each TF frame: one that two publish jumps between two places."""

import math
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from onebot_bringup.introspection.message_senders import Sender, SenderSubscription
from onebot_description.errors import listing
from onebot_description.wire.messages import BAD_MESSAGE, TfArrays, tf_arrays
from onebot_description.wire.tf_message import TFMessage

_RETURNED = 3  # turns: one publisher, another, and the first again (or a third)
_MOST_LISTS = 256  # of names, kept
_LISTED = 5  # frames of a warning


@dataclass(frozen=True)
class Conflict:
    """Frames that the same nodes publish at once."""

    frames: tuple[str, ...]  # child frames, sorted
    publishers: tuple[str, ...]  # names of the nodes, sorted; a name twice for two nodes of it
    parents: tuple[str, ...]  # of the first of these frames, by publisher

    def __str__(self) -> str:
        """Return it as a sentence, with the remedy."""
        nodes = ", ".join(self.publishers)
        which = f"{listing(self.frames, _LISTED)}: published by {nodes} at once"
        if len(set(self.parents)) > 1:
            placed = zip(self.parents, self.publishers, strict=True)
            which += f" ({', '.join(f'in {parent} by {node}' for parent, node in placed)})"
        return (
            f"{which}. Stop one, or give the frames of each robot a prefix of their own "
            "(namespace:=NAME, or frame_prefix:=NAME/)"
        )


@dataclass
class _Frame:
    """A child frame."""

    parents: dict[Sender, str] = field(default_factory=dict)  # by publisher, in order of turns
    latched: bool = False  # one publishes it to /tf_static, once and for all
    turns: int = 0  # how often another publisher than before sent it, up to _RETURNED
    last: Sender | None = None

    @property
    def is_shared(self) -> bool:
        """Whether several publish it now: a successor of one that ended does not count."""
        return len(self.parents) > 1 and (self.latched or self.turns >= _RETURNED)


class FramePublishers:
    """The publishers of each child frame, by the messages of /tf and /tf_static."""

    def __init__(self) -> None:
        """Begin with no frame."""
        self._frames: dict[str, _Frame] = {}
        self._changes = 0
        # By publisher and the identity of its list of frames (which is kept for that), the changes
        # at which it was added: what comes again and again costs next to nothing.
        self._added: dict[tuple[Sender, int], tuple[Sequence[str], int]] = {}

    def add(self, sender: Sender, transforms: TfArrays, *, latched: bool) -> None:
        """Add a message; ``latched`` if it is of /tf_static."""
        children, key = transforms.children, (sender, id(transforms.children))
        if self._added.get(key, (None, -1))[1] == self._changes:
            return
        for parent, child in zip(transforms.parents, children, strict=True):
            self._add(sender, parent, child, latched)
        if len(self._added) >= _MOST_LISTS:
            self._added.clear()
        self._added[key] = children, self._changes

    def _add(self, sender: Sender, parent: str, child: str, latched: bool) -> None:
        frame = self._frames.setdefault(child, _Frame())
        if frame.last != sender and frame.turns < _RETURNED:
            frame.turns += 1
            self._changes += 1
        frame.last = sender
        frame.parents[sender] = parent
        frame.latched |= latched

    def publishers(self, frame: str) -> list[str]:
        """Return the names of the nodes that published a frame, sorted."""
        known = self._frames.get(frame)
        return sorted(sender.name for sender in known.parents) if known else []

    def conflicts(self, running: Collection[Sender]) -> list[Conflict]:
        """Return which frames several of the ``running`` nodes publish at once."""
        shared: dict[tuple[Sender, ...], list[str]] = {}
        for child, frame in self._frames.items():
            senders = sorted(s for s in frame.parents if s in running)
            if frame.is_shared and len(senders) > 1:
                shared.setdefault(tuple(senders), []).append(child)
        return [self._conflict(senders, sorted(frames)) for senders, frames in shared.items()]

    def _conflict(self, senders: Sequence[Sender], frames: Sequence[str]) -> Conflict:
        by_name = sorted(senders, key=lambda sender: sender.name)
        parents = self._frames[frames[0]].parents
        return Conflict(
            tuple(frames),
            tuple(sender.name for sender in by_name),
            tuple(parents[sender] for sender in by_name),
        )


class TfSenders:
    """Receives /tf and /tf_static, each message with its sender."""

    def __init__(self, node: Node, depth: int = 500) -> None:
        """Subscribe on ``node``, for up to ``depth`` messages of a topic between two calls."""
        best_effort = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
        latched = QoSProfile(depth=depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._subscriptions = [
            SenderSubscription(node, topic, TFMessage, qos)
            for topic, qos in (("/tf", best_effort), ("/tf_static", latched))
        ]

    def take(self) -> Iterator[tuple[Sender, TfArrays, bool]]:
        """Yield what came: sender, transforms, and whether they are of /tf_static."""
        for latched, subscription in enumerate(self._subscriptions):
            for sender, data in subscription.take():
                with suppress(*BAD_MESSAGE):
                    yield sender, tf_arrays(data), bool(latched)

    def senders(self) -> set[Sender]:
        """Return the nodes that publish now."""
        return set().union(*(subscription.senders() for subscription in self._subscriptions))

    def close(self) -> None:
        """End the subscriptions."""
        for subscription in self._subscriptions:
            subscription.close()


class FrameConflicts:
    """Finds frames that several nodes publish at once, by receiving /tf for a while now and then.

    All the time it would cost as much as the transforms themselves.
    """

    def __init__(self, node: Node, *, every: float = 30.0, duration: float = 3.0) -> None:
        """Receive for ``duration`` seconds when a publisher comes or goes, and ``every`` so many.

        While one node alone publishes, it does not.
        """
        self._node = node
        self._every, self._duration = every, duration
        self._began = -math.inf  # when it was last begun, seconds
        self._counts: Sequence[int] = ()  # of publishers
        self._senders: TfSenders | None = None  # while it receives

    def poll(self, now: float) -> list[Conflict]:
        """Return what was found; call it some times a second, with the time in seconds."""
        if self._senders is None:
            if self._is_due(now):
                self._began = now
                self._senders, self._publishers = TfSenders(self._node), FramePublishers()
            return []
        for sender, transforms, latched in self._senders.take():
            self._publishers.add(sender, transforms, latched=latched)
        if now - self._began < self._duration:
            return []
        found = self._publishers.conflicts(self._senders.senders())
        self.close()
        return found

    def close(self) -> None:
        """End what is under way."""
        if self._senders is not None:
            self._senders.close()
            self._senders = None

    def _is_due(self, now: float) -> bool:
        counts = [self._node.count_publishers(topic) for topic in ("/tf", "/tf_static")]
        changed, self._counts = counts != self._counts, counts
        return max(counts) > 1 and (changed or now - self._began >= self._every)
