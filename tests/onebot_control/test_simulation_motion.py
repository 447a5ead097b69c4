"""What is told of a moving robot: its twist, its joints and their efforts."""

import math
from collections.abc import Iterator

import pytest

from tests.onebot_control.simulation_support import (
    LEFT,
    RIGHT,
    Simulation,
    planar,
    robot,
    simulate,
    wheels,
)


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    with simulate() as simulation:
        yield simulation


def test_twist_is_the_derivative_of_the_pose(simulation):
    """Also while the motion changes, within the accuracy of a difference quotient."""
    for cycle in range(50):
        simulation.step(wheels(0.004 * cycle, 0.01 * cycle), 0.01)
    before = planar(simulation)
    step = 1.0 / simulation.settings.rate
    simulation.step(wheels(0.2, 0.5), step)
    after, twist = planar(simulation), simulation.base_twist()
    c, s = math.cos(after[2]), math.sin(after[2])
    dx, dy, turn = ((b - a) / step for a, b in zip(before, after, strict=True))
    assert twist.angular[2] == pytest.approx(turn, rel=1e-6)
    # The velocity is constant in a step, but that of the center of mass, about which it turns.
    assert twist.linear[:2] == pytest.approx([c * dx + s * dy, c * dy - s * dx], abs=2e-4)


def test_joint_states_are_in_the_descriptions_order(simulation):
    assert simulation.joints == (LEFT, RIGHT, "caster_swivel_joint", "caster_wheel_joint")
    simulation.step([0.5, 1.0], 0.2)
    assert simulation.joint_states().velocities[:2] == pytest.approx([0.5, 1.0], abs=1e-3)
    assert not any(simulation.joint_states().efforts[2:])


def test_motor_is_no_stronger_than_its_effort():
    with simulate(robot(r'effort="3"', 'effort="0.01"')) as weak:
        weak.step([10.0, 10.0], 0.1)
        states = weak.joint_states()
        assert max(map(abs, states.efforts[:2])) <= 0.01 + 1e-12
        assert max(states.velocities[:2]) < 1.0
