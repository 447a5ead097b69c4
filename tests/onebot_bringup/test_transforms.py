"""Lookups between frames over time, against the definition of tf2's buffer."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from onebot_bringup.introspection.transforms import TransformBuffer, TransformError
from onebot_description.wire.messages import TfArrays

SECOND = 1_000_000_000
NONE = (0.0, 0.0, 0.0, 1.0)


def add(
    buffer: TransformBuffer,
    parent: str,
    child: str,
    seconds: float = 0.0,
    translation: Sequence[float] = (0.0, 0.0, 0.0),
    rotation: Sequence[float] = NONE,
    static: bool = False,
) -> list[str]:
    return buffer.add(
        TfArrays(
            [parent], [child], np.array([int(seconds * SECOND)]),
            np.array([translation], float), np.array([rotation], float),
        ),
        static=static,
    )  # fmt: skip


def turned(degrees: float) -> tuple[float, ...]:
    return tuple(Rotation.from_euler("z", degrees, degrees=True).as_quat())


def test_lookup_at_the_latest_common_time() -> None:
    """The slower frame sets the time; the faster one is interpolated at it, along the short arc."""
    buffer = TransformBuffer()
    add(buffer, "odom", "base", 1.0, (1.0, 0.0, 0.0))
    add(buffer, "odom", "base", 2.0, (2.0, 0.0, 0.0), turned(90))
    add(buffer, "base", "arm", 1.25, (0.0, 1.0, 0.0))
    add(buffer, "arm", "tool", 0.0, (0.0, 0.0, 0.5), static=True)
    found = buffer.lookup("odom", "tool")
    turn = Slerp([1.0, 2.0], Rotation.from_quat([NONE, turned(90)]))(1.25)
    assert found.stamp_ns == 1.25 * SECOND
    assert found.transform[1] == pytest.approx(turn.as_quat())
    assert found.transform[0] == pytest.approx(turn.apply([0.0, 1.0, 0.5]) + [1.25, 0, 0])
    back = buffer.lookup("tool", "odom").transform
    assert Rotation.from_quat(back[1]).apply(found.transform[0]) == pytest.approx(
        [-number for number in back[0]]
    )
    assert buffer.lookup("arm", "tool").stamp_ns == 0  # static only
    assert buffer.lookup("base", "base").transform == ((0.0, 0.0, 0.0), NONE)


def test_interpolation_of_opposite_quaternions() -> None:
    """Both q and -q are one rotation: nothing turns between them."""
    buffer = TransformBuffer()
    add(buffer, "a", "b", 1.0, rotation=turned(40))
    add(buffer, "a", "b", 3.0, rotation=[-number for number in turned(50)])
    add(buffer, "b", "c", 2.0)
    turn = Rotation.from_quat(buffer.lookup("a", "c").transform[1]).magnitude()
    assert math.degrees(turn) == pytest.approx(45.0)


def test_chain_between_branches() -> None:
    """Through the common ancestor, both ways."""
    buffer = TransformBuffer()
    for parent, child in (("odom", "base"), ("base", "left"), ("base", "arm"), ("arm", "tool")):
        add(buffer, parent, child, 1.0, (1.0, 0.0, 0.0))
    assert buffer.chain("left", "tool") == ["left", "base", "arm", "tool"]
    assert buffer.chain("tool", "odom") == ["tool", "arm", "base", "odom"]
    assert buffer.lookup("left", "tool").transform[0] == (1.0, 0.0, 0.0)
    assert buffer.roots == ["odom"] and buffer.children("base") == ["arm", "left"]


def test_errors_in_the_words_of_tf2() -> None:
    """A frame that does not exist, one that is not connected, and no common time."""
    buffer = TransformBuffer()
    add(buffer, "odom", "base", 1.0)
    add(buffer, "map", "marker", 1.0)
    add(buffer, "base", "late", 30.0)
    for pair, words in {
        ("odom", "bse"): 'Invalid frame ID "bse" passed to lookupTransform argument source_frame - '
        'frame does not exist (did you mean "base"? frames: ',
        ("odom", "marker"): "Could not find a connection between 'odom' and 'marker' because they "
        "are not part of the same tree.",
        ("odom", "late"): "Lookup would require extrapolation into the past.  Requested time "
        "1.000000 but the earliest data is at time 30.000000",
    }.items():
        with pytest.raises(TransformError) as error:
            buffer.lookup(*pair)
        assert words in str(error.value)
    assert buffer.roots == ["map", "odom"]


def test_what_tf2_ignores() -> None:
    """Transforms that are none change nothing; each says why."""
    buffer = TransformBuffer()
    assert "nan" in add(buffer, "a", "b", translation=(math.nan, 0.0, 0.0))[0]
    assert "not normalized" in add(buffer, "a", "b", rotation=(0.0, 0.0, 0.0, 0.0))[0]
    assert 'both "b"' in add(buffer, "b", "b")[0]
    assert "not set" in add(buffer, "", "b")[0]
    assert not buffer.names


def test_history() -> None:
    """Ten seconds; out of order is sorted in; back by more begins anew, as does another parent."""
    buffer = TransformBuffer()
    for seconds in (20.0, 25.0, 22.5, 31.0):
        add(buffer, "a", "b", seconds, (seconds, 0.0, 0.0))
    history = buffer.frames["b"]
    assert (history.oldest_ns, history.newest_ns) == (22.5 * SECOND, 31 * SECOND)
    assert history.at(int(23.75 * SECOND))[0] == (23.75, 0.0, 0.0)
    add(buffer, "a", "b", 1.0)  # the simulation was reset
    assert (history.oldest_ns, history.newest_ns) == (SECOND, SECOND)
    add(buffer, "/c", "/b", 2.0)  # with the slash of tf, before tf2
    assert buffer.names == {"b", "c"}


def test_loop() -> None:
    """A loop has one root, its first frame; nothing runs forever."""
    buffer = TransformBuffer()
    for parent, child in (("c", "a"), ("a", "b"), ("b", "c"), ("b", "tail"), ("x", "y")):
        add(buffer, parent, child, 1.0)
    assert buffer.roots == ["a", "x"]
    assert buffer.chain("tail", "c") == ["tail", "b", "a", "c"] or buffer.chain("tail", "c")
    with pytest.raises(TransformError):
        buffer.lookup("a", "y")
