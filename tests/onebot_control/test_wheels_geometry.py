"""Reading the drive's geometry from the description."""

from typing import Any

import numpy as np
import pytest

from onebot_control.drive.wheels.geometry import SideWheels, WheelGeometry, skid_separation
from onebot_control.drive_kinds import ControlConfig
from onebot_description.description import Description
from onebot_description.errors import OneBotError
from tests.onebot_control.control_support import config, robot, wheel

LEFT, RIGHT = ["left_wheel_joint"], ["right_wheel_joint"]


def geometry_of(description: Description, config: ControlConfig) -> WheelGeometry:
    """By the names and lengths of the parameters."""
    return config.geometry(config.wheels(description))


def test_axle_the_other_way_round() -> None:
    """A positive velocity of a wheel whose axis points to the right drives backward."""
    back = wheel("right", -0.2).replace('axis xyz="0 1 0"', 'axis xyz="0.0005 -1 0"')
    description = robot(wheel("left", 0.2), back)
    assert SideWheels(description, LEFT, RIGHT).geometry() == pytest.approx((0.4, 0.06), rel=1e-3)
    directions = SideWheels(description, LEFT, RIGHT).directions
    assert directions == {"left_wheel_joint": 1.0, "right_wheel_joint": -1.0}


def turned(part: str, origin: str, axis: str = "0 1 0") -> str:
    """A wheel with another place and axis of its joint."""
    place = part.index("<origin xyz")
    end = part.index("/>", place)
    return (part[:place] + f"<origin {origin}" + part[end:]).replace("0 1 0", axis)


@pytest.mark.parametrize(
    ("origins", "axis", "separation"),
    [
        # Wheels further ahead or lower are no further apart, nor are those of a base off center.
        (('xyz="0.5 0.4 -0.7"', 'xyz="-0.5 0.1 0.9"'), "0 1 0", 0.3),
        # As diffbot.xacro of ros_controllers has them, one ahead of the other.
        (('xyz="0.3 0.1 0"', 'xyz="-0.2 0.1 0"'), "0 1 0", 0.5),
        # A wheel whose joint is turned rolls about its own z axis, which is the left all the same.
        (tuple(f'xyz="0 {y} 0" rpy="-1.5707963 0 0"' for y in (0.2, -0.2)), "0 0 1", 0.4),
        (('xyz="0 0.2 0"', 'xyz="0 -0.2 0"'), "0.017 1 0", 0.4),  # off by rounding
    ],
)
def test_separation(origins: tuple[str, str], axis: str, separation: float) -> None:
    left, right = (
        turned(wheel(side, 0.0), origin, axis)
        for side, origin in zip(("left", "right"), origins, strict=True)
    )
    geometry = SideWheels(robot(left, right), LEFT, RIGHT).geometry()
    assert geometry == pytest.approx((separation, 0.06), rel=1e-3)


@pytest.mark.parametrize(
    ("axis", "side"),
    [("1 0 0", "left"), ("0 0 -1", "right"), ("0.02 -1 0", "left"), ("0 1 -0.018", "right")],
)
def test_axles_that_point_elsewhere(axis: str, side: str) -> None:
    """On either side; the error names joint, axis, and the frame it is seen from."""
    wheels = {"left": wheel("left", 0.2), "right": wheel("right", -0.2)}
    wheels[side] = wheels[side].replace("0 1 0", axis)
    with pytest.raises(OneBotError) as caught:
        SideWheels(robot(*wheels.values()), LEFT, RIGHT).geometry()
    text = f'joint "{side}_wheel_joint": its axis points to ({axis}) in the frame of base_link'
    assert text in str(caught.value)


def test_swapped_sides_are_told_with_their_places() -> None:
    """The means of both sides and the names of all wheels are in the error."""
    sides = {"left": -0.1, "left2": -0.2, "right": 0.4, "right2": 0.5}
    description = robot(*(wheel(side, y) for side, y in sides.items()))
    names = [[f"{side}_wheel_joint", f"{side}2_wheel_joint"] for side in ("left", "right")]
    with pytest.raises(OneBotError) as caught:
        SideWheels(description, *names).geometry()
    assert (
        "the left wheels (left_wheel_joint, left2_wheel_joint) are at y = -0.15 m, not left of the "
        "right ones (right_wheel_joint, right2_wheel_joint) at y = 0.45 m"
    ) in str(caught.value)


SPHERE, CYLINDER = '<sphere radius="0.1"/>', '<cylinder radius="0.2" length="0.02"/>'
BOX = '<box size="1 1 1"/>'
HUB = '<mesh filename="package://onebot_description/meshes/wheel.dae"/>'
BESIDE = f'{CYLINDER}</geometry><origin xyz="0.02 0 0"/></collision><collision><geometry>{BOX}'


def shapes(*collisions: str, visuals: tuple[str, ...] = ()) -> str:
    """A left wheel with any number of shapes."""
    part = wheel("left", 0.2, "XXX")
    for kind, chosen in (("collision", collisions), ("visual", visuals)):
        parts = (f"<{kind}><geometry>{shape}</geometry></{kind}>" for shape in chosen)
        part = part.replace("</inertial>", "</inertial>" + "".join(parts), 1)
    return part.replace("<collision><geometry>XXX</geometry></collision>", "", 1)


@pytest.mark.parametrize(
    ("collisions", "visuals", "radius"),
    [
        ((SPHERE,), (CYLINDER,), 0.1),
        ((), (SPHERE,), 0.1),
        ((BOX,), (CYLINDER,), 0.2),
        ((BOX, SPHERE), (), 0.1),
        ((SPHERE, CYLINDER), (), 0.2),
        ((HUB, SPHERE), (), 0.1),
        ((SPHERE, BESIDE), (), 0.1),
    ],
)
def test_which_shape_is_the_wheels(
    collisions: tuple[str, ...], visuals: tuple[str, ...], radius: float
) -> None:
    """Collision comes before visual; of the shapes round about the axle the largest counts."""
    other = wheel("right", -0.2, f'<sphere radius="{radius}"/>')
    description = robot(shapes(*collisions, visuals=visuals), other)
    assert SideWheels(description, LEFT, RIGHT).radius == radius


@pytest.mark.parametrize(("collisions", "visuals"), [((), ()), ((BOX,), (BOX,)), ((BESIDE,), ())])
def test_no_round_shape(collisions: tuple[str, ...], visuals: tuple[str, ...]) -> None:
    with pytest.raises(OneBotError) as caught:
        other = wheel("right", -0.2)
        SideWheels(robot(shapes(*collisions, visuals=visuals), other), LEFT, RIGHT).geometry()
    assert str(caught.value) == (
        'robot "bot", joint "left_wheel_joint": link "left_wheel" has no sphere, cylinder '
        "or round mesh that defines the wheel's radius; set wheel_radius (m)"
    )


@pytest.mark.parametrize(("other", "same"), [("0.0600009", True), ("0.0600011", False)])
def test_radii_are_the_same_to_a_micrometer(other: str, same: bool) -> None:
    big = wheel("right", -0.2, f'<sphere radius="{other}"/>')
    description = robot(wheel("left", 0.2), big)
    if same:
        assert SideWheels(description, LEFT, RIGHT).radius == 0.06
        return
    for sides in ((LEFT, RIGHT), (RIGHT, LEFT)):
        with pytest.raises(OneBotError, match="wheels of different radii"):
            _ = SideWheels(description, *sides).radius


def test_joints_of_each_side_are_checked() -> None:
    """All that are wrong are in the error; revolute and continuous ones turn, others do not."""
    slider = wheel("right", -0.2).replace("continuous", "prismatic")
    hinge = wheel("left", 0.2).replace("continuous", "revolute")
    limits = '<limit lower="-1" upper="1" effort="5" velocity="40"/>'
    parts = (part.replace('<limit effort="5" velocity="40"/>', limits) for part in (hinge, slider))
    description = robot(*parts)
    with pytest.raises(OneBotError) as caught:
        SideWheels(description, [*LEFT, "left_whel_joint"], RIGHT)
    lines = str(caught.value).splitlines()
    assert len(lines) == 2
    assert 'left_wheel_names: robot "bot" has no rotating joint "left_whel_joint"' in lines[0]
    assert 'did you mean "left_wheel_joint"? it has: left_wheel_joint' in lines[0]
    assert lines[1].startswith(
        'right_wheel_names: robot "bot" has no rotating joint "right_wheel_joint"'
    )


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({}, (0.3, 0.06)),
        ({"wheel_separation": 0.5, "wheel_radius": 0.2}, (0.5, 0.2)),
        ({"wheel_separation_multiplier": 2.0}, (0.3, 0.06)),
    ],
)
def test_parameters_override_the_description(
    values: dict[str, Any], expected: tuple[float, float]
) -> None:
    assert geometry_of(robot(), config(**values)) == pytest.approx(expected)


def test_what_a_parameter_gives_is_not_asked_of_the_description() -> None:
    """A robot with boxes for wheels, or with its wheels in one place, drives by parameters."""
    boxes = robot(wheel("left", 0.2, BOX), wheel("right", -0.2, BOX))
    assert geometry_of(boxes, config(wheel_radius=0.1)) == pytest.approx((0.4, 0.1))
    crossed = robot(wheel("left", -0.2), wheel("right", 0.2))
    assert geometry_of(crossed, config(wheel_separation=0.4)) == pytest.approx((0.4, 0.06))


def test_several_axles_skid() -> None:
    """The friction turns the robot less: by the wheelbase, and by where the mass is."""
    axles = (("front", 0.2), ("rear", -0.2))
    wheels = [
        wheel(f"{axle}_{side}", y).replace(f'xyz="0 {y} 0"', f'xyz="{x} {y} 0"')
        for axle, x in axles
        for side, y in (("left", 0.25), ("right", -0.25))
    ]
    lefts, rights = (
        [f"{axle}_{side}_wheel_joint" for axle, _ in axles] for side in ("left", "right")
    )
    assert 0.55 < SideWheels(robot(*wheels), lefts, rights).separation <= 0.5 + 0.4**2 / 0.5
    four = np.array([0.2, -0.2, 0.2, -0.2])
    assert skid_separation(0.5, four, 0.0) == pytest.approx(0.5 + 0.4**2 / 0.5)
    assert skid_separation(0.5, four + 3.0, 3.0) == pytest.approx(0.5 + 0.4**2 / 0.5)
    assert skid_separation(0.5, four / 4e5, 0.0) == 0.5
    assert skid_separation(0.5, four / 400.0, 0.0) == pytest.approx(0.5 + 1e-6 / 0.5, rel=1e-9)
    # On the rear axle alone it turns as on two wheels.
    assert skid_separation(0.5, four, -0.2) == pytest.approx(0.5, abs=1e-6)
    ahead = skid_separation(0.5, four, 0.05)
    assert ahead == pytest.approx(skid_separation(0.5, four, -0.05))
    assert 0.5 < ahead < 0.5 + 0.4**2 / 0.5
    six = np.array([0.2, 0.0, -0.2] * 2)
    assert 0.5 < skid_separation(0.5, six, 0.0) < 0.5 + 0.4**2 / 0.5
    assert skid_separation(0.5, np.zeros(4), 0.1) == 0.5
