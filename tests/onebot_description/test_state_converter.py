"""The hot path of raw bytes gives, bit by bit, what ordinary messages give."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from onebot_description.description import parse_description
from onebot_description.model import RobotModel
from onebot_description.wire import state_converter
from onebot_description.wire.cdr import WireError
from onebot_description.wire.messages import joint_state_arrays, to_message
from onebot_description.wire.state_converter import StateConverter
from onebot_description.wire.tf_message import TFMessage
from tests.random_robots import chain, robots

NOW = 10**18


def _message(names, positions, stamp=(100, 5), frame_id="", velocity=(), effort=()):
    header = Header(stamp=Time(sec=stamp[0], nanosec=stamp[1]), frame_id=frame_id)
    return JointState(
        header=header,
        name=list(names),
        position=list(positions),
        velocity=list(velocity),
        effort=list(effort),
    )


def _model(urdf):
    return RobotModel.from_description(parse_description(urdf))


def _both(model, messages, **options):
    """What the two paths publish for the same messages; each has its own throttle."""
    raw, plain = StateConverter(model, **options), StateConverter(model, **options)
    for message in messages:
        data = raw.convert_bytes(serialize_message(message), NOW)
        result = plain.convert(joint_state_arrays(message), NOW)
        yield (
            None if data is None else deserialize_message(data, TFMessage),
            None if result is None else to_message(result),
        )


@st.composite
def joint_states(draw, joints):
    """Subsets, reordered and unknown names, duplicates, other frames, extra fields, empty ones."""
    pool = [*joints, "unknown", "joint_0"]
    names = draw(st.lists(st.sampled_from(pool), max_size=len(pool)))
    value = st.floats(-10, 10) | st.sampled_from([float("nan"), float("inf"), 1e300])
    size = len(names)
    positions = draw(
        st.lists(value, min_size=size, max_size=size) | st.lists(value, max_size=size + 1)
    )
    stamp = (draw(st.integers(0, 3)), draw(st.integers(0, 999_999_999)))
    frame_id = draw(st.sampled_from(["", "base", "a_frame_with_a_name"]))
    extra = [draw(st.lists(value, max_size=4)) for _ in range(2)]
    return _message(names, positions, stamp, frame_id, *extra)


@settings(deadline=None, max_examples=150)
@given(
    robots(),
    st.data(),
    st.booleans(),
    st.sampled_from(["", "my_prefix/"]),
    st.sampled_from([0, 10**8]),
)
def test_raw_path_equals_message_path(urdf, data, ignore_timestamp, prefix, interval):
    """Equal messages, or nothing from both, on random robots and sequences of joint states."""
    model = _model(urdf)
    messages = data.draw(st.lists(joint_states([*model.joints, "joint_0"]), max_size=6))
    options = {
        "ignore_timestamp": ignore_timestamp,
        "frame_prefix": prefix,
        "interval_ns": interval,
    }
    for raw, plain in _both(model, messages, **options):
        assert raw == plain
        for edge in [] if raw is None else raw.transforms:
            rotation = edge.transform.rotation
            norm = np.linalg.norm([rotation.x, rotation.y, rotation.z, rotation.w])
            assert norm == pytest.approx(1.0, abs=1e-12)


def test_every_named_joint_is_published_at_its_angle():
    """A known angle gives the known half-angle quaternion, stamped as the message."""
    model = _model(chain(2).replace('rpy="0.1 0.2 0.3"', ""))
    [(raw, _)] = _both(model, [_message(["joint_1"], [1.0], (7, 9))])
    [edge] = raw.transforms
    assert (edge.header.frame_id, edge.child_frame_id) == ("link_1", "link_2")
    assert (edge.header.stamp.sec, edge.header.stamp.nanosec) == (7, 9)
    assert edge.transform.rotation.z == pytest.approx(np.sin(0.5))
    assert edge.transform.rotation.w == pytest.approx(np.cos(0.5))
    assert edge.transform.translation.z == 0.2


def test_padding_bytes_do_not_matter():
    """Other padding between the names is the same message, since writers leave it uninitialised."""
    model = _model(chain(2))
    converter = StateConverter(model)
    data = serialize_message(_message(["joint_0", "joint_1"], [0.5, 0.25]))
    first = converter.convert_bytes(data, NOW)
    start = data.index(b"joint_0\0") + 8
    other = data.replace(b"\0\0joint_1", b"\0\0joint_1")
    assert start and other == data  # 8-byte names leave no padding here; the next one does
    names = ["joint_0", "x", "joint_1"]
    data = serialize_message(_message(names, [0.5, 0.0, 0.25]))
    padding = data.index(b"x\0") + 2
    noisy = data[:padding] + b"\xaa\xbb" + data[padding + 2 :]
    assert deserialize_message(noisy, JointState) == deserialize_message(data, JointState)
    assert converter.convert_bytes(data, NOW) == converter.convert_bytes(noisy, NOW) == first


def test_throttle_looks_at_the_oldest_joint_of_the_message():
    """A joint not published lately lets the whole message pass, as in the standard node."""
    converter = StateConverter(_model(chain(2)), interval_ns=10**9)

    def published(names, second):
        data = serialize_message(_message(names, [0.0] * len(names), (second, 0)))
        return converter.convert_bytes(data, NOW) is not None

    assert published(["joint_0"], 10)
    assert not published(["joint_0"], 10)
    assert published(["joint_1"], 10)
    assert published(["joint_0"], 11)
    assert published(["joint_0", "joint_1"], 11)  # joint_1 was last published at 10
    assert not published(["joint_1"], 11)


def test_old_stamps_wait_until_the_clock_is_set_back():
    """An older stamp is dropped; when the node's clock went back, it is published afresh."""
    warnings = []
    converter = StateConverter(_model(chain(1)), warn=lambda key, _: warnings.append(key))
    new, old = (serialize_message(_message(["joint_0"], [0.0], (s, 0))) for s in (20, 10))
    assert converter.convert_bytes(new, NOW) is not None
    assert converter.convert_bytes(old, NOW + 1) is None
    assert converter.convert_bytes(old, NOW - 1) is not None
    assert warnings == ["clock"]


@pytest.mark.parametrize(
    ("message", "key"),
    [
        (_message(["joint_0"], [0.0], (0, 0)), "stamp"),
        (_message(["joint_0"], []), "empty"),
        (_message(["joint_0"], [1.0, 2.0]), "sizes"),
        (_message(["joint_0"], [float("nan")]), "finite"),
    ],
)
def test_unusable_messages_are_ignored_with_a_reason(message, key):
    """Neither path publishes them, and each says why once."""
    warnings = []
    options = {"warn": lambda key, _: warnings.append(key)}
    assert list(_both(_model(chain(1)), [message], **options)) == [(None, None)]
    assert warnings == [key, key]


@given(st.integers(4, 200), st.binary(max_size=60))
def test_broken_bytes_raise_wire_error(cut, noise):
    """A cut or noisy message is refused or ignored, never a crash."""
    converter = StateConverter(_model(chain(2)))
    whole = serialize_message(_message(["joint_0", "joint_1"], [0.5, 0.25]))
    converter.convert_bytes(whole, NOW)
    for data in (whole[:cut], whole[:cut] + noise, noise):
        try:
            result = converter.convert_bytes(data, NOW)
        except WireError:
            continue
        assert result is None or deserialize_message(result, TFMessage)


FOLLOWED = """<robot name="arm">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/>
  <joint name="lead" type="prismatic"><parent link="base"/><child link="a"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="follow" type="prismatic"><parent link="a"/><child link="b"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
    <mimic joint="lead" multiplier="{multiplier}" offset="{offset}"/></joint>
  <joint name="other" type="continuous"><parent link="base"/><child link="c"/></joint>
</robot>"""


@pytest.mark.parametrize(
    ("position", "multiplier", "offset", "moved"),
    [
        (1e308, -10.0, 0.0, {"c"}),
        (1.7e308, 1.0, 1.7e308, {"c"}),
        (1e200, 1e200, 0.0, {"c"}),
        (1e300, 10.0, 0.0, {"a", "b", "c"}),
        (0.5, 1e200, 1e150, {"a", "b", "c"}),
    ],
)
@pytest.mark.parametrize("library", [True, False])
def test_what_overflows_for_a_follower_is_ignored(
    monkeypatch, position, multiplier, offset, moved, library
):
    """As a position that is not finite; both paths agree, and nothing on /tf is ever not finite."""
    if not library:
        monkeypatch.setattr(state_converter, "compiled", lambda: None)
    model = _model(FOLLOWED.format(multiplier=multiplier, offset=offset))
    warnings = []
    options = {"warn": lambda key, text: warnings.append((key, text))}
    message = _message(["lead", "other"], [position, 0.25])
    ((raw, plain),) = _both(model, [message], **options)
    assert raw == plain
    assert {transform.child_frame_id for transform in raw.transforms} == moved
    for transform in raw.transforms:
        translation = transform.transform.translation
        assert np.isfinite([translation.x, translation.y, translation.z]).all()
    told = [] if "a" in moved else ["finite"] * 2
    assert [key for key, _ in warnings] == told
    assert all("too large for what follows it: lead; ignored" in text for _, text in warnings)
