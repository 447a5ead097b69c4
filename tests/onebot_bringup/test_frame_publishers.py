"""Who publishes which TF frame: by messages alone, and on real DDS."""

from collections.abc import Sequence

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped

from onebot_bringup.introspection.frame_publishers import (
    Conflict,
    FrameConflicts,
    FramePublishers,
    TfSenders,
)
from onebot_bringup.introspection.message_senders import Sender
from onebot_description.wire.messages import TfArrays
from onebot_description.wire.tf_message import TFMessage
from tests.ros_support import LATCHED, Peer
from tests.support import wait_for

A, B, C = (Sender(name.encode() * 12, f"/{name}") for name in "abc")


def arrays(*edges: str) -> TfArrays:
    """A message of edges such as "odom base"."""
    parents, children = zip(*(edge.split() for edge in edges), strict=True)
    count = len(edges)
    return TfArrays(
        list(parents),
        list(children),
        np.zeros(count, np.int64),
        np.zeros((count, 3)),
        np.zeros((count, 4)),
    )


def found(
    messages: Sequence[tuple[Sender, TfArrays, bool]], running: Sequence[Sender] = (A, B, C)
) -> list[Conflict]:
    """The conflicts after these messages."""
    publishers = FramePublishers()
    for sender, transforms, latched in messages:
        publishers.add(sender, transforms, latched=latched)
    return publishers.conflicts(running)


BASE, WHEELS, MAP = arrays("odom base"), arrays("base left", "base right"), arrays("map base")


@pytest.mark.parametrize(
    ("messages", "frames", "names"),
    [
        ([(A, BASE), (B, WHEELS)] * 3, (), ()),  # a robot's two nodes
        ([(A, BASE)] * 3 + [(B, BASE)] * 3, (), ()),  # started again
        ([(A, BASE), (B, BASE), (A, BASE)], ("base",), ("/a", "/b")),
        ([(A, BASE), (B, arrays("odom base"))] * 2, ("base",), ("/a", "/b")),
        ([(A, BASE), (B, MAP)] * 2, ("base",), ("/a", "/b")),
        ([(B, BASE)] + [(A, BASE)] * 5 + [(B, BASE)], ("base",), ("/a", "/b")),
        ([(B, WHEELS), (A, WHEELS), (C, BASE)] * 2, ("left", "right"), ("/a", "/b")),
        ([(A, arrays("base left")), (B, WHEELS)] * 2, ("left",), ("/a", "/b")),
        # A node that publishes its frames now together, now one at a time.
        ([(A, arrays("base left")), (A, WHEELS)] * 3, (), ()),
    ],
)
def test_a_frame_that_two_publish_in_turns(
    messages: list[tuple[Sender, TfArrays]], frames: tuple[str, ...], names: tuple[str, ...]
) -> None:
    """Frames and nodes are named; a successor of a node that ended is none of two."""
    conflicts = found([(sender, transforms, False) for sender, transforms in messages])
    assert [(one.frames, one.publishers) for one in conflicts] == ([(frames, names)] * bool(frames))


def test_a_static_frame_comes_once_and_counts() -> None:
    """It is published for good, unless its node has ended; a node may use both topics."""
    assert found([(A, BASE, True), (A, BASE, False)]) == []
    for second in (True, False):
        messages = [(A, BASE, True), (B, MAP, second)]
        assert found(messages) == [Conflict(("base",), ("/a", "/b"), ("odom", "map"))]
        assert found(messages, running=(B,)) == []


def test_the_sentence_names_nodes_frames_and_parents() -> None:
    """The parents only where they differ; two nodes of one name are both there."""
    twin = Sender(b"2" * 12, "/a")
    [conflict] = found([(A, WHEELS, False), (twin, WHEELS, False)] * 2, (A, twin))
    assert str(conflict).startswith("left, right: published by /a, /a at once. Stop one")
    assert "namespace:=NAME" in str(conflict)
    [conflict] = found([(A, BASE, True), (B, MAP, True)])
    assert "published by /a, /b at once (in odom by /a, in map by /b). Stop" in str(conflict)


def test_what_comes_again_is_not_looked_at_again() -> None:
    """However many frames there are: the lists of a publisher are the same objects each time."""

    class Counted(list[str]):
        read = 0

        def __iter__(self):
            Counted.read += 1
            return super().__iter__()

    publishers = FramePublishers()
    one = WHEELS._replace(parents=Counted(WHEELS.parents))
    for _ in range(100):
        publishers.add(A, one, latched=False)
        publishers.add(B, one, latched=False)
    assert Counted.read < 10
    assert publishers.publishers("left") == ["/a", "/b"] and publishers.publishers("x") == []


def edge(parent: str, child: str) -> TFMessage:
    """A message of one transform."""
    message = TFMessage(transforms=[TransformStamped(child_frame_id=child)])
    message.transforms[0].header.frame_id = parent
    return message


def test_publishers_are_named_on_dds(ros_domain: int) -> None:
    """Of /tf and /tf_static, beside garbage; who has ended is none of them."""
    with Peer(ros_domain, "watcher") as watcher, Peer(ros_domain, "one") as one:
        one.node.create_publisher(TFMessage, "/tf_static", LATCHED).publish(edge("base", "lamp"))
        senders, publishers = TfSenders(watcher.node), FramePublishers()
        moving = one.publisher(TFMessage, "/tf")
        with Peer(ros_domain, "other") as other:
            also = other.publisher(TFMessage, "/tf")
            frame = "wheel"

            def seen() -> list[Conflict]:
                moving.publish(edge("odom", "base"))
                also.publish(edge("odom", frame))
                also.publish(b"\0\1\0\0\xff\xff\xff\xff\0\0\0\0")
                for sender, transforms, latched in senders.take():
                    publishers.add(sender, transforms, latched=latched)
                return publishers.conflicts(senders.senders())

            for child, nodes in (("base", ["/one"]), ("wheel", ["/other"]), ("lamp", ["/one"])):
                wait_for(lambda c=child, n=nodes: seen() or publishers.publishers(c) == n, child)
            assert seen() == []
            frame = "base"
            assert wait_for(seen, "both") == [
                Conflict(("base",), ("/one", "/other"), ("odom",) * 2)
            ]
        wait_for(lambda: not publishers.conflicts(senders.senders()), "the end of one")
        senders.close()


def test_it_receives_now_and_then(ros_domain: int) -> None:
    """Only while several publish; when one comes, and again after a while."""
    with Peer(ros_domain, "watcher") as watcher, Peer(ros_domain, "one") as one:
        node, conflicts = watcher.node, FrameConflicts(watcher.node, every=30.0, duration=3.0)
        first = one.node.create_publisher(TFMessage, "/tf", 10)
        wait_for(lambda: node.count_publishers("/tf") == 1, "a publisher")
        assert conflicts.poll(0.0) == [] and node.count_subscribers("/tf") == 0
        second = node.create_publisher(TFMessage, "/tf", 10)
        wait_for(lambda: node.count_publishers("/tf") == 2, "another")
        now, lasted = 1.0, []
        while now < 100.0:
            lasted += [now] * node.count_subscribers("/tf")
            for publisher in (first, second):
                publisher.publish(edge("odom", "base"))
            conflicts.poll(now)
            now += 1.0
        assert lasted == [2.0, 3.0, 4.0, 32.0, 33.0, 34.0, 62.0, 63.0, 64.0, 92.0, 93.0, 94.0]
        conflicts.close()
