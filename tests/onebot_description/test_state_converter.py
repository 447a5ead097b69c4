"""The compiled call gives, bit by bit, what ordinary messages give, for any sequence of bytes."""

import gc
import tracemalloc
import weakref
from unittest.mock import patch

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from onebot_description.description import parse_description
from onebot_description.model import RobotModel
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.message_arrays import one_joint_state
from onebot_description.ros.wire.state_converter import JointStatePlan, StateConverter
from tests.any_message import broken
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


def _read(data):
    return None if data is None else deserialize_message(data, TFMessage)


def _both(model, messages, **options):
    """What the two ways publish for the same messages, all but the first; each with its times."""
    compiled, ordinary = StateConverter(model, **options), StateConverter(model, **options)
    for message in messages:
        data = serialize_message(message)
        yield (
            _read(compiled.convert_bytes(data, NOW)),
            _read(ordinary.convert_message(data, NOW)),
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
    seconds = st.integers(0, 3) | st.sampled_from([-(2**31), -1, 12, 2**31 - 1])
    nanoseconds = st.integers(0, 999_999_999) | st.sampled_from([10**9, 2**32 - 1])
    stamp = (draw(seconds), draw(nanoseconds))
    frame_id = draw(st.sampled_from(["", "base", "a_frame_with_a_name"]))
    extra = [draw(st.lists(value, max_size=4)) for _ in range(2)]
    return _message(names, positions, stamp, frame_id, *extra)


def test_a_floating_joint_is_left_to_another_node():
    """As in robot_state_publisher; an odometry moves its link, which has one parent."""
    joints = "".join(
        f'<joint name="{kind}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        '<origin xyz="1 0 0"/></joint>'
        for kind, parent, child in (
            ("floating", "world", "base"),
            ("planar", "world", "table"),
            ("fixed", "base", "lidar"),
        )
    )
    links = "".join(f'<link name="{name}"/>' for name in ("world", "base", "table", "lidar"))
    model = _model(f'<robot name="r">{links}{joints}</robot>')
    found = StateConverter(model, frame_prefix="a/").static_transforms(0).transforms
    frames = {each.child_frame_id: each.header.frame_id for each in found}
    assert frames == {"a/table": "a/world", "a/lidar": "a/base"}
    assert [each.transform.translation.x for each in found] == [1.0, 1.0]
    held = StateConverter(model).static_transforms(0, floating=True).transforms
    assert {each.child_frame_id for each in held} == {"base", "table", "lidar"}
    assert model.link_matrices({})["base"][0, 3] == 1.0


@pytest.mark.usefixtures("quick_collector")
def test_what_is_kept_of_messages_is_bounded():
    converter = StateConverter(_model(chain(1)), ignore_timestamp=True)
    gc.collect()
    tracemalloc.start()
    try:
        for number in range(100):
            names = ["joint_0", *(f"{number}_{index}" + "x" * 990 for index in range(400))]
            data = serialize_message(_message(names, [0.0] * len(names)))
            assert converter.convert_bytes(data, NOW) is not None
            assert one_joint_state(data).names[0] == "joint_0"
            del data, names
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 40e6


@pytest.mark.parametrize(
    ("message", "key"),
    [
        (_message(["joint_0"], [0.0], (0, 0)), "stamp"),
        (_message(["joint_0"], [0.0], (-1, 999_999_999)), "stamp"),
        (_message(["joint_0"], []), "empty"),
        (_message(["joint_0"], [1.0, 2.0]), "sizes"),
        (_message(["joint_0"], [float("nan")]), "finite"),
    ],
)
def test_unusable_messages_are_ignored_with_a_reason(message, key):
    warnings = []
    options = {"warn": lambda key, _: warnings.append(key)}
    assert list(_both(_model(chain(1)), [message], **options)) == [(None, None)]
    assert warnings == [key, key]


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
def test_what_overflows_for_a_follower_is_ignored(position, multiplier, offset, moved):
    model = _model(FOLLOWED.format(multiplier=multiplier, offset=offset))
    warnings = []
    options = {"warn": lambda key, text: warnings.append((key, text))}
    usual = _message(["lead", "other"], [0.0, 0.25])
    message = _message(["lead", "other"], [position, 0.25], (101, 0))
    *_, (compiled, ordinary) = _both(model, [usual, message], **options)
    assert compiled == ordinary
    assert {transform.child_frame_id for transform in compiled.transforms} == moved
    for transform in compiled.transforms:
        translation = transform.transform.translation
        assert np.isfinite([translation.x, translation.y, translation.z]).all()
    expected = [] if "a" in moved else ["finite"] * 2
    assert [key for key, _ in warnings] == expected
    assert all(text.endswith("are ignored: lead") for _, text in warnings)


# Any sequence of bytes ----------------------------------------------------------------------


@st.composite
def edits(draw, messages):
    """Serialized messages, some of them cut, longer, or with another byte somewhere."""
    return broken(draw, draw(st.sampled_from(messages)))


@given(
    robots(),
    st.data(),
    st.fixed_dictionaries(
        {
            "ignore_timestamp": st.booleans(),
            "frame_prefix": st.sampled_from(["", "my_prefix/"]),
            "interval_ns": st.sampled_from([0, 1, 10**8]),
        }
    ),
)
def test_any_bytes_give_what_ordinary_messages_give(urdf, data, options):
    model = _model(urdf)
    warnings = ([], [])
    compiled, ordinary = (
        StateConverter(model, warn=lambda *text, out=out: out.append(text), **options)
        for out in warnings
    )
    states = data.draw(st.lists(joint_states([*model.joints]), min_size=1, max_size=12))
    messages = [serialize_message(state) for state in states]
    steps = st.tuples(edits(messages), st.sampled_from([0, 0, 0, 1, -1]))
    now = NOW
    for message, step in data.draw(st.lists(steps, max_size=60)):
        now += step
        published = _read(compiled.convert_bytes(message, now))
        assert published == _read(ordinary.convert_message(message, now))
        for edge in [] if published is None else published.transforms:
            rotation = edge.transform.rotation
            norm = np.linalg.norm([rotation.x, rotation.y, rotation.z, rotation.w])
            assert norm == pytest.approx(1.0, abs=1e-12)
    assert warnings[0] == warnings[1]


def test_a_message_is_whole_or_ignored():
    warnings = []
    converter = StateConverter(_model(chain(2)), warn=lambda key, _: warnings.append(key))
    whole = serialize_message(
        _message(["joint_0", "joint_1"], [0.5, 0.25], velocity=[1.0, 2.0], effort=[3.0])
    )
    assert _read(converter.convert_bytes(whole, NOW)) == _read(converter.convert_bytes(whole, NOW))
    for size in range(len(whole)):
        assert converter.convert_bytes(whole[:size], NOW) is None
    assert warnings == ["bytes"] * len(whole)
    assert converter.convert_bytes(whole + b"more", NOW) is not None


@pytest.fixture
def ordinary_calls():
    """A mock that counts the messages that take the ordinary way."""
    original = StateConverter.convert_message
    with patch.object(
        StateConverter, "convert_message", autospec=True, side_effect=original
    ) as mock:
        yield mock


@pytest.mark.parametrize("publishers", [1, 16])
def test_the_usual_message_takes_the_compiled_call(ordinary_calls, publishers):
    converter = StateConverter(_model(chain(9)))
    for second in range(1, 6):
        for publisher in range(publishers):
            names = [f"joint_{publisher % 8}", "odd", f"joint_{publisher % 8 + 1}"]
            message = _message(names, [0.1, 0.2, 0.3], (second, publisher), f"robot{publisher}")
            data = serialize_message(message)
            at = data.index(b"odd\0") + 4
            data = data[:at] + bytes([second]) * (-at % 4) + data[at + -at % 4 :]
            assert converter.convert_bytes(data, NOW) is not None
    assert ordinary_calls.call_count == publishers


def test_what_is_not_usual_takes_ordinary_messages(ordinary_calls):
    converter = StateConverter(_model(chain(1)))

    def ordinary(position, stamp, now=NOW):
        ordinary_calls.reset_mock()
        converter.convert_bytes(serialize_message(_message(["joint_0"], [position], stamp)), now)
        return ordinary_calls.call_count

    assert ordinary(0.0, (5, 0)) == 1
    assert ordinary(0.0, (5, 1)) == 0
    assert ordinary(np.nan, (5, 2)) == 1
    assert ordinary(1e101, (5, 2)) == 1
    assert ordinary(-np.inf, (5, 2)) == 1
    assert ordinary(0.0, (0, 0)) == 1
    assert ordinary(0.0, (-1, 0)) == 1
    assert ordinary(0.0, (5, 0)) == 1
    assert ordinary(0.0, (4, 0), NOW - 1) == 1
    assert ordinary(0.0, (4, 1), NOW - 1) == 0


@pytest.mark.parametrize(
    "arguments", [(), (b"",), (b"", 1, 2), ("text", 1), (b"", "1"), (b"", 2**63)]
)
def test_wrong_arguments(arguments):
    with pytest.raises((TypeError, OverflowError)):
        StateConverter(_model(chain(1))).convert_bytes(*arguments)


def test_a_converter_goes_with_the_robot_it_served():
    converter = StateConverter(_model(chain(3)))
    data = [serialize_message(_message(["joint_0"], [0.5], (second, 0))) for second in (1, 2)]
    converter.convert_bytes(data[0], NOW)
    kept = converter.convert_bytes(data[1], NOW)
    copy = bytes(bytearray(kept))
    gone = weakref.ref(converter)
    del converter
    gc.collect()
    assert gone() is None
    assert kept == copy


@pytest.fixture
def quick_collector():
    """The garbage collector looks only at what the test makes, not at the whole session's."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.mark.usefixtures("quick_collector")
def test_the_builtin_outlives_its_converter():
    convert = StateConverter(_model(chain(3))).convert_bytes
    for second in range(1, 100):  # more names than are kept
        names = [f"joint_{second % 3}", "x" * second]
        first, again = (
            serialize_message(_message(names, [0.5, 0.0], (second, nanosecond)))
            for nanosecond in (0, 1)
        )
        ordinary = _read(convert(first, NOW)).transforms
        gc.collect()
        compiled = _read(convert(again, NOW)).transforms
        assert [t.transform for t in compiled] == [t.transform for t in ordinary]


# A plan's arithmetic ------------------------------------------------------------------------


@given(robots(), st.data())
def test_a_plan_agrees_with_the_model(urdf, data):
    model = _model(urdf)
    names = data.draw(st.permutations(model.joints))
    size = len(names)
    positions = np.array(data.draw(st.lists(st.floats(-1e3, 1e3), min_size=size, max_size=size)))
    plan = JointStatePlan(model, names, "robot/")
    translations, rotations = model.transforms(dict(zip(names, positions, strict=True)))
    expected = np.concatenate((translations, rotations), axis=1)
    # Positions up to 1e3 m, and mimics of mimics: the error grows with them.
    actual = plan.transforms(positions.astype(float))
    np.testing.assert_allclose(actual, expected[plan.rows], rtol=1e-12, atol=1e-12)
    assert plan.children == [f"robot/{child}" for child in model.moving.children]


def test_a_follower_left_out_follows_nothing_that_overflows():
    """Its own position is NaN; then it would follow the other's, and be infinite by that."""
    model = _model(FOLLOWED.format(multiplier=10.0, offset=0.0))
    names = ["lead", "follow", "other"]
    usual = _message(names, [0.0, 0.0, 0.25])
    message = _message(names, [1.7e308, np.nan, 0.25], (101, 0))
    *_, (compiled, ordinary) = _both(model, [usual, message])
    assert compiled == ordinary
    assert [transform.child_frame_id for transform in compiled.transforms] == ["c"]
