"""TFMessage: an ordinary ROS message, the same on the wire as that of tf2_msgs."""

import ctypes
import gc
import sys
import textwrap
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped, TransformStamped
from rclpy.serialization import deserialize_message, serialize_message

from onebot_description.compiled.library import load_library
from onebot_description.ros.wire import message_class, type_support
from onebot_description.ros.wire.interfaces import TFMessage
from tests.support import lines_of_ours, run_to_end

own_only = pytest.mark.skipif(
    TFMessage not in message_class._MADE.values(), reason="a genuine tf2_msgs is installed"
)


def make_transform(child: Any = "wheel") -> TransformStamped:
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = "base_link"
    return message


@own_only
def test_wrong_values_raise_when_sent() -> None:
    for wrong, expected in (
        ([1], AttributeError),
        (5, TypeError),
        (None, TypeError),
        ([make_transform(), None], AttributeError),
        ([make_transform(child=7)], TypeError),
        ([make_transform(child="\ud800")], UnicodeEncodeError),
    ):
        with pytest.raises(expected):
            serialize_message(TFMessage(transforms=wrong))
    message = TFMessage(transforms=(make_transform(), make_transform()))
    assert deserialize_message(serialize_message(message), TFMessage).transforms == list(
        message.transforms
    )


def test_no_leak() -> None:
    message = TFMessage(transforms=[make_transform()])
    data = serialize_message(message)

    def work(rounds: int) -> int:
        """Return the bytes that malloc has handed out after some work."""
        for _ in range(rounds):
            deserialize_message(serialize_message(message), TFMessage)
            for wrong in (data[:-8], data[:4] + b"\xff\xff\xff\0" + data[8:]):
                with pytest.raises(Exception, match="deserializ"):
                    deserialize_message(wrong, TFMessage)
        gc.collect()
        return int(mallinfo2().uordblks)

    mallinfo2 = ctypes.CDLL(None).mallinfo2
    mallinfo2.restype = _MallInfo
    before = work(200)
    # A leak of the smallest block that malloc gives, 32 bytes, would add 32 kB.
    assert work(1000) - before < 20_000


class _MallInfo(ctypes.Structure):
    """What glibc's malloc says of itself."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks k".split()
    ]


MANY_THREADS = """
    import threading, rclpy
    from concurrent.futures import ThreadPoolExecutor
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.serialization import serialize_message
    from geometry_msgs.msg import TransformStamped
    from onebot_description.ros.wire.interfaces import TFMessage

    rclpy.init()
    message = TFMessage(transforms=[TransformStamped(child_frame_id=str(i)) for i in range(20)])
    data = serialize_message(message)
    received = {name: 0 for name in "abc"}
    done = threading.Event()

    def publish(name):
        node = rclpy.create_node(f"publish_{name}")
        while not done.is_set():
            publisher = node.create_publisher(TFMessage, "/tf", 10)
            for _ in range(20):
                publisher.publish(message)
                publisher.publish(data)
            node.destroy_publisher(publisher)

    def subscribe(name):
        node, executor = rclpy.create_node(f"subscribe_{name}"), SingleThreadedExecutor()
        executor.add_node(node)
        while received[name] <= 100:
            messages = []
            objects = node.create_subscription(TFMessage, "/tf", messages.append, 10)
            raw = node.create_subscription(TFMessage, "/tf", messages.append, 10, raw=True)
            for _ in range(50):
                executor.spin_once(timeout_sec=0.05)
            node.destroy_subscription(objects)
            node.destroy_subscription(raw)
            received[name] += len(messages)

    with ThreadPoolExecutor(2 * len(received)) as pool:
        publishers = pool.map(publish, received)
        list(pool.map(subscribe, received))
        done.set()
        list(publishers)
    print("finished")
    rclpy.try_shutdown()
"""


def test_many_threads(ros_domain: int) -> None:
    done = run_to_end([sys.executable, "-c", textwrap.dedent(MANY_THREADS)], check=True)
    assert lines_of_ours(done.stdout) == ["finished"]


@own_only
def test_another_version_of_ros_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "humble")
    monkeypatch.setenv("ROS_VERSION", "2")
    with pytest.raises(type_support.TypeSupportError, match="ROS differs: it is humble"):
        type_support._library.__wrapped__()  # not cached


@own_only
def test_other_number_types_are_refused() -> None:
    message = TFMessage(transforms=[make_transform()])
    data = serialize_message(message)  # this configures the library
    with pytest.raises(type_support.TypeSupportError, match="laid out in memory in an unknown way"):
        type_support.configure(load_library(), [type_support.handle_of(PoseStamped)] * 4)
    assert deserialize_message(data, TFMessage) == message
