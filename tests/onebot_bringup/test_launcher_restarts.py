"""How often a node is started again, and after which waits: the policy, without a process."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.launcher.launcher import Restarts
from onebot_bringup.launcher.process import Restart


@given(
    limit=st.integers(0, 8),
    first=st.floats(0.01, 10.0),
    longest=st.floats(0.01, 100.0),
)
def test_the_waits_grow_up_to_the_limit(limit: int, first: float, longest: float) -> None:
    """Exactly ``limit`` starts, each after twice the last wait or the longest one; then None."""
    restarts = Restarts(Restart(limit, first, longest, healthy_after=30.0))
    waits = [restarts.next_wait(lived=0.0) for _ in range(limit + 2)]
    assert waits[:limit] == pytest.approx([min(first * 2**i, longest) for i in range(limit)])
    assert waits[limit:] == [None, None]
    assert restarts.count == limit


def test_a_node_that_lived_long_starts_counting_from_zero() -> None:
    """The count and the wait begin again, also when the limit was reached before."""
    restarts = Restarts(Restart(limit=2, first_wait=1.0, longest_wait=99.0, healthy_after=30.0))
    assert [restarts.next_wait(29.9) for _ in range(3)] == [1.0, 2.0, None]
    assert restarts.next_wait(30.1) == 1.0
    assert restarts.count == 1
    assert [restarts.next_wait(0.0) for _ in range(2)] == [2.0, None]


def test_the_policy_unless_a_node_has_another() -> None:
    """Five starts after 1, 2, 4, 8 and 10 s; half a minute counts as healthy."""
    restarts = Restarts(Restart())
    assert [restarts.next_wait(0.0) for _ in range(6)] == [1.0, 2.0, 4.0, 8.0, 10.0, None]
    assert restarts.next_wait(29.0) is None
    assert restarts.next_wait(31.0) == 1.0
