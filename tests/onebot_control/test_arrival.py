"""``moving`` and ``stalled``: joints that are late, blocked, too weak, or swing."""

import math
from collections.abc import Callable, Mapping

import pytest

from onebot_control import Simulation
from onebot_control.trajectories.arrival import Arrival
from tests.onebot_control.arm_models import arm, box_world, joint, link, rod, simulate, two_fingers

PERIOD = 0.01  # s


def limits(effort: float, velocity: float, lower: float = -2.0, upper: float = 2.0) -> str:
    """The attributes of a <limit>."""
    return f'lower="{lower}" upper="{upper}" effort="{effort}" velocity="{velocity}"'


def moved(simulation: Simulation, goal: Mapping[str, float], seconds: float) -> list[str]:
    """Move joints until they do no longer; those that did not get there."""
    robot = simulation.robot
    robot.move_to(goal, seconds=seconds)
    assert robot.moving
    simulation.run(until=lambda: not robot.moving)
    simulation.run(0.5)
    assert not robot.moving
    return list(robot.stalled)


@pytest.mark.parametrize(
    ("limit", "goal", "seconds", "least"),
    [
        (limits(100.0, 0.5), 1.4, 0.2, 2.8),  # by the limit of velocity: 1.4 / 0.5 s
        (limits(12.0, 2.0), -1.4, 0.2, 0.7),  # the motor hardly lifts the rod's 9.81 N m
        (limits(12.0, 20.0), -1.4, 0.2, 2.0),  # it overshoots, and swings about its goal for 8 s
        (limits(12.0, 20.0), 1.4, 0.2, 2.0),  # it falls past its goal, and is lifted
        (limits(100.0, 0.0004, 0.0, 0.01), 0.003, 0.1, 7.2),  # slower than what counts as rest
    ],
)
def test_a_motion_that_is_too_fast_takes_longer(
    limit: str, goal: float, seconds: float, least: float
) -> None:
    with simulate(rod(limit), rate=100.0) as simulation:
        assert moved(simulation, {"elbow": goal}, seconds) == []
        assert simulation.time - 0.5 >= least
        state = simulation.robot.joints["elbow"]
        assert state.position == pytest.approx(goal, abs=1e-4)
        assert state.velocity == pytest.approx(0.0, abs=1e-3)


def test_a_motion_in_time_ends_in_time() -> None:
    """Whole turns of a continuous joint count; what is there already is not waited for."""
    disc = link("disc", 1.0) + joint("spin", "world", "disc", "continuous")
    with simulate(arm(disc), rate=100.0) as simulation:
        simulation.robot.move_to({"spin": 10.0}, seconds=2.0)
        simulation.run(until=lambda: not simulation.robot.moving)
        assert simulation.time == pytest.approx(2.0, abs=0.011)
        assert simulation.robot.joints["spin"].position == pytest.approx(10.0, abs=1e-6)


@pytest.mark.parametrize(
    ("limit", "most"),
    [
        (limits(5.0, 2.0), 12.0),  # it swings between 0 and 1.8 rad for ever
        (limits(5.0, 2.0, -2.0, 0.5), 3.1),  # it falls on its position limit
        (limits(9.8, 2.0, -2.0, 0.0), 2.1),  # it nearly lifts the rod off it
    ],
)
def test_a_motor_that_is_too_weak_stalls(limit: str, most: float) -> None:
    with simulate(rod(limit), rate=100.0) as simulation:
        assert moved(simulation, {"elbow": -1.0}, 1.0) == ["elbow"]
        assert simulation.time - 0.5 <= most
        assert simulation.robot.joints["elbow"].position > -0.01


def test_a_finger_on_a_box_stalls_and_does_not_keep_the_lift_waiting() -> None:
    """Only the joints of the goal are waited for; each goal is judged anew."""
    with simulate(two_fingers(0.02), {"left": 0.04}, box_world(), rate=100.0) as simulation:
        assert moved(simulation, {"left": 0.0}, 0.5) == ["left"]
        before = simulation.time
        assert moved(simulation, {"lift": 0.1}, 1.0) == []
        assert simulation.time - before == pytest.approx(1.51, abs=0.011)
        assert moved(simulation, {"left": 0.04, "lift": 0.0}, 0.5) == []


def test_nothing_moves_after_a_reset() -> None:
    with simulate(rod(limits(5.0, 2.0)), rate=100.0) as simulation:
        assert moved(simulation, {"elbow": -1.0}, 1.0) == ["elbow"]
        simulation.robot.move_to({"elbow": 1.0}, seconds=1.0)
        simulation.reset()
        assert not simulation.robot.moving and not simulation.robot.stalled


def cycles(error: Callable[[float], float], velocity: float = 0.0) -> tuple[float, bool]:
    """When a joint with such an error is no longer waited for, s, and whether it stalled."""
    arrival = Arrival(["joint"])
    for cycle in range(10_000):
        time = cycle * PERIOD
        if arrival.update({"joint": error(time)}, {"joint": velocity}, PERIOD):
            return time, arrival.stalled == ("joint",)
    return math.inf, False


def test_what_cannot_get_there() -> None:
    """At rest elsewhere it is known after 1 s; of a swing without an end after five more."""
    assert cycles(lambda time: 0.0) == (0.0, False)
    assert cycles(lambda time: 1e-4) == (0.0, False)
    assert cycles(lambda time: 2e-4) == (1.0, True)
    assert cycles(lambda time: -0.3) == (1.0, True)
    assert cycles(lambda time: 1.0 - 0.01 * time, 0.01)[1] is False  # 0.01 rad/s, for 100 s
    late, stalled = cycles(lambda time: max(0.0, 1.0 - 0.25 * time))
    assert late == pytest.approx(4.0, abs=0.011) and not stalled
    assert cycles(lambda time: math.sin(3.0 * time), 3.0) == (6.0, True)
    damped, stalled = cycles(lambda time: math.exp(-0.2 * time) * math.cos(2.0 * time))
    assert damped > 10.0 and not stalled
    assert cycles(lambda time: 0.0, velocity=2e-3) == (math.inf, False)
