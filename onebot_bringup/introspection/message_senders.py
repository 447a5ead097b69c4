"""Which publisher sent a message: rclpy does not pass this on, but rcl does."""

import ctypes
from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.type_support import check_for_type_support

_GID_SIZE = 16  # bytes, RMW_GID_STORAGE_SIZE
_MOST_WAITING = 100  # messages
_UNKNOWN = "_NODE_NAME_UNKNOWN_"
_PARTICIPANT_SIZE = 12  # bytes of a GID that all publishers of a process share (RTPS 2.2, 8.2.4)


class Sender(NamedTuple):
    """The node that sent a message; those of one name in two processes are two."""

    participant: bytes
    name: str  # of the node, in full


class _Allocator(ctypes.Structure):
    """rcutils_allocator_t."""

    _fields_ = tuple(
        (name, ctypes.c_void_p) for name in ("allocate", "free", "resize", "zeroed", "state")
    )


class _Bytes(ctypes.Structure):
    """rcutils_uint8_array_t."""

    _fields_ = (
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", _Allocator),
    )


class _MessageInfo(ctypes.Structure):
    """rmw_message_info_t."""

    _fields_ = (
        ("source_timestamp", ctypes.c_int64),
        ("received_timestamp", ctypes.c_int64),
        ("publication_number", ctypes.c_uint64),
        ("reception_number", ctypes.c_uint64),
        ("implementation", ctypes.c_void_p),
        ("gid", ctypes.c_uint8 * _GID_SIZE),
        ("reserve", ctypes.c_uint8 * 64),  # what a later ROS may add
    )


class SenderSubscription:
    """Receives the messages of a topic, each with its sender, when it is asked for them.

    An executor knows nothing of it. Senders are only found where the GID of a message is that of
    the publisher in the ROS graph, as with Fast DDS.
    """

    def __init__(self, node: Node, topic: str, kind: Any, qos: QoSProfile) -> None:
        """Subscribe.

        Args:
            node: that subscribes.
            topic: the full name.
            kind: of the messages, a class.
            qos: with the depth for what comes between two calls of ``take``.
        """
        self._node, self._topic = node, topic
        # The symbols of rcl and rcutils are found by way of the module that is linked to them.
        self._rcl = ctypes.CDLL(rclpy_implementation.__file__)
        self._rcl.rcutils_get_default_allocator.restype = _Allocator
        self._data = _Bytes(allocator=self._rcl.rcutils_get_default_allocator())
        self._info = _MessageInfo()
        self._senders: dict[bytes, Sender] = {}
        self._waiting: deque[tuple[bytes, bytes]] = deque(maxlen=_MOST_WAITING)
        check_for_type_support(kind)
        with node.handle:
            self._subscription = rclpy_implementation.Subscription(
                node.handle, kind, topic, qos.get_c_qos_profile()
            )

    def take(self) -> Iterator[tuple[Sender, bytes]]:
        """Yield the messages that came since the last call.

        Those of a sender that is not discovered yet are kept for the next one.
        """
        messages = [*self._waiting, *iter(self._take_one, None)]
        if any(gid not in self._senders for gid, _ in messages):
            self._senders = self._known_senders()
        self._waiting.clear()
        for gid, data in messages:
            if gid in self._senders:
                yield self._senders[gid], data
            else:
                self._waiting.append((gid, data))

    def senders(self) -> set[Sender]:
        """Return the nodes that publish the topic now."""
        self._senders = self._known_senders()
        return set(self._senders.values())

    def close(self) -> None:
        """End the subscription."""
        self._subscription.destroy_when_not_in_use()
        self._rcl.rcutils_uint8_array_fini(ctypes.byref(self._data))

    def _take_one(self) -> tuple[bytes, bytes] | None:
        """Return the publisher's GID and the message; None if there is none."""
        with self._subscription:
            failed = self._rcl.rcl_take_serialized_message(
                ctypes.c_void_p(self._subscription.pointer),
                ctypes.byref(self._data),
                ctypes.byref(self._info),
                None,
            )
        if failed:
            return None
        return bytes(self._info.gid), ctypes.string_at(self._data.buffer, self._data.length)

    def _known_senders(self) -> dict[bytes, Sender]:
        return {
            gid: Sender(gid[:_PARTICIPANT_SIZE], name)
            for gid, name in publishers(self._node, self._topic).items()
        }


def publishers(node: Node, topic: str) -> dict[bytes, str]:
    """Return the full names of the nodes that publish a topic, by the GIDs of their publishers.

    A node's name is discovered after its publishers; until then they are left out.

    Args:
        node: whose knowledge of the ROS graph is used.
        topic: the full name.
    """
    return {
        bytes(end.endpoint_gid): f"{end.node_namespace.rstrip('/')}/{end.node_name}"
        for end in node.get_publishers_info_by_topic(topic)
        if end.node_name != _UNKNOWN
    }
