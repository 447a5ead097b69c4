"""What ``<gazebo>`` says of a robot's drive is read: its plugin, and the rollers of its wheels."""

import math
from pathlib import Path

import pytest

from onebot_description.description import Description, load_description, parse_description

QUARTER = math.pi / 4
ODE = "<collision><surface><friction><ode>{}</ode></friction></surface></collision>"
GRIPS = "<mu>1.0</mu><mu2>0.0</mu2>"


def robot(*inside: str, rpy: str = "0 0 0", axis: str = "0 1 0", base: str = "0 0 0") -> str:
    """A root, a base turned in it and a wheel, then what is given, by line."""
    return "\n".join(
        [
            '<robot name="r"><link name="root"/><link name="base"/><link name="w"/>'
            f'<joint name="f" type="fixed"><parent link="root"/><child link="base"/><origin '
            f'rpy="{base}"/></joint><joint name="j" type="continuous"><parent link="base"/>'
            f'<child link="w"/><origin rpy="{rpy}"/><axis xyz="{axis}"/></joint>',
            *inside,
            "</robot>",
        ]
    )


def of(inside: str, link: str = "w") -> str:
    return f'<gazebo reference="{link}">{inside}</gazebo>'


def read(*inside: str, **pose: str) -> Description:
    return parse_description(robot(*inside, **pose), "r")


@pytest.mark.parametrize(
    ("direction", "angle"),
    [
        ("1 -1 0", -QUARTER),
        ("1 1 0", QUARTER),
        ("-2 -2 0", QUARTER),
        ("1 0 0", 0.0),
        ("1 0.5 7", math.atan(0.5)),
    ],
)
@pytest.mark.parametrize(
    "block",
    [
        of(ODE.format(GRIPS + "<fdir1>{}</fdir1>")),
        of("<mu1>1</mu1><mu2>0.2</mu2><fdir1>{}</fdir1>"),
        of('<mu1 value="1"/><mu2 value="0.1"/><fdir1 value="{}"/>'),
        of("<mu2>0</mu2>") + of("<fdir1>{}</fdir1>"),
    ],
)
def test_friction_in_one_direction_is_rollers(block: str, direction: str, angle: float) -> None:
    """Their axle is where it grips, whatever the wheel's own frame, and nothing is lost of it."""
    for pose in ({}, {"rpy": "-1.5707963 0 0", "axis": "0 0 1"}, {"axis": "0 -1 0"}):
        description = read(block.format(direction), **pose)
        assert description.rollers == {"w": pytest.approx(angle)}
        assert not [text for text in description.warnings if "mu" in text or "fdir1" in text]


@pytest.mark.parametrize(
    ("inside", "found"),
    [
        ("<fdir1>1 1 0</fdir1>", True),
        ("<fdir1>1 0 0</fdir1>", False),  # of many robots with plain wheels
        ("<fdir1>0 1 0</fdir1>", False),
        (f"{GRIPS}<fdir1>0 1 0</fdir1>", False),  # the wheel's own axle
        (f"{GRIPS}<fdir1>0 0 0</fdir1>", False),
        (GRIPS, False),
        (f"{GRIPS}<fdir1/>", False),
        ("<mu1>1</mu1><mu2>1</mu2><fdir1>1 1 0</fdir1>", False),
        ("<mu1>0.5</mu1><mu2>0.11</mu2><fdir1>1 0 0</fdir1>", False),
        ("<mu>1.5</mu><mu2>0.7</mu2><fdir1>1 1 0</fdir1>", True),  # of linorobot2
    ],
)
def test_what_is_rollers(inside: str, found: bool) -> None:
    description = read(of(inside))
    assert ("w" in description.rollers) == found
    lost = [text for text in description.warnings if "friction is the same" in text]
    assert bool(lost) == (not found and "fdir1>" in inside and "0 0 0" not in inside)


def test_only_wheels_have_rollers() -> None:
    description = read(of(f"{GRIPS}<fdir1>1 1 0</fdir1>", "base"))
    assert description.rollers == {}
    assert any("friction is the same" in text for text in description.warnings)


def test_other_elements_beside_the_rollers_are_warned_of() -> None:
    kp = "<contact><ode><kp>1e6</kp></ode></contact>"
    block = of(ODE.format(f"{GRIPS}<fdir1>1 1 0</fdir1>").replace("<friction>", f"{kp}<friction>"))
    [warning] = read(block).warnings
    assert warning.endswith("<kp> of w: contacts are rigid here")
    slip = "<slip1>0.1</slip1><slip2>0</slip2><fdir1>1 1 0</fdir1>"
    [warning] = read(of(ODE.format(f"{GRIPS}{slip}"))).warnings
    assert warning.endswith("<slip1>, <slip2> of w: is not simulated")


NAMESPACE = ' xmlns:{}="http://gazebosim.org/schema"'


@pytest.mark.parametrize("prefix", ["gz:", "ignition:", ""])
@pytest.mark.parametrize("declared", ["robot", "gazebo", "nowhere"])
@pytest.mark.parametrize(("frame", "angle"), [("base", QUARTER - 0.3), ("root", -0.3)])
def test_the_direction_is_in_the_frame_it_names(
    prefix: str, declared: str, frame: str, angle: float, tmp_path: Path
) -> None:
    """The attribute's prefix need not be declared, and survives in the text that nodes get."""
    direction = f"{math.cos(-0.3)} {math.sin(-0.3)} 0"
    block = of(f'{GRIPS}<fdir1 {prefix}expressed_in="{frame}">{direction}</fdir1>')
    text = robot("<!-- <robot a gz:b -->", block, base=f"0 0 {QUARTER}")
    if prefix and declared != "nowhere":
        text = text.replace(f"<{declared} ", f"<{declared}{NAMESPACE.format(prefix[:-1])} ")
    (file := tmp_path / "r.urdf").write_text(text)
    description = load_description(file)
    assert description.rollers == {"w": pytest.approx(angle)}
    assert parse_description(description.urdf).rollers == description.rollers
    undeclared = [note for note in description.warnings if "is not declared" in note]
    assert len(undeclared) == (prefix != "" and declared == "nowhere")
    assert all(f"r.urdf:3: the prefix {prefix[:-1]} is" in note for note in undeclared)


def test_no_comment_is_taken_for_the_root_or_its_declarations(tmp_path: Path) -> None:
    comment = '<!-- once <robot name="old" xmlns:gz="somewhere"> -->\n'
    text = robot(of(f'{GRIPS}<fdir1 gz:expressed_in="base">1 1 0</fdir1>'))
    (file := tmp_path / "r.urdf").write_text(comment + text)
    description = load_description(file)
    assert description.rollers == {"w": pytest.approx(QUARTER)}
    [note] = [note for note in description.warnings if "is not declared" in note]
    assert "r.urdf:3: the prefix gz is" in note


@pytest.mark.parametrize(
    ("fdir1", "text"),
    [
        ("<fdir1>1 1</fdir1>", 'r:2: <gazebo> <fdir1>: "1 1" is not a direction; write x y z'),
        ("<fdir1>1 nan 0</fdir1>", '"1 nan 0" is not a direction'),
        ('<fdir1 expressed_in="bas">1 1 0</fdir1>', 'is no link (did you mean "base"?'),
    ],
)
def test_what_is_wrong_with_a_direction(fdir1: str, text: str) -> None:
    description = read(of(GRIPS + fdir1))
    assert any(text in notice for notice in description.notices)
    assert len(description.problems) == ("bas" not in fdir1)


def wheels(*names: str) -> str:
    return "".join(
        f'<link name="l_{name}"/><joint name="{name}" type="continuous"><parent link="base"/>'
        f'<child link="l_{name}"/><axis xyz="0 1 0"/></joint>'
        for name in names
    )


MECANUM = """<gazebo><plugin filename="gz-sim-mecanum-drive-system"
name="gz::sim::systems::MecanumDrive"><front_left_joint>fl</front_left_joint>
<front_right_joint> fr </front_right_joint><back_left_joint>rl</back_left_joint>
<back_right_joint>rr</back_right_joint><back_right_joint>j</back_right_joint>
<wheelbase>1.25</wheelbase><wheel_separation>1.5</wheel_separation><wheel_radius>0.3</wheel_radius>
<topic>/model/m/cmd_vel</topic></plugin></gazebo>"""
CAR = """<gazebo><plugin filename="ignition-gazebo-ackermann-steering-system"
name="ignition::gazebo::systems::AckermannSteering"><left_joint>fl</left_joint>
<left_joint>rl</left_joint><right_joint>fr</right_joint><right_joint>rr</right_joint>
<left_steering_joint>sl</left_steering_joint><right_steering_joint>sr</right_steering_joint>
<kingpin_width>1.0</kingpin_width><steering_limit>0.5</steering_limit><wheel_base>2</wheel_base>
</plugin></gazebo>"""
CLASSIC = """<gazebo><plugin name="car" filename="libgazebo_ros_ackermann_drive.so">
<front_left_joint>fl</front_left_joint><front_right_joint>fr</front_right_joint>
<rear_left_joint>rl</rear_left_joint><rear_right_joint>rr</rear_right_joint>
<left_steering_joint>sl</left_steering_joint><right_steering_joint>sr</right_steering_joint>
<steering_wheel_joint>none</steering_wheel_joint><max_steer>0.6</max_steer></plugin></gazebo>"""
CAMEL = """<gazebo><plugin name="four_diff_controller" filename="libgazebo_ros_ackerman.so">
<leftFrontJoint>fl</leftFrontJoint><rightFrontJoint>fr</rightFrontJoint>
<leftRearJoint>rl</leftRearJoint><rightRearJoint>rr</rightRearJoint>
<leftHingeJoint>sl</leftHingeJoint><rightHingeJoint>sr</rightHingeJoint>
<wheelSeparation>0.172</wheelSeparation><commandTopic>cmd_vel</commandTopic></plugin></gazebo>"""
DRIVEN = {"left": ("fl", "rl"), "right": ("fr", "rr")}
STEERED = {"left_steering": ("sl",), "right_steering": ("sr",)}


@pytest.mark.parametrize(
    ("block", "kind", "joints", "steering_limit"),
    [
        (
            MECANUM,
            "mecanum",
            {
                "front_left": ("fl",),
                "front_right": ("fr",),
                "rear_right": ("rr", "j"),
                "rear_left": ("rl",),
            },
            math.inf,
        ),
        (CAR, "ackermann", DRIVEN | STEERED, 0.5),
        (CLASSIC, "ackermann", DRIVEN | STEERED, 0.6),
        (CAMEL, "ackermann", DRIVEN | STEERED, math.inf),
    ],
)
def test_plugins_are_read(block: str, kind: str, joints: object, steering_limit: float) -> None:
    description = read(wheels("fl", "fr", "rl", "rr", "sl", "sr"), block, MECANUM)
    assert (plugin := description.drive_plugin)
    assert (plugin.kind, plugin.joints, plugin.steering_limit) == (kind, joints, steering_limit)
    assert plugin.where[:13] == "r:3: plugin " + plugin.where[12]
    assert description.notices == ()


@pytest.mark.parametrize(
    ("filename", "name", "kind"),
    [
        ("libgazebo_ros_planar_move.so", "object_controller", "planar"),
        ("gz-sim-velocity-control-system", "gz::sim::systems::VelocityControl", "planar"),
        ("libMecanumDrive.so", "x", "mecanum"),
        ("gz-sim-joint-controller-system", "gz::sim::systems::JointController", ""),
        ("gz-sim-diff-drive-system", "gz::sim::systems::DiffDrive", ""),
        ("libgazebo_ros2_control.so", "mecanum_drive_controller", ""),
        ("gz_ros2_control-system", "gz_ros2_control::GazeboSimROS2ControlPlugin", ""),
    ],
)
def test_kinds_of_plugins(filename: str, name: str, kind: str) -> None:
    plugin = read(f'<gazebo><plugin filename="{filename}" name="{name}"/></gazebo>').drive_plugin
    assert (plugin.kind if plugin else "") == kind


@pytest.mark.parametrize(
    ("limit", "text"),
    [
        ("x", 'plugin "p" <steering_limit>: "x" is not a finite number'),
        ("0", '"0" is not positive; it must be'),
        ("inf", '"inf" is not a finite number'),
    ],
)
def test_steering_limits_that_are_none(limit: str, text: str) -> None:
    inside = f"\n<steering_limit>{limit}</steering_limit>"
    description = read(f'<gazebo><plugin filename="Ackermann" name="p">{inside}</plugin></gazebo>')
    [problem] = description.problems
    assert problem.startswith("r:3: ") and text in problem
    assert description.drive_plugin and math.isinf(description.drive_plugin.steering_limit)


def test_a_joint_that_does_not_exist_is_a_warning() -> None:
    [warning] = read(
        wheels("fl", "fr", "rl", "wheel_rr"), MECANUM.replace("rr<", "whel_rr<")
    ).notices
    assert 'the robot has no joint "whel_rr" (did you mean "wheel_rr"?' in warning
