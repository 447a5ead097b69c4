"""Finding the wheels that drive a robot, and driving it by them."""

import math
from pathlib import Path

import pytest
import trimesh

from onebot_control.drive.wheels import rolling_shapes
from onebot_control.drive.wheels.finding import RunningGear
from onebot_control.drive.wheels.geometry import SideWheels
from onebot_control.drive_kinds import ControlConfig
from onebot_control.physics.simulated_model import casters_of, commandable, simulated_model
from onebot_description.description import Description, load_description, parse_description
from onebot_description.errors import OneBotError
from tests.accuracy import DrivenPath, measure, straight, turn
from tests.onebot_control.arm_models import interfaces
from tests.onebot_control.control_support import alone, robot

INERTIA = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
WIDE = 'rpy="-1.5707963267948966 0 0"', '<cylinder radius="0.1" length="0.05"/>'


def part(name: str, xyz: str, shape: str, **how: str) -> str:
    """A link with one shape, and its joint: continuous about y, without a limit."""
    origin, kind = how.get("origin", ""), how.get("kind", "continuous")
    limit = '<limit lower="-1" upper="1" effort="9" velocity="9"/>' if kind == "revolute" else ""
    return f"""
  <link name="{name}">
    <inertial><mass value="0.5"/>{INERTIA}</inertial>
    <collision><origin {origin}/><geometry>{shape}</geometry></collision>
  </link>
  <joint name="{name}_joint" type="{kind}">
    <parent link="{how.get("parent", "base_link")}"/><child link="{name}"/>
    <origin xyz="{xyz}"/><axis xyz="{how.get("axis", "0 1 0")}"/>{limit}
  </joint>"""


def wheel(name: str, x: float, y: float, axis: str = "0 1 0", radius: float = 0.1) -> str:
    """A wide wheel whose motor has no limit."""
    shape = f'<cylinder radius="{radius}" length="0.05"/>'
    return part(name, f"{x} {y} {radius - 0.1}", shape, origin=WIDE[0], axis=axis)


def base(*parts: str) -> Description:
    """A robot of 10 kg under whose root is nothing but the footprint."""
    return parse_description(f"""<robot name="bot"><link name="footprint"/>
  <joint name="base_joint" type="fixed"><parent link="footprint"/><child link="base_link"/></joint>
  <link name="base_link"><inertial><mass value="10"/>
    <inertia ixx="0.2" iyy="0.2" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  {"".join(parts)}</robot>""")


TWO = wheel("l", 0.0, 0.2), wheel("r", 0.0, -0.2)
FOUR = tuple(
    wheel(f"{end}{side}", x, y)
    for end, x in (("rear_", -0.15), ("front_", 0.15))
    for side, y in (("l", 0.2), ("r", -0.2))
)
BALLS = tuple(
    part(f"ball_{x:g}", f"{x} 0 -0.07", '<sphere radius="0.03"/>', kind="fixed")
    for x in (-0.2, 0.2)
)


def swivel(x: float, y: float = 0.0, name: str = "") -> str:
    """A caster that swivels and rolls, as low as the wheels."""
    fork, roller = f"fork{name}", f"roller{name}"
    return part(fork, f"{x} {y} -0.05", '<box size="0.02 0.02 0.02"/>', axis="0 0 1") + part(
        roller, "-0.03 0.02 0", '<sphere radius="0.05"/>', parent=fork
    )


SWIVEL = swivel(-0.2)


def rolling_on(uri: str) -> tuple[str, ...]:
    """Four wheels whose visuals are this mesh."""
    mesh = f'<visual><geometry><mesh filename="{uri}"/></geometry></visual><collision>'
    return tuple(wheel.replace("<collision>", mesh) for wheel in FOUR)


ROLLERS = tuple(
    wheel(f"caster_{side}", -0.2, y, radius=0.05) for side, y in (("l", 0.1), ("r", -0.1))
)
ARM = part("arm", "0.1 0 0.3", '<box size="0.2 0.02 0.02"/>', kind="revolute") + part(
    "hand", "0.2 0.1 0", '<cylinder radius="0.1" length="0.1"/>', parent="arm"
)

TURNTABLES = tuple(
    part(f"table_{y}", f"0.1 {y} 0", '<sphere radius="0.1"/>', axis="0 0 1") for y in (-0.1, 0.1)
)


def found(description: Description) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The joints on the left and on the right."""
    wheels = SideWheels(description)
    return wheels.left, wheels.right


@pytest.mark.parametrize(
    ("parts", "left", "right"),
    [
        (TWO, ["l"], ["r"]),
        ((*TWO, *BALLS), ["l"], ["r"]),
        ((*TWO, *ROLLERS), ["l"], ["r"]),
        ((*TWO, ARM), ["l"], ["r"]),
        ((*TWO, *TURNTABLES), ["l"], ["r"]),
        (FOUR, ["front_l", "rear_l"], ["front_r", "rear_r"]),
        (rolling_on("file:///omni/a/b/c.stl"), ["front_l", "rear_l"], ["front_r", "rear_r"]),
        ((wheel("a", 0.0, -0.2, "0 -1 0"), wheel("b", 0.0, 0.2)), ["b"], ["a"]),
    ],
)
def test_wheels_are_found(parts: tuple[str, ...], left: list[str], right: list[str]) -> None:
    """By their axes, shapes and places: not casters, arms, or what stands in the middle."""
    assert found(base(*parts)) == tuple(
        tuple(f"{name}_joint" for name in side) for side in (left, right)
    )


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ((), "its joints include no wheel on the left with a matching wheel"),
        ((TWO[0],), "its joints include no wheel on the left with a matching wheel"),
        (
            (wheel("a", 0.2, -1e-4, "1 -1e-4 0"), wheel("b", -0.2, 0.0, "1 0 0")),
            "at 0.2 0 0, axis 1 0 0",
        ),
        (
            (*TWO, wheel("m", 0.2, 0.1, radius=0.05), wheel("n", 0.2, -0.1, radius=0.05)),
            "it is not clear which of its wheels drive it: m_joint, n_joint or l_joint, r_joint",
        ),
        (
            (swivel(0.2, 0.1, "_l"), swivel(0.2, -0.1, "_r")),
            "its joints include no wheel on the left with a",
        ),
        (
            tuple(
                wheel.replace('"front_', '"mecanum_front_').replace('"rear_', '"mecanum_rear_')
                for wheel in FOUR
            ),
            "its wheels are omnidirectional, with rollers around them",
        ),
        (rolling_on("file:///a/omni/b/c.stl"), "its wheels are omnidirectional, with rollers"),
    ],
)
def test_what_cannot_be_driven(parts: tuple[str, ...], said: str) -> None:
    """One message names what is missing, how to name the wheels, and the joints that there are."""
    with pytest.raises(OneBotError) as caught:
        SideWheels(base(*parts))
    message = str(caught.value)
    assert 'robot "bot" cannot be driven: ' in message and said in message
    assert "left_wheel:=JOINT right_wheel:=JOINT" in message
    assert "Its rotating joints: " + ("" if parts else "none") in message


def test_a_round_housing_of_an_arm_is_no_wheel() -> None:
    """What rolls about a lateral axis is a wheel only near the robot's lowest point."""
    stand = part("stand", "0 0 0.1", "<box size='0.2 0.2 0.2'/>", kind="fixed")
    shoulder = part("shoulder", "0 0 0.2", "<box size='0.1 0.1 0.1'/>", axis="0 0 1")
    upper = part("upper", "0 0 0.2", WIDE[1], origin=WIDE[0], parent="shoulder")
    assert not RunningGear(base(stand, shoulder, upper)).drives
    for parts in ((*TWO, stand, shoulder, upper), (*TWO, *BALLS)):
        assert RunningGear(base(*parts)).drives


def mesh_wheels(folder: Path) -> Description:
    """Two wheels whose meshes lie outside of their joints."""
    file = folder / "wheel.stl"
    trimesh.creation.cylinder(radius=0.1, height=0.04, sections=64).export(file)
    mesh = f'<mesh filename="file://{file}"/>'
    origin = 'xyz="0 0.03 0" rpy="1.5707963267948966 0 0"'
    return base(
        part("l", "0 0.2 0", mesh, origin=origin),
        part("r", "0 -0.2 0", mesh, origin=origin.replace("0.03", "-0.03")),
        *BALLS,
    )


def test_a_wheel_may_be_a_mesh(tmp_path: Path) -> None:
    assert SideWheels(mesh_wheels(tmp_path)).geometry() == pytest.approx((0.46, 0.1), abs=1e-6)


def test_a_mesh_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At the start, and never in the control loop, for parameters that are set."""
    read: list[object] = []
    corners = rolling_shapes.mesh_corners
    monkeypatch.setattr(
        rolling_shapes, "mesh_corners", lambda mesh: (read.append(mesh), corners(mesh))[1]
    )
    with alone(mesh_wheels(tmp_path), CONFIG) as fleet:
        fleet.robots[0].configure(ControlConfig.from_parameters({"publish_rate": 10.0}))
    assert len(read) == 2


def test_what_is_simulated() -> None:
    """Wheels are thin and have motors, casters glide, an arm is held; a swivel follows."""
    description = base(*TWO, *BALLS, SWIVEL, ARM)
    wheels = SideWheels(description)
    assert commandable(description, wheels) == ["arm_joint", "hand_joint"]
    spawn = simulated_model(description, wheels)
    simulated, held = spawn.description, spawn.held
    assert held == {"arm_joint": 0.0, "hand_joint": 0.0}
    names = [joint.name for joint in simulated.moving_joints]
    assert names == ["l_joint", "r_joint", "fork_joint", "roller_joint"]
    assert simulated.moving_joints[0].effort == pytest.approx(9.81 * 14.0 * 0.1)
    frictions = {link.name: link.friction for link in simulated.links}
    assert frictions["base_link"] == frictions["ball_0.2"] == 0.01
    assert frictions["l"] is frictions["roller"] is None
    thin = next(link for link in simulated.links if link.name == "l").collisions[0]
    assert (thin.shape.radius, thin.shape.length) == (0.1, 0.004)  # type: ignore[union-attr]
    ball = next(link for link in simulated.links if link.name == "ball_0.2").collisions[0]
    assert ball.origin.xyz == pytest.approx((0.0, 0.0, 0.0002))
    assert simulated_model(robot(), SideWheels(robot())).description.joints == robot().joints


def test_continuous_joints_with_interfaces_are_no_casters() -> None:
    """A controller commands them, whatever they carry; one that none commands is held."""
    turret = part("pan", "0 0 0.2", "<box size='0.1 0.1 0.1'/>", axis="0 0 1") + part(
        "tilt", "0 0 0.1", "<box size='0.1 0.1 0.1'/>", parent="pan"
    )
    spinner = part("spinner", "0 0 0.1", "<box size='0.1 0.1 0.1'/>", axis="0 0 1", parent="tilt")
    listed = interfaces("pan_joint", "position"), interfaces("tilt_joint", "position")
    description = base(*TWO, *BALLS, SWIVEL, turret, spinner, *listed)
    wheels = SideWheels(description)
    commanded = commandable(description, wheels)
    assert commanded == ["pan_joint", "tilt_joint"]
    assert casters_of(wheels) == {"fork_joint", "roller_joint", "spinner_joint"}
    assert simulated_model(description, wheels, commanded[:1]).held == {"tilt_joint": 0.0}


PUBLIC = Path(__file__).parents[1] / "robots"


ROUTES = DrivenPath("line", straight(0.5)), DrivenPath("spot", turn(math.pi / 2.0), turning=True)


def drive(description: Description) -> list[tuple[float, float]]:
    """Drive 0.5 m, then turn by 90°; return odometry's and truth's distance and angle."""
    line, spot = measure(description, ROUTES)
    assert line.odometry.x == pytest.approx(0.5, abs=1e-3)
    assert abs(line.truth.y) < 1e-3 and abs(line.truth.yaw) < 1e-3
    assert spot.odometry.yaw == pytest.approx(math.pi / 2.0, abs=2e-3)
    return [(line.odometry.x, line.truth.x), (spot.odometry.yaw, spot.truth.yaw)]


CASTERS = tuple(
    swivel(x, y, f"_{x:g}_{y:g}".replace("-", "m")) for x in (-0.2, 0.2) for y in (-0.1, 0.1)
)


@pytest.mark.parametrize(("axis", "casters"), [("0 -1 0", BALLS), ("0 1 0", CASTERS)])
def test_two_wheels_drive(axis: str, casters: tuple[str, ...]) -> None:
    """Without any parameter, on wide wheels without a limit; either way round, and on casters."""
    line, spot = drive(base(wheel("l", 0.0, 0.2), wheel("r", 0.0, -0.2, axis), *casters, ARM))
    assert line[1] == pytest.approx(line[0], rel=1e-3)
    assert spot[1] == pytest.approx(spot[0], abs=5e-3)  # rad, most of it as it starts


BALLAST = part("ballast", "-0.1 0 0.1", '<box size="0.1 0.1 0.1"/>', kind="fixed").replace(
    'mass value="0.5"', 'mass value="10"'
)
MIDDLE = wheel("middle_l", 0.0, 0.2), wheel("middle_r", 0.0, -0.2)


@pytest.mark.parametrize("parts", [(*FOUR, BALLAST), (*FOUR, *MIDDLE, BALLAST)])
def test_several_wheels_a_side_skid(parts: tuple[str, ...]) -> None:
    """The truth follows the odometry, whose separation is the effective one, wherever the mass is.

    Friction opposes the sliding, and each wheel carries its share, as the separation assumes.
    """
    line, spot = drive(base(*parts))
    assert line[1] == pytest.approx(line[0], rel=1e-4)
    assert spot[1] == pytest.approx(spot[0], rel=0.01)


@pytest.mark.parametrize(
    ("name", "separation", "radius"),
    [
        ("leo_rover", 0.614, 0.0625),
        ("scout_v2", 1.008, 0.16459),
        ("tracer", 0.34, 0.0457774),
    ],
)
def test_public_robots_drive(name: str, separation: float, radius: float) -> None:
    """Chamfered tyres beside a smaller hub, and joints turned by 3.14 and -1.57."""
    description = load_description(PUBLIC / f"good_{name}.xacro")
    assert SideWheels(description).geometry() == pytest.approx((separation, radius), abs=1e-3)
    for odometry, truth in drive(description):
        assert truth == pytest.approx(odometry, rel=0.01)


BALL = '<sphere radius="0.1"/>'
HINGE = part("hinge", "0.2 0.2 0", "<box size='0.1 0.1 0.1'/>", axis="0 0 1", kind="revolute")


@pytest.mark.parametrize(
    ("car", "hinge", "wheel"),
    [
        (
            load_description(PUBLIC / "warn_deepracer.xacro"),
            "left_steering_hinge",
            "left_front_wheel",
        ),
        (base(*TWO, HINGE, part("tyre", "-0.05 0 0", BALL, parent="hinge")), "hinge", "tyre"),
    ],
)
def test_a_car_is_no_differential_drive(car: Description, hinge: str, wheel: str) -> None:
    """A hinge with limits steers a wheel, and so does any that the wheel does not trail."""
    with pytest.raises(OneBotError) as caught:
        SideWheels(car)
    message = str(caught.value)
    assert f'joint "{hinge}_joint" steers the wheel of "{wheel}_joint"' in message
    assert "ackermann_steering_controller/AckermannSteeringController" in message


def box(width: float, length: float, height: float, z: float) -> str:
    """A body whose lower side is at ``z`` below the axles."""
    shape = f'<box size="{length} {width} {height}"/>'
    return part("body", f"-0.02 0 {z + height / 2}", shape, kind="fixed")


@pytest.mark.parametrize("bottom", [-0.1, -0.108])
def test_a_body_that_lies_on_the_ground(bottom: float, caplog: pytest.LogCaptureFixture) -> None:
    """The wheels and the caster carry the robot; where it is deeper than rounding, that is logged.

    Meshes of bases reach down to the ground between the wheels, or include the casters.
    """
    robot = base(*TWO, box(0.36, 0.5, 0.1, bottom), BALLS[0], BALLAST)
    for odometry, truth in drive(robot):
        assert truth == pytest.approx(odometry, rel=1e-3)
    lifted = 'a collision shape of link "body" reaches below the wheels; the simulation lifts it'
    assert (lifted in caplog.text) == (bottom < -0.1)


def test_damping_and_light_wheels() -> None:
    """Of a driven wheel, damping far above its inertia, or too small an inertia, do no harm."""
    dynamics = "<dynamics damping='21.75' friction='10.5'/>"
    light = tuple(
        wheel.replace("</joint>", f"{dynamics}</joint>").replace('"0.01"', '"0.00005"')
        for wheel in TWO
    )
    for odometry, truth in drive(base(*light, *BALLS, BALLAST)):
        assert truth == pytest.approx(odometry, rel=1e-3)


CONFIG = ControlConfig.from_parameters({})
