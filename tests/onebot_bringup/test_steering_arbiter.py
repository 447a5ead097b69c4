"""Who drives, of several pages, and when the robot is stopped: no ROS, network or clock."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.steering.arbiter import COMMAND_TIMEOUT, MAX_AGE, ZEROS, Arbiter
from onebot_bringup.steering.limits import Bound, Limits
from onebot_bringup.steering.protocol import SetLimits, Velocity

LIMITS = Limits(Bound(1.0, 1.0, 1.0), Bound(2.0, 2.0, 2.0))
FORWARD, ZERO = Velocity(0.5, 0.1), Velocity()


@pytest.fixture
def arbiter() -> Arbiter:
    """Two pages, "a" and "b", at time 0."""
    arbiter = Arbiter(LIMITS)
    arbiter.join("a")
    arbiter.join("b")
    return arbiter


def _all_that_follows(arbiter: Arbiter) -> list[Velocity]:
    """What is published from now on, if nothing else happens."""
    taken = []
    while (velocity := arbiter.next_command()) is not None and len(taken) < 10:
        taken.append(velocity)
    return taken


def test_nothing_is_published_before_anybody_drives(arbiter):
    """Other sources of commands are left alone."""
    assert arbiter.next_command() is None and arbiter.driver is None


def test_what_is_held_is_published_within_the_limits(arbiter):
    """A command beyond them is slowed, and so is one that was given before they were lowered."""
    arbiter.drive("a", Velocity(4.0, -8.0), 0.0, 0.0)
    assert arbiter.next_command() == Velocity(1.0, -2.0)
    arbiter.limits = replace(LIMITS, chosen=SetLimits(0.25, None))
    assert arbiter.next_command() == arbiter.command == Velocity(0.25, -0.5)
    arbiter.limits = replace(LIMITS, angular=Bound(0.125, 0.125, 0.125))
    assert arbiter.next_command() == Velocity(0.0625, -0.125)


@pytest.mark.parametrize(
    "end",
    [
        lambda arbiter: arbiter.release("a"),
        lambda arbiter: arbiter.leave("a"),
        lambda arbiter: arbiter.reject("a"),
        lambda arbiter: arbiter.stop(),
        lambda arbiter: arbiter.check_timeout(COMMAND_TIMEOUT + 0.01),
    ],
    ids=["let go", "closed", "malformed", "stop button", "silent"],
)
def test_every_end_gives_zeros_and_then_silence(arbiter, end):
    """Three zeros follow, so that one may get lost, and then others may drive."""
    arbiter.drive("a", FORWARD, 0.0, 0.0)
    end(arbiter)
    assert arbiter.command == ZERO
    assert _all_that_follows(arbiter) == [ZERO] * ZEROS


def test_the_last_to_take_hold_drives(arbiter):
    """The one it takes control from does nothing until it lets go and takes hold anew."""
    arbiter.drive("a", FORWARD, 0.0, 0.0)
    arbiter.drive("b", Velocity(0.1, 0.0), 0.1, 0.1)
    arbiter.drive("a", FORWARD, 0.2, 0.2)
    assert arbiter.driver == "b" and arbiter.command == Velocity(0.1, 0.0)
    arbiter.release("b")
    arbiter.drive("a", FORWARD, 0.3, 0.3)
    assert arbiter.driver is None and arbiter.command == ZERO
    arbiter.release("a")
    arbiter.drive("a", FORWARD, 0.4, 0.4)
    assert arbiter.driver == "a" and arbiter.command == FORWARD


@pytest.mark.parametrize("end", ["stop", "reject"])
def test_a_driver_that_was_stopped_has_to_let_go_first(arbiter, end):
    """The stop button, and a message that was refused, are not undone by going on to hold."""
    arbiter.drive("a", FORWARD, 0.0, 0.0)
    if end == "stop":
        arbiter.stop()
    else:
        arbiter.reject("a")
    arbiter.drive("a", FORWARD, 0.05, 0.05)
    assert arbiter.driver is None and arbiter.command == ZERO
    arbiter.release("a")
    arbiter.drive("a", FORWARD, 0.1, 0.1)
    assert arbiter.driver == "a"


def test_a_page_that_lost_control_stops_nobody_by_letting_go(arbiter):
    """Its release, its end and its nonsense are its own."""
    arbiter.drive("a", FORWARD, 0.0, 0.0)
    arbiter.drive("b", FORWARD, 0.1, 0.1)
    arbiter.release("a")
    arbiter.reject("a")
    arbiter.leave("a")
    assert arbiter.driver == "b" and arbiter.command == FORWARD


def test_a_silence_stops_and_the_same_grip_goes_on_after_it(arbiter):
    """However long it was: what was sent meanwhile and comes late does not count."""
    arbiter.drive("a", FORWARD, 0.0, 0.0)
    arbiter.check_timeout(COMMAND_TIMEOUT - 0.01)
    assert arbiter.command == FORWARD and not arbiter.late
    arbiter.check_timeout(COMMAND_TIMEOUT + 0.01)
    assert arbiter.command == ZERO and arbiter.timeouts == 1
    assert arbiter.driver == "a" and arbiter.late == {"a"}
    arbiter.drive("a", FORWARD, 0.1, 10.0)
    assert arbiter.command == ZERO and arbiter.late == {"a"}
    arbiter.drive("a", FORWARD, 9.9, 10.0)
    assert arbiter.command == FORWARD and not arbiter.late


def test_a_command_holds_until_half_a_second_after_its_stamp(arbiter):
    """Whenever it comes: the hand that gave it may be gone as long as that."""
    arbiter.drive("a", FORWARD, 10.0, 10.4)
    arbiter.check_timeout(10.0 + MAX_AGE)
    assert arbiter.command == FORWARD
    arbiter.check_timeout(10.0 + MAX_AGE + 0.001)
    assert arbiter.command == ZERO and arbiter.late == {"a"}
    for end in (arbiter.release, arbiter.leave):
        arbiter.drive("a", FORWARD, 10.0, 12.0)
        end("a")
        assert not arbiter.late


@pytest.mark.parametrize("other", [lambda a: a.stop(), lambda a: a.drive("b", FORWARD, 5.0, 5.0)])
@pytest.mark.parametrize("first", [0.0, 4.9])
def test_who_held_before_another_page_acted_does_not_drive_after_it(arbiter, first, other):
    """Whether it drove and fell silent, or never came in time: it has to let go first."""
    arbiter.drive("a", FORWARD, first, 4.9)
    arbiter.check_timeout(4.9 + COMMAND_TIMEOUT + 0.01)
    other(arbiter)
    arbiter.drive("a", FORWARD, 5.1, 5.1)
    assert arbiter.driver != "a"
    arbiter.release("a")
    arbiter.drive("a", FORWARD, 5.2, 5.2)
    assert arbiter.driver == "a"


_event = st.tuples(
    st.sampled_from(["drive", "release", "stop", "reject", "leave", "wait", "take"]),
    st.sampled_from("abc"),
    st.floats(0.0, 0.4),
)


@given(st.lists(_event, max_size=60))
def test_the_robot_moves_only_while_its_driver_says_so(events):
    """Whatever pages do: a command that is not zero has a driver that spoke in time just before."""
    arbiter, now, spoke = Arbiter(LIMITS), 0.0, {}
    for page in "abc":
        arbiter.join(page)
    there = set("abc")
    for kind, page, wait in events:
        if kind == "wait":
            now += wait
            arbiter.check_timeout(now)
        elif kind == "stop":
            arbiter.stop()
        elif kind == "take":
            arbiter.next_command()
        elif page in there:
            if kind == "drive":
                arbiter.drive(page, FORWARD, now - 2.0 * wait, now)
                if 2.0 * wait <= MAX_AGE:  # a late one changes nothing of what holds
                    spoke[page] = now, now - 2.0 * wait
            else:
                getattr(arbiter, kind)(page)
                there -= {page} if kind == "leave" else set()
                assert arbiter.driver != page
        if arbiter.command != ZERO:
            assert arbiter.driver in there
            came, stamp = spoke[arbiter.driver]
            rounding = 1e-9  # of sums of times
            assert now - came <= COMMAND_TIMEOUT + rounding and now - stamp <= MAX_AGE + rounding
        assert arbiter.pages == len(there)


def test_the_times_of_silence_are_exceeded_not_reached(arbiter):
    """At the limit itself nothing happens yet; nor does an old time undo anything."""
    arbiter.drive("a", FORWARD, 10.0, 10.0)
    arbiter.check_timeout(10.0 + COMMAND_TIMEOUT)
    assert arbiter.command == FORWARD and arbiter.timeouts == 0
    arbiter.check_timeout(10.0 + COMMAND_TIMEOUT + 0.001)
    assert arbiter.command == ZERO and arbiter.timeouts == 1
    arbiter.check_timeout(20.0)
    assert arbiter.timeouts == 1


def test_a_robot_held_at_zero_is_told_so_and_stopped_like_any_other(arbiter):
    """A page that has control at rest commands zero, all the time."""
    arbiter.drive("a", ZERO, 0.0, 0.0)
    assert arbiter.moving and arbiter.busy
    assert [arbiter.next_command() for _ in range(5)] == [ZERO] * 5
    arbiter.release("a")
    assert not arbiter.moving and arbiter.busy
    assert _all_that_follows(arbiter) == [ZERO] * ZEROS
    assert not arbiter.busy


def test_stops_and_zeros_are_counted_anew(arbiter):
    """Each press of the button is one, and is followed by all of its zeros."""
    for number in (1, 2):
        arbiter.stop()
        assert arbiter.stops == number and arbiter.busy
        assert _all_that_follows(arbiter) == [ZERO] * ZEROS


def test_a_page_that_comes_back_may_take_hold(arbiter):
    """It is a new one: what it held before is forgotten."""
    arbiter.drive("a", FORWARD, 0.0, 0.0)
    arbiter.leave("a")
    assert arbiter.pages == 1 and arbiter.driver is None
    arbiter.join("a")
    arbiter.drive("a", FORWARD, 0.1, 0.1)
    assert arbiter.driver == "a" and arbiter.command == FORWARD and arbiter.pages == 2
