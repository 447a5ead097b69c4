"""Arms: steps of the physics with 7 and 14 joints, and OneBot's control cycle with an arm.

A step sets the motors, moves the world and reads the joints; its floor is the ``stepSimulation`` in
it, which is timed in the same steps. All arms move to and fro meanwhile, and have to be where they
were sent each time. Times are the thread's processor time. Goals in us and ms are of the computer
whose bare step of OneBot is in ``measuring``; they are scaled by what that step takes here.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import pytest

from onebot_control import RobotSetup, Simulation
from onebot_description.description import Description, load_description, parse_description
from tests.benchmarks.measuring import BARE_STEP, MODEL, WrongAnswer, fastest, in_turn, over
from tests.benchmarks.report import Report, Result
from tests.onebot_control.arm_models import joint, public_arm
from tests.readme import CHECKOUT

_IIWA = "kuka_iiwa/model.urdf"  # 7 joints
_APART = 3.0  # m between arms
_ENDS = (-0.4, 0.4)  # rad or m, of the motion, as far as the limits let it
_SECONDS = 1.0  # of it
_TRACKED = 1e-5  # rad or m from the goal
_DRIVEN = 0.005  # m between odometry and truth
_STEP = {1: 60.0, 2: 100.0}  # us at most, by the number of arms
_SHARE = 0.5  # of a step, at least, that is stepSimulation
_CYCLE = 0.3  # ms at most that an arm adds to OneBot's cycle


class Taken(NamedTuple):
    """Processor time, s."""

    cycle: float  # of a control cycle
    step: float  # of a physics step
    bare: float  # of stepSimulation in it


class Timed:
    """A function that counts its calls, and their processor time."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self.calls, self.seconds = 0, 0.0

    def __call__(self, *arguments: Any, **named: Any) -> None:
        began = time.thread_time()
        self._function(*arguments, **named)
        self.seconds += time.thread_time() - began
        self.calls += 1


def run(quick: bool) -> Report:
    """Measure one on OneBot, and arms that stand."""
    onebot = load_description(MODEL)
    with Simulation(onebot) as simulation, Simulation(_armed(onebot)) as other:
        alone, armed = _measure([simulation, other], quick)
    cycle = fastest([each.cycle for each in alone])
    added = fastest([each.cycle for each in armed]) - cycle
    slowness = fastest([each.bare for each in alone]) / BARE_STEP
    results = [
        Result("OneBot's cycle", 1e3 * cycle, unit="ms"),
        Result(
            "what an arm with a gripper adds to it",
            1e3 * added,
            round(_CYCLE * slowness, 3),
            unit="ms",
        ),
    ]
    for arms, most in _STEP.items():
        setups = {f"arm{row}": RobotSetup(x=_APART * row) for row in range(arms)}
        with Simulation(public_arm(_IIWA), robots=setups) as simulation:
            [taken] = _measure([simulation], quick)
        steps, bare = ([each.step for each in taken], [each.bare for each in taken])
        what = f"{7 * arms} joints:"
        results += [
            Result(f"{what} a step", 1e6 * fastest(steps), round(most * slowness, 1), unit="us"),
            Result(
                f"{what} stepSimulation's time of the whole", over(bare, steps), at_least=_SHARE
            ),
        ]
    return results


def _armed(onebot: Description) -> Description:
    """OneBot with an OpenManipulator-X: four joints and a gripper."""
    arm = load_description(CHECKOUT / "tests/robots/arms/open_manipulator_x.urdf")
    mount = joint("mount", "base_link", arm.root_link, "fixed", xyz="0 0 0.1")
    parts = arm.urdf.partition("<robot")[2].partition(">")[2]
    return parse_description(onebot.urdf.replace("</robot>", mount + parts))


def _measure(simulations: Sequence[Simulation], quick: bool) -> list[list[Taken]]:
    """Move the arms of simulations in turn; return what each took, a value a round."""
    ends = {simulation: _goals(simulation) for simulation in simulations}
    variants = {
        str(row): lambda simulation=simulation: _moved(simulation, ends[simulation])
        for row, simulation in enumerate(simulations)
    }
    return [*in_turn(variants, 2 if quick else 20).values()]


def _goals(simulation: Simulation) -> list[dict[str, float]]:
    """Positions of the joints with motors at both ends; the last one is where to go next."""
    [description] = {robot.description for robot in simulation.robots.values()}
    moving = {each.name: each for each in description.moving_joints if each.mimic is None}
    arm = [each for name, each in moving.items() if "wheel" not in name and "caster" not in name]
    return [
        {each.name: min(max(end, each.lower or end), each.upper or end) for each in arm}
        for end in _ENDS
    ]


def _moved(simulation: Simulation, ends: list[dict[str, float]]) -> Taken:
    """Move all arms from one end to the other, and drive if there are wheels."""
    ends.reverse()
    for robot in simulation.robots.values():
        if robot.has_wheels:
            robot.drive(0.2, 0.1)
        robot.move_to(ends[0], seconds=_SECONDS)
    cycles = round(_SECONDS / simulation.period)
    world = simulation._core.fleet.world
    with pytest.MonkeyPatch.context() as patch:
        bare, step = Timed(world.bullet.stepSimulation), Timed(world.step)
        patch.setattr(world.bullet, "stepSimulation", bare)
        patch.setattr(world, "step", step)
        began = time.thread_time()
        simulation.run(_SECONDS)
        taken = time.thread_time() - began
    _check(simulation, ends[0])
    return Taken(taken / cycles, step.seconds / bare.calls, bare.seconds / bare.calls)


def _check(simulation: Simulation, goals: Mapping[str, float]) -> None:
    """Raise WrongAnswer if an arm is not where it was sent, or a robot not where it drove."""
    for robot in simulation.robots.values():
        for name, goal in goals.items():
            position = robot.joints[name].position
            if not abs(position - goal) <= _TRACKED:
                raise WrongAnswer(f"{name} is at {position:.9g} rad, not at {goal:.9g}")
        if robot.has_wheels:
            odometry, pose = robot.odometry, robot.pose
            if not max(abs(odometry.x - pose.x), abs(odometry.y - pose.y)) <= _DRIVEN:
                raise WrongAnswer(f"{robot}, by its odometry {odometry}")
