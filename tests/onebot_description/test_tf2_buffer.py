"""tf2_py.BufferCore: numbers, rules, texts and the log of tf2, in the words of its C++ sources."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time
from scipy.spatial.transform import Rotation, Slerp
from tf2_py import (
    BufferCore,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
)

import onebot_description  # noqa: F401  (finds the package)

NONE = (0.0, 0.0, 0.0, 1.0)
LATEST = Time()


def at(seconds: float) -> Time:
    return Time(nanoseconds=round(seconds * 1e9))


def stamped(
    parent: str,
    child: str,
    seconds: float,
    place: Sequence[float] = (0.0, 0.0, 0.0),
    turn: Sequence[float] = NONE,
) -> TransformStamped:
    message = TransformStamped()
    message.header.frame_id, message.child_frame_id = parent, child
    message.header.stamp = at(seconds).to_msg()
    vector, quaternion = message.transform.translation, message.transform.rotation
    vector.x, vector.y, vector.z = map(float, place)
    quaternion.x, quaternion.y, quaternion.z, quaternion.w = map(float, turn)
    return message


def matrix(message: TransformStamped) -> np.ndarray:
    at, turn = message.transform.translation, message.transform.rotation
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    result[:3, 3] = at.x, at.y, at.z
    return result


@pytest.fixture
def buffer() -> BufferCore:
    """Odom -> base (1 to 3 s), base -> arm (2 to 4 s), arm -> tool (static), and map -> goal."""
    core = BufferCore()
    for seconds in (1.0, 2.0, 3.0):
        core.set_transform(stamped("odom", "base", seconds, (seconds, 0, 0)), "odometry")
        core.set_transform(stamped("base", "arm", seconds + 1.0, (0, 1, 0)), "joints")
    core.set_transform_static(stamped("arm", "tool", 0.0, (0, 0, 2)), "description")
    core.set_transform(stamped("map", "goal", 1.0), "planner")
    return core


def test_numbers_are_those_of_the_equations() -> None:
    """Interpolated frames down two branches, at two times, within 1e-12 of a re-derivation."""
    random = np.random.default_rng(7)
    stamps = [1.0, 1.25, 2.0, 2.5]
    names = [f"a{i}" for i in range(11)] + [f"b{i}" for i in range(1, 11)]
    parents = {**{f"a{i}": f"a{i - 1}" for i in range(1, 11)}}
    parents |= {f"b{i}": f"b{i - 1}" if i > 1 else "a0" for i in range(1, 11)}
    core, places, turns = BufferCore(), {}, {}
    for child, parent in parents.items():
        places[child] = random.uniform(-5.0, 5.0, (len(stamps), 3))
        turns[child] = Rotation.random(len(stamps), random)
        for row, seconds in enumerate(stamps):
            turn = turns[child][row].as_quat() * random.choice([-1.0, 1.0])
            core.set_transform(stamped(parent, child, seconds, places[child][row], turn), "me")

    def from_root(child: str, seconds: float) -> np.ndarray:
        pose = np.eye(4)
        while child in parents:
            step = np.eye(4)
            step[:3, 3] = [np.interp(seconds, stamps, axis) for axis in places[child].T]
            step[:3, :3] = Slerp(stamps, turns[child])(seconds).as_matrix()
            pose, child = step @ pose, parents[child]
        return pose

    for target, source in (("a0", "a10"), ("a10", "a0"), ("a10", "b10"), ("b3", "a7")):
        for seconds in (1.0, 1.1, 2.2, 2.5):
            expected = np.linalg.inv(from_root(target, seconds)) @ from_root(source, seconds)
            found = core.lookup_transform_core(target, source, at(seconds))
            np.testing.assert_allclose(matrix(found), expected, atol=1e-12)
            turn = found.transform.rotation
            assert abs(turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2 - 1.0) < 1e-12
        expected = np.linalg.inv(from_root(target, 1.1)) @ from_root("a0", 1.1)
        expected = expected @ np.linalg.inv(from_root("a0", 2.2)) @ from_root(source, 2.2)
        full = core.lookup_transform_full_core(target, at(1.1), source, at(2.2), "a0")
        np.testing.assert_allclose(matrix(full), expected, atol=1e-12)
        assert full.header.stamp == at(1.1).to_msg() and full.header.frame_id == target
    assert core._getFrameStrings()[:2] == ["a1", "a0"] and set(core._getFrameStrings()) == {*names}


MISSING = '"nobody" passed to lookupTransform argument {}_frame does not exist. '
UNCONNECTED = (
    "Could not find a connection between '{}' and '{}' because they are not part of the same "
    "tree.Tf has two or more unconnected trees."
)
WAY = ", when looking up transform from frame [{}] to frame [{}]"


@pytest.mark.parametrize(
    "target, source, seconds, kind, text",
    [
        ("nobody", "base", 0.0, LookupException, MISSING.format("target")),
        ("base", "nobody", 2.0, LookupException, MISSING.format("source")),
        ("", "base", 0.0, InvalidArgumentException,
         'Invalid argument "" passed to lookupTransform argument target_frame - in tf2 frame_ids '
         "cannot be empty"),
        ("odom", "/base", 0.0, InvalidArgumentException,
         'Invalid argument "/base" passed to lookupTransform argument source_frame - in tf2 '
         "frame_ids cannot start with a '/'"),
        ("odom", "goal", 0.0, ConnectivityException, UNCONNECTED.format("odom", "goal")),
        ("goal", "odom", 1.0, ConnectivityException, UNCONNECTED.format("goal", "odom")),
        ("odom", "base", 3.5, ExtrapolationException,
         "Lookup would require extrapolation into the future.  Requested time 3.500000 but the "
         "latest data is at time 3.000000" + WAY.format("base", "odom")),
        ("tool", "odom", 1.5, ExtrapolationException,
         "Lookup would require extrapolation into the past.  Requested time 1.500000 but the "
         "earliest data is at time 2.000000" + WAY.format("odom", "tool")),
        ("map", "goal", 1.5, ExtrapolationException,
         "Lookup would require extrapolation at time 1.500000, but only time 1.000000 is in the "
         "buffer" + WAY.format("goal", "map")),
    ],
)  # fmt: skip
def test_what_fails_in_the_words_of_tf2(
    buffer: BufferCore, target: str, source: str, seconds: float, kind: Any, text: str
) -> None:
    with pytest.raises(TransformException) as error:
        buffer.lookup_transform_core(target, source, at(seconds))
    assert (type(error.value), str(error.value)) == (kind, text)
    known, why = buffer.can_transform_core(target, source, at(seconds))
    if kind in (LookupException, InvalidArgumentException):
        role = "target" if "target" in text else "source"
        text = text.replace("Invalid argument", "Invalid frame ID").replace("lookup", "can")
        reason = text.rpartition(" - ")[2] if " - " in text else "frame does not exist"
        name = target if role == "target" else source
        text = f'Invalid frame ID "{name}" passed to canTransform argument {role}_frame - {reason}'
    assert (known, why) == (0, text)


def test_times(buffer: BufferCore) -> None:
    """0 is the latest common time; a static transform holds always, a frame is itself always."""
    found = buffer.lookup_transform_core("odom", "tool", LATEST)
    assert found.header.stamp == at(3.0).to_msg()
    np.testing.assert_allclose(matrix(found)[:3, 3], [3, 1, 2])
    assert buffer.get_latest_common_time("odom", "tool") == at(3.0)
    found = buffer.lookup_transform_core("arm", "tool", at(77.5))
    assert found.header.stamp == at(77.5).to_msg()
    assert buffer.lookup_transform_core("arm", "tool", LATEST).header.stamp == LATEST.to_msg()
    assert buffer.lookup_transform_core("base", "base", LATEST).header.stamp == at(3.0).to_msg()
    unknown = buffer.lookup_transform_core("nobody", "nobody", at(5.0))
    assert (
        unknown.header.stamp == at(5.0).to_msg() and matrix(unknown).tolist() == np.eye(4).tolist()
    )
    for time in (at(2.5), at(2.5).to_msg()):
        assert buffer.can_transform_core("odom", "arm", time) == (1, "")
    assert buffer.can_transform_full_core("odom", at(1), "tool", at(3), "base") == (1, "")
    with pytest.raises(TypeError, match="time must have sec and nanosec, or nanoseconds"):
        buffer.lookup_transform_core("odom", "arm", 2.5)
    with pytest.raises(TypeError, match="must be str, not None"):
        buffer.lookup_transform_core(None, "arm", LATEST)
    with pytest.raises(LookupException, match='"no" passed to get_latest_common_time does not'):
        buffer.get_latest_common_time("odom", "no")
    with pytest.raises(TransformException, match="two or more unconnected trees"):
        buffer.get_latest_common_time("odom", "goal")


def test_history(capfd: pytest.CaptureFixture[str]) -> None:
    """What is older than the cache time is refused; late and repeated transforms are not."""
    core = BufferCore(Duration(seconds=2))
    for seconds in (11.0, 12.5, 12.0, 12.0):
        core.set_transform(stamped("a", "b", seconds, (seconds, 0, 0)), "me")
    found = core.lookup_transform_core("a", "b", at(11.5))
    assert found.transform.translation.x == 11.5
    core.set_transform(stamped("a", "b", 10.4), "late")
    assert (
        "TF_OLD_DATA ignoring data from the past for frame b at time 10.400000 according to "
        "authority late\nPossible reasons are listed at http://wiki.ros.org/tf/Errors%20explained"
    ) in capfd.readouterr().err
    assert "  rate: 2.000\n" in core.all_frames_as_yaml()  # the repeated one is not counted
    core.set_transform(stamped("c", "b", 14.0), "me")  # another parent, from then on
    assert core.lookup_transform_core("a", "b", at(13.0)).transform.translation.x == 12.5
    assert core.can_transform_core("c", "b", at(14.0))[0] and core.all_frames_as_string() == (
        "Frame b exists with parent c.\n"
    )
    core.set_transform_static(stamped("a", "b", 0.0, (5, 0, 0)), "me")
    assert core.lookup_transform_core("a", "b", at(99.0)).transform.translation.x == 5.0
    core.clear()
    assert core.can_transform_core("a", "b", LATEST) == (1, "")
    core.set_transform(stamped("a", "b", 1.0), "me")
    core.clear()
    assert core.all_frames_as_yaml() == "" and core._frameExists("b")
    with pytest.raises(ConnectivityException):
        core.lookup_transform_core("a", "b", LATEST)


def test_no_more_than_the_cache_time_is_kept() -> None:
    core = BufferCore(Duration(seconds=1))
    for number in range(3_000):
        core.set_transform(stamped("a", "b", 1.0 + 0.001 * number), "me")
    assert core._core.states()["b"].samples == 1_002  # it is pruned before a transform is added


def test_what_is_ignored(capfd: pytest.CaptureFixture[str]) -> None:
    core, nan = BufferCore(), math.nan
    for message, text in (
        (stamped("b", "/b", 1.0), 'TF_SELF_TRANSFORM: Ignoring transform from authority "me" with '
         'frame_id and  child_frame_id "b" because they are the same'),
        (stamped("a", "", 1.0), 'TF_NO_CHILD_FRAME_ID: Ignoring transform from authority "me" '
         "because child_frame_id not set "),
        (stamped("", "b", 1.0), 'TF_NO_FRAME_ID: Ignoring transform with child_frame_id "b"  from '
         'authority "me" because frame_id not set'),
        (stamped("a", "b", 1.0, (1, nan, 0)), 'TF_NAN_INPUT: Ignoring transform for '
         'child_frame_id "b" from authority "me" because of a nan value in the transform '
         "(1.000000 nan 0.000000) (0.000000 0.000000 0.000000 1.000000)"),
        (stamped("a", "b", 1.0, turn=(0, 0, 0, 0)), 'TF_DENORMALIZED_QUATERNION: Ignoring '
         'transform for child_frame_id "b" from authority "me" because of an invalid quaternion '
         "in the transform"),
    ):  # fmt: skip
        core.set_transform(message, "me")
        assert text in capfd.readouterr().err
        assert core.all_frames_as_yaml() == "[]" and core.all_frames_as_string() == ""
    for length in (3.0, -1e-3):  # any other length is as good as 1, and w becomes positive
        turn = 0, 0.6 * length, 0, 0.8 * length
        core.set_transform_static(stamped("/a", "b", 0, turn=turn), "me")
        found = core.lookup_transform_core("a", "b", LATEST).transform.rotation
        np.testing.assert_allclose((found.y, found.w), (0.6, 0.8), atol=1e-15)
    message = stamped("a", "b", 1.0)
    message.transform.translation = message.transform.rotation
    with pytest.raises(TypeError, match="translation must be a Vector3"):
        core.set_transform(message, "me")


def test_a_loop_is_an_error_that_shows_the_tree() -> None:
    core = BufferCore()
    for parent, child in (("a", "b"), ("b", "c"), ("c", "a"), ("c", "d")):
        core.set_transform(stamped(parent, child, 1.0), "me")
    with pytest.raises(LookupException) as error:
        core.lookup_transform_core("d", "a", at(1.0))
    assert str(error.value).startswith(
        "The tf tree is invalid because it contains a loop.\nFrame b exists with parent a.\n"
    )


def test_the_tree_as_text(buffer: BufferCore) -> None:
    assert buffer.all_frames_as_yaml().startswith(
        "base: \n  parent: 'odom'\n  broadcaster: 'odometry'\n  rate: 1.500\n"
        "  most_recent_transform: 3.000000\n  oldest_transform: 1.000000\n  buffer_length: 2.000\n"
        "arm: \n  parent: 'base'\n"
    )
    assert "tool: \n  parent: 'arm'\n  broadcaster: 'description'\n  rate: 10000.000\n" in (
        buffer.all_frames_as_yaml()
    )


def test_velocities() -> None:
    """A body on a circle of 2 m at 0.5 rad/s, after a turn of 2.5 rad; as tf2, in world axes."""
    core, rate = BufferCore(), 0.5
    for number in range(101):
        angle = rate * 0.1 * number
        place = 2.0 * math.cos(angle), 2.0 * math.sin(angle), 0.0
        turn = 0.0, 0.0, math.sin(angle / 2.0), math.cos(angle / 2.0)
        core.set_transform(stamped("world", "body", 10.0 + 0.1 * number, place, turn), "me")
    linear, angular = core.lookupVelocityCore("body", "world", at(15.0), Duration(seconds=0.2))
    np.testing.assert_allclose(angular, [0.0, 0.0, rate], atol=1e-9)
    assert math.hypot(*linear) > 0.0
    of_point = core.lookupVelocityFullCore(
        "body", "world", "body", (0, 0, 0), "body", at(15.0), Duration(seconds=0.2)
    )
    np.testing.assert_allclose(of_point[0], [-math.sin(2.5), math.cos(2.5), 0.0], atol=1e-3)
    np.testing.assert_allclose(of_point[1], [0.0, 0.0, rate], atol=1e-9)
