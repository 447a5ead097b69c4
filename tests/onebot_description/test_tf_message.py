"""TFMessage: an ordinary ROS message, the same on the wire as that of tf2_msgs."""

import copy
import ctypes
import gc
import hashlib
import json
import os
import pickle
import random
import struct
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
import rclpy
from geometry_msgs.msg import PoseStamped, TransformStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from type_description_interfaces.srv import GetTypeDescription

from onebot_description.compiled.library import load_library
from onebot_description.ros.wire import interfaces, message_class, type_support
from onebot_description.ros.wire.interfaces import TFMessage
from tests.ros_support import node_here, spin_until
from tests.support import lines_of_ours

# The folder that onebot_description is imported from.
PACKAGES = Path(interfaces.__file__).parents[3]

TYPE_HASH = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
own_only = pytest.mark.skipif(
    TFMessage not in message_class._MADE.values(), reason="a genuine tf2_msgs is installed"
)


def make_transform(
    parent: str = "base_link",
    child: str = "wheel",
    stamp: tuple[int, int] = (0, 0),
    numbers: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
) -> TransformStamped:
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.sec, message.header.stamp.nanosec = stamp
    move, turn = message.transform.translation, message.transform.rotation
    move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w = numbers
    return message


def numbers_of(message: TransformStamped) -> tuple[float, ...]:
    move, turn = message.transform.translation, message.transform.rotation
    return (move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w)


def encode(transforms: list[TransformStamped]) -> bytes:
    """Write the CDR encoding as its specification says, independently of any ROS library."""
    body = bytearray(struct.pack("<I", len(transforms)))

    def put(form: str, *values: Any, align: int) -> None:
        body.extend(bytes(-len(body) % align))
        body.extend(struct.pack("<" + form, *values))

    for item in transforms:
        put("iI", item.header.stamp.sec, item.header.stamp.nanosec, align=4)
        for text in (item.header.frame_id, item.child_frame_id):
            data = text.encode() + b"\0"
            put(f"I{len(data)}s", len(data), data, align=4)
        put("7d", *numbers_of(item), align=8)
    return b"\0\1\0\0" + bytes(body)


def decode(data: bytes) -> list[tuple[Any, ...]]:
    """Read the CDR encoding; padding, whose bytes are arbitrary, is skipped."""
    position = 4

    def get(form: str, align: int) -> tuple[Any, ...]:
        nonlocal position
        position += -(position - 4) % align
        values = struct.unpack_from("<" + form, data, position)
        position += struct.calcsize("<" + form)
        return values

    result = []
    for _ in range(get("I", 4)[0]):
        stamp, names = get("iI", 4), []
        for _ in range(2):
            (length,) = get("I", 4)
            text = get(f"{length}s", 1)[0]
            assert text.endswith(b"\0")
            names.append(text[:-1].decode())
        result.append((stamp, *names, get("7d", 8)))
    assert position == len(data)
    return result


def content(message: TransformStamped) -> tuple[Any, ...]:
    stamp = message.header.stamp
    return (
        (stamp.sec, stamp.nanosec),
        message.header.frame_id,
        message.child_frame_id,
        numbers_of(message),
    )


def run_python(code: str, *path: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a program in a Python of its own, with folders to import from."""
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, path)), **environment}
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        env=variables,
        capture_output=True,
        text=True,
        timeout=180,
    )


names = st.text(
    st.characters(codec="utf-8", exclude_characters="\0"), max_size=20
)  # C strings end at a null character, in every ROS message
transforms_strategy = st.builds(
    make_transform,
    parent=names,
    child=names,
    stamp=st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1)),
    numbers=st.tuples(*[st.floats()] * 7),
)


@settings(deadline=None, max_examples=200)
@given(st.lists(transforms_strategy, max_size=8))
def test_round_trip(transforms: list[TransformStamped]) -> None:
    data = serialize_message(TFMessage(transforms=transforms))
    assert len(data) == len(encode(transforms))
    assert repr(decode(data)) == repr([content(item) for item in transforms])  # nan equals nan
    for source in (data, encode(transforms)):
        back = deserialize_message(source, TFMessage)
        assert type(back) is TFMessage
        numbers = [struct.pack("7d", *numbers_of(item)) for item in back.transforms]
        assert numbers == [struct.pack("7d", *numbers_of(item)) for item in transforms]
        assert [content(item)[:3] for item in back.transforms] == [
            content(item)[:3] for item in transforms
        ]


@pytest.mark.parametrize("count", [0, 1, 255, 256, 257, 5000])
def test_sizes_around_the_growth_steps(count: int) -> None:
    message = TFMessage(transforms=[make_transform(child=f"joint_{i}") for i in range(count)])
    assert deserialize_message(serialize_message(message), TFMessage) == message


def test_an_ordinary_message() -> None:
    assert TFMessage.get_fields_and_field_types() == {
        "transforms": "sequence<geometry_msgs/TransformStamped>"
    }
    assert len(TFMessage.SLOT_TYPES) == 1
    assert TFMessage.SLOT_TYPES[0].value_type.namespaced_name() == (
        "geometry_msgs",
        "msg",
        "TransformStamped",
    )
    assert list(TFMessage.__slots__) == ["_transforms", "_check_fields"]
    assert not hasattr(TFMessage(), "__dict__")
    assert TFMessage.__module__ == "tf2_msgs.msg._tf_message"
    assert TFMessage.__module__.split(".")[0] + "/msg/" + TFMessage.__name__ == (
        "tf2_msgs/msg/TFMessage"
    )
    message = TFMessage(transforms=[make_transform()])
    assert repr(message) == f"tf2_msgs.msg.TFMessage(transforms=[{make_transform()!r}])"
    assert TFMessage().transforms == []
    assert TFMessage().transforms is not TFMessage().transforms


def test_equality() -> None:
    """Messages are equal if their fields are; like other messages they cannot be hashed."""
    assert TFMessage(transforms=[make_transform()]) == TFMessage(transforms=[make_transform()])
    assert TFMessage(transforms=[make_transform()]) != TFMessage()
    assert TFMessage() != PoseStamped()
    assert TFMessage() != []
    with pytest.raises(TypeError):
        hash(TFMessage())


def test_copies() -> None:
    message = TFMessage(transforms=[make_transform()])
    shallow, deep = copy.copy(message), copy.deepcopy(message)
    assert shallow == deep == pickle.loads(pickle.dumps(message)) == message
    assert shallow.transforms is message.transforms
    assert deep.transforms[0] is not message.transforms[0]


def test_field_checks() -> None:
    for wrong in ([PoseStamped()], "text", 5, None, [1]):
        with pytest.raises(AssertionError, match="'transforms' field must be a set or sequence"):
            TFMessage(transforms=wrong, check_fields=True)
        TFMessage(transforms=wrong, check_fields=False)
    with pytest.raises(AssertionError, match="Invalid arguments passed to constructor: transform"):
        TFMessage(transform=[], check_fields=True)
    for right in ([make_transform()], (make_transform(),), []):
        assert TFMessage(transforms=right, check_fields=True).transforms is right


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
            serialize_message(TFMessage(transforms=wrong, check_fields=False))
    message = TFMessage(transforms=(make_transform(), make_transform()))
    assert deserialize_message(serialize_message(message), TFMessage).transforms == list(
        message.transforms
    )


def malformed_messages() -> Iterator[bytes]:
    good = encode([make_transform("parent" * i, "child") for i in range(4)])
    yield from (good[:length] for length in range(len(good)))
    for count in (5, 6, 1000, 10**6, 2**31, 2**32 - 1):
        yield good[:4] + struct.pack("<I", count) + good[8:]
    for length in (2**32 - 1, 2**31, 10**9, 1000):
        yield good[:16] + struct.pack("<I", length) + good[20:]


def test_malformed_bytes_are_refused() -> None:
    before = psutil.Process().memory_info().rss
    for data in malformed_messages():
        with pytest.raises(Exception, match=r"deserializ"):
            deserialize_message(data, TFMessage)
    assert psutil.Process().memory_info().rss - before < 20e6


def test_random_bytes_do_no_harm() -> None:
    dice = random.Random(1)
    good = encode([make_transform("parent" * i, "child") for i in range(4)])
    refused = 0
    for _ in range(4_000):
        data = bytearray(good)
        for _ in range(dice.randint(1, 6)):
            data[dice.randrange(4, len(data))] = dice.randrange(256)
        noise = b"\0" + bytes([dice.choice([0, 1])]) + b"\0\0" + dice.randbytes(dice.randint(0, 99))
        for candidate in (bytes(data), noise):
            try:
                message = deserialize_message(candidate, TFMessage)
            except rclpy._rclpy_pybind11.RMWError:
                refused += 1
            else:
                assert len(message.transforms) <= len(candidate) / 60
    assert refused > 200


def test_no_leak() -> None:
    message = TFMessage(transforms=[make_transform("parent", "child")])
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
    # A leak of the smallest block that malloc gives, 32 bytes, would add 64 kB.
    assert work(2000) - before < 20_000


class _MallInfo(ctypes.Structure):
    """What glibc's malloc says of itself."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks k".split()
    ]


@pytest.fixture
def node(ros_domain: int) -> Iterator[Any]:
    with node_here("test_tf_message") as node:
        yield node


def test_on_the_wire_it_is_tf2_msgs(node: Any) -> None:
    node.create_publisher(TFMessage, "/tf", 10)
    node.create_subscription(TFMessage, "/tf", lambda message: None, 10)
    for query in (node.get_publishers_info_by_topic, node.get_subscriptions_info_by_topic):
        (info,) = spin_until(node, lambda query=query: query("/tf"), "the topic's information")
        assert info.topic_type == "tf2_msgs/msg/TFMessage"
        assert str(info.topic_type_hash) == TYPE_HASH
    assert ("/tf", ["tf2_msgs/msg/TFMessage"]) in node.get_topic_names_and_types()


def test_type_description(node: Any) -> None:
    node.create_publisher(TFMessage, "/tf", 10)
    client = node.create_client(GetTypeDescription, "~/get_type_description")
    spin_until(node, client.service_is_ready, "the node's own service")
    request = GetTypeDescription.Request(
        type_name="tf2_msgs/msg/TFMessage", type_hash=TYPE_HASH, include_type_sources=True
    )
    future = client.call_async(request)
    spin_until(node, future.done, "the description")
    response = future.result()
    assert response.successful, response.failure_reason

    def as_json(individual: Any) -> dict[str, Any]:
        fields = [
            {
                "name": field.name,
                "type": {
                    "type_id": field.type.type_id,
                    "capacity": field.type.capacity,
                    "string_capacity": field.type.string_capacity,
                    "nested_type_name": field.type.nested_type_name,
                },
            }
            for field in individual.fields
        ]
        return {"type_name": individual.type_name, "fields": fields}

    # REP-2011: the hash is that of the description as JSON, without default values.
    described = {
        "type_description": as_json(response.type_description.type_description),
        "referenced_type_descriptions": [
            as_json(item) for item in response.type_description.referenced_type_descriptions
        ],
    }
    assert "RIHS01_" + hashlib.sha256(json.dumps(described).encode()).hexdigest() == TYPE_HASH
    sources = {source.type_name: source for source in response.type_sources}
    assert sources["tf2_msgs/msg/TFMessage"].raw_file_contents == (
        "geometry_msgs/TransformStamped[] transforms"
    )
    assert set(sources) == {"tf2_msgs/msg/TFMessage"} | {
        item["type_name"] for item in described["referenced_type_descriptions"]
    }


MANY_THREADS = """
    import threading, rclpy
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
        while received[name] <= 200:
            messages = []
            objects = node.create_subscription(TFMessage, "/tf", messages.append, 10)
            raw = node.create_subscription(TFMessage, "/tf", messages.append, 10, raw=True)
            for _ in range(50):
                executor.spin_once(timeout_sec=0.05)
            node.destroy_subscription(objects)
            node.destroy_subscription(raw)
            received[name] += len(messages)

    publishers = [threading.Thread(target=publish, args=(name,)) for name in received]
    subscribers = [threading.Thread(target=subscribe, args=(name,)) for name in received]
    for thread in publishers + subscribers:
        thread.start()
    for thread in subscribers:
        thread.join()
    done.set()
    for thread in publishers:
        thread.join()
    print("finished")
    rclpy.try_shutdown()
"""


def test_many_threads(ros_domain: int) -> None:
    result = run_python(MANY_THREADS, PACKAGES)
    assert result.returncode == 0, result.stderr
    assert lines_of_ours(result.stdout)[0].startswith("finished"), result.stdout


GENUINE_LOOKALIKE = """
    class Metaclass_TFMessage(type):
        _TYPE_SUPPORT = None

        @classmethod
        def __import_type_support__(cls):
            {load}

    class TFMessage(metaclass=Metaclass_TFMessage):
        pass
"""
# As in generated code, whose function to load a type support fails by a bare Exception.
NOT_LOADABLE = """
            from rosidl_generator_py import import_type_support
            cls._TYPE_SUPPORT = import_type_support("tf2_msgs").type_support_msg__msg__tf_message"""


@pytest.mark.parametrize("load", [NOT_LOADABLE, "pass"])
def test_a_tf2_msgs_that_cannot_be_loaded(tmp_path: Path, load: str) -> None:
    """It is passed over; test_colcon.py has one that is used."""
    package = tmp_path / "tf2_msgs" / "msg"
    package.mkdir(parents=True)
    (package.parent / "__init__.py").write_text("")
    text = textwrap.dedent(GENUINE_LOOKALIKE.format(load=load))
    (package / "__init__.py").write_text(text)
    code = """
        from geometry_msgs.msg import TransformStamped
        from rclpy.serialization import deserialize_message, serialize_message
        from onebot_description.ros.wire.interfaces import TFMessage
        import tf2_msgs.msg
        message = TFMessage(transforms=[TransformStamped(child_frame_id="child")])
        back = deserialize_message(serialize_message(message), TFMessage)
        assert type(back) is TFMessage and back.transforms == message.transforms
        print(TFMessage is tf2_msgs.msg.TFMessage)
    """
    result = run_python(code, tmp_path, PACKAGES)
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == ["False"]


@own_only
def test_another_version_of_ros_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    package = tmp_path / "share" / "rosidl_runtime_c"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><version>4.9.2</version></package>")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    with pytest.raises(type_support.TypeSupportError) as caught:
        type_support.check_versions()
    assert isinstance(caught.value, ImportError)
    assert "rosidl_runtime_c is version 4.9.2 instead of 4.6.x" in str(caught.value)


@own_only
def test_other_number_types_are_refused() -> None:
    message = TFMessage(transforms=[make_transform()])
    data = serialize_message(message)  # this configures the library
    with pytest.raises(type_support.TypeSupportError, match="laid out in memory in an unknown way"):
        type_support.configure(load_library(), [type_support.handle_of(PoseStamped)] * 4)
    assert deserialize_message(data, TFMessage) == message
