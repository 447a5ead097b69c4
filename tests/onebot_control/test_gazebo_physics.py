"""What ``<gazebo>`` says of gravity and friction acts in the simulation."""

import math

import pytest

from onebot_control import Simulation
from onebot_description.description import Description, parse_description
from tests.onebot_control.arm_models import (
    GRAVITY,
    RATE,
    ROD,
    arm,
    box,
    box_world,
    joint,
    link,
    quintic,
    rod,
    simulate,
)
from tests.onebot_control.simulation_support import robot as onebot


def gazebo(description: Description, **inside: str) -> Description:
    """The description with ``<gazebo>`` blocks, by link."""
    blocks = [f'<gazebo reference="{name}">{text}</gazebo>' for name, text in inside.items()]
    return parse_description(description.urdf.replace("</robot>", f"{''.join(blocks)}</robot>"))


NONE = "<gravity>false</gravity>"


def test_a_rod_without_gravity_needs_the_effort_of_its_inertia() -> None:
    """None at rest, also after a restart, and J a in motion."""
    with simulate(gazebo(rod(), rod=NONE)) as simulation:
        for _ in range(2):
            simulation.run(0.5)
            assert simulation.robot.joints["elbow"].effort == pytest.approx(0.0, abs=1e-9)
            simulation.reset()
        simulation.robot.move_to({"elbow": -1.0}, seconds=1.0)
        before = simulation.robot.joints["elbow"]
        for number in range(1, round(RATE)):
            simulation.run(1.0 / RATE)
            now = simulation.robot.joints["elbow"]
            assert now.position == pytest.approx(-quintic(number / RATE), abs=1e-9)
            expected = ROD.inertia * RATE * (now.velocity - before.velocity)
            assert now.effort == pytest.approx(expected, abs=1e-5)
            before = now


@pytest.mark.parametrize("reference", ["rod", "tip"])
def test_gravity_acts_on_the_other_parts_of_a_body(reference: str) -> None:
    """Of a rod and a tip that is fixed to it, turned, each with a mass of its own."""
    body = arm(
        link("rod", ROD.mass, f"{ROD.length} 0 0", ROD.moment),
        joint("elbow", "world", "rod", xyz="0 0 3"),
        link("tip", 0.3),
        joint("glue", "rod", "tip", "fixed", xyz="1 0 0", rpy="1 2 3"),
    )
    with simulate(gazebo(body, **{reference: NONE})) as simulation:
        simulation.run(0.5)
        load = 0.3 * GRAVITY if reference == "rod" else ROD.load
        assert simulation.robot.joints["elbow"].effort == pytest.approx(-load, rel=1e-6)


def test_a_weightless_box_floats_until_it_is_pushed() -> None:
    """Beside one that falls."""
    world = gazebo(box_world(xyz="1 0 2"), box=NONE)
    with (
        simulate(rod(), world=world) as floating,
        simulate(rod(), world=box_world(xyz="1 0 2")) as falling,
    ):
        heights = []
        for simulation in (floating, falling):
            simulation.run(1.5)
            [place] = simulation.boxes.values()
            heights.append(place.z)
    assert heights == [pytest.approx(2.0, abs=1e-9), pytest.approx(0.025, abs=1e-3)]


@pytest.mark.parametrize("friction", [0.1, 0.3, None])
def test_a_box_slides_down_a_slope_by_its_mu1(friction: float | None) -> None:
    """By g (sin - mu cos) from rest; without one, friction of 1 holds it."""
    slope = math.radians(25.0)
    tilted = f"0 {slope} 0"
    ramp = link("ramp", shape=box("4 1 0.1"))
    glue = joint("glue", "world", "ramp", "fixed", xyz="0 0 3", rpy=tilted)
    start = f"{0.075 * math.sin(slope)} 0 {3.0 + 0.075 * math.cos(slope)}"
    cube = link("box", 0.05, moment=0.05 * 0.05**2 / 6, shape=box("0.05 0.05 0.05"))
    free = joint("free", "world", "box", "floating", xyz=start, rpy=tilted)
    world = arm(ramp, glue, cube, free)
    if friction is not None:
        world = gazebo(world, box=f"<mu1>{friction}</mu1><mu2>{friction}</mu2>")
    with simulate(rod(), world=world) as simulation:
        [before] = simulation.boxes.values()
        simulation.run(0.5)
        [after] = simulation.boxes.values()
    gain = GRAVITY * (math.sin(slope) - friction * math.cos(slope)) if friction is not None else 0.0
    assert math.dist((after.x, after.y, after.z), (before.x, before.y, before.z)) == pytest.approx(
        gain * 0.5**2 / 2.0, rel=0.03, abs=2e-3
    )


def test_wheels_casters_and_base_keep_their_friction() -> None:
    """A differential drive drives bit by bit as without ``<mu1>``."""
    plain = onebot()
    slippery = gazebo(plain, **dict.fromkeys(plain.link_names, "<mu1>0.05</mu1>"))
    poses = []
    for description in (plain, slippery):
        with Simulation(description) as simulation:
            simulation.robot.drive(0.4, 0.7)
            simulation.run(2.0)
            poses.append(simulation.robot.pose)
    assert poses[0] == poses[1]
