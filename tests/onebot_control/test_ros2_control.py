"""What the simulation makes of ``<ros2_control>``, and what it refuses."""

import math
from collections.abc import Mapping

import pytest

from onebot_control.fleet import Fleet
from onebot_control.joint_controllers import JointController
from onebot_control.prepared_robot import Member, PreparedRobot
from onebot_control.simulation import Simulation
from onebot_control.simulation_parameters import SimulationConfig
from onebot_control.trajectories.following import TrajectoryFollower
from onebot_control.trajectories.forwarding import PositionForwarder
from onebot_description.description import Description, describe, parse_description
from onebot_description.errors import DescriptionError, OneBotError
from tests.onebot_control.arm_models import arm, interfaces, joint, link, mimic
from tests.onebot_control.control_support import CASTER, urdf, wheel

LIMITS = 'effort="20" velocity="1" lower="-0.5" upper="0.5"'
POSITION = '<command_interface name="position"/>'


def listed(name: str, inside: str, attributes: str = "") -> str:
    """A <joint> of <ros2_control>."""
    return f'<joint name="{name}" {attributes}>{inside}</joint>'


def robot(*joints: str, more: str = "") -> Description:
    """Two joints, right and left, beside each other, of which ``joints`` list some."""
    parts = [
        link("r", 0.2, "0 0 0.1"),
        joint("right", "world", "r", axis="1 0 0", xyz="0 0 1", limits=LIMITS),
        link("l", 0.2, "0 0 0.1"),
        joint("left", "world", "l", axis="1 0 0", xyz="1 0 1", limits=LIMITS, more=more),
    ]
    return arm(*parts, f'<ros2_control name="s" type="system">{"".join(joints)}</ros2_control>')


def starting(name: str, value: object) -> str:
    """A state interface with an initial value."""
    start = f'<param name="initial_value">{value}</param>'
    return f'<state_interface name="{name}">{start}</state_interface>'


MIMIC = mimic("right")


def problem(description: Description) -> str:
    """What is refused, by a check as by the simulation."""
    with pytest.raises(DescriptionError) as strict:
        description.raise_problems()
    with pytest.raises(OneBotError) as simulated:
        Simulation(description)
    assert str(simulated.value) in str(strict.value)
    return str(simulated.value)


def positions(description: Description, targets: Mapping[str, float]) -> list[float]:
    """Where right and left are a second after a command."""
    with Simulation(description) as simulation:
        simulation.robot.move_to(targets, seconds=0.8)
        simulation.run(1.0)
        joints = simulation.robot.joints
        return [joints[name].position if name in joints else 0.0 for name in ("right", "left")]


def test_a_joint_that_does_not_mimic_here() -> None:
    """It is commanded by itself; without the attribute it follows."""
    free = robot(listed("right", POSITION), listed("left", POSITION, 'mimic="false"'), more=MIMIC)
    assert not free.problems
    assert "= right" not in describe(free)
    assert positions(free, {"right": 0.4}) == pytest.approx([0.4, 0.0], abs=1e-6)
    assert positions(free, {"left": 0.3}) == pytest.approx([0.0, 0.3], abs=1e-6)
    follows = robot(listed("right", POSITION), listed("left", ""), more=MIMIC)
    assert positions(follows, {"right": 0.4}) == pytest.approx([0.4, 0.4], abs=1e-3)


def test_a_mimic_joint_with_a_command_interface_is_refused() -> None:
    """As in Jazzy; in the form of older versions, it is a warning."""
    text = 'joint "left": follows "right" by <mimic>, so it cannot have a command interface'
    refused = robot(listed("right", POSITION), listed("left", POSITION), more=MIMIC)
    assert text in problem(refused)
    older = '<param name="mimic">right</param><param name="multiplier">1</param>'
    accepted = robot(listed("right", POSITION), listed("left", older + POSITION), more=MIMIC)
    assert text in accepted.warnings[0] and not accepted.problems
    assert positions(accepted, {"right": 0.4}) == pytest.approx([0.4, 0.4], abs=1e-3)
    needless = robot(listed("right", POSITION, 'mimic="true"'))
    assert 'joint "right": mimic="true", but the joint has no <mimic>' in problem(needless)


@pytest.mark.parametrize(
    ("interface", "value", "said"),
    [
        ("position", "0.6", "initial_value 0.6 is beyond the joint's limits, -0.5 to 0.5"),
        ("position", "-7", "initial_value -7 is beyond the joint's limits, -0.5 to 0.5"),
        ("position", "inf", 'initial_value: "inf" is not a finite number'),
        ("position", "", 'initial_value: "" is not a finite number'),
        ("velocity", "nan", 'initial_value: "nan" is not a finite number'),
    ],
)
def test_a_start_that_is_impossible(interface: str, value: str, said: str) -> None:
    assert said in problem(robot(listed("right", POSITION + starting(interface, value))))


def test_a_start_by_parameters_that_is_impossible() -> None:
    """A rounded limit is none."""
    description = robot(listed("right", POSITION))
    with pytest.raises(OneBotError, match="initial_positions.right: 0.6 is beyond the joint's lim"):
        Simulation(description, parameters={"initial_positions.right": 0.6})
    with Simulation(description, parameters={"initial_positions.right": 0.50001}) as simulation:
        assert simulation.robot.joints["right"].position == 0.5


def limited(name: str, least: object, greatest: object, *more: str) -> str:
    """A command interface with limits."""
    limits = f'<param name="min">{least}</param><param name="max">{greatest}</param>'
    return f'<command_interface name="{name}">{limits}{"".join(more)}</command_interface>'


def test_limits_of_a_command_interface() -> None:
    """Of positions, those beyond are refused; those of velocity and effort are the motor's."""
    wide, narrow = limited("position", -3, 3), limited("position", -0.1, 0.2)
    switched_off = limited("position", -0.1, 0.2, '<limits enable="false"/>')
    beyond = robot(listed("right", narrow + starting("position", 0.3)))
    assert "initial_value 0.3 is beyond the joint's limits, -0.1 to 0.2" in problem(beyond)
    for inside in (wide, switched_off):
        assert positions(robot(listed("right", inside)), {"right": 0.4})[0] == pytest.approx(0.4)
    with pytest.raises(OneBotError, match="0.4 is above the joint's limit 0.2"):
        positions(robot(listed("right", narrow)), {"right": 0.4})
    slow = robot(listed("right", POSITION + limited("velocity", -0.25, 5)))
    assert positions(slow, {"right": 0.4})[0] == pytest.approx(0.24, abs=0.02)
    # Its weight at 0.1 m needs 0.196 Nm at most.
    weak = robot(listed("right", POSITION + limited("effort", -0.05, 0.05)))
    with Simulation(weak, parameters={"initial_positions.right": 0.4}) as simulation:
        simulation.run(0.5)
        state = simulation.robot.joints["right"]
        assert state.position == pytest.approx(0.5, abs=1e-3) and abs(state.effort) <= 0.05


@pytest.mark.parametrize(
    ("inside", "said"),
    [
        (limited("position", "{-pi}", 1), 'min: "{-pi}" is not a finite number'),
        (limited("position", 2, 1), "min 2 is greater than max 1"),
        (starting("velocity", 0.5), "initial_value has no effect; only a position's"),
    ],
)
def test_what_has_no_effect_is_a_warning(inside: str, said: str) -> None:
    description = robot(listed("right", inside))
    assert said in description.warnings[0] and not description.problems


def test_limits_that_are_not_enforced_are_reported(caplog: pytest.LogCaptureFixture) -> None:
    inside = limited("position", -0.1, 0.2) + limited("velocity", -0.25, 0.25)
    description = robot(listed("right", inside))
    free = JointController(
        TrajectoryFollower, "arm", {"joints": ["right"], "enforce_command_limits": False}
    )
    member = Member(description, SimulationConfig(), controllers=[free])
    with Fleet.from_members([member]) as fleet:
        text = "joint right: min and max of <command_interface> do not limit it, because enforce_co"
        assert text in caplog.text
        assert fleet.robots[0].body.spawn.description.moving_joints[0].velocity == 1.0


@pytest.mark.parametrize("kind", ["velocity", "effort"])
def test_other_command_interfaces_are_refused_by_name(kind: str) -> None:
    """Unless another joint has positions: then the joint is held, which is reported."""
    other = listed("left", f'<command_interface name="{kind}"/>')
    said = f"<ros2_control> has only the command interface {kind}, which cannot be simulated yet"
    for inside in (other, other + listed("right", "")):
        with pytest.raises(OneBotError, match=f"joint left: {said}; add position"):
            Simulation(robot(inside))
    mixed = robot(other, listed("right", POSITION))
    with pytest.raises(OneBotError, match=f"joint left: {said}"):
        named = JointController(PositionForwarder, "arm", {"joints": ["left"]})
        PreparedRobot(Member(mixed, SimulationConfig(), controllers=[named]))
    assert positions(mixed, {"right": 0.4}) == pytest.approx([0.4, 0.0], abs=1e-6)


def test_joints_that_are_held_are_named(caplog: pytest.LogCaptureFixture) -> None:
    """A hand that is not listed with its arm; an arm of efforts on a robot that drives."""
    wheels = [wheel(side, y) for side, y in (("left", 0.15), ("right", -0.15))]
    boom = link("boom", 0.2) + joint("lift", "base_link", "boom", limits=LIMITS)
    carrier = parse_description(urdf(*wheels, CASTER, boom, interfaces("lift", "effort")))
    for held, description in (("left", robot(listed("right", POSITION))), ("lift", carrier)):
        Simulation(description).close()
        text = f"joint {held}: held still, because no controller moves it; name it in a"
        assert text in caplog.text


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
def test_a_joint_without_a_command_interface_is_free(kind: str) -> None:
    """A pendulum swings about its lowest point, a slider falls to its end."""
    limits = LIMITS.replace("0.5", "4") if kind == "prismatic" else LIMITS.replace("0.5", "3")
    axis = "0 0 1" if kind == "prismatic" else "1 0 0"
    moving = joint("swing", "world", "rod", kind, axis, "0 0 9", limits=limits)
    block = listed("swing", starting("position", 1))
    control = f'<ros2_control name="s" type="system">{block}</ros2_control>'
    description = arm(link("rod", 1.0, "0 0 -0.5"), moving, control)
    with Simulation(description) as simulation:
        robot, least, greatest = simulation.robot, math.inf, -math.inf
        for _ in range(300):
            simulation.run(simulation.period)
            least = min(least, robot.joints["swing"].position)
            greatest = max(greatest, robot.joints["swing"].position)
    if kind == "prismatic":
        assert least == pytest.approx(-4.0, abs=0.05)
    else:
        assert (least, greatest) == (pytest.approx(-1.0, abs=0.02), pytest.approx(1.0, abs=0.02))
