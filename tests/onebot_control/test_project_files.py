"""Control files as projects have them: each starts, follows 1 rad, and says what it skips.

They have the structure of those of makers, for a small robot.
"""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pytest

from onebot_control.control_files import (
    ControlFiles,
    drive_node,
)
from onebot_control.conventions import MANAGER
from onebot_control.drive_kinds import ControlConfig
from onebot_control.fleet import Fleet
from onebot_control.prepared_robot import Member
from onebot_control.simulation_parameters import SimulationConfig
from onebot_control.trajectories.following import TrajectoryFollower
from onebot_control.trajectories.goal import TrajectoryGoal
from onebot_control.trajectories.gripping import GripperFollower, GripperGoal
from onebot_control.trajectories.trajectory import Waypoint
from onebot_description.description import Description, parse_description
from onebot_description.parameters.reader import read
from tests.onebot_control import control_support
from tests.onebot_control.arm_models import arm, joint, link, mimic

TRAJECTORY = "{type: joint_trajectory_controller/JointTrajectoryController}"
POSITIONS = "{type: position_controllers/JointGroupPositionController}"
FORWARD = "{type: forward_command_controller/ForwardCommandController}"
GRIPPER = "{type: position_controllers/GripperActionController}"
STATES = "{type: joint_state_broadcaster/JointStateBroadcaster}"
FAST = 'effort="50" velocity="2" lower="-2" upper="2"'


def parts(base: str) -> Sequence[str]:
    """Two joints of an arm, a finger that slides by up to 2 m, and one that mimics it."""
    return (
        link("upper", 0.5, "0 0 0.1"),
        joint("yaw", base, "upper", xyz="0 0 0.5", axis="0 0 1", limits=FAST),
        link("lower", 0.3, "0.1 0 0"),
        joint("lift", "upper", "lower", xyz="0 0 0.2", axis="0 1 0", limits=FAST),
        link("tip", 0.1),
        joint("finger", "lower", "tip", "prismatic", axis="1 0 0", limits=FAST),
        link("other_tip", 0.1),
        joint(
            "thumb", "lower", "other_tip", "prismatic", "-1 0 0", limits=FAST, more=mimic("finger")
        ),
    )


ARM = arm(*parts("world"))
WHEELS = [control_support.wheel(side, y) for side, y in (("left", 0.15), ("right", -0.15))]
CARRIER = parse_description(
    control_support.urdf(*WHEELS, control_support.CASTER, *parts("base_link"))
)


class Project(NamedTuple):
    """A control file, and what is right."""

    text: str
    active: str  # the controllers
    said: Sequence[str]  # the beginnings of the warnings, each after its place
    namespace: str = "/"


VENDOR = Project(
    f"""\
controller_manager:
  ros__parameters:
    update_rate: 500  # Hz
    joint_state_broadcaster: {STATES}
    io_controller: {{type: vendor_controllers/GPIOController}}
    arm: {TRAJECTORY}
    arm_scaled: {{type: vendor_controllers/ScaledJointTrajectoryController}}
    arm_velocities: {{type: velocity_controllers/JointGroupVelocityController}}
    arm_positions: {POSITIONS}
io_controller:
  ros__parameters: {{command_interfaces: {{flange: [{{interfaces: [output1, output2]}}]}}}}
arm:
  ros__parameters:
    joints: &joints [$(var prefix)yaw, "$(var prefix)lift"]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
    state_publish_rate: 100.0
    constraints: {{stopped_velocity_tolerance: 0.2, yaw: {{trajectory: 0.2, goal: 0.1}}}}
arm_scaled:
  ros__parameters: {{joints: *joints, speed_scaling_interface_name: speed/factor}}
arm_velocities:
  ros__parameters: {{joints: *joints, interface_name: velocity}}
arm_positions:
  ros__parameters: {{joints: *joints}}
some_driver:
  ros__parameters: {{rate: 3}}
""",
    "arm",
    (
        "14: only ros2 launch can replace $(var prefix); it is left out",
        "5: io_controller: vendor_controllers/GPIOController does not run here, so it is skipped",
        "7: arm_scaled: vendor_controllers/ScaledJointTrajectoryController does not run",
        "8: arm_velocities: velocity_controllers/JointGroupVelocityController does not run",
        '26: section "/some_driver" matches no node, so it is skipped',
        "9: arm_positions: is inactive: arm comes first, and moves lift, yaw",
    ),
)

MOVEIT = Project(
    f"""\
controller_manager:
  ros__parameters:
    arm_controller: {TRAJECTORY}
    hand_controller: {GRIPPER}
    twist_controller: {{type: vendor_twist/TwistController}}
    second_hand: {{type: parallel_gripper_action_controller/GripperActionController}}
    thumb_controller: {{type: parallel_gripper_action_controller/GripperActionController}}
    joint_state_broadcaster: {STATES}
arm_controller:
  ros__parameters:
    command_interfaces: [position, velocity]
    state_interfaces: [position, velocity]
    joints: [yaw, lift]
    interface_name: position
    allow_nonzero_velocity_at_trajectory_end: true
hand_controller:
  ros__parameters: {{joint: finger, update_rate: 100, is_async: false}}
second_hand:
  ros__parameters: {{joint: knuckle, allow_stalling: true, default: true}}
thumb_controller:
  ros__parameters: {{joint: thumb}}
""",
    "arm_controller hand_controller",
    (
        "5: twist_controller: vendor_twist/TwistController does not run here",
        '14: interface_name: no such parameter (did you mean "state_interfaces"? known: ',
        "19: default: no such parameter (known: ",
        "6: second_hand: is inactive: the robot has no joint knuckle",
        "7: thumb_controller: is inactive: <mimic> moves thumb",
    ),
)

NAMESPACED = Project(
    f"""\
/**:
  ros__parameters:
    update_rate: 100
    arm: {TRAJECTORY}
    arm_forward: {FORWARD}
    hand: {FORWARD}
/**/arm:
  ros__parameters:
    joints: [yaw, lift]
    command_interfaces: [position]
    constraints: {{goal_time: 0.6, yaw: {{trajectory: 0.1, goal: 0.1}}}}
/**/arm_forward:
  ros__parameters: {{joints: [yaw, lift], interface_name: position, is_async: false}}
/**:
  hand:
    ros__parameters: {{joints: [finger], interface_name: position, command_interfaces: [position]}}
/other/arm:
  ros__parameters: {{joints: [shoulder]}}
""",
    "arm hand",
    (
        "16: command_interfaces: no such parameter",
        '18: section "/other/arm" matches no node, so it is skipped (did you mean ',
        "5: arm_forward: is inactive: arm comes first, and moves lift, yaw",
    ),
    "/robot1",
)

EFFORTS = Project(
    f"""\
controller_manager:
  ros__parameters:
    update_rate: 200
    arm: {TRAJECTORY}
    hand: {POSITIONS}
    arm_effort: {TRAJECTORY}
    hand_effort: {POSITIONS}
    effort: {{type: effort_controllers/JointGroupEffortController}}
arm:
  ros__parameters:
    joints: [yaw, lift]
    command_interfaces: [position, velocity]
    start_position_control: false
    constraints: {{other_controller: {{joint1: {{trajectory: 0.05, goal: 0.03}}}}}}
hand:
  ros__parameters: {{joints: [finger], command_interfaces: [position, velocity]}}
arm_effort:
  ros__parameters:
    joints: [yaw, lift]
    command_interfaces: [effort]
    gains: {{yaw: {{p: 75.0, i: 0.0, d: 1.0}}, lift: {{p: 75.0, i_clamp: 1.0, u_clamp_max: .inf}}}}
hand_effort:
  ros__parameters: {{joints: [finger], gains: {{finger: {{p: 75.0}}}}}}
effort:
  ros__parameters: {{joints: [yaw, lift, finger]}}
rest_broadcaster:
  ros__parameters: {{type: joint_state_broadcaster/JointStateBroadcaster, joints: [yaw]}}
""",
    "arm hand",
    (
        "8: effort: effort_controllers/JointGroupEffortController does not run here",
        "13: start_position_control: no such parameter",
        "16: command_interfaces: no such parameter",
        "6: arm_effort: commands effort, which is not simulated yet, so it is skipped",
        "23: gains.finger.p: no such parameter",
        "7: hand_effort: is inactive: hand comes first, and moves finger",
        "14: arm.constraints.other_controller.joint1: not a joint of the controller",
    ),
)

MANAGERS = Project(
    """\
controller_manager:
  ros__parameters:
    hardware_components_initial_state: {inactive: [System], unconfigured: [Other]}
    enforce_command_limits: true
    handle_exceptions: false
    defaults: {switch_controller: {strictness: strict}}
    overruns: {manage: true, print_warnings: false}
    diagnostics: {threshold: {controllers: {periodicity: {mean_error: {warn: 3.0}}}}}
    joint_state_broadcaster: {params_file: ""}
    arm: {type: joint_trajectory_controller/JointTrajectoryController, fallback_controllers: [x]}
arm:
  ros__parameters:
    joints: [yaw, lift]
    positions_upsampling: {enable: false}
    gains: {yaw: {p: 100.0, i_clamp: 1.0, angle_wraparound: true}, boom: {p: 1.0}}
    update_rate: 100
    is_async: false
joint_state_broadcaster:
  ros__parameters:
    use_local_topics: false
    use_urdf_to_filter: true
    publish_dynamic_joint_states: false
    map_interface_to_joint_state: {position: position, velocity: velocity, effort: effort}
    update_rate: 50
    is_async: false
""",
    "arm",
    ("15: arm.gains.boom: not a joint of the controller (known: lift, yaw); it is ignored",),
)

PROJECTS = {
    name.lower(): value for name, value in [*globals().items()] if isinstance(value, Project)
}


def fleet_of(file: Path, robot: Description, namespace: str, name: str) -> tuple[Fleet, list[str]]:
    """The robot with its controllers, and what is said of the file but of inactive ones."""
    config = ControlFiles([file], namespace, name).parameters()
    controllers = ControlFiles([file], namespace, name).joint_controllers()
    member = Member(
        robot,
        read(SimulationConfig if name == MANAGER else ControlConfig, config.values),
        places=controllers.places,
        controllers=controllers.controllers,
    )
    foreign = ControlFiles([file], namespace, name).foreign_sections().values()
    warnings = dict.fromkeys([*config.warnings, *controllers.warnings, *foreign])
    return Fleet.from_members([member]), [*warnings]


def move(fleet: Fleet) -> None:
    """Every controller of joints moves them by 1 rad or m, which they reach."""
    [robot] = fleet.robots
    for follower in robot.followers.values():
        targets = (1.0,) * len(follower.names)
        if isinstance(follower, TrajectoryFollower):
            points = (Waypoint(2.0, targets, (0.0,) * len(targets)),)
            goal = TrajectoryGoal(follower.names, points)
            assert not follower.problems(goal, 0)
            follower.start(goal, token="mine")
        elif isinstance(follower, GripperFollower):
            follower.start(GripperGoal(targets), token="mine")
        else:
            follower.command(targets)  # type: ignore[attr-defined]
    for _ in range(round(3.0 * fleet.rate)):
        fleet.cycle()
    assert all(outcome.code == 0 for _, outcome in robot.finished)
    positions = dict(zip(robot.body.joints, robot.body.positions, strict=True))
    for follower in robot.followers.values():
        assert [positions[name] for name in follower.names] == pytest.approx(
            [1.0] * len(follower.names), abs=1e-3
        )


@pytest.mark.parametrize("project", PROJECTS.values(), ids=PROJECTS)
def test_it_starts_follows_and_says_what_it_skips(
    project: Project, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "control.yaml"
    file.write_text(project.text)
    with caplog.at_level(logging.WARNING):
        fleet, warnings = fleet_of(file, ARM, project.namespace, MANAGER)
    warnings += [record.getMessage() for record in caplog.records]
    of_file = [text.removeprefix(f"{file}:") for text in warnings if text.startswith(str(file))]
    assert len(of_file) == len(project.said), of_file
    for text, said in zip(of_file, project.said, strict=True):
        assert text.startswith(said)
    others = [text for text in warnings if not text.startswith(str(file))]
    held = "<string>: joint finger: held still, because no controller moves it; name it in a"
    assert [text[: len(held)] for text in others] == [held] * ("hand" not in project.active)
    with fleet:
        assert " ".join(fleet.robots[0].followers) == project.active
        move(fleet)


DRIVE = f"""\
/**:
  controller_manager:
    ros__parameters:
      update_rate: 100
      joint_state_broadcaster: {STATES}
      base_controller: {{type: diff_drive_controller/DiffDriveController}}
      arm: {TRAJECTORY}
      wheels: {{type: forward_command_controller/ForwardCommandController}}
  base_controller:
    ros__parameters:
      use_stamped_vel: false
      wheels_per_side: 1
      is_async: false
      preserve_turning_radius: true
      linear.x.has_velocity_limits: true
      linear.x.max_velocity: 0.3
      linear.x.has_jerk_limits: false
      linear.x.max_jerk: 0.0
      linear.x.max_acceleration: 1.0
      linear.x.min_acceleration: -2.0
  arm:
    ros__parameters: {{joints: [yaw, lift]}}
  wheels:
    ros__parameters: {{joints: [left_wheel_joint, right_wheel_joint]}}
"""


def test_a_drive_of_any_name(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """With parameters of older versions; its limits count, and an arm moves beside it."""
    file = tmp_path / "control.yaml"
    file.write_text(DRIVE)
    name = drive_node([file]).name
    assert name == "base_controller"
    fleet, [unknown] = fleet_of(file, CARRIER, "/", name)
    assert unknown.startswith(f"{file}:14: preserve_turning_radius: no such parameter")
    text = "wheels: is inactive: the controller of the wheels comes first, and moves left_wheel"
    assert f"{file}:8: {text}" in caplog.text
    with fleet:
        [robot] = fleet.robots
        linear = []
        robot.accept(0.5, 0.0)
        for command in (0.5,) * 40 + (0.0,) * 20:
            robot.accept(command, 0.0)
            linear.append(fleet.cycle()[0].drive.command.linear)
        assert linear[:2] == pytest.approx([0.01, 0.02]) and max(linear) == 0.3
        assert linear[40:42] == pytest.approx([0.28, 0.26]) and linear[-1] == 0.0
        move(fleet)
