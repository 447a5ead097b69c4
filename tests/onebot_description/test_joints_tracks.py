"""onebot_description.joints.motions: motions of many joints evaluated together."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_description.joints.motions import Constant, Keyframes, Motion, Sine, Sweep, Tracks


def at(motion: Motion, time: float, start: float = 0.0, endless: bool = False) -> float:
    """One motion that began at 0."""
    tracks = Tracks([motion], np.zeros(1), np.array([start]), np.array([endless]))
    return float(tracks.at(time)[0])


def test_constant() -> None:
    """Stays."""
    assert at(Constant(0.5), 7.0) == 0.5


@given(st.floats(0.0, 1e3))
def test_sine(time: float) -> None:
    """Is the formula."""
    expected = 0.1 + 0.5 * math.sin(2.0 * math.pi * 0.2 * time + 0.3)
    assert at(Sine(0.5, 0.2, 0.3, 0.1), time) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("time", "position"), [(0, 0), (1, 0), (2, 0.5), (3, 1), (4, 0), (5, -1), (6, 0), (8, 0.5)]
)
def test_linear_keyframes_loop(time: float, position: float) -> None:
    """The first position holds until its time; after the last it starts over."""
    assert at(Keyframes((1, 3, 5, 6), (0, 1, -1, 0)), time) == pytest.approx(position)


def test_keyframes_hold_the_last_when_they_do_not_loop() -> None:
    """Once, then for ever."""
    motion = Keyframes((0.0, 2.0), (0.0, 1.0), loop=False)
    assert [at(motion, t) for t in (1.0, 2.0, 99.0)] == [0.5, 1.0, 1.0]


def test_one_keyframe_is_a_constant() -> None:
    """Nothing to loop over."""
    assert at(Keyframes((0.0,), (0.5,)), 3.0) == 0.5


def test_minimum_jerk_starts_and_ends_at_rest() -> None:
    """Half-way in the middle, and hardly moving at both ends."""
    motion = Keyframes((0.0, 1.0), (0.0, 1.0), "minimum_jerk", False)
    assert at(motion, 0.5) == pytest.approx(0.5)
    assert at(motion, 0.01) < 2e-5
    assert at(motion, 0.99) > 1.0 - 2e-5
    speeds = np.diff([at(motion, t) for t in np.linspace(0.0, 1.0, 1001)]) * 1000.0
    assert speeds.max() == pytest.approx(1.875, abs=1e-3)


def test_lead_goes_once_from_where_the_joint_stands() -> None:
    """From 0.4 to the first position in 2 s; the loop afterwards leaves the lead out."""
    motion = Keyframes((0.0, 1.0, 3.0), (0.0, 1.0, 0.0), "linear", True, lead=2.0)
    assert at(motion, 0.0, start=0.4) == pytest.approx(0.4)
    assert at(motion, 1.0, start=0.4) == pytest.approx(0.2)
    assert at(motion, 3.0, start=0.4) == pytest.approx(1.0)
    assert at(motion, 6.0, start=0.4) == pytest.approx(1.0)


def test_endless_joints_go_on_turning() -> None:
    """Keyframes over a whole turn add up; a limited joint starts over."""
    motion = Keyframes((0.0, 2.0), (0.0, 2.0 * math.pi))
    assert at(motion, 5.0, endless=True) == pytest.approx(5.0 * math.pi)
    assert at(motion, 5.0) == pytest.approx(math.pi)


def test_sweep_goes_to_and_fro() -> None:
    """Up from the start, then down to the lower end, then up again."""
    motion = Sweep(1.0, 0.5, -1.0, 1.0)
    assert [at(motion, t) for t in (0.0, 0.5, 2.5, 3.5)] == pytest.approx([0.5, 1.0, -1.0, 0.0])
    assert at(Sweep(1.0, 0.0, -math.inf, math.inf), 7.0) == 7.0
    assert at(Sweep(1.0, 0.5, 0.5, 0.5), 7.0) == 0.5


def test_many_motions_are_as_each_alone() -> None:
    """Padding rows of keyframes of unlike length changes none."""
    motions: list[Motion] = [
        Keyframes((0.0, 1.0), (0.0, 1.0)),
        Constant(0.3),
        Keyframes((0.0, 1.0, 2.0, 7.0), (0.0, 1.0, 0.5, 0.0), "minimum_jerk"),
        Sine(1.0, 0.1),
        Keyframes((2.0,), (0.2,)),
        Sweep(0.1, 0.0, -1.0, 1.0),
    ]
    count = len(motions)
    tracks = Tracks(motions, np.zeros(count), np.zeros(count), np.zeros(count, dtype=bool))
    for time in np.linspace(0.0, 20.0, 101):
        assert tracks.at(time) == pytest.approx([at(motion, time) for motion in motions])


def test_no_motions() -> None:
    """An empty robot has no positions."""
    assert Tracks([], np.zeros(0), np.zeros(0), np.zeros(0, dtype=bool)).at(1.0).shape == (0,)
