"""The compiled way gives what arrays give, and where it is not built, arrays serve."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from onebot_description.description import parse_description
from onebot_description.model import RobotModel
from onebot_description.wire import state_converter
from onebot_description.wire.cdr import decode_tf
from onebot_description.wire.state_converter import JointStatePlan
from tests.random_robots import chain, robots

STAMP = b"\x05\x00\x00\x00\x07\x00\x00\x00"


def _data(positions, lead):
    """A JointState as far as a plan looks at it: the stamp, and ``lead`` bytes before positions."""
    return b"\x00\x01\x00\x00" + STAMP + bytes(lead) + positions.astype("<f8").tobytes(), 12 + lead


@settings(deadline=None, max_examples=200)
@given(robots(), st.data(), st.integers(0, 9))
def test_it_agrees_with_the_model(urdf, data, lead):
    """Any kinds, mimics, order and alignment: to the rounding of sine and cosine."""
    model = RobotModel.from_description(parse_description(urdf))
    names = data.draw(st.permutations(model.joints))
    values = st.floats(-1e3, 1e3)
    positions = np.array(
        data.draw(st.lists(values, min_size=len(names), max_size=len(names))), float
    )
    plan = JointStatePlan(model, names, "robot/")
    assert state_converter.compiled() is not None
    translations, rotations = model.transforms(dict(zip(names, positions, strict=True)))
    expected = np.concatenate((translations, rotations), axis=1)
    # Positions up to 1e3 m, and mimics of mimics: the error grows with them.
    close = {"rtol": 1e-12, "atol": 1e-12}
    np.testing.assert_allclose(plan.transforms(positions), expected[plan.rows], **close)
    state, at = _data(positions, lead)
    decoded = decode_tf(plan.message(state, at, len(positions)))
    assert decoded.children == [f"robot/{child}" for child in model.moving.children]
    assert set(decoded.stamps_ns.tolist()) <= {5 * 10**9 + 7}
    np.testing.assert_array_equal(
        np.concatenate((decoded.translations, decoded.rotations), axis=1),
        plan.transforms(positions),
    )


def test_a_thousand_joints_to_the_last_digit():
    """Against the formula in long arithmetic: the error of one rounding or two."""
    model = RobotModel.from_description(parse_description(chain(1000)))
    plan = JointStatePlan(model, model.joints, "")
    positions = np.random.default_rng(1).uniform(-3, 3, 1000)
    half = (positions * 0.5).astype(np.longdouble)[:, None]
    moving = model.moving
    exact = moving.constant[:, 3:] * np.cos(half) + moving.sine * np.sin(half)
    assert np.abs(plan.transforms(positions)[:, 3:] - exact).max() < 3e-16


def test_without_the_library_arrays_serve(monkeypatch):
    """A ROS installation with tf2_msgs of its own may have no library: same bytes but rounding."""
    model = RobotModel.from_description(parse_description(chain(20)))
    positions = np.random.default_rng(2).uniform(-3, 3, 20)
    state, at = _data(positions, 4)
    compiled = JointStatePlan(model, model.joints, "").message(state, at, 20)
    monkeypatch.setattr(state_converter, "make_kernel", lambda *_: None)
    plain = JointStatePlan(model, model.joints, "").message(state, at, 20)
    ours, theirs = decode_tf(compiled), decode_tf(plain)
    assert ours.children == theirs.children and (ours.stamps_ns == theirs.stamps_ns).all()
    np.testing.assert_allclose(ours.rotations, theirs.rotations, rtol=0, atol=3e-16)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -1e101])
@pytest.mark.parametrize("library", [True, False])
def test_what_is_not_moderate_is_found_anywhere(monkeypatch, bad, library):
    """At every place, at any alignment, and not beyond the end."""
    if not library:
        monkeypatch.setattr(state_converter, "compiled", lambda: None)
    for lead in range(8):
        for place in range(5):
            positions = np.zeros(5)
            positions[place] = bad
            data, at = _data(positions, lead)
            assert not state_converter.all_moderate(data, at, 5)
            assert state_converter.all_moderate(data, at, place)


def test_sines_of_any_angle():
    """To the last digit in all quadrants, at their borders, and far beyond what is reduced here."""
    model = RobotModel.from_description(parse_description(chain(7)))
    plan = JointStatePlan(model, model.joints, "")
    random = np.random.default_rng(3)
    quarters = np.arange(-40, 41) * np.pi / 2
    near = np.concatenate([np.nextafter(quarters, way) for way in (-np.inf, 0.0, np.inf)])
    angles = np.concatenate(
        (near, random.uniform(-4, 4, 1000), random.uniform(-1, 1, 1000) * 2.0**18, [1e22, -1e99])
    )
    moving = model.moving
    for first in range(len(angles) - 6):
        half = angles[first : first + 7]
        exact = [np.sin(half.astype(np.longdouble)), np.cos(half.astype(np.longdouble))]
        sine, cosine = (numbers.astype(float)[:, None] for numbers in exact)
        expected = moving.constant[:, 3:] * cosine + moving.sine * sine
        assert np.abs(plan.transforms(2.0 * half)[:, 3:] - expected).max() < 4e-16


def test_at_zero_a_joint_is_exactly_where_its_origin_is():
    """No rounding, and no lane is filled by its neighbour's number."""
    model = RobotModel.from_description(parse_description(chain(9)))
    plan = JointStatePlan(model, model.joints, "")
    for moved in range(9):
        positions = np.zeros(9)
        positions[moved] = 1.0
        still = np.arange(9) != moved
        np.testing.assert_array_equal(
            plan.transforms(positions)[still], model.moving.constant[still]
        )
