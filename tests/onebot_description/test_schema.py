"""Messages read by their definition; test_interfaces.py reads those of every installed type."""

import copy
import random
import struct
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Point, PoseStamped, TwistWithCovariance
from nav_msgs.msg import Path
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import LaserScan, PointCloud2, PointField
from std_msgs.msg import ColorRGBA, String
from visualization_msgs.msg import Marker, MarkerArray

from onebot_description.ros.wire.cdr import ENCAPSULATION, WireError, nanoseconds
from onebot_description.ros.wire.definition import DefinitionError, type_name
from onebot_description.ros.wire.interface_text import full_definition
from onebot_description.ros.wire.schema import Message, Schema, Sequences, Table
from tests.any_message import serialized


def schema_of(message: Any) -> Schema:
    name = type_name(message)
    return Schema.from_definition(name, full_definition(name))


def read(message: Any) -> Message:
    """Read what rclpy writes."""
    return schema_of(message).read(serialized(message))


# ---- Tables, arrays and views ----


def path_of(*frames: str) -> Path:
    path = Path()
    for number, frame in enumerate(frames):
        pose = PoseStamped()
        pose.header.frame_id, pose.header.stamp.sec = frame, number
        pose.pose.position.x, pose.pose.position.y = float(number), 0.5
        path.poses.append(pose)
    return path


def test_a_sequence_of_messages_reads_by_columns_and_by_rows():
    poses = read(path_of("map", "odom", "map", "été")).poses
    assert len(poses) == 4
    assert poses.header.frame_id == ["map", "odom", "map", "été"]
    assert poses.header.frame_id[0] is poses.header.frame_id[2]
    assert poses.pose.position.x.tolist() == [0, 1, 2, 3]
    assert poses["pose.position.x"].tolist() == [0, 1, 2, 3]
    assert poses.pose.position.array().tolist() == [[n, 0.5, 0] for n in range(4)]
    assert poses.pose.array().shape == (4, 7)
    assert poses[-1].pose.array().tolist() == [3, 0.5, 0, 0, 0, 0, 1]
    assert poses[3].header.frame_id == "été"
    assert nanoseconds(poses[2].header.stamp) == 2_000_000_000
    assert [pose.pose.position.x for pose in poses] == [0, 1, 2, 3]
    assert poses[::-2].header.frame_id == ["été", "odom"]
    assert poses[::-2].pose.position.x.tolist() == [3, 1]
    with pytest.raises(IndexError):
        poses[4]
    with pytest.raises(TypeError, match="not adjacent numbers of one type"):
        poses.array()


def test_an_empty_table_has_empty_columns():
    poses = read(Path()).poses
    assert (len(poses), poses.header.frame_id, list(poses)) == (0, [], [])
    assert poses.pose.array().shape == (0, 7)
    assert len(read(Marker()).points.array()) == 0
    assert len(read(MarkerArray()).markers.points) == 0


def test_arrays_in_a_table_are_one_for_each_row():
    some = Marker(points=[Point(x=1.0), Point(y=2.0)], colors=[ColorRGBA(a=0.5)])
    markers = read(MarkerArray(markers=[Marker(), some])).markers
    assert markers.points[1].array().tolist() == [[1, 0, 0], [0, 2, 0]]
    assert markers.colors[-1].a.tolist() == [0.5]
    assert [len(points) for points in markers.points[1:]] == [2]
    assert markers.texture.data[0].tolist() == []


def test_numeric_fields_are_those_outside_of_arrays():
    schema = schema_of(path_of())
    assert schema.numeric_fields() == ("header.stamp.sec", "header.stamp.nanosec")
    twist = TwistWithCovariance()
    twist.twist.linear.x = 0.25
    fields = schema_of(twist).numeric_fields()
    assert fields == tuple(
        f"twist.{part}.{axis}" for part in ("linear", "angular") for axis in "xyz"
    )
    assert read(twist)["twist.linear.x"] == 0.25
    assert Schema.from_definition("std_msgs/msg/Empty", "").numeric_fields() == ()


def test_an_unknown_field_is_named_with_those_that_exist():
    scan = read(LaserScan())
    with pytest.raises(
        AttributeError, match='LaserScan has no field "range" .*did you mean "ranges"'
    ):
        scan.range  # noqa: B018
    with pytest.raises(LookupError, match='LaserScan.header has no field "frame"'):
        scan["header.frame"]
    with pytest.raises(LookupError, match="LaserScan.angle_min .* is not a message"):
        scan["angle_min.x"]
    assert "ranges" in dir(scan)
    assert copy.copy(scan).angle_min == 0


# ---- Layout ----

TIGHT = """uint8 flag
float64 value
"""
LOOSE = """float64 value
uint8 flag
"""
ALL = """
{name}/A[] many
uint8 before
{name}/A[2] two
{name}/A one
float64[] none
uint16 after
================================================================================
MSG: {name}/A
"""


MIXED = """uint8 number
string name
bool good
float64[] values
float64 last
bool[] flags"""


@pytest.mark.parametrize(
    "inner", [TIGHT, LOOSE, f"{TIGHT}uint16 end", "uint8 a\nuint8 b", "bool a", "", MIXED]
)
@pytest.mark.parametrize("count", [0, 1, 2, 5, 24])
def test_structs_of_equal_and_of_other_lengths_are_laid_out_as_by_rosbags(inner, count):
    definition = ALL.format(name="test") + inner
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, "test/msg/All"))
    names = [line.split()[1] for line in inner.split("\n") if line] or [EMPTY]

    def one(number: int) -> Any:
        values = {"flag": number, "value": number / 2, "end": number, "a": number % 2, "b": 7}
        values |= {"number": number, "last": number / 4, "good": number % 3 == 1}
        # Some that follow one another are equally long.
        values |= {"name": "x" * (number // 4), "values": np.arange(number // 6 % 3, dtype=float)}
        values["flags"] = np.array([True, False], bool)[: number // 8 % 3]
        return store.types["test/msg/A"](**{name: values.get(name, 0) for name in names})

    many, two = [one(number) for number in range(count)], [one(8), one(9)]
    message = store.types["test/msg/All"](many, 3, two, one(10), np.empty(0), 65535)
    data = bytes(store.serialize_cdr(message, "test/msg/All"))
    schema = Schema.from_definition("test/msg/All", definition)
    ours = schema.read(data)
    assert (ours.before, ours.after, len(ours.none)) == (3, 65535, 0)
    tables = ((ours.many, many), (ours.two, two), ([ours.one], [message.one]))
    for our, their in tables:
        for row, expected in zip(our, their, strict=True):
            for name in set(names) - {EMPTY}:
                np.testing.assert_array_equal(row[name], getattr(expected, name))
    for size in range(len(data)):
        with pytest.raises(WireError):
            schema.read(data[:size])


EMPTY = "structure_needs_at_least_one_member"


def wide(text: str) -> bytes:
    encoded = text.encode("utf-16-le")
    return struct.pack("<I", len(encoded) // 2) + encoded


def test_wstrings_and_bounded_types():
    definition = """wstring<=5 a "default # not a comment"
        wstring[] b
        string<=3[<=2] c
        int8[<=4] d [1, 2]
        uint8 X=5
        string Y = "a # b"
        char class
        byte lambda"""
    body = wide("aé") + struct.pack("<I", 2) + wide("😀") + wide("")
    body += struct.pack("<I", 2) + b"\2\0\0\0x\0" + b"\0\0" + b"\0\0\0\0"
    body += struct.pack("<Ib", 1, -1) + b"\xfe\xff"
    message = Schema.from_definition("test/msg/Strings", definition).read(ENCAPSULATION + body)
    assert (message.a, message.b, message.c) == ("aé", ["😀", ""], ["x", ""])
    assert (message.d.tolist(), message["class"], message["lambda"]) == ([-1], 254, 255)


@pytest.mark.parametrize("text", [b"a\0b\0", b"abc", b"ab\0\0", b"\0a", b"\0", b"", b"a\xff"])
def test_a_string_ends_as_with_rclpy(text):
    data = ENCAPSULATION + struct.pack("<I", len(text)) + text
    ours = Schema.from_definition("std_msgs/msg/String", "string data").read(data).data
    assert ours == deserialize_message(data, String).data


# ---- Bytes that are no message ----


def read_all(view: Any) -> None:
    """Read each field of a message, at every depth."""
    for name in view._group.fields:
        value = view[name]
        for one in value if isinstance(value, Sequences) else [value]:
            if isinstance(one, Message | Table):
                read_all(one)


FUZZED = (
    MarkerArray(markers=[Marker(ns="a", points=[Point()] * 3, text="b"), Marker(), Marker()]),
    MarkerArray(markers=[Marker(ns="a", text="b")] * 5),
    path_of("map", "odom"),
    PointCloud2(fields=[PointField(name="x")] * 3, data=bytes(40)),
)


@pytest.mark.parametrize("message", FUZZED, ids=lambda message: type(message).__name__)
def test_any_bytes_are_a_message_or_an_error(message):
    data = serialized(message)
    schema = schema_of(message)
    for size in range(len(data) - 3):  # the last three may be padding
        with pytest.raises(WireError):
            schema.read(data[:size])
    chance = random.Random(1)
    errors = 0
    for _ in range(2000):
        changed = bytearray(data)
        for _ in range(chance.randint(1, 4)):
            place = chance.randrange(4, len(data))
            changed[place : place + 4] = chance.choice(
                [b"\xff\xff\xff\xff", b"\0\0\0\x80", chance.randbytes(1), chance.randbytes(4)]
            )
        try:
            read_all(schema.read(bytes(changed)))
        except WireError:
            errors += 1
    assert 0 < errors < 2000


@pytest.mark.parametrize(
    "definition", ["float64[] a", "string[] a", "test/A[] a", "string a", "wstring a", "test/B[] a"]
)
def test_a_huge_count_takes_no_memory(definition):
    definition += "\n===\nMSG: test/A\nstring s\n===\nMSG: test/B\nfloat64[100000] b"
    schema = Schema.from_definition("test/msg/Huge", definition)
    for count in (5, 2**31 - 1, 2**31, 2**32 - 1):
        with pytest.raises(WireError, match="truncated"):
            schema.read(ENCAPSULATION + struct.pack("<I", count) + bytes(4))


@pytest.mark.parametrize("definition", ["bool a", "bool[3] a", "bool[] a", "test/A[] a"])
def test_a_bool_is_zero_or_one(definition):
    """Anything else is undefined in arrays of NumPy's."""
    schema = Schema.from_definition("test/msg/Bool", f"{definition}\n===\nMSG: test/A\nbool b")
    for value in (0, 1, 2):
        data = ENCAPSULATION + (b"\3\0\0\0" if "[]" in definition else b"") + bytes([value]) * 3
        if value == 2:
            with pytest.raises(WireError, match="bool"):
                schema.read(data)
        else:
            read_all(schema.read(data))


def test_a_bool_in_any_of_equal_structs_is_checked():
    definition = "test/A[] many\n===\nMSG: test/A\nfloat64 value\nstring name\nbool flag"
    schema = Schema.from_definition("test/msg/Alike", definition)
    one = struct.pack("<dI5s?6x", 1.0, 5, b"name\0", True)
    data = ENCAPSULATION + struct.pack("<I4x", 9) + 9 * one
    assert schema.read(data).many.flag.tolist() == [True] * 9
    for place in range(29, len(data), len(one)):
        with pytest.raises(WireError, match="bool"):
            schema.read(data[:place] + b"\2" + data[place + 1 :])


def test_only_plain_little_endian_is_read():
    schema = Schema.from_definition("std_msgs/msg/Empty", "")
    assert schema.read(ENCAPSULATION + b"\0")._group.fields
    for data in (b"", b"\0\1", b"\0\0\0\0\0", b"\0\3\0\0\0", ENCAPSULATION):
        with pytest.raises(WireError):
            schema.read(data)


# ---- Definitions ----


@pytest.mark.parametrize(
    ("definition", "problem"),
    [
        ("float64 x\nfloat64", 'test/T, line 2: "float64" is not a field'),
        ("float64 _x", "is not a field"),
        ("float64[0] x", "is not a field"),
        ("float64[9999999999] x", "larger than two gigabytes"),
        ("float64 x\nuint8 x", "an earlier field has this name"),
        ("A x", "no definition of test/A"),
        ("A x\n===\nMSG: test/A\nint8 x\nB y", "test/A, line 2: .*no definition of test/B"),
        ("A x\n===\nMSG: test/A\nA x", "test/A contains itself"),
        ("A[] x\n===\nMSG: test/A\nT[] x", "test/T contains itself"),
    ],
)
def test_a_definition_that_cannot_be_used_names_type_and_line(definition, problem):
    with pytest.raises(DefinitionError, match=problem):
        Schema.from_definition("test/msg/T", definition)


def test_a_definition_that_grows_without_bound_is_refused():
    section = "\n===\nMSG: test/A{}\n"
    wide = "A0 a" + "".join(
        section.format(at) + "".join(f"A{at + 1} f{field}\n" for field in range(10))
        for at in range(9)
    )
    wide += f"{section.format(9)}int8 x"
    deep = "A0 a" + "".join(f"{section.format(at)}A{at + 1} f" for at in range(5000))
    # Where the inner types come first, no type is within many others when it is compiled.
    chain = "".join(f"A{at}[] f{at}\n" for at in range(60, -1, -30))
    chain += "".join(f"{section.format(at)}A{at + 1}[] f" for at in range(90))
    chain += f"{section.format(90)}int8 x"
    for definition, problem in (
        (wide, "more than 10000 fields"),
        (deep, "more than 64 deep"),
        (chain, "more than 64 deep"),
    ):
        with pytest.raises(DefinitionError, match=problem):
            Schema.from_definition("test/msg/T", definition)


def test_definitions_as_various_writers_store_them():
    text = "std_msgs/msg/Header header\r\n" + "=" * 80 + "\r\nMSG: std_msgs/msg/Header\r\n"
    text += "builtin_interfaces/Time stamp\r\nstring frame_id\r\n"
    data = ENCAPSULATION + struct.pack("<iII", 1, 2, 2) + b"m\0"
    for definition in (text, f"===\nMSG: test/T\n{text}"):
        message = Schema.from_definition("test/T", definition).read(data)
        assert (nanoseconds(message.header.stamp), message.header.frame_id) == (10**9 + 2, "m")
    with pytest.raises(DefinitionError, match="not the name of a message type"):
        Schema.from_definition("test/srv/T", "")
