"""Simulation and controller together, one cycle at a time."""

import numpy as np
import pytest

from onebot_control.driven_robot import DrivenRobot, Snapshot
from onebot_control.parameters import ControlConfig, default_control_file, read_control_files
from onebot_control.poses import PlanarPose
from onebot_description.description import load_description
from onebot_description.description.packages import package_share
from onebot_description.errors import OneBotError
from tests.onebot_control.control_support import (
    CASTER,
    IdealPlant,
    config,
    ideal_drive,
    robot,
    wheel,
)

LIMITS = {"linear_x_max_acceleration": 0.5, "angular_z_max_acceleration": 1.0}


def run(drive: DrivenRobot, linear: float, angular: float, cycles: int) -> Snapshot:
    """Command the same in each cycle."""
    for _ in range(cycles):
        drive.accept(linear, angular)
        drive.cycle()
    return drive.begin()


def test_odometry_is_the_truth_of_wheels_that_never_slip() -> None:
    """On an ideal plant the two agree to rounding, on a curve with limits."""
    drive = ideal_drive(**LIMITS)
    snapshot = run(drive, 0.4, 0.7, 1000)
    assert snapshot.odometry[:2] == pytest.approx(drive.true_pose[:2], abs=1e-9)


def test_wheels_anywhere_at_the_start() -> None:
    """Odometry starts at zero wherever the wheels stand."""
    drive = ideal_drive(IdealPlant(left=100.0, right=-3.0))
    assert run(drive, 0.0, 0.0, 5).odometry == PlanarPose()


def test_reset_odometry_keeps_the_robot_and_moves_the_origin() -> None:
    """The truth stays; the odometry's zero is where the robot stands."""
    drive = ideal_drive()
    run(drive, 0.5, 0.0, 100)
    truth = drive.true_pose
    drive.place_odometry(PlanarPose())
    assert drive.true_pose == truth
    assert drive.origin == pytest.approx(truth)
    assert run(drive, 0.0, 0.0, 2).odometry.x == pytest.approx(0.0, abs=0.02)


def test_teleport_is_no_driving() -> None:
    """The robot is elsewhere and at rest; the odometry has not moved."""
    drive = ideal_drive()
    before = run(drive, 0.5, 0.0, 100).odometry
    drive.teleport(PlanarPose(5.0, 6.0, 1.0))
    snapshot = drive.begin()
    assert drive.true_pose == pytest.approx((5.0, 6.0, 1.0))
    assert snapshot.odometry == before
    assert (snapshot.command.left, snapshot.twist) == (0.0, (0.0, 0.0))


def test_configure_refuses_what_does_not_suit_the_robot() -> None:
    """A joint the robot lacks is refused, and all stays as it was."""
    drive = ideal_drive()
    before = drive.config
    with pytest.raises(OneBotError, match='no joint "arm"'):
        drive.configure(config(**{"joint_state_broadcaster.joints": ["arm"]}))
    assert drive.config is before


def test_broadcaster_chooses_orders_and_adds() -> None:
    """The joints named come in that order, then the extra ones; other interfaces are NaN."""
    drive = ideal_drive(
        IdealPlant(left=1.0, right=2.0),
        **{
            "joint_state_broadcaster.joints": ["right_wheel_joint", "left_wheel_joint"],
            "joint_state_broadcaster.extra_joints": ["arm"],
            "joint_state_broadcaster.interfaces": ["position"],
        },
    )
    assert drive.broadcaster.names == ("right_wheel_joint", "left_wheel_joint", "arm")
    positions, velocities, _ = drive.broadcaster.values(drive.begin().joints)
    assert positions == [2.0, 1.0, 0.0]
    assert np.isnan(velocities[:2]).all() and velocities[2] == 0.0


def test_simulated_robot_drives_as_told() -> None:
    """In PyBullet: 0.2 m/s for 5 s with gentle limits ends where it should, by odom and truth."""
    drive = DrivenRobot.of(robot(), config(x=1.0, y=2.0, yaw=0.0, **LIMITS))
    snapshot = run(drive, 0.2, 0.0, 500)
    # It takes 0.4 s to speed up, which costs half of 0.2 m/s times 0.4 s (and one step's grid).
    expected = 0.2 * 5.0 - 0.2 * 0.2 * 1.0
    assert snapshot.odometry.x == pytest.approx(expected, abs=0.003)
    assert drive.true_pose.x - 1.0 == pytest.approx(snapshot.odometry.x, rel=5e-4)
    assert drive.true_pose.y - 2.0 == pytest.approx(0.0, abs=1e-4)
    drive.plant.close()


def test_same_commands_give_the_same_bits() -> None:
    """Two runs of one sequence agree in every bit of state, odometry and truth."""

    def once() -> list[bytes]:
        drive = DrivenRobot.of(robot(), config(**LIMITS))
        log = []
        for cycle in range(200):
            if cycle % 7 == 0:
                drive.accept(0.3, 1.0 - cycle / 100.0)
            snapshot = drive.cycle()
            values = [*snapshot.joints, *snapshot.pose, *snapshot.velocity]
            numbers = [*snapshot.odometry, *snapshot.twist, *snapshot.command[:4]]
            log.append(b"".join(v.tobytes() for v in values) + np.array(numbers).tobytes())
        drive.plant.close()
        return log

    assert once() == once()


def test_replaced_robot_stands_where_the_old_one_stood() -> None:
    """Another description is taken up in place: truth and odometry stay."""
    drive = DrivenRobot.of(robot(), config(**LIMITS))
    before = run(drive, 0.3, 0.5, 200).odometry
    truth = drive.true_pose
    shape = '<sphere radius="0.07"/>'
    caster = CASTER.replace("-0.2 0 -0.03", "-0.2 0 -0.04")
    wheels = wheel("left", 0.2, shape), wheel("right", -0.2, shape)
    other = drive.replaced(robot(*wheels, caster))
    assert other.geometry == pytest.approx((0.4, 0.07))
    assert other.true_pose == pytest.approx(truth, abs=1e-9)
    assert other.begin().odometry == before
    other.plant.close()
    drive.plant.close()


def test_onebot_drives_by_its_own_control_yaml() -> None:
    """OneBot and its control.yaml suit each other; on a curve, odometry is the truth."""
    file = default_control_file()
    values = read_control_files([file], "/", "velocity_controller").values
    model = package_share("onebot_description") / "urdf" / "onebot.urdf.xacro"
    drive = DrivenRobot.of(load_description(model), ControlConfig.from_parameters(values))
    assert len(drive.broadcaster.names) == 4
    snapshot = run(drive, 0.2, 0.3, 500)
    way = 0.2 * 5.0
    assert snapshot.odometry.yaw == pytest.approx(0.3 * 5.0 - 0.3 * 0.3 / 2.0, abs=0.005)
    assert drive.true_pose[:2] == pytest.approx(snapshot.odometry[:2], abs=0.005 * way)
    drive.plant.close()
