"""Messages as YAML, in the very form that ros2 prints, and YAML as messages, type by type."""

import math

import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovariance, Twist, TwistStamped
from hypothesis import given
from hypothesis import strategies as st
from rcl_interfaces.msg import ParameterValue
from rosidl_runtime_py import message_to_csv, message_to_yaml
from sensor_msgs.msg import JointState
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Bool, ByteMultiArray, Int8, String

from onebot_bringup.introspection.interfaces import message_class
from onebot_bringup.introspection.message_text import (
    fill,
    pick,
    read_scalar,
    stamp,
)
from onebot_description.errors import OneBotError
from onebot_description.ros.wire.interface_text import installed_interfaces


def joint_state() -> JointState:
    state = JointState(name=["a", "b"], position=[0.5, -1.0])
    state.header.stamp.sec = 3
    state.header.frame_id = "base"
    return state


def test_what_is_written() -> None:
    """Lists as items, empty ones as []; without their items; cut; and as columns."""
    assert message_to_yaml(joint_state()) == (
        "header:\n  stamp:\n    sec: 3\n    nanosec: 0\n  frame_id: base\n"
        "name:\n- a\n- b\nposition:\n- 0.5\n- -1.0\nvelocity: []\neffort: []\n"
    )
    text = message_to_yaml(joint_state(), no_arr=True)
    assert "name: '<sequence type: string, length: 2>'\n" in text
    assert "position: '<sequence type: double, length: 2>'\n" in text
    status = message_to_yaml(DiagnosticStatus(values=[KeyValue()]), no_arr=True)
    assert "<sequence type: diagnostic_msgs/msg/KeyValue, length: 1>" in status
    state = JointState(position=[1.0] * 200)
    text = message_to_yaml(state, truncate_length=128)
    assert text.count("- 1.0\n") == 128 and "- '...'\n" in text
    assert message_to_yaml(String(data="x" * 9), truncate_length=3) == "data: xxx...\n"
    assert message_to_csv(joint_state()) == "3,0,base,a,b,0.5,-1.0,,"
    assert message_to_csv(joint_state(), no_arr=True).endswith("<sequence type: double, length: 0>")
    assert message_to_csv(state, truncate_length=2) == "0,0,,,1.0,1.0,...,,"
    assert message_to_csv(2.5) == "2.5"


def test_pick() -> None:
    """A path of names and indices leads to a part."""
    assert pick(joint_state(), "header.stamp.sec") == 3
    assert pick(joint_state(), "position[1]") == -1.0
    assert pick(joint_state(), "name") == ["a", "b"]


@pytest.mark.parametrize(
    ("path", "part"),
    [
        ("heder.stamp", 'did you mean "header"'),
        ("header.stamp.sec.x", "nothing within a int"),
        ("position[9]", "no item [9]"),
        ("position[x]", "no item [x]"),
        ("header[0]", "no item [0]"),
    ],
)
def test_no_such_part(path: str, part: str) -> None:
    """A wrong path is refused with what there is."""
    with pytest.raises(OneBotError) as caught:
        pick(joint_state(), path)
    assert part in str(caught.value)


def filled(message: object, text: str, finite: bool = True) -> object:
    assert fill(message, text, finite=finite) == []
    return message


def refusal(message: object, text: str) -> str:
    with pytest.raises(OneBotError) as caught:
        fill(message, text)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_nested_fields_in_flow_and_block_style() -> None:
    """Both styles of YAML fill the same message; what is left out keeps its default."""
    assert message_to_yaml(Twist(), flow_style=True) == (
        "{linear: {x: 0.0, y: 0.0, z: 0.0}, angular: {x: 0.0, y: 0.0, z: 0.0}}\n"
    )
    flow = filled(Twist(), "{linear: {x: 0.2}, angular: {z: -1}}")
    block = filled(Twist(), "linear:\n  x: 0.2\nangular:\n  z: -1\n")
    assert flow == block and flow.linear.x == 0.2 and flow.angular.z == -1.0
    assert flow.linear.y == 0.0


@pytest.mark.parametrize("text", ["", "{}", "  ", "linear:"])
def test_nothing_given_is_the_default(text: str) -> None:
    """No values at all leave the message as it is."""
    assert filled(Twist(), text) == Twist()


@pytest.mark.parametrize("written", ["12:30", "on", "5", "1.0", "true", "010", "'quoted'", "~x"])
def test_a_string_stays_what_was_written(written: str) -> None:
    """A string field never gets what YAML makes of a word, such as 750 of 12:30."""
    assert filled(String(), f"{{data: {written}}}").data == written.strip("'")


def test_lists_and_arrays() -> None:
    """Sequences, fixed arrays, lists of strings, of bytes and of messages take lists."""
    state = filled(JointState(), "{name: [a, b], position: [1, 2.5]}")
    assert state.name == ["a", "b"] and list(state.position) == [1.0, 2.5]
    pose = filled(PoseWithCovariance(), f"covariance: {list(range(36))}")
    assert pose.covariance.tolist() == list(range(36))
    assert filled(ByteMultiArray(), "data: [1, 2]").data == [b"\x01", b"\x02"]
    assert filled(ParameterValue(), "bool_array_value: [true, no]").bool_array_value == [1, 0]
    message = filled(
        message_class("tf2_msgs/msg/TFMessage")(),
        "transforms: [{child_frame_id: a}, {transform: {translation: {x: 1}}}]",
    )
    assert message.transforms[0].child_frame_id == "a"
    assert message.transforms[1].transform.translation.x == 1.0


def test_now_and_auto_are_the_time_of_sending() -> None:
    """A header that is auto and a stamp that is now get the time, each time anew."""
    for text in ("{header: auto}", "{header: {stamp: now}}"):
        message = TwistStamped()
        times = fill(message, text)
        for nanoseconds in (5_000_000_006, 7_000_000_008):
            stamp(times, nanoseconds)
            time = message.header.stamp
            assert time.sec * 10**9 + time.nanosec == nanoseconds


@pytest.mark.parametrize(
    ("kind", "text", "parts"),
    [
        (Twist, "{liner: {x: 1}}", ['"liner"', 'mean "linear"', "fields: angular, linear"]),
        (Twist, "{linear: {v: 1}}", ["(linear)", '"v"', "fields: x, y, z"]),
        (Twist, "{linear: {x:1}}", ['"x:1"', 'space after each ":"']),
        (Twist, "{linear: {x: fast}}", ["linear.x is a number", '"fast"']),
        (Twist, "{linear: {x: [1]}}", ["linear.x is one value (double), not a list"]),
        (Twist, "{linear: 3}", ["geometry_msgs/msg/Vector3", "x, y, z", '"3"']),
        (Twist, "{linear: {x: .nan}}", ["linear.x is a finite number", "--allow-non-finite"]),
        (Twist, "fast", ["dictionary in YAML format", "fast"]),
        (Twist, "{linear: {x: 1}", ["invalid YAML", "line 1, column"]),
        (Int8, "data: 128", ["-128 to 127", "128"]),
        (Bool, "data: maybe", ["true or false", '"maybe"']),
        (JointState, "position: 3", ["position is a list of double"]),
        (JointState, "position: [1, a]", ["position[1] is a number"]),
        (PoseWithCovariance, "covariance: [1, 2]", ["36 values, not 2"]),
        (SolidPrimitive, "dimensions: [1, 2, 3, 4]", ["at most 3 values, not 4"]),
        (TwistStamped, "header: now", ["std_msgs/msg/Header", '"auto"']),
    ],
)  # fmt: skip
def test_mistakes(kind: type, text: str, parts: list[str]) -> None:
    """What does not fit is refused in one line that names the field and what would be right."""
    error = refusal(kind(), text)
    for part in parts:
        assert part in error


@given(
    st.builds(
        lambda names, values: (names, values),
        st.lists(st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]))),
        st.lists(st.floats(allow_nan=False, allow_infinity=False)),
    )
)
def test_printed_and_read_back(data: tuple[list[str], list[float]]) -> None:
    """What is printed as YAML fills an equal message."""
    state = JointState(name=data[0], position=data[1])
    state.header.frame_id = "".join(data[0])
    for flow in (False, True):
        text = message_to_yaml(state, flow_style=flow)
        assert filled(JointState(), text) == state


def test_every_installed_message_is_printed_and_read_back() -> None:
    """No type of message is left out: the default of each survives the round trip."""
    assert len(installed_interfaces("msg")) > 100
    for name in installed_interfaces("msg"):
        message = message_class(name)()
        assert filled(message_class(name)(), message_to_yaml(message)) == message


@pytest.mark.parametrize("bits", [8, 16, 32, 64])
@pytest.mark.parametrize("unsigned", [False, True])
def test_whole_numbers_within_their_type(bits: int, unsigned: bool) -> None:
    """Both ends are in, the next ones are out, and each text says what it is."""
    low, high = (0, 2**bits - 1) if unsigned else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    kind = f"{'u' if unsigned else ''}int{bits}"
    for value in (low, high, 0, 7):
        assert read_scalar(kind, str(value)) == value
    for value in (low - 1, high + 1):
        with pytest.raises(ValueError, match=f"is an {kind} from {low} to {high}, not {value}"):
            read_scalar(kind, str(value))


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        ("int32", "+5", 5),
        ("int32", " 0x10 ", 16),
        ("int32", "-0x10", -16),
        ("int32", "007", 7),
        ("octet", "7", b"\x07"),
        ("octet", "a", b"a"),
        ("octet", "\xff", b"\xff"),
        ("octet", " ", b" "),
        ("boolean", " On ", True),
        ("boolean", "NO", False),
        ("float", "-3.4028235e38", -3.4028235e38),
        ("double", "3.5e38", 3.5e38),
        ("long double", "-1e-9", -1e-9),
    ],
)
def test_texts_of_scalars(kind: str, text: str, value: object) -> None:
    """Value and type."""
    found = read_scalar(kind, text)
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("octet", "256"),
        ("octet", "ab"),
        ("octet", "Ā"),
        ("boolean", "2"),
        ("int32", "1.5"),
        ("int32", "1e3"),
        ("int32", "0x"),
        ("float", "3.4028236e38"),
        ("double", "1,5"),
    ],
)
def test_texts_that_are_no_such_scalar(kind: str, text: str) -> None:
    """None is rounded, cut off or guessed, whether infinities are allowed or not."""
    for finite in (True, False):
        with pytest.raises(ValueError, match="is "):
            read_scalar(kind, text, finite)


@pytest.mark.parametrize("kind", ["float", "double"])
def test_infinities_only_when_they_are_meant(kind: str) -> None:
    """They must be allowed and spelled out; a number that is too large never is one."""
    twist = filled(Twist(), "{linear: {x: .inf}}", finite=False)
    assert twist.linear.x == math.inf
    for text, value in (("inf", math.inf), ("-.inf", -math.inf), (".Inf", math.inf)):
        assert read_scalar(kind, text, finite=False) == value
        with pytest.raises(ValueError, match="--allow-non-finite accepts it"):
            read_scalar(kind, text)
    assert math.isnan(read_scalar(kind, ".NaN", finite=False))
    for finite in (True, False):
        with pytest.raises(ValueError, match='is a finite number, not "1e999"$'):
            read_scalar(kind, "1e999", finite)
