"""Reading the drive's geometry from the description."""

import pytest

from onebot_control.wheel_geometry import wheel_geometry
from onebot_description.errors import OneBotError
from tests.onebot_control.control_support import robot, wheel

LEFT, RIGHT = ["left_wheel_joint"], ["right_wheel_joint"]


def test_separation_and_radius_are_read() -> None:
    """They come from the wheels' poses and their collision shapes."""
    assert wheel_geometry(robot(), LEFT, RIGHT) == pytest.approx((0.3, 0.06))


def test_cylinders_are_wheels_too() -> None:
    """A cylinder's radius counts as a sphere's does."""
    shape = '<cylinder radius="0.1" length="0.02"/>'
    description = robot(wheel("left", 0.2, shape), wheel("right", -0.2, shape))
    assert wheel_geometry(description, LEFT, RIGHT) == pytest.approx((0.4, 0.1))


def test_several_wheels_a_side_are_averaged() -> None:
    """The separation is between the means of the sides."""
    sides = {"left": 0.2, "right": -0.2, "left2": 0.3, "right2": -0.3}
    description = robot(*(wheel(side, y) for side, y in sides.items()))
    names = ["left_wheel_joint", "left2_wheel_joint"], ["right_wheel_joint", "right2_wheel_joint"]
    assert wheel_geometry(description, *names).separation == pytest.approx(0.5)


def test_joint_the_robot_lacks() -> None:
    """The error names it, the nearest one, and those there are."""
    with pytest.raises(OneBotError) as caught:
        wheel_geometry(robot(), ["left_whel_joint"], RIGHT)
    message = str(caught.value)
    assert 'left_wheel_names: robot "bot" has no joint "left_whel_joint" that turns' in message
    assert 'did you mean "left_wheel_joint"? it has: left_wheel_joint, right_wheel_joint' in message


def test_fixed_joint_is_no_wheel() -> None:
    """A joint that does not turn is refused, though the robot has it."""
    with pytest.raises(OneBotError, match='no joint "caster_joint" that turns'):
        wheel_geometry(robot(), ["caster_joint"], RIGHT)


def test_swapped_sides() -> None:
    """Left wheels on the right are an error, with the remedy."""
    with pytest.raises(OneBotError, match="swap left_wheel_names and right_wheel_names"):
        wheel_geometry(robot(), RIGHT, LEFT)


def test_axle_the_wrong_way_round() -> None:
    """An axis to the right would drive backward: an error that says so."""
    back = wheel("right", -0.2).replace('axis xyz="0 1 0"', 'axis xyz="0 -1 0"')
    with pytest.raises(OneBotError, match=r"right_wheel_joint.*\(0 -1 0\).*must point to the left"):
        wheel_geometry(robot(wheel("left", 0.2), back), LEFT, RIGHT)


def test_wheels_of_different_radii() -> None:
    """Both radii are named, and what to set."""
    big = wheel("right", -0.2, '<sphere radius="0.1"/>')
    with pytest.raises(OneBotError, match=r"0\.06 m, right_wheel_joint 0\.1 m.*set wheel_radius"):
        wheel_geometry(robot(wheel("left", 0.2), big), LEFT, RIGHT)


def test_wheel_without_round_shape() -> None:
    """A box has no radius: the parameter to set is named."""
    box = wheel("right", -0.2, '<box size="0.1 0.1 0.1"/>')
    with pytest.raises(OneBotError, match='link "right_wheel" has no sphere.*set wheel_radius'):
        wheel_geometry(robot(wheel("left", 0.2), box), LEFT, RIGHT)
