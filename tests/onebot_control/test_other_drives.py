"""Mecanum and omni drives, cars and tricycles: found in the URDF or named, driven and measured."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry

from onebot_control import RobotSetup, Simulation
from onebot_control.control_files import ControlFiles, default_control_file, drive_node
from onebot_control.drive.wheels.finding import RunningGear
from onebot_control.drive_kinds import (
    ControlConfig,
    found_drive,
)
from onebot_description.description import Description, load_description, parse_description
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import ConfigError, read
from onebot_description.ros.wire.interfaces import load_interface
from tests.onebot_control.drive_models import (
    BASE,
    CIRCLE,
    CORNERS,
    LENGTH,
    MECANUM,
    OMNI,
    RADIUS,
    STEERING,
    STEERS,
    TRACK,
    WIDTH,
    car,
    mecanum,
    omni,
    robot,
    steered,
    tricycle,
    wheel,
)
from tests.onebot_control.node_support import RosSimulation, Stepped
from tests.ros_support import NodeProcess, Peer
from tests.support import wait_for

ONEBOT = load_description("package://onebot_description/urdf/onebot.urdf.xacro")
FRONT = "tricycle_controller/TricycleController"
HOLONOMIC = [
    ((0.5, 0.0, 0.0), 4.0),
    ((0.0, 0.5, 0.0), 4.0),
    ((0.4, -0.3, 0.0), 4.0),
    ((0.0, 0.0, 1.0), 6.3),
    ((0.2, 0.1, 0.4), 15.7),
    ((0.2, -0.1, -0.4), 15.7),
]
CURVES = [
    ((0.5, 0.0, 0.0), 4.0),
    ((0.4, 0.0, 0.4), 15.7),
    ((0.4, 0.0, -0.4), 15.7),
    ((-0.3, 0.0, 0.2), 5.0),
]


def follow(simulation: Simulation, path: list[Any]) -> tuple[float, float]:
    """Drive along a path; return how far odometry and truth are apart, as shares of the way."""
    robot, way, turned = simulation.robot, 0.0, 0.0
    for (x, y, turn), seconds in [*path, ((0.0, 0.0, 0.0), 2.0)]:
        robot.drive(x, turn, **({"lateral": y} if y else {}))
        simulation.run(seconds)
        way, turned = way + math.hypot(x, y) * seconds, turned + abs(turn) * seconds
    pose, odometry = robot.pose, robot.odometry
    off = math.hypot(odometry.x - pose.x, odometry.y - pose.y)
    return off / way, abs(math.remainder(odometry.yaw - pose.yaw, math.tau)) / max(turned, 1.0)


@pytest.mark.parametrize(
    ("description", "parameters", "path"),
    [
        (mecanum(), {}, HOLONOMIC),
        (mecanum({}, 0.07), {}, HOLONOMIC),  # the base's frame is not in the middle
        (omni(), {}, HOLONOMIC),
        (car(), {}, CURVES),
        (car(axis="0 0 -1"), {}, CURVES),
        (tricycle(), {}, CURVES),
        (tricycle(), {"type": FRONT}, CURVES),
    ],
    ids=["mecanum", "moved", "omni", "car", "mirrored", "tricycle", "front"],
)
def test_odometry_is_the_truth(
    description: Description, parameters: dict[str, Any], path: list[Any]
) -> None:
    """Straight, sideways, diagonal, on the spot, and a figure of eight, without a parameter."""
    with Simulation(description, parameters=parameters) as simulation:
        off, turned = follow(simulation, path)
        assert off <= 5e-4 and turned <= 5e-4
        assert not simulation.robot.collided


@pytest.mark.slow
@pytest.mark.parametrize(("description", "aside"), [(mecanum(), 0.5), (car(), 0.0)])
def test_odometry_is_the_truth_after_100_meters(description: Description, aside: float) -> None:
    with Simulation(description) as simulation:
        path = [((0.65, aside, 0.2), 63.0), ((0.65, -aside, -0.2), 63.0)]
        off, _ = follow(simulation, path if aside else [*path, ((0.65, 0.0, 0.0), 30.0)])
        assert off <= 5e-4


# Which drive it is ------------------------------------------------------------------------------


def _plugin(name: str) -> str:
    return f'<gazebo><plugin filename="{name}" name="drive"/></gazebo>'


def _plain(*parts: str) -> Description:
    return mecanum({corner: corner for corner in CORNERS}, 0.0, *parts)


_FDIR = "".join(
    f'<gazebo reference="{corner}"><mu1>1</mu1><mu2>0</mu2><fdir1>1 {-x * y} 0</fdir1></gazebo>'
    for corner, (x, y) in CORNERS.items()
)


@pytest.mark.parametrize(
    ("description", "kind"),
    [
        (ONEBOT, ControlConfig),
        (_plain(), ControlConfig),
        (_plain(_FDIR), MECANUM),
        (_plain(_plugin("gz-sim-mecanum-drive-system")), MECANUM),
        (_plain(_plugin("libgazebo_ros_planar_move.so")), MECANUM),
        (mecanum(), MECANUM),
        (omni(3), OMNI),
        (omni(4, math.pi / 4.0), OMNI),
        (car(), STEERING),
        (tricycle(), STEERING),
    ],
)
def test_the_description_says_which_drive_it_is(description: Description, kind: type) -> None:
    assert found_drive(description) is kind


def test_named_joints_say_which_drive_it_is() -> None:
    """By the parameters of that drive, whatever the description shows; test_control_files.py."""
    named = {f"{corner}_wheel_command_joint_name": f"{corner}_joint" for corner in CORNERS}
    with Simulation(_plain(), parameters=named) as simulation:
        assert type(drive_of(simulation).config) is MECANUM


def test_the_wheels_are_looked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    read, places = list[str](), RunningGear.__init__

    def reads(gear: RunningGear, description: Description) -> None:
        read.append(description.robot_name)
        places(gear, description)

    monkeypatch.setattr(RunningGear, "__init__", reads)
    descriptions = {made.robot_name: made for made in (mecanum(), omni(), car(), tricycle())}
    robots = {
        name: RobotSetup(y=2.0 * row, model=description)
        for row, (name, description) in enumerate(descriptions.items())
    }
    with Simulation(robots=robots):
        assert read == [*descriptions]


def test_lengths_are_those_of_the_description() -> None:
    """The kinematics are the standard controllers', whose lengths need not be given."""
    given = {
        "type": "mecanum_drive_controller/MecanumDriveController",
        "kinematics.wheels_radius": RADIUS,
        "kinematics.sum_of_robot_center_projection_on_X_Y_axis": LENGTH + WIDTH,
        "kinematics.base_frame_offset.x": -0.07,
    }
    for description, parameters in (
        (mecanum({}, 0.07), given),
        (omni(), {"robot_radius": CIRCLE, "wheel_radius": RADIUS, "wheel_offset": 0.3}),
    ):
        found, named = (_kinematics(description, values) for values in ({}, parameters))
        for twist in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
            expected = named.command(twist).wheels
            assert found.command(twist).wheels == pytest.approx(expected, abs=1e-6)
    with Simulation(car()) as simulation:
        geometry = drive_of(simulation).geometry
        assert geometry[:4] == pytest.approx((BASE, RADIUS, TRACK, TRACK))
        inner = BASE / math.tan(STEERS) + TRACK / 2.0
        assert geometry.minimum_radius == pytest.approx(inner)
        with pytest.raises(OneBotError, match="no differential drive, but wheelbase 0.32 m"):
            _ = simulation.robot.wheel_separation


def drive_of(simulation: Simulation) -> Any:
    return simulation.robot._controlled.drive


def _kinematics(description: Description, parameters: dict[str, Any]) -> Any:
    with Simulation(description, parameters=parameters) as simulation:
        return drive_of(simulation).odometry.kinematics


@pytest.mark.parametrize(
    ("make", "parameters", "fault"),
    [
        (mecanum, {"type": "mecanum_drive"}, 'no drive has the type "mecanum_drive" .known: ack'),
        (mecanum, {"front_left_wheel_command_joint_name": "x"}, "front_right.*: is missing"),
        (
            mecanum,
            {f"{c}_wheel_command_joint_name": "wheel_joint" for c in CORNERS},
            'no rotating joint "wheel_joint"',
        ),
        (lambda: robot(steered("rear", -0.2, 0.0), *_front(), name="t"), {}, "not in front of"),
        (car, {"front_steering": False}, "front_steering: vehicles that steer their rear"),
        (
            car,
            {"type": "diff_drive_controller/DiffDriveController"},
            "steers the wheel of .*ackermann_steering_controller/AckermannSteeringController",
        ),
        (
            mecanum,
            {"type": "diff_drive_controller/DiffDriveController"},
            "its wheels are omnidirectional, with rollers around them; let the control file",
        ),
        (omni, {"wheel_names": ["w0_joint", "w1_joint"]}, "it needs three wheels or more, not 2"),
        (
            car,
            {"type": "omni_wheel_drive_controller/OmniWheelDriveController"},
            "it has no three omni wheels on the ground; name its wheels",
        ),
    ],
)
def test_what_cannot_be_driven_is_refused(
    make: Callable[[], Description], parameters: dict[str, Any], fault: str
) -> None:
    with pytest.raises(OneBotError, match=fault):
        Simulation(make(), parameters=parameters).close()


def _front() -> list[str]:
    return [wheel(name, (0.15, y, RADIUS)) for name, y in (("fl", 0.14), ("fr", -0.14))]


# What a drive cannot do ---------------------------------------------------------------------------


def test_a_drive_without_the_axis_does_not_move_sideways() -> None:
    for description in (ONEBOT, car()):
        with Simulation(description) as simulation:
            with pytest.raises(OneBotError, match="does not move sideways"):
                simulation.robot.drive(0.1, lateral=0.1)


def test_a_car_turns_as_far_as_it_can(caplog: pytest.LogCaptureFixture) -> None:
    """On the spot not at all, which is logged once."""
    with Simulation(car()) as simulation:
        robot = simulation.robot
        robot.drive(0.0, 1.0)
        simulation.run(2.0)
        assert robot.pose.yaw == pytest.approx(0.0, abs=1e-3)
        assert robot.joints["front_left_steering"].position == pytest.approx(STEERS, abs=1e-3)
        assert "no turn on the spot" in drive_of(simulation).notice
        robot.drive(0.3, 1.0)
        simulation.run(5.0)
        least = BASE / math.tan(STEERS) + TRACK / 2.0
        assert robot.command.angular == pytest.approx(0.3 / least)
        assert robot.twist.angular == pytest.approx(0.3 / least, rel=0.01)
        assert caplog.text.count("no turn on the spot") == 1


@pytest.mark.parametrize("limit", [0.4, 1.2, 1.6])
def test_no_wheel_is_steered_beyond_its_limit(limit: float) -> None:
    """In the sharpest curve, the inner wheel is at its limit, also beyond a quarter turn."""
    hinges = car().urdf.replace(f'lower="-{STEERS}"', f'lower="-{limit}"')
    description = parse_description(hinges.replace(f'upper="{STEERS}"', f'upper="{limit}"'))
    kinematics = _kinematics(description, {})
    assert max(kinematics.command((0.1, 0.0, 10.0)).steering) == pytest.approx(limit)


# In a fleet, and on topics ------------------------------------------------------------------------


def test_a_fleet_mixes_drives() -> None:
    setups = {
        "a": RobotSetup(),
        "b": RobotSetup(y=2.0, model=mecanum()),
        "c": RobotSetup(y=4.0, model=car()),
        "d": RobotSetup(y=6.0, model=omni()),
    }
    with Simulation(ONEBOT, robots=setups) as simulation:
        for name, each in simulation.robots.items():
            each.drive(0.3, lateral=0.2 if name in "bd" else 0.0)
        simulation.run(4.0)
        moved = {name: each.pose.y - setups[name].y for name, each in simulation.robots.items()}
        assert all(each.pose.x > 1.0 for each in simulation.robots.values())
        expected = {"a": 0.0, "b": moved["d"], "c": 0.0, "d": moved["b"]}
        assert moved == pytest.approx(expected, abs=0.01)
        assert moved["b"] > 0.6


def test_a_twist_drives_sideways(ros_simulation: RosSimulation) -> None:
    stepped = Stepped(ros_simulation(mecanum()))
    heard, message = stepped.hear(Odometry, "/velocity_controller/odom"), Twist()
    message.linear.y = 0.2
    stepped.drive(message, 2.0)
    assert heard[-1].twist.twist.linear.y == pytest.approx(0.2, abs=1e-6)
    assert heard[-1].pose.pose.position.y == pytest.approx(
        stepped.simulation.robot.odometry.y, abs=0.01
    )


def test_ackermann_commands_drive_a_car(
    ros_simulation: RosSimulation, capfd: pytest.CaptureFixture[str]
) -> None:
    """As in F1TENTH's bags, on the topic drive; they are as good as a Twist."""
    stepped = Stepped(ros_simulation(car()))
    message = load_interface("ackermann_msgs/msg/AckermannDriveStamped")()
    message.header.stamp.sec, message.drive.speed = 1, 0.5
    message.drive.steering_angle = 0.2
    stepped.publish("/drive", *[message] * 100, apart=0.02)
    command = stepped.simulation.robot.command
    assert command.linear == pytest.approx(0.5)
    assert command.angular == pytest.approx(0.5 * math.tan(0.2) / BASE, rel=1e-6)
    for speed, angle in ((0.5, 45.0), (0.5, math.nan), (math.nan, 0.2)):
        message.drive.speed, message.drive.steering_angle = speed, angle
        stepped.publish("/drive", *[message] * 5, apart=0.02)
        assert stepped.simulation.robot.command == pytest.approx(command, rel=1e-6)
    assert math.isfinite(stepped.simulation.robot.pose.x)
    assert "ignored: steering_angle 45 rad is not within a quarter turn" in capfd.readouterr().err


CONTROL = """\
controller_manager:
  ros__parameters:
    joint_state_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}
    base: {type: TYPE}
base:
  ros__parameters:
    reference_timeout: 1.0
    PARAMETERS
"""
_MECANUM = "\n    ".join(
    f"{corner}_wheel_command_joint_name: mecanum_{corner}_joint" for corner in CORNERS
)


@pytest.mark.parametrize(
    ("description", "kind", "parameters", "state"),
    [
        (
            mecanum(),
            "mecanum_drive_controller/MecanumDriveController",
            _MECANUM,
            "MecanumDriveControllerState",
        ),
        (
            car(),
            "ackermann_steering_controller/AckermannSteeringController",
            "rear_wheels_names: [rear_left_joint, rear_right_joint]\n"
            "    front_wheels_names: [front_left_steering, front_right_steering]",
            "SteeringControllerStatus",
        ),
    ],
    ids=["mecanum", "car"],
)
def test_standard_topics(
    tmp_path: Path,
    ros_domain: int,
    description: Description,
    kind: str,
    parameters: str,
    state: str,
) -> None:
    """A control file that names the controller gets the controller's own topics and types."""
    file, control = tmp_path / "robot.urdf", tmp_path / "control.yaml"
    file.write_text(description.urdf)
    control.write_text(CONTROL.replace("TYPE", kind).replace("PARAMETERS", parameters))
    assert drive_node([control]) == ("base", "reference", "odometry")
    arguments = ("--ros-args", "--params-file", str(control))
    with (
        Peer(ros_domain) as peer,
        NodeProcess("onebot_control.velocity_controller", str(file), *arguments),
    ):
        states = peer.hear(load_interface(f"control_msgs/msg/{state}"), "/base/controller_state")
        odometry = peer.hear(Odometry, "/base/odometry")
        command = TwistStamped()
        command.twist.linear.x, command.twist.angular.z = 0.3, 0.2
        publisher = peer.node.create_publisher(TwistStamped, "/base/reference", 10)

        def drives() -> bool:
            command.header.stamp = peer.node.get_clock().now().to_msg()
            publisher.publish(command)
            return bool(odometry and odometry[-1].pose.pose.position.x > 0.2 and states)

        wait_for(drives, "the robot to drive")
        if state == "MecanumDriveControllerState":
            assert states[-1].reference_velocity.linear.x == pytest.approx(0.3, abs=0.3)
            assert states[-1].front_right_wheel_velocity > states[-1].front_left_wheel_velocity
        else:
            assert len(states[-1].traction_wheels_velocity) == 2
            assert states[-1].steer_positions[0] > 0.0
        answer = peer.call(
            load_interface("control_msgs/srv/SetOdometry"), "/base/set_odometry", x=7.0, yaw=0.5
        )
        assert answer.success
        wait_for(lambda: odometry[-1].pose.pose.position.x > 6.0, "the set pose")


def test_onebots_file_suits_all_drives() -> None:
    """What it has for any drive counts; limits of driving forward are those of driving sideways."""
    values = ControlFiles(
        [default_control_file()], "/", "velocity_controller", MECANUM
    ).parameters()
    assert values.warnings == []
    config = read(MECANUM, values.values)
    assert config.lateral == config.linear and config.lateral.max_acceleration == 0.5
    assert "left_wheel_noise" not in values.values


def test_wrong_values_are_named() -> None:
    with pytest.raises(ConfigError, match="wheelbase: -1 is below 0"):
        Simulation(car(), parameters={"wheelbase": -1.0})
    with pytest.raises(OneBotError, match="cannot move the robot forward, sideways and around"):
        urdf = _plain(_FDIR).urdf.replace("1 -1 0", "1 1 0")
        Simulation(parse_description(urdf, "same.urdf"))
