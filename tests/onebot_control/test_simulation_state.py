"""The same calls give the same bits; reset, teleport and brake do exactly what they say."""

import gc
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_control.physics.engine import PhysicsSettings, engine
from onebot_description.errors import OneBotError
from tests.onebot_control.simulation_support import (
    bits,
    drive,
    planar,
    robot,
    simulate,
)


def test_teleport_is_exact_and_hides_from_the_wheels():
    """Place and heading to rounding, at rest; wheel positions and time go on."""
    with simulate() as simulation:
        drive(simulation, 0.2, 0.4, 2.0)
        before = simulation.joint_states()
        simulation.step([5.0, 5.0], 0.01)
        moving = simulation.joint_states().positions
        simulation.teleport(-3.5, 12.25, 2.75)
        assert planar(simulation) == pytest.approx((-3.5, 12.25, 2.75), abs=1e-13)
        assert simulation.joint_states().positions == moving
        assert not any(simulation.joint_states().velocities)
        assert not any(map(any, simulation.base_twist()))
        assert before.positions[0] != moving[0]
        simulation.step([0.0, 0.0], 10.0)
        assert planar(simulation) == pytest.approx((-3.5, 12.25, 2.75), abs=1e-6)


def test_drives_the_same_wherever_it_stands():
    """A kilometer away, and turned, it drives as at the origin to half a millimeter.

    What remains is that friction is a little weaker along some directions of the ground.
    """
    with simulate() as here, simulate(x=1000.0, y=-1000.0, yaw=1.0) as there:
        for simulation in (here, there):
            drive(simulation, 0.3, 0.4, 2.0)
        x, y, yaw = planar(here)
        c, s = math.cos(1.0), math.sin(1.0)
        expected = (1000.0 + c * x - s * y, -1000.0 + s * x + c * y, yaw + 1.0)
        assert planar(there) == pytest.approx(expected, abs=5e-4)


def test_what_is_not_finite_never_reaches_the_physics():
    with simulate() as simulation:
        before = bits(simulation)
        with pytest.raises(OneBotError, match="finite"):
            simulation.teleport(0.0, math.inf, 0.0)
        assert bits(simulation) == before
        with pytest.raises(OneBotError, match="finite"):
            simulate(x=math.nan)


def test_a_state_that_is_not_finite_goes_no_further():
    with simulate() as simulation:
        parts = simulation.parts
        index = parts.joints["caster_wheel_joint"]
        parts.bullet.resetJointState(parts.body, index, math.nan, math.nan)
        for use in (
            lambda: simulation.step([0.0, 0.0], 0.01),
            lambda: simulation.step([0.0, 0.0], 0.01),
            simulation.base_pose,
            simulation.base_twist,
            simulation.joint_states,
            simulation.reset,
        ):
            with pytest.raises(OneBotError, match="no longer finite; start it again"):
                use()


def test_forgotten_simulations_free_their_worlds():
    """PyBullet has room for a limited number of them."""
    description = robot()
    first = simulate(description, settings=PhysicsSettings(settling=0.01))
    client = first.bullet.client
    del first
    gc.collect()
    assert not engine.isConnected(client)


_speeds = st.one_of(
    st.floats(-25.0, 25.0), st.floats(allow_nan=False, allow_infinity=False), st.just(-0.0)
)


@given(st.lists(st.tuples(_speeds, _speeds, st.integers(1, 20)), max_size=12))
def test_no_command_makes_the_state_non_finite(commands):
    """Any finite speeds, however wild, leave a robot near the ground with a pose."""
    _wild.reset()
    for left, right, steps in commands:
        _wild.step([left, right], steps / 200)
        values = np.concatenate([*_wild.joint_states(), *_wild.base_pose(), *_wild.base_twist()])
        assert np.isfinite(values).all()
        assert np.linalg.norm(_wild.base_pose().rotation) == pytest.approx(1.0, abs=1e-6)
        assert -0.1 < _wild.base_pose().translation[2] < 2.0


_wild = simulate()
