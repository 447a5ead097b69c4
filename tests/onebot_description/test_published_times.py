"""Which joint states are published: by their stamps, the interval, and clocks that are set back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_description.ros.wire.state_converter import PublishedTimes

SECOND = 1_000_000_000
ALL, FIRST = (np.array(rows, np.intp) for rows in ([0, 1], [0]))


class Warnings(list[str]):
    """The kinds of the warnings given."""

    def __call__(self, kind: str, text: str) -> None:
        """Note one."""
        assert text
        self.append(kind)


def due(times: PublishedTimes, rows: np.ndarray, stamp: int, now: int = SECOND) -> bool:
    """Whether a message is published; the only warning may be of an older stamp."""
    warnings = Warnings()
    found = times.due(rows, stamp, now, warnings)
    assert warnings in ([], [] if found else ["old"])
    return found


@pytest.mark.parametrize("stamp", [0, -1])
def test_a_stamp_that_is_no_time_is_reported_and_not_published(stamp: int) -> None:
    times, warnings = PublishedTimes(1), Warnings()
    assert not times.due(FIRST, stamp, 0, warnings)
    assert warnings == ["stamp"] and times.stamps.tolist() == [0]


LATEST = (2**31 - 1) * SECOND + 2**32 - 1  # that a message can have


@pytest.mark.parametrize("future", [100 * SECOND + 10 * SECOND, LATEST])
def test_a_stamp_in_the_future_does_not_silence_the_joints(future: int) -> None:
    times, warnings = PublishedTimes(2, SECOND), Warnings()
    assert due(times, ALL, 90 * SECOND) and due(times, FIRST, future)
    assert due(times, ALL, 100 * SECOND)  # the second joint is due
    assert due(times, FIRST, future)
    assert times.due(FIRST, 100 * SECOND, 10**18, warnings) and warnings == ["back"]
    assert times.stamps.tolist() == [100 * SECOND, 100 * SECOND]
    assert not due(times, ALL, 100 * SECOND + 1, now=10**18)
    assert due(times, ALL, 101 * SECOND, now=10**18)


def test_a_little_older_is_out_of_order() -> None:
    times, warnings = PublishedTimes(1), Warnings()
    assert due(times, FIRST, 100 * SECOND)
    assert not times.due(FIRST, 90 * SECOND + 1, SECOND, warnings)
    assert not times.due(FIRST, 100 * SECOND - 1, SECOND, warnings)
    assert warnings == ["old", "old"]
    assert due(times, FIRST, 100 * SECOND)


def test_stamps_may_be_ignored() -> None:
    times = PublishedTimes(2, SECOND, ignore_timestamp=True)
    assert all(due(times, ALL, stamp) for stamp in (9, 9, 0, 5, 1))


def test_a_clock_set_back_is_noticed_by_messages_that_are_not_published() -> None:
    times, warnings = PublishedTimes(1, SECOND), Warnings()
    nothing = np.array([], np.intp)
    assert times.due(FIRST, 50 * SECOND, 50, warnings)
    assert not times.due(nothing, 0, 10, warnings)
    assert warnings == ["clock"] and times.stamps.tolist() == [0]
    assert times.due(FIRST, 3 * SECOND, 20, warnings)
    assert warnings == ["clock"]


@given(
    interval=st.integers(0, 5),
    messages=st.lists(
        st.tuples(st.sampled_from([[0], [1], [0, 1]]), st.integers(1, 40), st.integers(0, 20)),
        max_size=40,
    ),
)
def test_a_joint_is_published_no_more_often_than_asked(interval: int, messages: list) -> None:
    """Between two resets of the clock every joint alone keeps the interval and the order.

    An older message than the last one of its joints is reported.

    A joint that was never published counts as published at time 0, as in the standard node.
    """
    times, clock = PublishedTimes(2, interval), 0
    last: dict[int, int] = {}
    for rows, stamp, now in messages:
        warnings = Warnings()
        published = times.due(np.array(rows, np.intp), stamp, now, warnings)
        if now < clock:
            last.clear()
        older = stamp < min(last.get(row, 0) for row in rows)
        assert warnings == ["clock"] * (now < clock) + ["old"] * older
        clock = now
        wanted = any(stamp >= last.get(row, 0) + interval for row in rows)
        assert published == wanted
        last |= dict.fromkeys(rows, stamp) if published else {}
