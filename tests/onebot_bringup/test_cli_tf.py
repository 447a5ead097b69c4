"""``onebot tf``, on real DDS, in the forms that tf2's tools print."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from geometry_msgs.msg import TransformStamped

from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_bringup.cli_support import onebot, output_of, running
from tests.ros_support import LATCHED, Peer


def transform(parent: str, child: str, x: float = 0.0) -> TransformStamped:
    found = TransformStamped(child_frame_id=child)
    found.header.frame_id = parent
    found.transform.translation.x = x
    return found


@pytest.fixture
def frames(ros_domain: int) -> Iterator[None]:
    """Moving odom -> base at 50 Hz, a wheel that is fixed to it, and a tree apart."""
    with Peer(ros_domain, "driver") as peer:
        node = peer.node
        fixed = node.create_publisher(TFMessage, "/tf_static", LATCHED)
        fixed.publish(
            TFMessage(transforms=[transform("base", "wheel", 0.5), transform("map", "m")])
        )
        moving = node.create_publisher(TFMessage, "/tf", 100)

        def publish() -> None:
            base = transform("odom", "base", 1.0)
            base.transform.rotation.z = base.transform.rotation.w = 0.5**0.5
            base.header.stamp = node.get_clock().now().to_msg()
            moving.publish(TFMessage(transforms=[base]))

        node.create_timer(0.02, publish)
        yield


def test_tree(frames: None) -> None:
    """Each tree with rate and age, static frames marked; unconnected ones are warned of."""
    done = onebot("tf", "tree", "--wait-time", "2.5")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].split() == ["frame", "rate", "age"]
    assert lines[1] == "map" and lines[2].split() == ["└─", "m", "static"]
    assert lines[3] == "odom"
    assert re.fullmatch(r"└─ base +[\d.]+ Hz +-?\d\.\d{3} s", lines[4])
    assert lines[5].split() == ["└─", "wheel", "static"]
    assert "warning: 2 unconnected trees, of map, odom" in done.stderr


def test_echo(frames: None) -> None:
    """Time, translation, rotation in all forms, and the matrix, as tf2_echo prints them."""
    out = output_of("tf", "echo", "odom", "wheel", "--once")
    first, *rest = out.replace("-0.000", " 0.000").replace("[ 0.000,", "[0.000,").splitlines()
    assert re.fullmatch(r"At time \d+\.\d{9}", first)
    assert "\n".join(rest).replace(",  0.000", ", 0.000") == (
        "- Translation: [1.000, 0.500, 0.000]\n"
        "- Rotation: in Quaternion (xyzw) [0.000, 0.000, 0.707, 0.707]\n"
        "- Rotation: in RPY (radian) [0.000, 0.000, 1.571]\n"
        "- Rotation: in RPY (degree) [0.000, 0.000, 90.000]\n"
        "- Matrix:\n"
        "   0.000 -1.000  0.000  1.000\n"
        "   1.000  0.000  0.000  0.500\n"
        "   0.000  0.000  1.000  0.000\n"
        "   0.000  0.000  0.000  1.000"
    )


def test_echo_of_what_is_not_there(frames: None, tmp_path: Path) -> None:
    """It waits, printing why, until Ctrl-C."""
    with running(tmp_path, "tf", "echo", "odom", "wheeel") as command:
        command.says('frame does not exist (did you mean "wheel"? frames: base, m, map,')
        assert "Waiting for transform odom ->  wheeel: " in command.err
        assert command.interrupt() == 0 and not command.out


def test_several_publishers(frames: None, ros_domain: int) -> None:
    """Two nodes of one name are two robots, two publishers of one node are not.

    The parents of a frame with two are named; a frame of one parent is not, however many messages
    it has.
    """
    message = transform("map", "base")
    message.transform.rotation.w = 1.0
    with Peer(ros_domain, "driver") as driver, Peer(ros_domain, "amcl") as amcl:
        driver.node.create_publisher(TFMessage, "/tf", 100)
        amcl.node.create_publisher(TFMessage, "/tf", 100)
        publisher = amcl.node.create_publisher(TFMessage, "/tf", 100)
        amcl.node.create_timer(0.05, lambda: publisher.publish(TFMessage(transforms=[message])))
        done = onebot("tf", "tree")
    assert done.stderr.count("warning: /tf is published by 2 nodes named /driver: ") == 1
    assert "/amcl" not in done.stderr
    assert "warning: base has 2 parents, map and odom: it jumps between them" in done.stderr
    assert done.stderr.count("parents") == 1


def test_without_transforms(ros_domain: int) -> None:
    """One line, or the reason."""
    done = onebot("tf", "tree")
    assert done.returncode == 1
    assert done.stderr.endswith("error: no transform was received on /tf and /tf_static\n")
    late = onebot("tf", "echo", "odom", "base", "--timeout", "0.5")
    assert late.returncode == 1
    assert 'error: no transform odom -> base: Invalid frame ID "odom" passed to' in late.stderr
