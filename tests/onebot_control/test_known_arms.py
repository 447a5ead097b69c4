"""Well-known arms: they are read, rest for 4 s, and follow a goal of every joint.

Those of ``tests/robots/arms`` have the figures of their makers' files, without the meshes; those of
pybullet_data are read from their own files. What is repaired in either is said in a sentence.
"""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import pybullet_data
import pytest

from onebot_bringup.cli import check
from onebot_control import Simulation
from onebot_description.elements.urdf import Joint
from onebot_description.model import RobotModel
from tests.onebot_control.arm_models import RATE, quintic, simulate

ARMS = Path(__file__).parents[1] / "robots" / "arms"
SECONDS = 2.0  # of a motion
SAG, OFF, LINKED = 4e-5, 1e-5, 1e-3  # rad or m: at rest, in motion, and of a linkage in motion


class Arm(NamedTuple):
    """What there is to know about an arm."""

    commanded: int  # joints
    mimics: int = 0  # joints that follow one of them
    linkage: bool = False  # several of them turn as one
    warnings: Mapping[str, int] = MappingProxyType({})  # of ``onebot check``, and how many of each
    repaired: Sequence[str] = ()  # what the simulation's log says, a line each
    starts: Mapping[str, float] = MappingProxyType({})  # not at 0, where it would be in the ground


UNMOVED = "velocity is 0, so the joint cannot move; the simulation takes 0 for no limit"
XARM = Arm(
    6,
    warnings={"links of one robot do not collide here": 1},
    repaired=[
        'link "link3" has the principal moments of inertia 0.00202, 0.0043, 0.00731 kg m^2; the '
        "largest is simulated as 0.00632, the sum of the others"
    ],
    starts={"joint2": -0.6, "joint3": -0.3},
)
XARM_WITH_GRIPPER = XARM._replace(commanded=7, mimics=5, linkage=True)
HELD = (
    "joint gripper: held still, because no controller moves it; name it in a controller's "
    "parameter joints, or give it a position command interface in <ros2_control>"
)
HOLLOW = (
    "link left_inner_knuckle, right_inner_knuckle: a collision mesh fills less than half of its "
    "convex hull, which is used for contacts; to grip well, fingers need boxes or several convex "
    "meshes"
)
KNOWN = {
    "gen3_2f85": Arm(8, 5, linkage=True),
    "iiwa14": Arm(
        7,
        repaired=[
            "link link_1, link_2, link_3, link_4, link_5, link_6, link_7: no <inertial>, simulated "
            "with 0.02 kg; efforts are wrong until they have mass and inertia",
        ],
    ),
    "ned2": Arm(6),
    "open_manipulator_x": Arm(5, 1),
    "panda": Arm(
        8,
        1,
        repaired=[
            'link "fer_link4" has the principal moments of inertia 0.00368, 0.00796, 0.0127 kg '
            "m^2; the largest is simulated as 0.0116, the sum of the others"
        ],
    ),
    "so_arm100": Arm(6),
    "stretch_se3": Arm(
        12,
        warnings={
            UNMOVED: 2,
            "lower and upper are both 0, so the joint cannot move": 2,
            'unknown attribute "spring_': 4,
        },
    ),
    "ur5e": Arm(6),
    "wx250s": Arm(
        7,
        1,
        warnings={"contains a space or slash, which breaks TF frame names": 14},
        repaired=[HELD],
    ),
    "xarm6_gripper": XARM_WITH_GRIPPER._replace(warnings={}),
}
PUBLIC = {
    "xarm/xarm6_with_gripper.urdf": XARM_WITH_GRIPPER._replace(repaired=[HOLLOW, *XARM.repaired]),
}
FILES = {
    **{name: (ARMS / f"{name}.urdf", arm) for name, arm in KNOWN.items()},
    **{name: (Path(pybullet_data.getDataPath()) / name, arm) for name, arm in PUBLIC.items()},
}


def goal(joint: Joint, at: float) -> float:
    """A position 0.3 of a joint's range away, or what it can move in time; 0.8 rad without one."""
    lower, upper = joint.range
    far = 0.8 if joint.kind == "continuous" else 0.3 * (upper - lower)
    far = min(far, (joint.velocity or far) / 1.876 * SECONDS)
    return at - far if at - far >= lower else at + far


def positions(simulation: Simulation) -> dict[str, float]:
    """Where each joint is."""
    return {name: state.position for name, state in simulation.robot.joints.items()}


def off(positions: Mapping[str, float], expected: Mapping[str, float]) -> float:
    """The greatest error of the joints that something is expected of."""
    return max(abs(positions[name] - value) for name, value in expected.items())


def test_each_file_is_known() -> None:
    assert {file.stem for file in ARMS.iterdir()} == {*KNOWN}


@pytest.mark.parametrize("name", FILES)
def test_arm_is_good_and_warned_of(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """``onebot check`` has no other warnings, and says of inertias what the simulation does."""
    file, arm = FILES[name]
    assert check.run([str(file)]) == 0
    lines = capsys.readouterr().err.splitlines()
    inertias = [text for text in arm.repaired if "moments of inertia" in text]
    assert [line.partition(f"{file}: ")[2] for line in lines if "moments of" in line] == inertias
    lines = [line for line in lines if "moments of" not in line]
    assert {text: sum(text in line for line in lines) for text in arm.warnings} == arm.warnings
    assert len(lines) == sum(arm.warnings.values()), lines


@pytest.mark.parametrize("name", FILES)
def test_arm_rests_and_follows(name: str, caplog: pytest.LogCaptureFixture) -> None:
    """It sags by 4e-5 rad or m in 4 s, and is off by 1e-5 in motion, a linkage by 1e-3."""
    file, arm = FILES[name]
    with caplog.at_level(logging.WARNING), simulate(file, arm.starts) as simulation:
        assert caplog.messages == [f"{file}: {text}" for text in arm.repaired]
        moving = {joint.name: joint for joint in simulation.robot.description.moving_joints}
        start = positions(simulation)
        mimics = [name for name in start if moving[name].mimic is not None]
        commanded = simulation._core.fleet.robots[0].body.commanded
        assert (len(commanded), len(mimics)) == (arm.commanded, arm.mimics)

        simulation.run(4.0)
        begun = positions(simulation)
        assert off(begun, {name: start[name] for name in commanded}) < SAG

        sent = {name: goal(moving[name], begun[name]) for name in commanded}
        simulation.robot.move_to(sent, seconds=SECONDS)
        model = RobotModel.from_description(simulation.robot.description)
        cycles = round(SECONDS * RATE)
        for cycle in range(1, cycles + 1):
            simulation.run(simulation.period)
            at, share = positions(simulation), quintic(cycle / cycles)
            way = {name: begun[name] + share * (end - begun[name]) for name, end in sent.items()}
            assert off(at, way) < OFF
            if mimics:
                led = model.positions({name: at[name] for name in commanded})
                followed = {name: led[model.row(name)] for name in mimics}
                assert off(at, followed) < (LINKED if arm.linkage else OFF)
