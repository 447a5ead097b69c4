"""onebot_description.joints.motions: where a motion is at a time."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_description.joints.motions import Keyframes, Motion, Sine


def at(motion: Motion, time: float, endless: bool = False) -> float:
    """Where a motion is; of an endless joint it keeps turning."""
    if endless and isinstance(motion, Keyframes):
        motion = motion.turning()
    return motion.at(time)


def expected(motion: Keyframes, time: float, endless: bool) -> float:
    """Where a joint ought to be on keyframes, worked out one piece after the other."""
    times, places = list(motion.times), list(motion.positions)
    turned, period = 0.0, times[-1]
    if motion.loop and period > 0.0:
        turn = motion.positions[-1] - motion.positions[0]
        while time >= times[-1]:
            time -= period
            turned += turn if endless and abs(math.remainder(turn, math.tau)) < 1e-2 else 0.0
    if time < times[0]:
        return places[0] + turned
    for (begin, end), (from_, to) in zip(
        zip(times, times[1:], strict=False), zip(places, places[1:], strict=False), strict=True
    ):
        if begin <= time < end:
            u = (time - begin) / (end - begin)
            if motion.blend == "minimum_jerk":
                u = 10 * u**3 - 15 * u**4 + 6 * u**5
            return from_ + u * (to - from_) + turned
    return places[-1] + turned


_quarters = st.integers(1, 12).map(lambda number: number / 4)
_keyframes = st.builds(
    lambda first, steps, positions, blend, loop: Keyframes(
        tuple(np.cumsum([first, *steps[: len(positions) - 1]]).tolist()),
        tuple(positions),
        blend,
        loop,
    ),
    st.sampled_from([0.0, 0.5]),
    st.lists(_quarters, min_size=4, max_size=4),
    st.lists(st.sampled_from([-1.0, 0.0, 0.75, math.tau, 2 * math.tau]), min_size=1, max_size=5),
    st.sampled_from(["linear", "minimum_jerk"]),
    st.booleans(),
)


@given(_keyframes, st.integers(0, 400).map(lambda number: number / 8), st.booleans())
def test_keyframes_at_every_moment(motion: Keyframes, time: float, endless: bool) -> None:
    found = at(motion, time, endless)
    assert found == pytest.approx(expected(motion, time, endless), abs=1e-9)


@pytest.mark.parametrize(
    ("beyond", "whole"), [(0.009, True), (-0.009, True), (0.011, False), (-0.011, False)]
)
def test_what_counts_as_a_whole_turn(beyond: float, whole: bool) -> None:
    turn = math.tau + beyond
    motion = Keyframes((0.0, 1.0), (0.0, turn))
    assert at(motion, 1.5, endless=True) == pytest.approx((1.5 if whole else 0.5) * turn)


@given(st.floats(0.1, 3.0), st.floats(0.0, 50.0), st.floats(-1.0, 2.0))
def test_a_sweep_stays_in_its_range_at_its_speed(speed: float, time: float, start: float) -> None:
    motion = Keyframes.sweep(speed, start, -1.0, 2.0)
    here, next_ = at(motion, time), at(motion, time + 0.001)
    assert -1.0 - 1e-9 <= here <= 2.0 + 1e-9
    assert abs(next_ - here) <= 0.001 * speed + 1e-9
    assert at(motion, time + 6.0 / speed) == pytest.approx(here, abs=1e-6)
    assert at(motion, 0.0) == pytest.approx(start)
    if start < 1.9:
        assert at(motion, 0.01 / speed) == pytest.approx(start + 0.01)


@given(st.floats(0.0, 1e3))
def test_sine(time: float) -> None:
    wanted = 0.1 + 0.5 * math.sin(2.0 * math.pi * 0.2 * time + 0.3)
    assert at(Sine(0.5, 0.2, 0.3, 0.1), time) == pytest.approx(wanted, abs=1e-9)
    assert at(Sine(0.5, 0.2), 0.0) == 0.0


def test_sweep_goes_to_and_fro() -> None:
    motion = Keyframes.sweep(1.0, 0.5, -1.0, 1.0)
    assert [at(motion, t) for t in (0.0, 0.5, 2.5, 3.5)] == pytest.approx([0.5, 1.0, -1.0, 0.0])
    assert at(Keyframes.sweep(1.0, 0.0, -math.inf, math.inf), 7.0) == 7.0
    assert at(Keyframes.sweep(1.0, 0.5, 0.5, 0.5), 7.25) == 0.5
    assert at(Keyframes.sweep(0.0, 0.5, -1.0, 1.0), 7.25) == 0.5
    assert at(Keyframes.sweep(1.0, 0.0, -1.0, math.inf), 7.0) == 7.0
