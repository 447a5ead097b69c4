"""What touches a robot: where, with which force by hand calculation, and in any physics step."""

from collections import defaultdict
from pathlib import Path

import pytest

from onebot_control import Contact, OneBotError, RobotSetup, Simulation
from onebot_description.description import Description, parse_description
from tests.onebot_control.arm_models import box, joint, link

GRAVITY = 9.81
ROBOTS = Path(__file__).parents[1] / "robots"
DIFF_DRIVE, CUBE = ROBOTS / "diff_drive.urdf", ROBOTS / "meshes" / "cube.stl"
MASS, EFFORT, RADIUS = 4.0, 3.0, 0.06  # kg, Nm and m of that robot


def world(*parts: str) -> Description:
    return parse_description(f'<robot name="w"><link name="world"/>{"".join(parts)}</robot>')


def wall(name: str, size: str, xyz: str, friction: float = 0.0) -> str:
    contact = f'<contact><lateral_friction value="{friction}"/></contact>'
    shape = box(size).replace("</collision>", "</collision>" + contact)
    return link(name, shape=shape) + joint(f"to_{name}", "world", name, "fixed", xyz=xyz)


def crate(name: str, mass: float, size: str, xyz: str) -> str:
    """A movable box."""
    body = link(name, mass, moment=mass * 0.01, shape=box(size))
    return body + joint(f"to_{name}", "world", name, "floating", xyz=xyz)


def forces(contacts: list[Contact], *names: str) -> dict[tuple[str, ...], float]:
    """The sums of forces by these fields."""
    sums: dict[tuple[str, ...], float] = defaultdict(float)
    for contact in contacts:
        sums[tuple(getattr(contact, name) for name in names)] += contact.force
    return dict(sums)


def round_shape(kind: str) -> str:
    return f"<collision><geometry><{kind}/></geometry></collision>"


TABLE = "".join(
    [
        '<robot name="table">',
        link("base", 5.0, shape=box("0.1 0.1 0.4", "0 0 0.2")),
        link("left", 1.0, shape=box("0.2 0.4 0.02")),
        link("right", 1.0, shape=round_shape('cylinder radius="0.2" length="0.02"')),
        link("mesh", 1.0, shape=round_shape(f'mesh filename="{CUBE}" scale="0.2 0.2 0.02"')),
        joint("j1", "base", "left", "fixed", xyz="0 0.3 0.41"),
        joint("j2", "base", "right", "fixed", xyz="0 -0.3 0.41"),
        joint("j3", "right", "mesh", "fixed", xyz="0.4 0 0"),
        "</robot>",
    ]
)


def test_boxes_at_rest_weigh_m_g_on_the_links_that_carry_them():
    """All links are one rigid body in the physics; the box that is asleep weighs as much."""
    scene = world(
        crate("one", 2.0, "0.1 0.1 0.1", "0 0.3 0.475"),
        crate("two", 0.3, "0.1 0.1 0.1", "0.05 -0.3 0.475"),
        crate("three", 0.5, "0.02 0.02 0.02", "0 -0.4 0.435"),
        crate("four", 1.0, "0.1 0.1 0.1", "0.4 -0.3 0.5"),
        link("foot", shape=round_shape('cylinder radius="0.05" length="0.02"')),
        joint("to_foot", "four", "foot", "fixed", xyz="0 0 -0.06"),
    )
    with Simulation(parse_description(TABLE), world=scene) as simulation:
        robot = simulation.robot
        assert not robot.contacts and not robot.collided
        for seconds in (1.0, 4.0):
            simulation.run(seconds)
            weights = forces(robot.contacts, "link", "other", "other_link")
            assert weights == {
                ("left", "world", "one"): pytest.approx(2.0 * GRAVITY, rel=0.01),
                ("right", "world", "two"): pytest.approx(0.3 * GRAVITY, rel=0.01),
                ("right", "world", "three"): pytest.approx(0.5 * GRAVITY, rel=0.01),
                ("mesh", "world", "foot"): pytest.approx(GRAVITY, rel=0.01),
            }
        for contact in robot.contacts:
            assert contact.normal == pytest.approx((0.0, 0.0, -1.0), abs=0.01)
            height = 0.412 if contact.link == "mesh" else 0.42  # the cube's edge is 0.2 m
            assert contact.point[2] == pytest.approx(height, abs=1e-3)
        assert robot.collided  # they stand on it, not it on them


def test_a_tyre_that_is_fixed_to_its_wheel_is_named():
    """The wheel rolls on a thin cylinder, which is neither of them."""
    wheels = DIFF_DRIVE.read_text().split('<link name="left_wheel">')
    tyre = link("tyre", shape=round_shape('cylinder radius="0.06" length="0.03"'))
    tyre = tyre.replace("<collision>", '<collision><origin rpy="1.5707963267948966 0 0"/>')
    wheel, rest = wheels[1].split("<collision>", 1)
    rest = rest.split("</collision>", 1)[1]
    text = f'{wheels[0]}<link name="left_wheel">{wheel}{rest}'.replace(
        "</robot>", tyre + joint("tj", "left_wheel", "tyre", "fixed") + "</robot>"
    )
    with Simulation(parse_description(text)) as simulation:
        simulation.run(0.1)
        links = {contact.link for contact in simulation.robot.contacts}
        assert links == {"tyre", "right_wheel", "caster_wheel"}


def test_a_box_at_rest_on_a_robot_that_drives():
    """The robot is never asleep; it has its own weight and that of the box on the ground."""
    scene = world(crate("load", 0.5, "0.1 0.1 0.1", "-0.1 0 0.2"))
    with Simulation(DIFF_DRIVE, world=scene) as simulation:
        robot = simulation.robot
        for _ in range(2):
            simulation.run(5.0)
            assert forces(robot.contacts, "other") == {
                ("ground",): pytest.approx((MASS + 0.5) * GRAVITY, rel=0.01),
                ("world",): pytest.approx(0.5 * GRAVITY, rel=0.01),
            }


def test_a_robot_at_rest_weighs_m_g_and_has_touched_nothing():
    with Simulation(DIFF_DRIVE) as simulation:
        robot = simulation.robot
        simulation.run(1.0)
        assert {contact.link for contact in robot.contacts} == {
            *("left_wheel", "right_wheel", "caster_wheel")
        }
        assert forces(robot.contacts, "other") == {
            ("ground",): pytest.approx(MASS * GRAVITY, rel=0.01)
        }
        robot.drive(0.5, 0.5)
        simulation.run(until=lambda: robot.pose.x > 0.3)
        assert {contact.other for contact in robot.contacts} == {"ground"}
        assert not robot.collided


@pytest.mark.parametrize("effort", [EFFORT, 0.3])
def test_a_push_against_a_wall_is_as_strong_as_the_wheels(effort: float):
    """Their motors' efforts, or the friction of what they carry, whichever is less."""
    text = DIFF_DRIVE.read_text().replace('effort="3"', f'effort="{effort}"')
    scene = world(wall("wall", "0.1 2 1", "0.5 0 0.5"))  # the wheels are ahead of the base
    with Simulation(parse_description(text), world=scene) as simulation:
        robot = simulation.robot
        robot.drive(0.3)
        simulation.run(4.0)
        pressed = [contact for contact in robot.contacts if contact.other == "world"]
        carried = sum(
            contact.force
            for contact in robot.contacts
            if contact.link in ("left_wheel", "right_wheel") and contact.other == "ground"
        )
        limit = min(2.0 * effort / RADIUS, carried)
        assert forces(pressed, "other_link") == {("wall",): pytest.approx(limit, rel=0.05)}
        assert {contact.link for contact in pressed} <= {"left_wheel", "right_wheel"}
        assert all(contact.normal == pytest.approx((-1, 0, 0), abs=1e-3) for contact in pressed)
        assert all(contact.point[0] == pytest.approx(0.45, abs=1e-3) for contact in pressed)
        assert robot.collided
        # Apart again: a collision is of the past, a contact of the last cycle.
        robot.drive(-0.3)
        simulation.run(2.0)
        assert {contact.other for contact in robot.contacts} == {"ground"}
        assert robot.collided
        robot.teleport(0.0, 1.0)
        assert not robot.contacts and not robot.collided
        simulation.run(0.5)
        assert robot.contacts and not robot.collided
        simulation.reset()
        assert not robot.contacts and not robot.collided


def test_ramps_and_steps_carry_a_robot_and_walls_do_not():
    with Simulation(world="ramp") as simulation:
        robot = simulation.robot
        robot.drive(0.5)
        start = robot.pose.z
        simulation.run(until=lambda: robot.pose.z > start + 0.02, timeout=20.0)
        assert ("world",) in forces(robot.contacts, "other")
        assert not robot.collided


def test_a_robot_that_is_thrown_at_a_distant_wall_has_collided():
    """Nobody asks in between, and it is much faster than it can drive."""
    scene = world(wall("wall", "0.1 9 2", "6 0 1"))
    with Simulation(DIFF_DRIVE, world=scene) as simulation:
        robot = simulation.robot
        simulation.run(0.5)
        robot.push((150.0, 0.0, 0.0), 0.5)
        simulation.run(1.0)
        assert robot.pose.x < 5.95 and robot.collided


class _Spy:
    """Lists PyBullet's contact points after each physics step."""

    def __init__(self, simulation: Simulation) -> None:
        self._bullet = simulation._core.fleet.world.bullet
        self._step, self.steps = self._bullet.stepSimulation, list[list[tuple[int, float]]]()
        self._bullet.stepSimulation = self

    def __call__(self) -> None:
        self._step()
        points = self._bullet.getContactPoints(1)
        self.steps.append([(point[2], point[9]) for point in points if point[8] <= 1e-6 < point[9]])


def test_a_contact_is_of_any_physics_step_of_the_cycle():
    """At 10 Hz there are 20 steps; a robot that is pushed back leaves a crate before the last."""
    scene = world(crate("crate", 0.2, "0.1 0.3 0.1", "0.3 0 0.05"))
    with Simulation(DIFF_DRIVE, world=scene, parameters={"update_rate": 10}) as simulation:
        robot, spy = simulation.robot, _Spy(simulation)
        only_earlier = 0
        robot.drive(0.5)
        for number in range(25):
            if number == 20:
                robot.push((-100.0, 0.0, 0.0), 0.1)
            spy.steps.clear()
            simulation.step()
            assert len(spy.steps) == 20
            total = defaultdict(float)
            for step in spy.steps:
                for body, force in step:
                    total["ground" if body == 0 else "world"] += force / 20.0
            found = forces(robot.contacts, "other")
            assert {name: force for (name,), force in found.items()} == pytest.approx(dict(total))
            only_earlier += "world" in total and all(body == 0 for body, _ in spy.steps[-1])
        assert only_earlier > 0
        assert robot.collided


def test_robots_that_meet_name_each_other():
    """Each of two that push with the same force; the third has touched nothing."""
    robots = {
        "one": RobotSetup(model=DIFF_DRIVE),
        "two": RobotSetup(x=1.0, yaw=3.14159265, model=DIFF_DRIVE),
        "three": RobotSetup(y=2.0, model=DIFF_DRIVE),
    }
    with Simulation(robots=robots) as simulation:
        one, two, three = simulation.robots.values()
        for robot in (one, two, three):
            robot.drive(0.3)
        simulation.run(4.0)
        [own] = [contact for contact in one.contacts if contact.other != "ground"][:1]
        assert (own.link, own.other, own.other_link) == ("right_wheel", "two", "left_wheel")
        assert own.normal == pytest.approx((-1.0, 0.0, 0.0), abs=0.1)
        first, second = (forces(robot.contacts, "other") for robot in (one, two))
        assert first["two",] == pytest.approx(second["one",]) and first["two",] > 10.0
        assert one.collided and two.collided and not three.collided
        two.teleport(2.0, 0.0)
        assert one.collided and not two.collided


LIFT = 'lower="-0.1" upper="0.3" effort="200" velocity="1"'
FINGER = 'lower="-0.05" upper="0" effort="8" velocity="1"'
GRIPPER = "".join(
    [
        '<robot name="gripper">',
        link("base", 1.0, shape=box("0.2 0.2 0.02", "-0.3 0 0.01")),
        link("hand", 1.0),
        link("left_finger", 0.1),
        link("left_pad", 0.02, shape=box("0.02 0.01 0.05")),
        link("left_tip", 0.02, shape=box("0.01 0.01 0.02", "0 0 -0.035")),
        link("right_finger", 0.1, shape=box("0.02 0.01 0.05")),
        joint("lift", "base", "hand", "prismatic", "0 0 1", "0 0 0.07", limits=LIFT),
        joint("left", "hand", "left_finger", "prismatic", "0 1 0", "0 0.05 0", limits=FINGER),
        joint("right", "hand", "right_finger", "prismatic", "0 -1 0", "0 -0.05 0", limits=FINGER),
        joint("pad", "left_finger", "left_pad", "fixed"),
        joint("tip", "left_finger", "left_tip", "fixed"),
        "</robot>",
    ]
)


def test_a_gripper_presses_with_the_effort_of_its_fingers():
    scene = world(crate("cube", 0.1, "0.04 0.04 0.1", "0 0 0.05"))
    with Simulation(parse_description(GRIPPER), world=scene) as simulation:
        robot = simulation.robot
        simulation.run(0.5)
        assert not robot.collided and not robot.contacts
        robot.move_to({"left": -0.05, "right": -0.05}, seconds=0.5)
        simulation.run(1.5)
        pressed = forces(robot.contacts, "link", "other", "other_link")
        assert set(pressed) <= {
            *(("left_pad", "world", "cube"), ("left_tip", "world", "cube")),
            ("right_finger", "world", "cube"),
        }
        right = pressed["right_finger", "world", "cube"]
        assert right == pytest.approx(8.0, rel=0.05)
        assert sum(pressed.values()) == pytest.approx(2.0 * right, rel=0.05)
        assert robot.collided
        robot.move_to({"lift": 0.1}, seconds=0.5)
        simulation.run(1.0)
        assert simulation.boxes["cube"].z == pytest.approx(0.15, abs=2e-3)
        assert set(pressed) == set(forces(robot.contacts, "link", "other", "other_link"))


def test_the_ground_is_an_obstacle_for_an_arm():
    with Simulation(parse_description(GRIPPER)) as simulation:
        robot = simulation.robot
        simulation.run(0.1)
        assert not robot.collided
        robot.move_to({"lift": -0.1}, seconds=0.5)
        simulation.run(1.0)
        assert robot.collided
        assert set(forces(robot.contacts, "link", "other")) == {("left_tip", "ground")}


def test_recorded_contacts_change_nothing():
    """Bit by bit, whether somebody asks in each cycle or nobody does."""
    ends = []
    for asks in (False, True):
        with Simulation(world="maze") as simulation:
            robot = simulation.robot
            robot.drive(0.5)
            if asks:
                simulation.on_step(lambda robot=robot: robot.contacts)
            else:
                finish = simulation._core.fleet.finish
                simulation._core.fleet.finish = lambda recorded, finish=finish: finish()  # type: ignore[method-assign]
            simulation.run(5.0)
            ends.append((robot.pose, robot.joints, simulation.boxes))
    assert ends[0] == ends[1]


def test_contacts_of_a_closed_simulation():
    with Simulation() as simulation:
        simulation.run(0.1)
    with pytest.raises(OneBotError, match="closed"):
        simulation.robot.contacts  # noqa: B018
