"""The TF tree: lookups between frames over time, against the definition of tf2's buffer."""

import math
import time
from collections.abc import Sequence

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from onebot_description.ros.frame_tree import FrameTree
from onebot_description.ros.transform_buffer import TransformException
from onebot_description.ros.wire.message_arrays import TfArrays
from tests.support import assert_time_grows_with_size

SECOND = 1_000_000_000
NONE = (0.0, 0.0, 0.0, 1.0)
NO_TURN = np.array(NONE)
QUARTER_TURN = np.array([0, 0, np.sqrt(0.5), np.sqrt(0.5)])  # about z


def add(
    tree: FrameTree,
    parent: str,
    child: str,
    seconds: float = 0.0,
    translation: Sequence[float] = (0.0, 0.0, 0.0),
    rotation: Sequence[float] = NONE,
    static: bool = False,
) -> list[str]:
    return tree.add(
        TfArrays(
            (parent,), (child,), np.array([int(seconds * SECOND)]),
            np.array([translation], float), np.array([rotation], float),
        ),
        static=static,
    )  # fmt: skip


def turned(degrees: float) -> tuple[float, ...]:
    return tuple(Rotation.from_euler("z", degrees, degrees=True).as_quat())


def test_lookup_at_the_latest_common_time() -> None:
    """The slower frame sets the time; the faster one is interpolated at it, along the short arc."""
    tree = FrameTree()
    add(tree, "odom", "base", 1.0, (1.0, 0.0, 0.0))
    add(tree, "odom", "base", 2.0, (2.0, 0.0, 0.0), turned(90))
    add(tree, "base", "arm", 1.25, (0.0, 1.0, 0.0))
    add(tree, "arm", "tool", 0.0, (0.0, 0.0, 0.5), static=True)
    found = tree.lookup("odom", "tool")
    turn = Slerp([1.0, 2.0], Rotation.from_quat([NONE, turned(90)]))(1.25)
    assert found.stamp_ns == 1.25 * SECOND
    np.testing.assert_allclose(found.matrix[:3, :3], turn.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(found.matrix[:3, 3], turn.apply([0, 1, 0.5]) + [1.25, 0, 0])
    back = tree.lookup("tool", "odom").matrix
    np.testing.assert_allclose(back @ found.matrix, np.eye(4), atol=1e-12)
    assert tree.lookup("arm", "tool").stamp_ns == 0  # static only
    np.testing.assert_allclose(tree.lookup("base", "base").matrix, np.eye(4), atol=1e-12)
    add(tree, "base", "left", 0.0, (0.0, 3.0, 0.0), static=True)
    np.testing.assert_allclose(tree.lookup("left", "arm").matrix[:3, 3], [0, -2, 0], atol=1e-12)


def test_errors_in_the_words_of_tf2() -> None:
    """A frame that does not exist, and one that is not connected; test_tf2_buffer.py has others."""
    tree = FrameTree()
    add(tree, "odom", "base", 1.0)
    add(tree, "map", "marker", 1.0)
    for pair, words in {
        ("odom", "bse"): 'Invalid frame ID "bse" passed to lookupTransform argument source_frame - '
        'frame does not exist (did you mean "base"? frames: ',
        ("odom", "marker"): "Could not find a connection between 'odom' and 'marker' because they "
        "are not part of the same tree.",
    }.items():
        with pytest.raises(TransformException) as error:
            tree.lookup(*pair)
        assert words in str(error.value)
    assert tree.roots == ["map", "odom"]


def test_what_tf2_ignores() -> None:
    """Transforms that are none change nothing; each says why."""
    tree = FrameTree()
    assert "nan" in add(tree, "a", "b", translation=(math.nan, 0.0, 0.0))[0]
    assert "not normalized" in add(tree, "a", "b", rotation=(0.0, 0.0, 0.0, 0.0))[0]
    assert 'both "b"' in add(tree, "b", "b")[0]
    assert "not set" in add(tree, "", "b")[0]
    assert not tree.names


def test_history() -> None:
    """Ten seconds; a late one is sorted in; a clock set back begins anew, as does a new parent."""
    tree = FrameTree()
    for seconds in (20.0, 23.0, 22.5, 31.0):
        add(tree, "a", "b", seconds, (seconds, 0.0, 0.0))
    assert tree.span("b") == (22.5 * SECOND, 31 * SECOND)
    add(tree, "a", "b", 1.0)  # the simulation was reset
    assert tree.span("b") == (SECOND, SECOND)
    add(tree, "c", "b", 2.0)
    assert tree.names == {"b", "c"} and tree.span("c") is None
    add(tree, "c", "b", static=True)
    assert tree.span("b") is None


def joined(parents: Sequence[str], children: Sequence[str], x: float = 1.0) -> TfArrays:
    """A message in which each child is ``x`` meters along x of its parent."""
    count = len(parents)
    places, turns = np.tile([x, 0.0, 0.0], (count, 1)), np.tile(NO_TURN, (count, 1))
    return TfArrays(tuple(parents), tuple(children), np.zeros(count, np.int64), places, turns)


def test_poses_chain_transforms() -> None:
    """A point 2 m along y of a base turned by a quarter lies at x = 1 - 2."""
    tree = FrameTree()
    add(tree, "odom", "base", 1.0, (1.0, 0.0, 0.0), QUARTER_TURN)
    add(tree, "base", "arm", 1.0, (0.0, 2.0, 0.0))
    add(tree, "base", "wheel", translation=(0.0, 0.0, 3.0), static=True)
    np.testing.assert_allclose(tree.pose("arm", "odom")[:3, 3], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(tree.pose("wheel", "arm")[:3, 3], [0, -2, 3], atol=1e-12)
    assert tree.pose("elsewhere", "odom") is None
    assert set(tree.poses(["arm", "elsewhere"], "base")) == {"arm"}


def test_each_frame_of_a_circle_is_its_own_top() -> None:
    """Nonsense on /tf must not hang the viewer; what is below the circle remains connected."""
    for own_parent in ([], ["d"]):
        tree = FrameTree()
        parents = ["b", "c", "a", "b", "link", *own_parent]
        tree.update(joined(parents, ["a", "b", "c", "link", "tip", *own_parent]))
        assert [tree.top(name) for name in "abcd"] == ["a", "b", "c", "d"]
        assert tree.top("tip") == tree.top("link") == "b"
        assert tree.pose("tip", "link")[0, 3] == 1.0 and tree.pose("tip", "b")[0, 3] == 2.0
        assert tree.pose("a", "b") is None and tree.pose("a", "a")[0, 3] == 0.0
        assert tree.roots == ["a", *own_parent]
        with pytest.raises(TransformException, match="Could not find a connection"):
            tree.lookup("tip", "a")


def test_a_large_circle_takes_time_by_its_size() -> None:
    """And not by its square."""

    def seconds(count: int) -> float:
        names = [f"frame_{number}" for number in range(count)]
        tree, start = FrameTree(), time.process_time()
        tree.update(joined(names, [*names[1:], names[0]]))
        for name in names:
            tree.top(name)
        return time.process_time() - start

    assert_time_grows_with_size(seconds, 20_000)


def test_the_latest_message_on_a_frame_counts() -> None:
    """The same names again move their frames; another parent, or a forgotten frame, is a change."""
    tree = FrameTree()
    both = joined("ab", "bc")
    tree.update(both)
    version = tree.version
    tree.update(both._replace(translations=3.0 * both.translations))
    assert tree.version == version and tree.pose("c", "a")[0, 3] == 6.0
    tree.update(joined("x", "c"))
    assert tree.version != version and tree.top("c") == "x"
    tree.update(both)
    assert tree.top("c") == "a" and tree.pose("c", "a")[0, 3] == 2.0
    tree.forget(["b", "never"])
    assert tree.top("c") == "b" and tree.names == {"b", "c"}
    tree.update(both)
    assert tree.top("c") == "a" and tree.names == {"a", "b", "c"}


def test_a_pose_at_a_time() -> None:
    """Interpolated between two messages, as tf2 does; else that of the nearest."""
    tree = FrameTree()
    add(tree, "base", "laser", translation=(1.0, 0.0, 0.0), static=True)
    add(tree, "odom", "base", 1.0)
    add(tree, "odom", "base", 2.0, (4.0, 0.0, 0.0), -QUARTER_TURN)
    add(tree, "odom", "base", 3.0, (6.0, 0.0, 0.0), QUARTER_TURN)

    def laser(seconds: float) -> np.ndarray:
        return tree.pose("laser", "odom", int(seconds * 1e9))[:2, 3]

    np.testing.assert_allclose(laser(1.5), [2 + np.sqrt(0.5), np.sqrt(0.5)])
    np.testing.assert_allclose(laser(2.75), [5.5, 1], atol=1e-12)
    for first in (0.5, 1.0):
        np.testing.assert_allclose(laser(first), [1, 0])
    for latest in (0, -20.0, 3.0, 9.0):
        np.testing.assert_allclose(laser(latest), [6, 1], atol=1e-12)
    back = tree.pose("odom", "laser", int(1.5e9))
    np.testing.assert_allclose(back, np.linalg.inv(tree.pose("laser", "odom", int(1.5e9))))
    for seconds in (1.0, 2.0):  # the clock was set back
        add(tree, "odom", "base", seconds, (8.0, 0.0, 0.0))
    np.testing.assert_allclose(laser(1.5), [9, 0])


def test_a_transform_that_comes_late_takes_its_place_in_the_history() -> None:
    """The latest is that of the latest stamp, as in tf2."""
    tree = FrameTree()
    for seconds in (1.0, 2.0, 3.0, 2.5, 4.0, 3.5):
        add(tree, "odom", "base", seconds, (10 * seconds, 0.0, 0.0))
    for seconds, x in ((0, 40), (1.5, 15), (2.25, 22.5), (3.25, 32.5)):
        assert tree.pose("base", "odom", int(seconds * 1e9))[0, 3] == pytest.approx(x)
    assert tree.known_until("base") == 4e9
