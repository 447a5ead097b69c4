"""When a node is started again, how often, and when that ends: the policy, without a process."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.launcher.launcher import Restarts
from onebot_bringup.launcher.process import Node, Restart

NEVER = 1e6
"""Seconds: no test lasts so long."""


def node(name: str = "n", **policy: float) -> Node:
    """A node with the restart policy given; it is never healthy unless that says so."""
    return Node(name, ("true",), "restart", restart=Restart(**{"healthy_after": 30.0, **policy}))


@given(
    limit=st.integers(0, 8),
    first=st.floats(0.01, 10.0),
    longest=st.floats(0.01, 100.0),
)
def test_the_waits_are_planned_up_to_the_limit(limit: int, first: float, longest: float) -> None:
    """Exactly ``limit`` starts, each after twice the last wait or the longest one; then None."""
    restarts = Restarts()
    failing = node(limit=limit, first_wait=first, longest_wait=longest)
    waits = [restarts.plan(failing, lived=0.0) for _ in range(limit + 2)]
    assert waits[:limit] == pytest.approx([min(first * 2**i, longest) for i in range(limit)])
    assert waits[limit:] == [None, None]
    assert restarts.done(failing) == limit


def test_giving_up_plans_nothing() -> None:
    """A node that may not be started again is not among those that are due."""
    restarts = Restarts()
    assert restarts.plan(node(limit=0), lived=0.0) is None
    assert not restarts and restarts.until_next() is None and restarts.take_due() == []


def test_a_node_that_lived_long_starts_counting_from_zero() -> None:
    """The count and the wait begin again, also when the limit was reached before."""
    restarts = Restarts()
    failing = node(limit=2, first_wait=1.0, longest_wait=99.0)
    assert [restarts.plan(failing, 29.9) for _ in range(3)] == [1.0, 2.0, None]
    assert restarts.plan(failing, 30.1) == 1.0
    assert restarts.done(failing) == 1
    assert [restarts.plan(failing, 0.0) for _ in range(2)] == [2.0, None]


def test_nodes_are_counted_apart() -> None:
    """One that keeps failing leaves the starts of another one alone."""
    restarts = Restarts()
    one, other = node("one", limit=1), node("other", limit=1)
    assert restarts.plan(one, 0.0) is not None and restarts.plan(one, 0.0) is None
    assert restarts.done(other) == 0
    assert restarts.plan(other, 0.0) is not None


def test_what_is_due_is_taken_once_and_the_rest_stays_planned() -> None:
    """A wait of zero is over at once; a long one is not."""
    restarts = Restarts()
    now, later = node("now", first_wait=0.0), node("later", first_wait=NEVER, longest_wait=NEVER)
    restarts.plan(later, 0.0)
    restarts.plan(now, 0.0)
    assert restarts and restarts.until_next() == 0.0
    assert restarts.take_due() == [now]
    assert restarts.take_due() == []
    assert restarts and restarts.until_next() == pytest.approx(NEVER, rel=0.01)


def test_the_next_start_is_the_earliest_of_those_planned() -> None:
    """Whatever the order in which the nodes ended."""
    for waits in ((NEVER, 2 * NEVER), (2 * NEVER, NEVER)):
        restarts = Restarts()
        for name, wait in zip("ab", waits, strict=True):
            restarts.plan(node(name, first_wait=wait, longest_wait=math.inf), 0.0)
        assert restarts.until_next() == pytest.approx(NEVER, rel=0.01)


def test_cancelled_starts_do_not_happen() -> None:
    """Nothing is planned, and nothing is due, after the launcher was told to stop."""
    restarts = Restarts()
    restarts.plan(node(first_wait=0.0), 0.0)
    restarts.cancel()
    assert not restarts and restarts.until_next() is None and restarts.take_due() == []


def test_the_policy_unless_a_node_says_otherwise() -> None:
    """Five starts after 1, 2, 4, 8 and 10 s; half a minute counts as healthy."""
    restarts, failing = Restarts(), Node("n", ("true",), "restart")
    waits = [restarts.plan(failing, 0.0) for _ in range(6)]
    assert waits == [1.0, 2.0, 4.0, 8.0, 10.0, None]
    assert restarts.plan(failing, 29.0) is None
    assert restarts.plan(failing, 31.0) == 1.0
