"""Robots of one kind, driven together."""

from typing import Any

import pytest

from onebot_control.driven_robot import Fleet
from onebot_control.poses import PlanarPose
from onebot_description.errors import OneBotError
from tests.onebot_control.control_support import config, robot

STARTS = [PlanarPose(), PlanarPose(2.0, 1.0, 1.5)]


def test_a_cycle_is_one_of_each_robot() -> None:
    """Seen as it begins, one period long; who is not commanded stands."""
    with Fleet(robot(), config(update_rate=50, x=9.0, y=9.0, yaw=9.0), STARTS) as fleet:
        for drive, start in zip(fleet.robots, STARTS, strict=True):
            assert drive.true_pose == drive.odom_in_world == pytest.approx(start, abs=1e-6)
        fleet.robots[1].accept(0.3, 0.2)
        began = fleet.world.time
        for cycle in range(3):
            snapshots = fleet.cycle()
            assert [snapshot.tick for snapshot in snapshots] == [cycle] * 2
            assert [drive.ticks for drive in fleet.robots] == [cycle + 1] * 2
            assert [s.command[2:4] for s in snapshots] == [(0.0, 0.0), (0.3, 0.2)]
        assert fleet.world.time - began == pytest.approx(3 * 0.02)
        turned = [s.joints.velocities for s in fleet.cycle()]
        assert turned[0] == pytest.approx(0.0, abs=1e-3)
        assert turned[1] == pytest.approx([4.5, 5.5], abs=0.2)


def test_reset_of_one_leaves_the_others() -> None:
    """It stands at its own start with its odometry at zero, and time goes on for all."""
    with Fleet(robot(), config(), STARTS) as fleet:
        for _ in range(20):
            for drive in fleet.robots:
                drive.accept(0.3, 0.2)
            fleet.cycle()
        fleet.robots[1].reset()
        assert fleet.robots[1].odom_in_world == pytest.approx(STARTS[1], abs=1e-6)
        resting = fleet.cycle()
        assert [snapshot.tick for snapshot in resting] == [20, 20]
        assert resting[0].command.linear == 0.3 and resting[1].command.linear == 0.0
        assert resting[0].odometry.x > 0.01
        assert resting[1].odometry == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"left_wheel_names": ["arm"]}, 'left_wheel_names: .*no joint "arm" that turns'),
        ({"right_wheel_names": ["arm"]}, 'right_wheel_names: .*no joint "arm" that turns'),
        ({"joint_state_broadcaster.joints": ["arm"]}, 'no joint "arm"'),
    ],
)
def test_what_does_not_suit_the_robot_is_refused(values: dict[str, Any], said: str) -> None:
    """As of a single robot."""
    with pytest.raises(OneBotError, match=said):
        Fleet(robot(), config(**values), STARTS)


def test_the_world_is_freed_with_the_fleet() -> None:
    """By close, or at the end of with."""
    with Fleet(robot(), config(), STARTS) as fleet:
        fleet.cycle()
    with pytest.raises(OneBotError, match="closed"):
        fleet.cycle()
