"""Arms in the simulation: how exactly they move and hold, against formulas and Newton-Euler.

The numbers that are demanded are in the names and docstrings. Everything runs in PyBullet, at 200
physics steps a second.
"""

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np
import pytest
from scipy.special import ellipk

from onebot_control import RobotSetup, Simulation
from onebot_control.fleet import Fleet
from onebot_control.joint_controllers import DEFAULT_CONTROLLER
from onebot_control.physics.spawning import RobotSpawn
from onebot_control.physics.world import World
from onebot_control.prepared_robot import Member
from onebot_control.sensing.readings import JointState
from onebot_control.simulation_parameters import SimulationConfig
from onebot_control.trajectories.goal import TrajectoryGoal
from onebot_control.trajectories.trajectory import Waypoint
from onebot_description.description import Description, parse_description
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose
from onebot_description.model import RobotModel
from tests.onebot_control import control_support
from tests.onebot_control.arm_models import (
    GRAVITY,
    HAND_DOWN,
    MRM,
    PANDA,
    RATE,
    ROD,
    arm,
    box,
    box_world,
    interfaces,
    joint,
    link,
    mimic,
    newton_euler,
    panda,
    public_arm,
    quintic,
    robotiq,
    rod,
    simulate,
    two_fingers,
)
from tests.onebot_control.test_scene import part, scene

XARM = "xarm/xarm6_robot.urdf"


def steps(simulation: Simulation, seconds: float) -> Iterator[Mapping[str, JointState]]:
    """The joints after each control cycle."""
    for _ in range(round(seconds / simulation.period)):
        simulation.run(simulation.period)
        yield simulation.robot.joints


def goals(simulation: Simulation) -> dict[str, float]:
    """Positions that each commanded joint is to move to: 0.8 rad away, or what it can in 2 s."""
    chosen = {}
    moving = {each.name: each for each in simulation.robot.description.moving_joints}
    for name, state in simulation.robot.joints.items():
        each = moving[name]
        if each.mimic is None:
            lower = -9.0 if each.lower is None else each.lower
            upper = 9.0 if each.upper is None else each.upper
            far = min(0.8, (each.velocity or 9.0) / 1.876 * 2.0)
            there = state.position + far
            chosen[name] = there if there <= upper else max(state.position - far, lower)
    return chosen


def field(name: str, joints: Mapping[str, JointState]) -> dict[str, float]:
    """Position, velocity or effort of each joint."""
    return {joint: getattr(state, name) for joint, state in joints.items()}


def box_place(simulation: Simulation) -> np.ndarray:
    """Where the box is, mm."""
    pose = simulation.boxes["box"]
    return 1e3 * np.array([pose.x, pose.y, pose.z])


# Tracking and efforts ---------------------------------------------------------------------------


def test_worst_error_of_a_2_s_quintic_and_sag_in_10_s() -> None:
    """1e-12 rad of MRM; test_known_arms.py has arms of several joints."""
    with simulate(public_arm(MRM)) as simulation:
        [(name, end)] = goals(simulation).items()
        simulation.robot.move_to({name: end}, seconds=2.0)
        for number, joints in enumerate(steps(simulation, 2.0), 1):
            reference = quintic(number / (2.0 * RATE)) * end
            assert joints[name].position == pytest.approx(reference, abs=1e-12)
        simulation.run(10.0)
        assert not simulation.robot.moving
        assert simulation.robot.joints[name].position == pytest.approx(end, abs=1e-12)


@pytest.mark.parametrize(
    ("file", "starts"),
    [(XARM, {}), (PANDA, {**HAND_DOWN, "panda_finger_joint1": 0.02})],
    ids=["xArm6", "Panda"],
)
def test_efforts_are_newton_eulers_within_2_percent_of_each_joints_greatest(
    file: str, starts: Mapping[str, float]
) -> None:
    """At rest and in motion, with damping and friction, and with what a joint's gear moves."""
    with simulate(public_arm(file), starts) as simulation:
        simulation.run(0.1)
        before = dict(simulation.robot.joints)
        rows = [(before, newton_euler(simulation, field("position", before), {}, {}))]
        simulation.robot.move_to(goals(simulation), seconds=2.0)
        for number, joints in enumerate(steps(simulation, 2.0)):
            # Near the ends, nearly at rest, friction has no sign.
            if number % 5 == 0 and 10 <= number < 390:
                at, speeds = field("position", before), field("velocity", before)
                gains = {name: RATE * (joints[name].velocity - speeds[name]) for name in at}
                rows.append((joints, newton_euler(simulation, at, speeds, gains)))
            before = joints
    for name in before:
        greatest = max(abs(expected[name]) for _, expected in rows)
        for joints, expected in rows:
            assert joints[name].effort == pytest.approx(expected[name], abs=0.02 * greatest), name


def test_effort_is_m_g_l_at_rest_and_adds_j_a_damping_and_friction() -> None:
    """Of a rod that lies level: 9.81 Nm hold it, without any sag."""
    dynamics = '<dynamics damping="0.3" friction="0.5"/>'
    with simulate(rod(more=dynamics)) as simulation:
        for joints in steps(simulation, 2.0):
            assert joints["elbow"].position == pytest.approx(0.0, abs=1e-9)
        assert joints["elbow"].effort == pytest.approx(-ROD.load, rel=1e-6)
        simulation.robot.move_to({"elbow": -1.0}, seconds=2.0)
        before, met = joints["elbow"], 0
        for joints in steps(simulation, 2.0):
            now = joints["elbow"]
            if now.velocity < -1e-3:
                gain = RATE * (now.velocity - before.velocity)
                held = ROD.load * math.cos(before.position)
                expected = ROD.inertia * gain - held + 0.3 * before.velocity - 0.5
                assert now.effort == pytest.approx(expected, abs=1e-6)
                met += 1
            before = now
        assert met > 380


# Limits -----------------------------------------------------------------------------------------


def test_no_faster_than_1_0001_times_the_velocity_limit() -> None:
    """A joint that is sent 1 rad away at 0.5 rad/s arrives after 2 s, and stays there."""
    with simulate(rod('lower="-2" upper="2" effort="100" velocity="0.5"')) as simulation:
        simulation.robot.move_to({"elbow": 1.0}, seconds=0.005)
        for number, joints in enumerate(steps(simulation, 2.5), 1):
            assert joints["elbow"].velocity <= 0.5 * 1.0001
            expected = min(0.5 * number / RATE, 1.0)
            assert joints["elbow"].position == pytest.approx(expected, abs=1e-9)


def test_effort_limit_is_exact() -> None:
    """5 Nm do not hold 9.81 Nm: the effort is the limit, and the rod falls by the difference."""
    with simulate(rod('lower="-2" upper="2" effort="5" velocity="2"')) as simulation:
        first, *others = [joints["elbow"] for joints in steps(simulation, 0.2)]
    assert first.velocity == pytest.approx((ROD.load - 5.0) / ROD.inertia / RATE, rel=1e-9)
    assert {state.effort for state in (first, *others)} == {-5.0}


def test_motor_does_not_press_beyond_a_position_limit() -> None:
    """Sent 1 rad beyond it with 100 Nm: for a step 3 mrad beyond it at most, then at the limit."""
    spawn = RobotSpawn(rod(), (), commanded=("elbow",), starts={"elbow": 1.5}, fixed_base=True)
    with World([spawn]) as world:
        [robot] = world.robots
        robot.follow([[3.0]])
        reached = []
        for _ in range(200):
            world.step(1.0 / RATE)
            reached.append(robot.positions[0])
    assert max(reached) <= 2.003
    assert sum(position > 2.0 + 1e-9 for position in reached) <= 1
    assert reached[-1] == pytest.approx(2.0, abs=1e-9)


def test_load_is_at_most_3_mrad_beyond_a_position_limit_for_a_step() -> None:
    """A rod that falls on its limit at 0.7 rad/s goes back from then on, to where it stops."""
    with simulate(rod('lower="-0.02" upper="0.02" effort="1" velocity="9"')) as simulation:
        beyond = [joints["elbow"].position - 0.02 for joints in steps(simulation, 1.0)]
    worst = int(np.argmax(beyond))
    assert 0.0 < beyond[worst] <= 0.003
    assert all(later < earlier for earlier, later in pairwise(beyond[worst : worst + 20]))
    assert beyond[-1] == pytest.approx(1e-4, abs=1e-6)


def test_motor_alone_holds_a_joint_at_its_limit() -> None:
    """What presses it there is the motor's effort, and not the limit's."""
    with simulate(rod('lower="-2" upper="0" effort="100" velocity="2"')) as simulation:
        simulation.run(0.5)
        state = simulation.robot.joints["elbow"]
    assert state.position == pytest.approx(0.0, abs=1e-9)
    assert state.effort == pytest.approx(-ROD.load, rel=1e-6)


# Passive joints ---------------------------------------------------------------------------------


def pendulum(start: float, dynamics: str = "") -> Description:
    """A rod of ``ROD`` that hangs from a joint without a command interface."""
    body = link("rod", ROD.mass, f"0 0 {-ROD.length}", ROD.moment)
    swing = joint("swing", "world", "rod", "continuous", xyz="0 0 3", more=dynamics)
    return arm(body, swing, interfaces("swing", start=start))


def test_pendulums_period_and_energy_are_right_to_0_01_percent_for_60_s() -> None:
    """The period against the elliptic integral; the energy of the first swings and the last.

    Cycles have two physics steps.
    """
    amplitude, rate = 1.5, 100.0
    small = math.sqrt(ROD.inertia / ROD.load)
    period = 4.0 * small * float(ellipk(math.sin(amplitude / 2.0) ** 2))
    crossings, energies, before = [], [], amplitude
    with simulate(pendulum(amplitude), rate=rate) as simulation:
        assert simulation.robot.joints["swing"].position == amplitude
        for number, joints in enumerate(steps(simulation, 60.0)):
            angle, speed, _ = vars(joints["swing"]).values()
            if before < 0.0 <= angle:
                crossings.append((number + before / (before - angle)) / rate)
            energies.append(0.5 * ROD.inertia * speed**2 + ROD.load * (1.0 - math.cos(angle)))
            before = angle
    assert np.mean(np.diff(crossings)) == pytest.approx(period, rel=1e-4)
    count = round(5 * period * rate)  # it ripples within a swing
    first, last = np.mean(energies[:count]), np.mean(energies[-count:])
    assert last == pytest.approx(first, rel=1e-4)


def test_friction_of_a_passive_joint_is_coulombs() -> None:
    """Each half of a small swing is shorter than the last by 2 f / (m g l)."""
    friction, amplitude = 0.05, 0.1
    lost = 2.0 * friction / ROD.load
    with simulate(pendulum(amplitude, f'<dynamics friction="{friction}"/>')) as simulation:
        angles = np.array([joints["swing"].position for joints in steps(simulation, 6.0)])
    inner = angles[1:-1]
    turning = inner[(abs(inner) > abs(angles[:-2])) & (abs(inner) >= abs(angles[2:]))]
    expected = amplitude - lost * np.arange(1, 5)
    assert abs(turning[:4]) == pytest.approx(expected, abs=0.03 * amplitude)


# Gears ------------------------------------------------------------------------------------------


def test_mimic_joints_are_within_1e_4_while_moving() -> None:
    """Of both kinds, with multipliers and offsets, a chain of them, and one with tight limits."""
    wide = 'lower="-9" upper="9" effort="100" velocity="9"'
    tight = 'lower="-0.1" upper="0.1" effort="100" velocity="9"'
    laws = {  # leader, multiplier, offset, kind, limits
        "same": ("lead", 1.0, 0.0, "revolute", wide),
        "back": ("lead", -0.5, 0.3, "revolute", wide),
        "slide": ("lead", 0.2, 0.1, "prismatic", wide),
        "tight": ("lead", 2.0, 0.0, "revolute", tight),
        "next": ("back", 2.0, -0.4, "revolute", wide),
        "last": ("next", -0.1, 0.05, "prismatic", wide),
        "turn": ("rail", 3.0, 0.2, "revolute", wide),
        "push": ("rail", -1.0, 0.0, "prismatic", wide),
    }
    parts = [link("lead_body", 1.0, "0.1 0 0"), link("rail_body", 1.0)]
    parts += [joint("lead", "world", "lead_body", xyz="0 0 3", limits=wide)]
    parts += [joint("rail", "world", "rail_body", "prismatic", xyz="0 1 3", limits=wide)]
    for row, (name, (leader, multiplier, offset, kind, limits)) in enumerate(laws.items()):
        parts.append(link(f"{name}_body", 0.2, "0.05 0 0"))
        xyz, more = f"0 {row + 2} 3", mimic(leader, multiplier, offset)
        parts.append(joint(name, "world", f"{name}_body", kind, xyz=xyz, limits=limits, more=more))
    with simulate(arm(*parts), {"lead": 0.2}) as simulation:
        assert simulation.robot.joints["lead"].position == 0.2
        simulation.robot.move_to({"lead": 1.2, "rail": -0.4}, seconds=1.0)
        for joints in steps(simulation, 1.5):
            for name, (leader, multiplier, offset, *_) in laws.items():
                expected = multiplier * joints[leader].position + offset
                assert joints[name].position == pytest.approx(expected, abs=1e-4), name
        assert joints["lead"].position == pytest.approx(1.2, abs=1e-5)
        assert joints["rail"].position == pytest.approx(-0.4, abs=1e-5)
        assert not any(joints[name].effort for name in laws)


def test_a_strong_linkage_is_within_1e_3_rad_while_it_presses() -> None:
    """Robotiq's 2F-85 has 50 Nm in its maker's file; its links have 14 to 86 g."""
    description = robotiq(50.0)
    led = {joint.name: joint.mimic for joint in description.moving_joints if joint.mimic}
    with simulate(description, world=box_world(0.04, "0 0 0.02"), rate=100.0) as simulation:
        for name, goal in (("robotiq_85_left_knuckle_joint", 0.8), ("lift", 0.3)):
            simulation.robot.move_to({name: goal}, seconds=1.0)
            for joints in steps(simulation, 2.0):
                for follower, law in led.items():
                    expected = law.at(joints[law.joint].position)
                    assert joints[follower].position == pytest.approx(expected, abs=1e-3)
        assert joints["robotiq_85_left_knuckle_joint"].effort == pytest.approx(50.0, rel=1e-3)
        assert box_place(simulation)[2] == pytest.approx(320.0, abs=1.0)


# Grasps -----------------------------------------------------------------------------------------

# The Panda's hand points down, its fingers 25 and 325 mm above the ground at x = 0.5 m; rad.
PICKS = {"panda_joint2": 0.4703577, "panda_joint4": -2.3625967, "panda_joint6": 2.8329544}
LIFTS = {"panda_joint2": -0.1378678, "panda_joint4": -2.2330301, "panda_joint6": 2.0951623}
TURNED = {"panda_joint7": math.pi / 4.0}


def grasped(effort: float, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """How far the Panda moves a box of 50 g by lifting it 300 mm, and in the seconds after, mm."""
    starts = {**PICKS, **TURNED, "panda_finger_joint1": 0.04}
    world = box_world(xyz="0.5 0 0.025")
    with simulate(panda(effort), starts, world, rate=100.0) as simulation:
        start = box_place(simulation)
        simulation.robot.move_to({"panda_finger_joint1": 0.0}, seconds=0.5)
        simulation.run(1.0)
        assert simulation.robot.joints["panda_finger_joint1"].effort == pytest.approx(-effort)
        simulation.robot.move_to(LIFTS, seconds=2.0)
        simulation.run(2.2)
        at = field("position", simulation.robot.joints)
        model = RobotModel.from_description(public_arm(PANDA))
        hand = [
            dict(zip(model.links, model.link_poses(each), strict=True))["panda_hand"][:3]
            for each in ({**PICKS, **TURNED}, at)
        ]
        assert 1e3 * (hand[1] - hand[0]) == pytest.approx([0.0, 0.0, 300.0], abs=1e-3)
        lifted = box_place(simulation)
        simulation.run(seconds)
        return lifted - start, box_place(simulation) - lifted


@pytest.mark.parametrize(("effort", "holds"), [(0.6, True), (0.4, False)])
def test_box_falls_where_2_mu_f_is_less_than_m_g(effort: float, holds: bool) -> None:
    """Half of the motor's effort is the force F of each finger; the box weighs 0.49 N, mu is 1.

    The fingers press on while the arm moves, with all that their motor has.
    """
    moved, slipped = grasped(effort, 1.0)
    assert moved[2] == pytest.approx(300.0 if holds else 0.0, abs=1.0)
    assert slipped == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)


def test_fingers_of_1_g_hold_a_box_of_50_g() -> None:
    """As those of OpenManipulator-X: the motor behind them has the least inertia."""
    with simulate(two_fingers(0.001), {"left": 0.04}, box_world(), rate=100.0) as simulation:
        start = box_place(simulation)
        simulation.robot.move_to({"left": 0.0}, seconds=0.5)
        simulation.run(1.0)
        simulation.robot.move_to({"lift": 0.3}, seconds=2.0)
        simulation.run(2.5)
        assert box_place(simulation) - start == pytest.approx([0.0, 0.0, 300.0], abs=1.0)
        # The motors of palm, two fingers with 20 g each, and the box.
        weight = (0.5 + 2 * 0.02 + 0.05) * GRAVITY
        assert simulation.robot.joints["lift"].effort == pytest.approx(weight, rel=1e-6)


@pytest.mark.parametrize(
    ("mass", "beside", "holds"),
    [(1.1, 0.01, True), (0.9, 0.02, False)],
)
def test_a_box_gripped_beside_its_center_turns_where_soft_fingers_would_let_it(
    mass: float, beside: float, holds: bool
) -> None:
    """Where m g sqrt(1 + (d / r)^2) = 2 mu F, with F = 10 N and r = 8 mm: 1.27 kg, 0.76 kg."""
    block = link("box", mass, moment=mass * 0.05**2 / 6, shape=box("0.12 0.05 0.05"))
    world = arm(block, joint("free", "world", "box", "floating", xyz=f"{beside} 0 0.025"))
    with simulate(two_fingers(0.02), {"left": 0.045}, world, rate=100.0) as simulation:
        simulation.robot.move_to({"left": 0.0}, seconds=0.5)
        simulation.run(0.7)
        simulation.robot.move_to({"lift": 0.15}, seconds=1.5)
        simulation.run(2.5)
        pitch = abs(math.degrees(simulation.boxes["box"].pitch))
        assert pitch < 0.5 if holds else pitch > 10.0


# Starts -----------------------------------------------------------------------------------------


def test_initial_positions_hold_from_the_first_step() -> None:
    """The parameter overrides <ros2_control>; nothing falls before a controller has begun."""
    parts = []
    for row, name in enumerate(("plain", "file", "both")):
        parts += [
            link(f"{name}_body", 2.0, "0.5 0 0"),
            joint(name, "world", f"{name}_body", xyz=f"0 {row} 3"),
            interfaces(name, "position", None if name == "plain" else 0.4),
        ]
    with simulate(arm(*parts), {"both": -0.7, "plain": 0.2}) as simulation:
        expected = {"plain": 0.2, "file": 0.4, "both": -0.7}
        for joints in (simulation.robot.joints, *steps(simulation, 0.1)):
            assert field("position", joints) == pytest.approx(expected, abs=1e-9)


def test_what_no_controller_commands_is_held() -> None:
    """A joint with another command interface stays where it starts, and does not sag."""
    parts = [
        link("upper", 2.0, "0.5 0 0"),
        joint("shoulder", "world", "upper", xyz="0 0 3"),
        link("lower", 1.0, "0.5 0 0"),
        joint("elbow", "upper", "lower", xyz="1 0 0"),
        interfaces("shoulder", "position"),
        interfaces("elbow", "velocity", 0.3),
    ]
    with simulate(arm(*parts)) as simulation:
        simulation.run(1.0)
        assert list(simulation.robot.joints) == ["shoulder"]
        load = (2.0 * 0.5 + 1.0 * (1.0 + 0.5 * math.cos(0.3))) * GRAVITY
        assert simulation.robot.joints["shoulder"].effort == pytest.approx(-load, rel=1e-6)
        with pytest.raises(OneBotError, match='no joint "elbow" is commanded'):
            simulation.robot.move_to({"elbow": 0.0}, seconds=1.0)


IN_TABLE = "cannot stand there, .* link table of scene.urdf; .* other initial_positions"


def on_post(root: str) -> Description:
    """A post, 0.5 m high, with a rod that reaches 1 m forward near its top."""
    base = link(root, 1.0, shape=box("0.2 0.2 0.5", "0 0 0.25"))
    hand = link("hand", 2.0, "0.5 0 0", shape=box("1 0.05 0.05", "0.5 0 0"))
    elbow = joint("elbow", root, "hand", xyz="0 0 0.4")
    return parse_description(f'<robot name="arm">{base}{hand}{elbow}</robot>')


def table(x: float) -> Description:
    """A table, 0.7 m high and wide."""
    return scene(part("table", "0.7 0.7 0.7", f"{x} 0 0.35"))


def test_base_stands_on_what_is_below_it() -> None:
    """At the start, after a reset, and after a teleport; refused if only its hand is in it."""
    with simulate(on_post("base_link"), world=table(0.0)) as simulation:
        for _ in range(2):
            for x, height in ((0.0, 0.7), (9.0, 0.0), (0.1, 0.7)):
                simulation.robot.teleport(x, 0.0)
                assert simulation.robot.pose.z == pytest.approx(height, abs=2e-4)
            simulation.reset()
            assert simulation.robot.pose.z == pytest.approx(0.7, abs=2e-4)
        with pytest.raises(OneBotError, match=IN_TABLE):
            simulation.robot.teleport(-0.8, 0.0)
    for root, start in (("base_link", -1.5), ("world", -1.5)):
        with simulate(on_post(root), {"elbow": start}, table(0.8)) as simulation:
            assert simulation.robot.pose.z == 0.0


@pytest.mark.parametrize(("depth", "refused"), [(0.3, True), (0.02, True), (0.005, False)])
def test_an_arm_that_starts_deep_in_what_stands_still_is_refused(
    depth: float, refused: bool
) -> None:
    """Also if it hangs from the world; a base may be in it, and a little of it is pushed out."""
    description, world = on_post("world"), table(1.35 - depth)
    if refused:
        with pytest.raises(OneBotError, match=IN_TABLE):
            simulate(description, world=world)
        return
    with simulate(description, world=world) as simulation:
        simulation.run(1.0)
        assert simulation.robot.joints["elbow"].position == pytest.approx(0.0, abs=0.01)


def test_a_base_that_hangs_from_the_world_may_be_in_a_wall() -> None:
    with simulate(on_post("world"), {"elbow": -1.5}, table(-0.38)) as simulation:
        simulation.run(0.5)
        assert simulation.robot.joints["elbow"].position == pytest.approx(-1.5, abs=1e-6)


def test_a_live_description_of_a_standing_arm_stands_with_its_joints_as_they_are() -> None:
    """Where its hand would be in a table with the joint at its start, which is 0."""
    member = Member(on_post("base_link"), SimulationConfig(), controllers=[DEFAULT_CONTROLLER])
    with Fleet.from_members([member], scene=table(-0.8)) as fleet:
        [follower] = fleet.robots[0].followers.values()
        follower.start(TrajectoryGoal(("elbow",), (Waypoint(0.5, (-1.5,)),)))
        for _ in range(100):
            fleet.cycle()
        fleet.robots[0].teleport(PlanarPose(-1.6, 0.0, 0.0))
        fleet.replace(0, on_post("base_link"))
        [snapshot] = fleet.cycle()
        assert snapshot.joints.positions == pytest.approx((-1.5,), abs=1e-3)
        assert snapshot.pose.translation == pytest.approx((-1.6, 0.0, 0.0), abs=1e-9)


def test_each_of_several_robots_stands_on_its_own_held_joints() -> None:
    """Of one description, with legs that are held at other lengths."""
    legs = {"low": 0.1, "high": 0.3}
    foot = joint("leg", "base_link", "foot", "prismatic", "0 0 -1", limits='lower="0" upper="1"')
    turret = link("turret", 1.0) + joint("turn", "base_link", "turret", axis="0 0 1")
    parts = [link("base_link", 1.0), link("foot", 1.0, shape=box("0.2 0.2 0.2")), foot, turret]
    listed = interfaces("leg", "velocity") + interfaces("turn", "position")
    text = f'<robot name="arm">{"".join(parts)}{listed}</robot>'
    setups = {
        name: RobotSetup(x=2.0 * row, parameters={"initial_positions.leg": length})
        for row, (name, length) in enumerate(legs.items())
    }
    with Simulation(parse_description(text), robots=setups) as simulation:
        for name, robot in simulation.robots.items():
            assert robot.pose.z == pytest.approx(legs[name] + 0.1, abs=1e-9)


# Repetition, and arms that drive -----------------------------------------------------------------


def mobile() -> Description:
    """A robot on two wheels with an arm of two joints, 0.6 kg of its 4.5 kg."""
    parts = [
        link("upper", 0.3, "0 0 0.1"),
        joint("shoulder", "base_link", "upper", xyz="0 0 0.1"),
        link("lower", 0.3, "0 0 0.1"),
        joint("elbow", "upper", "lower", axis="1 0 0", xyz="0 0 0.2"),
    ]
    wheels = [control_support.wheel(side, y) for side, y in (("left", 0.15), ("right", -0.15))]
    return parse_description(control_support.urdf(*wheels, control_support.CASTER, *parts))


def trip(simulation: Simulation, *, arm_moves: bool = True) -> list[str]:
    """Every bit of where a robot is, by its odometry and truly, on a drive of 1.5 s."""
    robot = simulation.robot
    rows = []
    for cycle in range(round(1.5 / simulation.period)):
        robot.drive(0.4, 0.2)
        if cycle % 50 == 0 and arm_moves:
            robot.move_to({"shoulder": 0.6 - 0.01 * cycle, "elbow": 0.4}, seconds=0.6)
        simulation.run(simulation.period)
        rows.append(repr((robot.odometry, robot.pose, robot.joints)))
    return rows


def test_runs_and_resets_are_equal_to_the_bit() -> None:
    """Two simulations, one that was reset in motion, and a robot that was put back."""
    with simulate(mobile(), rate=100.0) as first, simulate(mobile(), rate=100.0) as second:
        expected = trip(first)
        assert trip(second) == expected
        second.reset()
        assert trip(second) == expected


def test_odometry_is_within_0_01_mm_of_that_without_the_arms_motion() -> None:
    """Driven 0.5 m on an arc; the arm is no heavier for the wheels than it is."""
    ends = []
    for moves in (True, False):
        with simulate(mobile(), rate=100.0) as simulation:
            trip(simulation, arm_moves=moves)
            ends.append((simulation.robot.odometry, simulation.robot.pose))
            assert simulation.robot.odometry.x > 0.3
    (moved, _), (still, _) = ends
    assert math.hypot(moved.x - still.x, moved.y - still.y) < 1e-5
    assert moved.yaw == pytest.approx(still.yaw, abs=1e-5)


def test_a_rail_of_30_m_is_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    """And the cart goes along it."""
    rail = link("rail", 1.0, shape=box("30 0.05 0.05"))
    limits = 'lower="-15" upper="15" effort="100" velocity="5"'
    cart = joint("slide", "rail", "cart", "prismatic", "1 0 0", "0 0 0.2", limits=limits)
    parts = rail, joint("glue", "world", "rail", "fixed", xyz="0 0 1"), link("cart", 1.0), cart
    with simulate(arm(*parts)) as simulation:
        simulation.robot.move_to({"slide": 12.0}, seconds=6.0)
        simulation.run(6.5)
        assert simulation.robot.joints["slide"].position == pytest.approx(12.0, abs=1e-6)
    [warning] = [text for text in caplog.messages if "large" in text]
    assert '<collision> of link "world" is 30 m large' in warning
