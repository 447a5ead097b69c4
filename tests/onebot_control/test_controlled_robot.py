"""Simulation and controller together, one cycle at a time."""

from collections.abc import Callable
from typing import Any

import pytest

from onebot_control.controlled_robot import ControlledRobot, Snapshot
from onebot_control.drive.kinematics import DriveCommand
from onebot_control.joint_controllers import JointController
from onebot_control.prepared_robot import Member, PreparedRobot
from onebot_control.trajectories.following import TrajectoryFollower
from onebot_description.description import parse_description
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose, PlanarVelocity
from tests.onebot_control.arm_models import interfaces, joint, link, mimic
from tests.onebot_control.control_support import (
    CASTER,
    IdealPlant,
    alone,
    config,
    cycle,
    ideal_drive,
    robot,
    urdf,
    wheel,
)

NO_COMMAND = DriveCommand(0.0, 0.0, 0.0, (0.0, 0.0))
LIMITS = {"linear_x_max_acceleration": 0.5, "angular_z_max_acceleration": 1.0}


def run(drive: ControlledRobot, linear: float, angular: float, cycles: int) -> Snapshot:
    """Command the same in each cycle."""
    for _ in range(cycles):
        drive.accept(linear, angular)
        cycle(drive)
    return drive.begin()


SET = {"wheel_separation": 0.3, "wheel_radius": 0.06}  # so that the description is not asked


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"joint_state_broadcaster.joints": ["arm"]}, 'no joint "arm"'),
        ({"left_wheel_names": ["arm"], **SET}, 'left_wheel_names: .*no rotating joint "arm"'),
        ({"right_wheel_names": ["arm"], **SET}, 'right_wheel_names: .*no rotating joint "arm"'),
        ({"right_wheel_names": ["caster_joint"]}, 'no rotating joint "caster_joint"'),
        ({"wheel_radius": 1e-320}, "left_radius must be at least 1e-06 m, not 9.99989e-321 m"),
        (
            {"wheel_separation": 1e-200, "wheel_separation_multiplier": 1e-200},
            "separation must be at least 1e-06 m, not 0 m",
        ),
    ],
)
def test_what_does_not_suit_the_robot_is_refused(values: dict[str, Any], said: str) -> None:
    wrong = {"linear_x_max_velocity": 0.1, **values}
    with pytest.raises(OneBotError, match=said):
        ideal_drive(**wrong)
    with pytest.raises(OneBotError, match=said):
        alone(robot(), config(**wrong))


def ignored_of(*joints: str) -> list[str]:
    """What is said of controllers of these joints, one joint each."""
    controllers = [
        JointController(TrajectoryFollower, f"arm{row}", {"joints": [joint]})
        for row, joint in enumerate(joints)
    ]
    prepared = PreparedRobot(Member(robot(), config(), controllers=controllers))
    assert len(prepared.controllers) == len(joints) - len(prepared.ignored)
    return [problem.message() for problem in prepared.ignored]


def test_controllers_that_cannot_run_are_inactive() -> None:
    """If their joints have another controller, or the robot has no such joints."""
    wheel = "left_wheel_joint"
    moved = f"is inactive: the controller of the wheels comes first, and moves {wheel}"
    assert ignored_of(wheel) == [f"arm0: {moved}"]
    none = "is inactive: the robot has no joint finger"
    assert ignored_of("finger", wheel) == [f"arm0: {none}", f"arm1: {moved}"]


def test_a_controller_of_no_joint_is_refused() -> None:
    """If it is the only one, or has some other joints: then a name is misspelt."""
    with pytest.raises(OneBotError, match='arm0.joints: joint "caster_joint" does not move'):
        ignored_of("caster_joint")
    wrong = JointController(
        TrajectoryFollower, "arm", {"joints": ["left_wheel_joint", "left_wheel_joynt"]}
    )
    other = JointController(TrajectoryFollower, "other", {"joints": ["finger"]})
    with pytest.raises(OneBotError, match='arm.joints: joint "left_wheel_joynt" .*did you mean'):
        PreparedRobot(Member(robot(), config(), controllers=[wrong, other]))


def test_parameters_that_do_not_suit_a_driven_robot_change_nothing() -> None:
    wrong = {"linear_x_max_velocity": 0.1, "joint_state_broadcaster.joints": ["arm"]}
    drive = ideal_drive()
    before = drive.config, drive.drive.geometry, drive.broadcaster
    with pytest.raises(OneBotError, match='no joint "arm"'):
        drive.configure(config(**wrong))
    assert (drive.config, drive.drive.geometry, drive.broadcaster) == before
    assert run(drive, 0.5, 0.0, 1).drive.command.linear == 0.5


def test_configure_takes_effect_at_once_and_disturbs_nothing_else() -> None:
    """Rate, geometry, limits and broadcaster are the new ones; pose, time and command stay."""
    drive = ideal_drive()
    before = run(drive, 0.5, 0.2, 20)
    chosen = config(
        update_rate=50,
        wheel_radius=0.12,
        linear_x_max_velocity=0.25,
        **{"joint_state_broadcaster.joints": ["right_wheel_joint"]},
    )
    drive.configure(chosen)
    assert drive.config is chosen
    assert drive.drive.geometry == pytest.approx((0.3, 0.12))
    assert drive.broadcaster.names == ("right_wheel_joint",)
    assert drive.period == 0.02
    assert drive.snapshot() == before
    snapshot = drive.begin()
    assert snapshot.tick == before.tick
    assert snapshot.drive.command[:3] == (0.25, 0.0, 0.2)
    assert snapshot.drive.command.wheels[0] == pytest.approx((0.25 - 0.03) / 0.12)


class Jumpy(IdealPlant):
    """Its wheels stand anywhere after a reset and a teleport."""

    def reset(self) -> None:
        super().reset()
        self.left, self.right, self.speeds = self.left - 7.0, self.right + 5.0, (0.0, 0.0)

    def teleport(self, x: float, y: float, yaw: float) -> None:
        super().teleport(x, y, yaw)
        self.left, self.right, self.speeds = self.left + 3.0, self.right - 8.0, (0.0, 0.0)


JERKY = {"linear_x_max_jerk": 10.0, "angular_z_max_jerk": 10.0}


def check_it_drives_as(new: ControlledRobot, drive: ControlledRobot) -> None:
    """It stands until the first command, and has the same commands and twists from then on."""
    for _ in range(3):
        assert cycle(drive).drive.command == cycle(new).drive.command == NO_COMMAND
    for _ in range(60):
        mine, fresh = run(drive, 0.4, -0.2, 1), run(new, 0.4, -0.2, 1)
        assert mine.drive.command == fresh.drive.command
        assert mine.drive.twist == pytest.approx(fresh.drive.twist, abs=1e-12)


def test_reset_leaves_nothing_but_time_and_parameters() -> None:
    """From then on it drives as a new robot does, which began with the first command."""
    drive, new = ideal_drive(Jumpy(), **JERKY), ideal_drive(**JERKY)
    run(drive, 0.5, 0.3, 100)
    drive.teleport(PlanarPose(5.0, 6.0, 1.0))
    drive.place_odometry(PlanarPose(1.0, 2.0, 3.0))
    run(drive, 0.5, 0.3, 20)
    chosen = drive.config
    drive.reset()
    snapshot = drive.snapshot()
    assert (drive.true_pose, drive.odom_in_world) == (PlanarPose(), PlanarPose())
    assert (snapshot.drive.odometry, snapshot.drive.twist) == (PlanarPose(), PlanarVelocity())
    assert not any(snapshot.joints.velocities)
    assert (drive.ticks, drive.config) == (120, chosen)
    check_it_drives_as(new, drive)
    assert drive.snapshot().drive.odometry == pytest.approx(new.snapshot().drive.odometry, abs=1e-9)


@pytest.mark.parametrize(
    "place",
    [ControlledRobot.reset, lambda drive: drive.teleport(PlanarPose(5.0, 6.0, 1.0))],
    ids=["reset", "teleport"],
)
def test_a_robot_that_is_placed_during_a_cycle_stays(
    place: Callable[[ControlledRobot], None],
) -> None:
    """As by a callback of a node in step: what the cycle has decided is not carried out."""
    plant = IdealPlant()
    drive = ideal_drive(plant)
    run(drive, 0.5, 0.3, 20)
    drive.begin()
    place(drive)
    drive.turn()
    assert plant.targets == [0.0, 0.0]


def test_after_a_teleport_it_starts_from_rest() -> None:
    """Command, speed and twist are gone, odometry, its origin and time are kept."""
    drive, new = ideal_drive(Jumpy(), **JERKY), ideal_drive(**JERKY)
    run(drive, 0.5, 0.3, 100)
    before, origin = cycle(drive), drive.odom_in_world
    drive.teleport(PlanarPose(5.0, 6.0, 1.0))
    assert drive.true_pose == pytest.approx((5.0, 6.0, 1.0))
    assert (drive.odom_in_world, drive.ticks) == (origin, 101)
    snapshot = drive.snapshot()
    assert (snapshot.drive.odometry, snapshot.drive.twist) == (
        before.drive.odometry,
        PlanarVelocity(),
    )
    assert drive.begin().drive.odometry == before.drive.odometry
    check_it_drives_as(new, drive)


@pytest.mark.parametrize("pose", [PlanarPose(), PlanarPose(3.0, -1.0, 2.0)])
def test_set_odometry_moves_only_the_origin(pose: PlanarPose) -> None:
    """The odometry says the pose, the truth is where it was, and the robot drives on."""
    drive, twin = ideal_drive(**JERKY), ideal_drive(**JERKY)
    for one in (drive, twin):
        run(one, 0.5, 0.3, 50)
    truth, twist = drive.true_pose, drive.snapshot().drive.twist
    drive.place_odometry(pose)
    assert drive.true_pose == truth
    assert (drive.snapshot().drive.odometry, drive.snapshot().drive.twist) == (pose, twist)
    assert drive.odom_in_world.compose(pose) == pytest.approx(truth)
    for _ in range(40):
        mine, other = cycle(drive), cycle(twin)
        assert (mine.drive.command, mine.tick) == (other.drive.command, other.tick)
        assert mine.drive.twist == other.drive.twist
    assert drive.odom_in_world.compose(drive.begin().drive.odometry) == pytest.approx(
        drive.true_pose, abs=1e-9
    )


def test_a_cycle_is_seen_as_it_begins() -> None:
    """The state is that of before the wheels turn, the command that of from then on."""
    drive = ideal_drive()
    assert drive.snapshot().drive.command == NO_COMMAND
    drive.accept(0.6, 0.0)
    first, second = cycle(drive), cycle(drive)
    assert (first.tick, second.tick, drive.ticks) == (0, 1, 2)
    assert not any(first.joints.positions) and first.drive.command.wheels[0] == pytest.approx(10.0)
    assert second.joints.positions == pytest.approx([0.1, 0.1])
    assert second.pose.translation[0] == pytest.approx(0.006)
    assert drive.true_pose.x == pytest.approx(0.006)
    assert drive.begin().tick == drive.ticks == 2
    assert drive.true_pose.x == pytest.approx(0.012)


def test_velocities_are_by_the_clock_that_stamps_them() -> None:
    """After a stall as long as a cycle they are half of those in the simulation's time."""
    drive = ideal_drive(position_feedback=False, velocity_rolling_window_size=1)
    full = run(drive, 0.6, 0.3, 5)
    drive.wait(drive.period, stalled=True)
    half = drive.begin()
    assert full.drive.twist == pytest.approx((0.6, 0.0, 0.3))
    assert half.drive.twist == pytest.approx((0.3, 0.0, 0.15))
    assert half.joint_states.velocities == pytest.approx(
        [speed / 2.0 for speed in full.joints.velocities]
    )
    assert half.velocity.linear == pytest.approx([0.3, 0.0, 0.0])
    assert half.velocity.angular == pytest.approx([0.0, 0.0, 0.15])


def test_the_pace_is_that_of_cycles_in_the_time_that_passes() -> None:
    """Over the window: of a stall's time its next cycle has none, of a pause nothing has."""
    drive = ideal_drive(velocity_rolling_window_size=2, update_rate=10.0)
    paces = [drive.pace.value]
    run(drive, 0.0, 0.0, 3)
    paces.append(drive.pace.value)
    drive.wait(0.3, stalled=True)
    paces += [cycle(drive).pace for _ in range(3)]
    drive.wait(0.3)
    assert [*paces, drive.snapshot().pace] == pytest.approx([1.0, 1.0, 0.4, 0.4, 1.0, 0.25])


def test_covariance_is_of_the_way_since_the_odometry_was_set() -> None:
    """It grows on the way, not by a teleport; where the pose is set it is zero."""
    drive = ideal_drive(left_wheel_noise=0.01, right_wheel_noise=0.02)
    grown = run(drive, 0.5, 0.3, 100).drive.covariance
    assert grown.yaw_yaw == pytest.approx(
        (0.01**2 * (0.5 - 0.045) + 0.02**2 * (0.5 + 0.045)) / 0.3**2, rel=0.02
    )
    drive.teleport(PlanarPose(5.0, 6.0, 1.0))
    assert cycle(drive).drive.covariance == grown
    drive.place_odometry(PlanarPose(1.0, 2.0, 3.0))
    assert cycle(drive).drive.covariance == (0.0,) * 6
    assert run(drive, 0.5, 0.3, 10).drive.covariance.xx > 0.0
    drive.configure(config(left_wheel_noise=0.0, right_wheel_noise=0.0))
    kept = cycle(drive).drive.covariance.yaw_yaw
    assert run(drive, 0.5, 0.3, 10).drive.covariance.yaw_yaw == kept
    drive.reset()
    assert cycle(drive).drive.covariance == (0.0,) * 6


def moving(name: str, kind: str, limit: str, leader: str, factor: float, offset: float) -> str:
    """A link that mimics a joint."""
    follows = mimic(leader, factor, offset)
    moved = joint(f"{name}_joint", "base_link", name, kind, UP, limits=limit, more=follows)
    return link(name) + moved


UP, LIMIT = "0 0 1", 'lower="{}" upper="{}" effort="1" velocity="9"'
ARM = link("arm") + joint("arm_joint", "base_link", "arm", axis=UP, limits=LIMIT.format(0.25, 1))


def test_mimic_joints_stand_where_their_masters_have_them() -> None:
    """Of held masters and of driven wheels, in chains, within their limits."""
    wheels = wheel("left", 0.2), wheel("right", -0.2)
    leader, wide = "left_wheel_joint", LIMIT.format(-900, 900)
    description = parse_description(
        urdf(
            *wheels,
            CASTER,
            # Followers before their masters, too.
            moving("tip", "revolute", wide, "finger_joint", 2.0, 0.1),
            moving("finger", "revolute", wide, "arm_joint", -1.0, 0.5),
            moving("stop", "revolute", LIMIT.format(-1, 0.125), "arm_joint", 1.0, 0.5),
            moving("slide", "prismatic", LIMIT.format(-1, 0.3), leader, 0.5, 0.1),
            moving("gauge", "continuous", "", "gear_joint", -1.0, 0.25),
            moving("gear", "revolute", wide, leader, 3.0, 0.5),
            ARM,
            interfaces("arm_joint", "velocity"),  # which no controller commands
        )
    )
    with alone(description, config()) as fleet:
        (drive,) = fleet.robots
        for cycles in (1, 150):
            for _ in range(cycles):
                drive.accept(0.1, 0.0)
                snapshot = fleet.cycle()[0]
            names = drive.broadcaster.names
            positions, velocities, _ = (
                dict(zip(names, values, strict=True))
                for values in drive.broadcaster.values(snapshot.joints)
            )
            turned, speed = positions[leader], velocities[leader]
            expected = {
                "arm_joint": (0.25, 0.0),
                "finger_joint": (0.25, 0.0),
                "tip_joint": (0.6, 0.0),
                "stop_joint": (0.125, 0.0),
                "slide_joint": (0.1 + 0.5 * turned, 0.5 * speed),
                "gear_joint": (0.5 + 3.0 * turned, 3.0 * speed),
                "gauge_joint": (-0.25 - 3.0 * turned, -3.0 * speed),
            }
            if turned > 0.4:
                expected["slide_joint"] = 0.3, 0.0
            for name, (position, velocity) in expected.items():
                assert positions[name] == pytest.approx(position, abs=1e-9), name
                assert velocities[name] == pytest.approx(velocity, abs=1e-9), name
        assert turned > 1.0 and len(names) == len(set(names)) == 9
        # The physics has them there, too.
        held = {joint.name: joint for joint in drive.body.spawn.description.joints}
        assert held["tip_joint"].origin.rpy[2] == pytest.approx(0.6)
        assert held["gear_joint"].origin.rpy[2] == pytest.approx(0.5)
