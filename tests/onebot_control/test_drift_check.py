"""The warning that odometry and ground truth drift apart."""

from pathlib import Path

import pytest

from onebot_control.control_files import ControlFiles, default_control_file
from onebot_control.controlled_robot import ControlledRobot
from onebot_control.drive.drift_check import DriftCheck
from onebot_control.drive_kinds import ControlConfig
from onebot_control.fleet import Fleet
from onebot_control.physics.scene import load_scene
from onebot_control.prepared_robot import Member
from onebot_description.description import load_description
from onebot_description.elements.packages import package_share
from onebot_description.geometry.poses import PlanarPose
from tests.onebot_control.control_support import alone, config, cycle, ideal_drive, robot

ROBOTS = Path(__file__).parents[1] / "robots"
ONEBOT = package_share("onebot_description") / "urdf/onebot.urdf.xacro"
LIMITS = ControlFiles([default_control_file()], "/", "velocity_controller").parameters().values


def drifted(drive: ControlledRobot, linear: float, angular: float, seconds: float = 20.0) -> str:
    """Drive until there is a warning; return it."""
    for _ in range(round(seconds / drive.period)):
        drive.accept(linear, angular)
        cycle(drive)
        if drive.drive.drift.warning:
            return drive.drive.drift.warning
    return ""


@pytest.mark.parametrize(
    ("values", "linear", "angular", "warned"),
    [
        ({}, -0.2, 0.3, ""),
        ({"wheel_radius": 0.065}, 0.2, 0.3, ""),
        ({"wheel_radius": 0.12}, -0.2, 0.1, "by its wheels, the robot drove -1.0"),
        ({"wheel_separation": 0.15}, 0.0, 0.3, "by its wheels, the robot turned 1.0"),
    ],
)
def test_lengths_that_are_not_the_robots(
    values: dict[str, float], linear: float, angular: float, warned: str
) -> None:
    """A tenth is not worth a warning; more is, once, with the parameter that is wrong."""
    warning = drifted(ideal_drive(**values), linear, angular)
    assert (warned in warning) if warned else not warning
    assert all(f"{name} is wrong" in warning for name in values if warned)


def test_what_jumps_does_not_drift() -> None:
    drive = ideal_drive()
    for jump in (drive.teleport, drive.place_odometry, lambda _: drive.reset()):
        assert drifted(drive, 0.4, 0.3, 1.55) == ""
        jump(PlanarPose(3.0, 2.0, 1.0))
    assert drifted(drive, 0.4, 0.3, 5.0) == ""


def test_a_push_is_not_counted_after_it() -> None:
    """It begins again where the robot no longer skids, but then it counts each step."""
    check, true = DriftCheck(skids=False), PlanarPose(0.0, 0.0, 0.0)
    for touched in (True, False, False):
        true = true.compose(PlanarPose(0.0, 0.0, 0.5))
        check.update(PlanarPose(0.0, 0.0, 0.0), true, obstructed=touched)
    for step in range(20):
        check.update(PlanarPose(0.25 * step, 0.0, 0.0), true, obstructed=False)
        assert bool(check.warning) == (step >= 7)
        true = true.compose(PlanarPose(0.1, 0.0, 0.0))


def test_a_car_driven_by_its_rear_wheels() -> None:
    names = {f"{side}_wheel_names": [f"{side}_rear_wheel_joint"] for side in ("left", "right")}
    car = load_description(ROBOTS / "warn_deepracer.xacro")
    with alone(car, ControlConfig.from_parameters({**LIMITS, **names})) as fleet:
        assert "as in a car" in drifted(fleet.robots[0], 0.2, 0.5)


@pytest.mark.parametrize("world", ["maze", "ramp"])
def test_walls_and_ramps_are_no_reason_to_warn(world: str) -> None:
    """Nor is another robot in the way: wheels slip there, as those of a real robot do."""
    limits = ControlConfig.from_parameters(LIMITS)
    members = [Member(load_description(ONEBOT), limits), Member(robot(), config(x=-0.6), "other")]
    with Fleet.from_members(members, scene=load_scene(world)) as fleet:
        for cycle in range(650):
            fleet.robots[0].accept(0.6, 0.8 if cycle > 500 else 0.0)
            fleet.robots[1].accept(0.8, 0.0)
            fleet.cycle()
        assert [each.drive.drift.warning for each in fleet.robots] == ["", ""]
        apart = fleet.robots[0].snapshot().drive.odometry.x - fleet.robots[0].true_pose.x
        assert world == "ramp" or abs(apart) > 0.5
