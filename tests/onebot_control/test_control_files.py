"""control.yaml, in ros2_control's form."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_control.control_files import (
    ControlFiles,
    default_control_file,
    drive_node,
    unknown_by_node,
)
from onebot_control.conventions import MANAGER
from onebot_control.drive_kinds import ControlConfig
from onebot_control.nodes.control_parameters import ControlParameters
from onebot_control.trajectories.following import TrajectoryFollower
from onebot_control.trajectories.forwarding import PositionForwarder
from onebot_control.trajectories.gripping import GripperFollower
from onebot_description.errors import OneBotError
from onebot_description.parameters.files import Parameters
from onebot_description.parameters.reader import ConfigError, Problem
from onebot_description.ros.command_line import RosArguments
from tests.onebot_control.drive_models import MECANUM, TRICYCLE
from tests.ros_support import ros_args

GOOD = """\
controller_manager:
  ros__parameters:
    update_rate: 200
    velocity_controller: {type: diff_drive_controller/DiffDriveController}
    joint_state_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}
joint_state_broadcaster:
  ros__parameters:
    joints: [right_wheel_joint, left_wheel_joint]
velocity_controller:
  ros__parameters:
    left_wheel_names: [left_wheel_joint]
    right_wheel_names: [right_wheel_joint]
    wheel_radius: 0.1
    linear:
      x: {max_velocity: 0.7}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "control.yaml"
    path.write_text(GOOD)
    return path


def read(file: Path, namespace: str = "/") -> ControlConfig:
    parameters = ControlFiles([file], namespace, "velocity_controller").parameters()
    return ControlConfig.from_parameters(parameters.values)


def complaint(file: Path, old: str, new: str) -> str:
    """What is said of the good file with ``old`` replaced."""
    assert old in GOOD
    file.write_text(GOOD.replace(old, new))
    with pytest.raises(OneBotError) as caught:
        parameters = ControlFiles([file], "/", "velocity_controller").parameters()
        try:
            ControlConfig.from_parameters(parameters.values)
        except OneBotError as error:
            raise error.located(parameters.places) from None  # type: ignore[attr-defined]
    return str(caught.value)


def test_three_sections_make_one_configuration(file: Path) -> None:
    """Rate, joints and the drive come each from the section that ros2_control has them in."""
    config = read(file)
    assert config.update_rate == 200
    assert config.broadcaster.joints == ("right_wheel_joint", "left_wheel_joint")
    assert (config.wheel_radius, config.linear.max_velocity) == (0.1, 0.7)


def test_onebots_own_file_is_right_in_every_namespace() -> None:
    for namespace in ("/", "/robot1"):
        config = read(default_control_file(), namespace)
        assert config.left_wheel_names == ()  # found in the URDF
        assert config.linear.max_acceleration == 0.5
        assert config.angular.max_acceleration == 1.0
        assert config.update_rate == 100
        assert config.wheel_radius == config.wheel_separation == 0.0


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("wheel_radius: 0.1", "wheel_radius: big", ':13: wheel_radius: "big" is a string'),
        (
            "diff_drive_controller/DiffDriveController",
            "swerve_drive_controller/SwerveController",
            ":4: velocity_controller.type: swerve_drive_controller/SwerveController cannot",
        ),
        ("{max_velocity: 0.7}", "{max_velocity: 0.7", ":16: invalid YAML"),
        ("[right_wheel_joint, left_wheel_joint]", "[a, a]", ":8: joint_state_broadcaster.joints: "),
        ("update_rate: 200", "enforce_command_limits: 3", ":3: enforce_command_limits: 3 is a n"),
    ],
)
def test_mistakes_are_named_with_file_and_line(file: Path, old: str, new: str, said: str) -> None:
    text = complaint(file, old, new)
    assert text.startswith(str(file))
    assert said in text


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("wheel_radius: 0.1", "wheel_raduis: 0.1", ":13: wheel_raduis: no such parameter (did you"),
        ("update_rate: 200", "update_rat: 200", ":3: update_rat: no such parameter (did you mean"),
        ("joints: [", "joint: [", ':8: joint: no such parameter (did you mean "joints"?'),
    ],
)
def test_unknown_parameters_are_ignored_with_a_warning(
    file: Path, old: str, new: str, said: str
) -> None:
    assert old in GOOD
    file.write_text(GOOD.replace(old, new))
    read_parameters = ControlFiles([file], "/", "velocity_controller").parameters()
    [warning] = read_parameters.warnings
    assert warning.startswith(f"{file}{said}") and warning.endswith("; it is ignored")
    assert new.partition(":")[0] not in read_parameters.values


def test_what_is_said_to_all_nodes_is_no_mistake(file: Path) -> None:
    """Under /** stands what other nodes understand; what this one knows, counts."""
    shared = "/**:\n  ros__parameters: {use_sim_time: true, frame_prefix: a, wheel_radius: 0.2}\n"
    file.write_text(shared + GOOD.replace("    wheel_radius: 0.1\n", ""))
    assert read(file).wheel_radius == 0.2


def test_later_files_come_first(file: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    other.write_text("velocity_controller: {ros__parameters: {wheel_radius: 0.5}}")
    values = ControlFiles([file, other], "/", "velocity_controller").parameters().values
    assert (values["wheel_radius"], values["update_rate"]) == (0.5, 200)


def test_the_controllers_own_section_comes_first(file: Path) -> None:
    """What it says of the rate and of the broadcaster overrides the sections of those."""
    own = "    update_rate: 50\n    joint_state_broadcaster: {joints: [left_wheel_joint]}\n"
    file.write_text(GOOD + own)
    config = read(file)
    assert config.update_rate == 50
    assert config.broadcaster.joints == ("left_wheel_joint",)


def test_all_of_the_broadcasters_parameters_are_read(file: Path) -> None:
    more = "    interfaces: [effort]\n    extra_joints: [arm]\n    frame_id: odd\n"
    file.write_text(GOOD.replace("velocity_controller:\n", f"{more}velocity_controller:\n"))
    broadcaster = read(file).broadcaster
    assert broadcaster.interfaces == ("effort",)
    assert (broadcaster.extra_joints, broadcaster.frame_id) == (("arm",), "odd")
    places = ControlFiles([file], "/", "velocity_controller").parameters().places
    assert places["joint_state_broadcaster.frame_id"] == f"{file}:11"
    assert places["update_rate"] == f"{file}:3"


def test_the_drive_may_have_another_name(file: Path) -> None:
    """The first one counts; of a robot that stands, none."""
    file.write_text(GOOD.replace("velocity_controller", "base"))
    assert drive_node([file]).name == "base"
    parameters = ControlFiles([file], "/", "base").parameters()
    assert ControlConfig.from_parameters(parameters.values).wheel_radius == 0.1
    assert (
        parameters.warnings == [] == ControlFiles([file], "/", "base").joint_controllers().warnings
    )
    [skipped] = ControlFiles([file], "/", MANAGER).joint_controllers().warnings
    assert skipped.startswith(
        f"{file}:4: base: is a second diff_drive_controller, or the robot has"
    )
    kind = "diff_drive_controller/DiffDriveController"
    file.write_text(f"base: {{ros__parameters: {{type: {kind}, wheel_radius: 1.0}}}}")
    assert drive_node([file]).name == "base"
    assert ControlFiles([file], "/", "base").parameters().values == {"wheel_radius": 1.0}
    assert drive_node([]).name == "velocity_controller"


def _set(**values: Any) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in values.items()]


@contextmanager
def node(*arguments: str) -> Iterator[Node]:
    rclpy.init(args=list(arguments))
    velocity_controller = Node("velocity_controller")
    try:
        yield velocity_controller
    finally:
        velocity_controller.destroy_node()
        rclpy.try_shutdown()


def test_what_can_be_set_while_the_node_runs(ros_domain: int, file: Path) -> None:
    """Checked first, and then in force; the pace and its clock only where time is simulated."""
    with node() as mine:
        parameters = ControlParameters(mine, RosArguments((file,)), ControlConfig)
        assert parameters.config == read(file) and parameters.values["wheel_radius"] == 0.1
        new = _set(wheel_radius=0.2, publish_rate=25, nothing_of_ours=1)
        for simulated in (True, False):
            changed = parameters.changed(new, simulated)
            assert (changed.wheel_radius, changed.publish_rate) == (0.2, 25.0)
        assert parameters.config.wheel_radius == 0.1
        for pace in (1, 1.0):
            assert parameters.changed(_set(real_time_factor=pace), False).real_time_factor == 1.0
        assert parameters.changed(_set(real_time_factor=2.0), True).real_time_factor == 2.0
        for refused, simulated, words in [
            (_set(real_time_factor=2.0), False, "start it with use_sim_time:=true to change"),
            (_set(use_sim_time=True), False, "use_sim_time: is only read when the node starts"),
            (_set(use_sim_time=False), True, "use_sim_time: is only read when the node starts"),
            (_set(wheel_radius=-1.0), True, "wheel_radius: -1 is below 0"),
        ]:
            with pytest.raises(ConfigError, match=words):
                parameters.changed(refused, simulated)
        for simulated in (True, False):
            assert parameters.changed(_set(use_sim_time=simulated), simulated) == parameters.config
        parameters.accept(new)
        assert parameters.config == parameters.changed([], False)
        assert parameters.config.wheel_radius == 0.2 and "nothing_of_ours" not in parameters.values
        problem = Problem("linear.x.max_velocity", "is odd")
        error = ConfigError([problem], parameters.places)
        assert str(error) == f"{file}:15: linear.x.max_velocity: is odd"


def test_the_lines_of_what_the_command_line_overrides_are_not_named(
    ros_domain: int, file: Path
) -> None:
    """A mistake there is none of the file's, whether it is more or less than the file has."""
    with node(*ros_args(wheel_radius=0.3, **{"linear.x.max_velocity": 0.5})) as mine:
        given = (("", "wheel_radius"), ("velocity_controller", "linear.x.max_velocity"))
        parameters = ControlParameters(mine, RosArguments((file,), given), ControlConfig)
        assert (parameters.config.wheel_radius, parameters.config.linear.max_velocity) == (0.3, 0.5)
        names = ("wheel_radius", "linear.x.max_velocity", "update_rate")
        error = ConfigError((Problem(name, "is odd") for name in names), parameters.places)
        assert str(error).splitlines() == [
            "wheel_radius: is odd",
            "linear.x.max_velocity: is odd",
            f"{file}:3: update_rate: is odd",
        ]


def test_unknown_names_on_the_command_line(ros_domain: int, file: Path) -> None:
    """Those meant for this node or for all are refused; those for another one are its own."""
    name = "linear.x.max_velocty"
    with node() as mine:
        for to in ("", "velocity_controller"):
            with pytest.raises(ConfigError, match=f"{name}: no such parameter .did you mean"):
                ControlParameters(mine, RosArguments((file,), ((to, name),)), ControlConfig)
        assert ControlParameters(mine, RosArguments((file,), (("other", name),)), ControlConfig)


# Controllers of joints --------------------------------------------------------------------------

JOINTS = """\
controller_manager:
  ros__parameters:
    arm: {type: joint_trajectory_controller/JointTrajectoryController}
    head: {type: forward_command_controller/ForwardCommandController}
    neck: {type: position_controllers/JointGroupPositionController}
    hand: {type: parallel_gripper_action_controller/GripperActionController}
    joint_state_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}
arm:
  ros__parameters: {joints: [elbow], constraints.elbow.goal: 0.1}
head:
  ros__parameters: {joints: [pan, tilt], interface_name: position}
neck:
  ros__parameters: {joints: [yaw]}
hand:
  ros__parameters:
    joint: finger
    stall_timeout: 0.5
"""


def test_a_file_names_controllers_of_several_kinds(file: Path) -> None:
    file.write_text(JOINTS)
    controllers, places, warnings = ControlFiles([file], "/").joint_controllers()
    assert not warnings
    assert [(each.kind, each.name, each.config.joint_names) for each in controllers] == [
        (TrajectoryFollower, "arm", ("elbow",)),
        (PositionForwarder, "head", ("pan", "tilt")),
        (PositionForwarder, "neck", ("yaw",)),
        (GripperFollower, "hand", ("finger",)),
    ]
    assert controllers[-1].config.stall_timeout == 0.5
    assert places["hand.stall_timeout"] == f"{file}:17"
    assert places["arm.constraints.elbow.goal"] == f"{file}:9"
    # Read for a robot that stands, the manager has them and nothing else.
    assert ControlFiles([file], "/", MANAGER).parameters() == Parameters(
        sections=["/controller_manager", "/arm", "/head", "/neck", "/hand"]
    )


def test_without_a_name_trajectories_are_followed(file: Path) -> None:
    """By the parameters of that node, wherever they are."""
    section = "joint_trajectory_controller: {ros__parameters: {joints: [elbow]}}\n"
    for text, joints in ((GOOD, ()), (GOOD + section, ("elbow",))):
        file.write_text(text)
        [controller], *_ = ControlFiles([file], "/").joint_controllers()
        assert (controller.kind, controller.config.joint_names) == (TrajectoryFollower, joints)
        assert controller.name == "joint_trajectory_controller"


def test_mistakes_of_controllers_of_joints(file: Path) -> None:
    file.write_text(JOINTS.replace("stall_timeout: 0.5", "stall_timeout: -0.5"))
    with pytest.raises(ConfigError, match=f"^{file}:17: hand.stall_timeout: -0.5 is below 0; wri"):
        ControlFiles([file], "/").joint_controllers()


@pytest.mark.parametrize(
    ("old", "new", "left", "said"),
    [
        (
            "    joint: finger\n",
            "",
            "arm head neck",
            "6: hand: has no parameter joint, so it is skipped",
        ),
        (
            "position_controllers/JointGroupPositionController",
            "position_controller/JointGroupPositionController",
            "arm head hand",
            "5: neck: position_controller/JointGroupPositionController does not run here (did you "
            "mean position_controllers/JointGroupPositionController?), so it is skipped",
        ),
    ],
)
def test_what_does_not_run_is_skipped_with_a_warning(
    file: Path, old: str, new: str, left: str, said: str
) -> None:
    assert JOINTS.count(old) == 1
    file.write_text(JOINTS.replace(old, new))
    controllers, _, warnings = ControlFiles([file], "/").joint_controllers()
    assert [controller.name for controller in controllers] == left.split()
    [warning] = warnings
    assert warning.startswith(f"{file}:{said}")


def test_where_nothing_runs_trajectories_are_followed(file: Path) -> None:
    file.write_text(JOINTS.replace("elbow", "a").replace("_controller", "_other"))
    controllers, _, warnings = ControlFiles([file], "/").joint_controllers()
    assert [controller.name for controller in controllers] == ["joint_trajectory_controller"]
    assert len(warnings) == 4


def test_a_type_may_be_in_the_controllers_own_section(file: Path) -> None:
    """In any of the ways that a section names a node; those of other namespaces are not its own."""
    kind = "type: joint_trajectory_controller/JointTrajectoryController, joints: [a]"
    file.write_text(
        "".join(
            f"{section}: {{ros__parameters: {{{kind}}}}}\n"
            for section in ("arm", "/**/boom", "/robot1/crane", "/robot2/other")
        )
    )
    for namespace, names in (("/", "arm boom"), ("/robot1", "boom crane")):
        controllers, _, warnings = ControlFiles([file], namespace).joint_controllers()
        assert " ".join(controller.name for controller in controllers) == names
        assert not warnings
    foreign = ControlFiles([file], "/robot1", MANAGER).foreign_sections()
    assert [section for _, section in foreign] == ["/arm", "/robot2/other"]
    [text, _] = foreign.values()
    assert text.startswith(f'{file}:1: section "/arm" matches no node, so it is skipped (')


def test_a_controller_may_have_a_file_of_its_own(file: Path, tmp_path: Path) -> None:
    other = tmp_path / "arm.yaml"
    other.write_text("arm: {ros__parameters: {joints: [a]}}")
    kind = "type: joint_trajectory_controller/JointTrajectoryController"
    more = "fallback_controllers: [x], node_options_args: [y]"
    manager = f"arm: {{{kind}, params_file: {other}, {more}}}"
    file.write_text(f"controller_manager: {{ros__parameters: {{{manager}, cpu_affinity: 3}}}}")
    [controller], places, warnings = ControlFiles([file], "/").joint_controllers()
    assert (controller.config.joint_names, places, warnings) == (
        ("a",),
        {"arm.joints": f"{other}:1", "arm": f"{file}:1"},
        [],
    )


@pytest.mark.parametrize("enforced", [True, False])
def test_the_managers_limits_are_the_controllers_default(file: Path, enforced: bool) -> None:
    manager = f"  ros__parameters:\n    enforce_command_limits: {str(enforced).lower()}\n"
    file.write_text(JOINTS.replace("  ros__parameters:\n", manager, 1))
    arm = ControlFiles([file], "/").joint_controllers().controllers[0]
    assert arm.config.enforce_command_limits is enforced
    own = JOINTS.replace("joints: [elbow]", "joints: [elbow], enforce_command_limits: true")
    file.write_text(own.replace("  ros__parameters:\n", manager, 1))
    assert (
        ControlFiles([file], "/").joint_controllers().controllers[0].config.enforce_command_limits
    )


def test_joints_that_a_section_without_a_type_names_say_which_drive_it_is(file: Path) -> None:
    """Whatever the description shows; empty names are none."""
    section = "velocity_controller: {ros__parameters: {%s}}"
    for named, kind in (
        ("traction_joint_name: front, wheelbase: 0.5", TRICYCLE),
        ("front_left_wheel_command_joint_name: fl, wheel_separation_x: 0.3", MECANUM),
        ("traction_joint_name: '', wheel_radius: 0.1", ControlConfig),
    ):
        file.write_text(section % named)
        assert ControlFiles([file], "/", "velocity_controller", ControlConfig).declared is kind
        warnings = ControlFiles([file], "/", "velocity_controller").parameters().warnings
        assert bool(warnings) == (kind is ControlConfig)


def test_the_nodes_that_a_file_is_for(file: Path) -> None:
    """Each with the parameters of its kind."""
    file.write_text(JOINTS)
    unknown = unknown_by_node("velocity_controller", [file])
    names = ["constraints.elbow.goal", "interface_name", "stall_timeout", "wheel_radius"]
    known = {
        node: [name for name in names if not report([name])] for node, report in unknown.items()
    }
    assert known == {
        "joint_trajectory_controller": ["constraints.elbow.goal"],
        "arm": ["constraints.elbow.goal"],
        "head": ["interface_name"],
        "neck": ["interface_name"],
        "hand": ["stall_timeout"],
        "/velocity_controller": ["wheel_radius"],
        "controller_manager": [],
        "joint_state_broadcaster": [],
    }
