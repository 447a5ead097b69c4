"""Cars, tricycles and omni drives as makers describe them drive by their descriptions alone."""

import math
from itertools import pairwise
from pathlib import Path

import pytest

from onebot_control import Simulation
from onebot_control.control_files import ControlFiles
from onebot_control.drive.steered import SteeredKinematics
from onebot_control.drive.wheels.steering import SteeredGeometry
from onebot_control.drive_kinds import DRIVES, ControlConfig, found_drive
from onebot_control.simulated_robot import SimulatedRobot
from onebot_description.description import Description, parse_description
from onebot_description.geometry.poses import PlanarPose
from onebot_description.parameters.reader import read
from tests.onebot_control.arm_models import box, joint, link
from tests.onebot_control.drive_models import CORNERS, mecanum, omni

BASE, TRACK, RADIUS = 1.7, 1.0, 0.3  # m, of the car
ROUGH = "-1.57"  # rad, as makers write a quarter turn
CAR = "ackermann_steering_controller/AckermannSteeringController"
TRICYCLE = "tricycle_controller/TricycleController"
OMNI = "omni_wheel_drive_controller/OmniWheelDriveController"
REAR, FRONT = ("rear_right", "rear_left"), ("front_right", "front_left")


def mounted(name: str, parent: str, xyz: str, rpy: str, axis: str, kind: str = "continuous") -> str:
    """The joint of a link."""
    limits = 'lower="-0.5" upper="0.5" effort="9" velocity="100"'
    return joint(name, parent, f"{name}_link", kind, axis, xyz, rpy=rpy, limits=limits)


def solid(geometry: str) -> str:
    return f"<collision><geometry>{geometry}</geometry></collision>"


def wheel(name: str, parent: str, xyz: str, rpy: str = f"{ROUGH} 0 0", mass: float = 2.0) -> str:
    shape = solid(f'<cylinder radius="{RADIUS}" length="0.08"/>')
    body = link(f"{name}_link", mass, moment=0.14, shape=shape)
    return body + mounted(name, parent, xyz, rpy, "0 0 1")


def robot(*parts: str) -> Description:
    """A robot whose body is lighter than its wheels."""
    body = link("body_link", 1.0, moment=0.4, shape=box("1.8 0.8 0.3"))
    fixed = mounted("body", "base", f"{BASE / 2} 0 {RADIUS + 0.2}", "0 0 0", "1 0 0", "fixed")
    return parse_description(
        f'<robot name="bot"><link name="base"/>{body}{fixed}{"".join(parts)}</robot>'
    )


def steered(name: str, x: float, y: float, kind: str) -> str:
    hinge = link(f"{name}_hinge_link", 0.1, moment=1e-4)
    hinge += mounted(f"{name}_hinge", "base", f"{x} {y} {RADIUS}", "0 0 0", "0 0 1", kind)
    return hinge + wheel(name, f"{name}_hinge_link", "0 0 0")


def car(*more: str, kind: str = "continuous") -> Description:
    sides = {"right": -TRACK / 2.0, "left": TRACK / 2.0}
    rear = [wheel(f"rear_{side}", "base", f"0 {y} {RADIUS}") for side, y in sides.items()]
    front = [steered(f"front_{side}", BASE, y, kind) for side, y in sides.items()]
    return robot(*rear, *front, *more)


def control(**commands: str) -> str:
    joints = (
        f'<joint name="{name}"><command_interface name="{command}"/></joint>'
        for name, command in commands.items()
    )
    return f'<ros2_control name="r" type="system">{"".join(joints)}</ros2_control>'


def tricycle() -> Description:
    """Its front wheel is steered and driven."""
    rear = [wheel(f"rear_{y}", "base", f"0 {y} {RADIUS}") for y in (-0.5, 0.5)]
    hinge = link("hinge_link", 0.005, moment=0.1)
    hinge += mounted("hinge", "base", f"{BASE} 0 {RADIUS}", "0 0 0", "0 0 1")
    driven = wheel("driven", "hinge_link", "0 0 0", f"{-math.pi / 2.0} 0 0", 15.0)
    return robot(*rear, hinge, driven, control(hinge="position", driven="velocity"))


def error(robot: SimulatedRobot, start: PlanarPose) -> float:
    """Return how far the odometry is off, m; ``start`` is its frame in the world."""
    pose = start.compose(PlanarPose(robot.odometry.x, robot.odometry.y, robot.odometry.yaw))
    return math.hypot(pose.x - robot.pose.x, pose.y - robot.pose.y)


@pytest.mark.parametrize(("kind", "turn"), [("continuous", 0.5), ("revolute", 0.25)])
def test_a_light_car_drives_a_figure_of_eight(kind: str, turn: float) -> None:
    """Its wheels weigh more than its body, and their axles are off by what 1.57 is rounded."""
    with Simulation(car(kind=kind)) as simulation:
        robot, circle = simulation.robot, math.tau / turn
        for angular in (turn, -turn):
            robot.drive(1.0, angular)
            simulation.run(circle)
            assert abs(robot.twist.angular - angular) < 1e-3
        assert error(robot, PlanarPose()) < 5e-4 * 2.0 * circle
        assert max(abs(robot.pose.roll), abs(robot.pose.pitch)) < 1e-4
        assert abs(robot.pose.z) < 1e-3


def test_steering_that_swings_round_throws_no_car_over() -> None:
    """In reverse, the angle swings from one limit to the other while the speed passes zero."""
    with Simulation(car()) as simulation:
        robot, tilts = simulation.robot, []
        simulation.on_step(lambda: tilts.append(max(abs(robot.pose.roll), abs(robot.pose.pitch))))
        for linear in (1.0, -1.0, 1.0):
            robot.drive(linear, 0.3)
            simulation.run(4.5)
        assert max(tilts) < 1e-3
        assert robot.twist.linear == pytest.approx(1.0, abs=1e-3)
        assert robot.twist.angular == pytest.approx(0.3, abs=1e-3)


def test_steered_wheels_fit_each_other_while_they_move() -> None:
    """No joint turns faster than its limit, and the driven wheels drive as the steering stands."""
    geometry = SteeredGeometry(BASE, RADIUS, TRACK, TRACK, 1.0, speed=2.0)
    kinematics, dt, steering = SteeredKinematics(geometry), 0.01, (0.0, 0.0)
    angles = []
    for _ in range(200):
        _, _, turn, (right, left), reached = kinematics.command((1.0, 0.0, 9.0), steering, dt)
        most = max(abs(b - a) for a, b in zip(steering, reached, strict=True))
        assert most < 1.05 * 2.0 * dt
        middle = kinematics.middle_angle(reached)
        assert kinematics._steering_positions(middle) == pytest.approx(reached)
        assert (right - left) * RADIUS == pytest.approx(turn * TRACK)
        steering = reached
        angles.append(middle)
    assert angles[0] < 0.02
    assert angles[-1] == pytest.approx(1.0)


_CLASSIC = "".join(
    f"<{end}_{side}_joint>{end}_{side}</{end}_{side}_joint>"
    for end in ("front", "rear")
    for side in ("left", "right")
)
_FOUR = "".join(
    f"<{side}_joint>{end}_{side}</{side}_joint>"
    for end in ("front", "rear")
    for side in ("left", "right")
)
_HINGES = "".join(
    f"<{side}_steering_joint>front_{side}_hinge</{side}_steering_joint>"
    for side in ("left", "right")
)


@pytest.mark.parametrize("named", [_CLASSIC, _FOUR])
def test_of_a_plugins_wheels_those_that_are_not_steered_are_driven(named: str) -> None:
    """Classic Gazebo's names the front wheels, too; that of new Gazebo may drive all four."""
    inside = f"{named}{_HINGES}<steering_limit>0.3</steering_limit>"
    plugin = f'<plugin filename="libgazebo_ros_ackermann_drive.so">{inside}</plugin>'
    description = car(f"<gazebo>{plugin}</gazebo>", kind="revolute")
    config = found_drive(description)()
    wheels = config.wheels(description)
    assert wheels.names == REAR
    assert config.geometry(wheels).limit == 0.3
    assert {*wheels.free} == {*FRONT}


def test_a_tricycle_whose_steered_wheel_is_driven() -> None:
    assert found_drive(car()) is DRIVES[CAR]
    assert found_drive(tricycle()) is DRIVES[TRICYCLE]
    with Simulation(tricycle()) as simulation:
        robot = simulation.robot
        robot.drive(0.5, 0.3)
        simulation.run(4.0)
        assert robot.twist.linear == pytest.approx(0.5, abs=1e-3)
        assert robot.twist.angular == pytest.approx(0.3, abs=1e-3)
        robot.drive(0.0, 0.5)
        simulation.run(4.0)
        assert robot.twist.linear == pytest.approx(0.0, abs=5e-3)
        assert robot.twist.angular == pytest.approx(0.5, abs=5e-3)


@pytest.mark.parametrize(("count", "first"), [(3, -90), (3, 0), (4, 0), (4, 45)])
def test_an_omni_drive_may_have_lateral_wheels(count: int, first: int) -> None:
    description = omni(count, math.radians(first))
    assert found_drive(description) is DRIVES[OMNI]
    with Simulation(description) as simulation:
        robot = simulation.robot
        for linear, lateral, angular in ((0.3, 0.0, 0.0), (0.0, 0.3, 0.0), (0.2, -0.1, 0.4)):
            robot.drive(linear, angular, lateral=lateral)
            simulation.run(1.5)
            twist = robot.twist
            assert (twist.linear, twist.lateral, twist.angular) == pytest.approx(
                (linear, lateral, angular), abs=2e-3
            )
        assert error(robot, PlanarPose()) < 2e-3


def test_a_ball_that_rolls_sideways_makes_no_omni_drive() -> None:
    """Nor do wheels of another radius."""
    ball = link("ball_link", 0.1, moment=1e-4, shape=solid('<sphere radius="0.05"/>'))
    ball += mounted("ball", "base", "0.5 0 0.05", "0 0 0", "1 0 0")
    sides = [wheel(f"side_{y}", "base", f"0 {y} {RADIUS}") for y in (-0.5, 0.5)]
    description = robot(*sides, ball, ball.replace("ball", "bowl").replace('"0.5 0', '"0.6 0'))
    assert found_drive(description) is ControlConfig


def test_parameters_of_husarions_mecanum_drive(tmp_path: Path) -> None:
    """The names of its wheels, and their distances with multipliers."""
    names = {corner: corner[0] + corner.partition("_")[2][0] for corner in CORNERS}
    lines = [f"    {corner}_wheel_name: {name}_joint" for corner, name in names.items()]
    file = tmp_path / "control.yaml"
    file.write_text(
        "controller_manager:\n  ros__parameters:\n    drive_controller:\n"
        "      type: husarion_mecanum_drive_controller/MecanumDriveController\n"
        "drive_controller:\n  ros__parameters:\n" + "\n".join(lines) + "\n"
        "    wheel_separation_x: 0.4\n    wheel_separation_y: 0.6\n    wheel_radius: 0.1\n"
        "    wheel_separation_y_multiplier: 1.5\n    wheel_radius_multiplier: 2.0\n"
    )
    values = ControlFiles([file], "/", "drive_controller").parameters()
    assert not values.warnings
    kind = DRIVES["husarion_mecanum_drive_controller/MecanumDriveController"]
    config = read(kind, values.values)
    wheels = config.wheels(mecanum(names))
    assert wheels.names == ("fl_joint", "fr_joint", "rr_joint", "rl_joint")
    (right, *_) = config.geometry(wheels).command((0.0, 0.0, 1.0)).wheels
    assert right == pytest.approx(-(0.4 + 0.6 * 1.5) / 2.0 / 0.2)


@pytest.mark.parametrize(
    ("steering", "limit", "speed"),
    [
        ("max_position: 1.57, min_position: -1.57, max_velocity: 1.0", math.pi / 2.0, 1.0),
        ("max_position: 1.2, min_position: -0.7, min_velocity: 0.0", 0.7, 3.0),
    ],
)
def test_steering_limits_of_tricycle_controller(
    tmp_path: Path, steering: str, limit: float, speed: float
) -> None:
    """A limit of 1.57 rad is a quarter turn."""
    file = tmp_path / "control.yaml"
    file.write_text(
        f"tricycle_controller:\n  ros__parameters:\n    type: {TRICYCLE}\n"
        f"    steering: {{{steering}, min_acceleration: 0.0, max_acceleration: 1000.0}}\n"
        "    traction: {min_velocity: 0.0, min_acceleration: 0.0, max_acceleration: 5.0,\n"
        "      min_deceleration: 0.0, min_jerk: 0.0, max_jerk: 1000.0}\n"
    )
    values = ControlFiles([file], "/", "tricycle_controller").parameters()
    assert not values.warnings
    config = read(DRIVES[TRICYCLE], values.values)
    geometry = config.geometry(config.wheels(tricycle()))
    assert (geometry.limit, geometry.speed) == (limit, speed)


def test_traction_limits_of_tricycle_controller_keep_its_wheels_on_the_ground() -> None:
    """A heavy front wheel whose speed jumps as the robot reverses in a turn lifts those behind."""
    limits = {"max_velocity": 1.9, "max_acceleration": 5.0, "max_deceleration": 8.0}
    parameters = {
        "type": TRICYCLE,
        "linear.x.max_acceleration": math.nan,
        **{f"traction.{name}": limit for name, limit in limits.items()},
    }
    with Simulation(tricycle(), parameters=parameters) as simulation:
        robot, tilts, speeds = simulation.robot, list[float](), list[float]()

        def watch() -> None:
            tilts.append(max(abs(robot.pose.roll), abs(robot.pose.pitch)))
            speeds.extend(robot._controlled.drive.command.wheels)
            turned = math.hypot(robot.command.linear, robot.command.angular * BASE)
            assert turned == pytest.approx(abs(speeds[-1]) * RADIUS)

        simulation.on_step(watch)
        for linear in (0.5, -0.5, 0.5):
            robot.drive(linear, 0.2)
            simulation.run(4.0)
        changes = [abs(after) - abs(before) for before, after in pairwise(speeds)]
        assert max(tilts) < 2e-3
        assert max(map(abs, speeds)) == pytest.approx(1.9)
        assert max(changes) == pytest.approx(5.0 * simulation.period)
        assert min(changes) == pytest.approx(-8.0 * simulation.period)
