"""Robots of one world, driven together."""

from typing import Any

import pytest

from onebot_control.controlled_robot import Snapshot
from onebot_control.fleet import Fleet
from onebot_control.joint_controllers import DEFAULT_CONTROLLER
from onebot_control.prepared_robot import Member
from onebot_control.simulation_parameters import SimulationConfig
from onebot_control.trajectories.goal import TrajectoryGoal
from onebot_control.trajectories.trajectory import Waypoint
from onebot_description.description import Description
from onebot_description.description.loading import load_world
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose
from tests.onebot_control.arm_models import arm, box, joint, link, rod
from tests.onebot_control.control_support import CASTER, config, robot, wheel
from tests.onebot_control.test_scene import part, scene

STARTS = [PlanarPose(), PlanarPose(2.0, 1.0, 1.5)]
PLACES = {"left_wheel_names": "f.yaml:3"}
LIMITS = {"linear_x_max_acceleration": 1.0, "angular_z_max_acceleration": 1.0}


def fleet_of(*starts: PlanarPose, scene: Description | None = None, **values: Any) -> Fleet:
    """Small robots at these places."""
    chosen = [config(**{**start._asdict(), **values}) for start in starts or STARTS]
    names = [f"/r{row + 1}" for row in range(len(chosen))]
    members = [Member(robot(), *each) for each in zip(chosen, names, strict=True)]
    return Fleet.from_members(members, scene=scene)


def larger(separation: float = 0.4) -> Description:
    """A robot whose wheels are of radius 0.07 m."""
    shape = '<sphere radius="0.07"/>'
    wheels = wheel("left", separation / 2, shape), wheel("right", -separation / 2, shape)
    return robot(*wheels, CASTER.replace("-0.2 0 -0.03", "-0.2 0 -0.04"))


def run(fleet: Fleet, row: int, linear: float, angular: float, cycles: int) -> list[Snapshot]:
    """Drive one robot; the last snapshots."""
    for _ in range(cycles):
        fleet.robots[row].accept(linear, angular)
        snapshots = fleet.cycle()
    return snapshots


def test_a_cycle_is_one_of_each_robot() -> None:
    with fleet_of(update_rate=50) as fleet:
        for drive, start in zip(fleet.robots, STARTS, strict=True):
            assert drive.true_pose == drive.odom_in_world == pytest.approx(start, abs=1e-6)
        fleet.robots[1].accept(0.3, 0.2)
        for cycle in range(3):
            snapshots = fleet.cycle()
            assert [snapshot.tick for snapshot in snapshots] == [cycle] * 2
            assert [drive.ticks for drive in fleet.robots] == [cycle + 1] * 2
            assert [s.drive.command[:3] for s in snapshots] == [(0.0, 0.0, 0.0), (0.3, 0.0, 0.2)]
        turned = [s.joints.velocities for s in fleet.cycle()]
        assert turned[0] == pytest.approx([0.0, 0.0], abs=1e-3)
        assert turned[1] == pytest.approx([4.5, 5.5], abs=0.2)


def test_what_does_not_suit_a_robot_is_refused() -> None:
    wrong = config(left_wheel_names=["arm"])
    members = [Member(robot(), config(x=1.0)), Member(robot(), wrong, "/r1", PLACES)]
    message = '/r1: f.yaml:3: left_wheel_names: .*no rotating joint "arm"'
    with pytest.raises(OneBotError, match=message):
        Fleet.from_members(members)


def test_all_robots_have_the_cycles_of_one_loop() -> None:
    members = [
        Member(robot(), config(update_rate=rate, x=x), name)
        for name, rate, x in (("/r1", 100, 0.0), ("/r2", 50, 2.0))
    ]
    with pytest.raises(OneBotError, match="/r2: update_rate is 50 Hz, but /r1 has 100 Hz; it must"):
        Fleet.from_members(members)


def test_robots_in_one_place_are_refused_by_name() -> None:
    with pytest.raises(OneBotError, match=r"robots /r1 and /r3 .*x 0.1 m, y 0 m; move one"):
        fleet_of(PlanarPose(), PlanarPose(0.0, 2.0, 0.0), PlanarPose(0.1, 0.0, 0.0))


@pytest.mark.parametrize("starts", [[PlanarPose(1.0, -2.0, 2.0)], STARTS])
def test_another_description_is_driven_where_the_robot_is(starts: list[PlanarPose]) -> None:
    with fleet_of(*starts, cmd_vel_timeout=5.0, **LIMITS) as fleet:
        last = len(starts) - 1
        run(fleet, last, 0.3, 0.5, 60)
        fleet.robots[last].place_odometry(PlanarPose(3.0, 2.0, 1.0))
        for drive in fleet.robots:
            drive.accept(0.2, 0.1)
        before = run(fleet, last, 0.3, 0.5, 60)
        old = fleet.robots[last]
        others = [drive.body.state()[1] for drive in fleet.robots[:last]]
        truth, kept = old.true_pose, (old.odom_in_world, old.ticks, old.config)
        fleet.replace(last, larger())
        new = fleet.robots[last]
        assert new.drive.geometry == pytest.approx((0.4, 0.07))
        assert new.true_pose == pytest.approx(truth, abs=1e-9)
        assert (new.odom_in_world, new.ticks, new.config) == kept
        assert new.snapshot().drive.covariance == old.snapshot().drive.covariance != (0.0,) * 6
        for pose, drive in zip(others, fleet.robots, strict=False):
            for placed, expected in zip(drive.body.state()[1], pose, strict=True):
                assert placed == pytest.approx(expected, abs=1e-12)
        after = fleet.cycle()
        assert after[last].drive.odometry == pytest.approx(before[last].drive.odometry, abs=0.01)
        assert after[last].drive.command[:4] == (0.0, 0.0, 0.0, (0.0, 0.0))
        for one, other in zip(before[:last], after, strict=False):
            assert other.drive.twist == pytest.approx(one.drive.twist, abs=0.02)
            assert other.drive.command.linear == pytest.approx(0.2)
        assert run(fleet, last, 0.3, 0.0, 1)[last].drive.command.linear == pytest.approx(0.01)


def test_a_description_without_room_changes_nothing() -> None:
    with fleet_of(PlanarPose(), PlanarPose(0.0, 0.5, 0.0)) as fleet:
        world, drives = fleet.world, list(fleet.robots)
        with pytest.raises(OneBotError, match="robots /r1 and /r2 of .*same place"):
            fleet.replace(1, larger(0.8))
        assert fleet.world is world and fleet.robots == drives
        assert run(fleet, 1, 0.3, 0.0, 10)[1].drive.twist[0] > 0.1


def nosed(length: float) -> Description:
    """The small robot with a box that reaches so far before it, m."""
    nose = link("nose", shape=box(f"{length} 0.1 0.02"))
    nose += joint("nose_joint", "base_link", "nose", "fixed", xyz=f"{length / 2} 0 0.05")
    return robot(wheel("left", 0.15), wheel("right", -0.15), CASTER, nose)


def test_a_robot_is_not_put_into_another() -> None:
    """Neither by teleport nor by reset: refused, nothing has changed, and both drive on."""
    with fleet_of(cmd_vel_timeout=5.0, **LIMITS) as fleet:
        one, other = fleet.robots
        other.teleport(PlanarPose(0.05, 3.0, 1.0))
        run(fleet, 0, 0.3, 0.4, 500)
        other.teleport(PlanarPose(0.02, 0.01, 0.5))
        moving = one.body.state()[2]
        before = [repr(each.body.state()[1]) for each in (one, other)]
        with pytest.raises(OneBotError, match="robots /r1 and /r2 .* would stand in the same pl"):
            one.reset()
        with pytest.raises(OneBotError, match="robots /r1 and /r2 .* would stand in the same pl"):
            one.teleport(PlanarPose(0.05, 0.0, 0.3))
        assert [repr(each.body.state()[1]) for each in (one, other)] == before
        assert one.body.state()[2].linear == pytest.approx(moving.linear)
        odometry, [after, beside] = one.snapshot().drive.odometry, fleet.cycle()
        assert after.drive.twist == pytest.approx((0.3, 0.0, 0.4), abs=0.01)
        assert after.drive.odometry[:2] == pytest.approx(odometry[:2], abs=0.01)
        run(fleet, 0, 0.3, 0.4, 50)
        assert other.true_pose == pytest.approx(beside.pose.translation[:2] + (0.5,), abs=1e-3)


def test_all_robots_are_reset_at_once() -> None:
    """Each may stand where another one starts."""
    with fleet_of() as fleet:
        one, other = fleet.robots
        one.teleport(PlanarPose(9.0, 9.0, 0.0))
        other.teleport(STARTS[0])
        one.teleport(STARTS[1])
        run(fleet, 1, 0.3, 0.4, 3)
        fleet.reset()
        for drive, start in zip(fleet.robots, STARTS, strict=True):
            assert drive.true_pose == drive.odom_in_world == pytest.approx(start, abs=1e-6)
        assert {s.drive.command[:3] for s in fleet.cycle()} == {(0.0, 0.0, 0.0)}
        assert [drive.ticks for drive in fleet.robots] == [4, 4]


def test_an_arm_goes_on_when_it_or_another_robot_is_replaced() -> None:
    """The new world, too, tracks its reference, which still moves or has come to its goal."""
    members = [
        Member(robot(), config(**STARTS[1]._asdict()), "/r1"),
        Member(rod(), SimulationConfig(), "/r2", controllers=[DEFAULT_CONTROLLER]),
    ]
    with Fleet.from_members(members) as fleet:
        [follower] = fleet.robots[1].followers.values()
        follower.start(TrajectoryGoal(("elbow",), (Waypoint(0.5, (1.0,)),)))
        run(fleet, 0, 0.0, 0.0, 20)
        fleet.replace(1, rod())
        run(fleet, 0, 0.0, 0.0, 40)
        fleet.replace(0, larger())
        assert run(fleet, 0, 0.0, 0.0, 60)[1].joints.positions == pytest.approx((1.0,), abs=1e-3)
        fleet.robots[1].reset()
        assert fleet.robots[1].finished == []
        assert run(fleet, 0, 0.0, 0.0, 60)[1].joints.positions == pytest.approx((0.0,), abs=1e-3)


def test_a_replaced_description_has_the_physics_of_a_new_start() -> None:
    """As many iterations as it needs, and no more when it has no arm any longer."""
    member = Member(arm(), SimulationConfig())
    with (
        Fleet.from_members([member]) as fleet,
        Fleet.from_members([member._replace(description=rod())]) as new,
    ):
        few, many = fleet.world.settings, new.world.settings
        assert few.iterations < many.iterations
        for description, settings in ((rod(), many), (arm(), few)):
            fleet.replace(0, description)
            assert fleet.world.settings == settings


@pytest.mark.parametrize("walled", [False, True])
def test_a_description_needs_room_where_the_robot_is_not_at_its_start(walled: bool) -> None:
    """Where there is none at its start, only reset is refused, and other replacements are not."""
    wall = scene(part("wall", "0.1 1 0.3", "0.6 0 0.15"))
    starts = [PlanarPose(), PlanarPose(0.6, 0.0, 0.0)][: 1 if walled else 2]
    with fleet_of(*starts, scene=wall if walled else None) as fleet:
        for row, drive in enumerate(fleet.robots):
            drive.teleport(PlanarPose(-3.0, 4.0 * row, 0.0))
        fleet.replace(0, nosed(0.8))
        fleet.replace(len(starts) - 1, nosed(0.8))
        poses = [drive.true_pose for drive in fleet.robots]
        assert poses == [
            pytest.approx((-3.0, 4.0 * row, 0.0), abs=1e-9) for row in range(len(poses))
        ]
        if walled:
            with pytest.raises(OneBotError, match="cannot stand there, .* link wall of scene.urdf"):
                fleet.robots[0].reset()
            assert fleet.robots[0].true_pose == poses[0]
        else:
            fleet.robots[1].reset()
            with pytest.raises(OneBotError, match="/r1 and /r2"):
                fleet.robots[0].reset()
            poses = [repr(drive.body.state()[1]) for drive in fleet.robots]
            with pytest.raises(OneBotError, match="/r1 and /r2"):
                fleet.reset()
            assert [repr(drive.body.state()[1]) for drive in fleet.robots] == poses
        stands = [drive.true_pose for drive in fleet.robots]
        with pytest.raises(
            OneBotError, match="link wall of scene.urdf" if walled else "/r1 and /r2"
        ):
            fleet.restart()
        fleet.cycle()
        for drive, pose in zip(fleet.robots, stands, strict=True):
            drive.observe()
            assert (drive.true_pose, drive.ticks) == (pytest.approx(pose, abs=1e-5), 1)


def test_the_boxes_of_a_world_stay_where_they_were_pushed_when_a_robot_is_replaced() -> None:
    with Fleet.from_members([Member(robot(), config(**LIMITS))], scene=load_world("maze")) as fleet:
        assert fleet.robots[0].world_frame == "world"
        run(fleet, 0, 0.5, 0.0, 500)
        scene = fleet.world.scene
        assert scene is not None and scene.poses[0][0][0] > 1.6
        fleet.replace(0, larger())
        replaced = fleet.world.scene
        assert replaced is not None and replaced is not scene
        assert replaced.poses[0][0] == pytest.approx(scene.poses[0][0], abs=1e-9)
        fleet.robots[0].reset()
        assert replaced.poses[0][0] == pytest.approx((1.52, 0.0, 0.1))
