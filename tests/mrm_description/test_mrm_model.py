"""MRM is exactly the robot that its users know."""

import math

import pytest
import yaml

from onebot_description.description import load_description
from onebot_description.elements.packages import package_share
from onebot_description.elements.urdf import Box, Cylinder
from onebot_description.geometry.poses import Origin

SHARE = package_share("mrm_description")


@pytest.fixture(scope="module")
def mrm():
    return load_description(SHARE / "urdf/mrm.xacro")


def test_joint_is_exact(mrm):
    """One revolute joint about z on top of the box, with its limits."""
    assert mrm.link_names == ("base_link", "link1")
    assert mrm.warnings == ()
    [joint] = mrm.joints
    assert joint.name == "base_link__link_01"
    assert joint.kind == "revolute"
    assert (joint.parent, joint.child) == ("base_link", "link1")
    assert (joint.origin.xyz, joint.origin.rpy) == ((0.0, 0.0, 0.5), (0.0, 0.0, 0.0))
    assert joint.axis == (0.0, 0.0, 1.0)
    assert (joint.lower, joint.upper) == (-3.14, 3.14)
    assert (joint.velocity, joint.effort) == (0.5, 1000.0)


def test_shapes_are_exact(mrm):
    """A box of 1 m at the origin, and a cylinder on the joint; collision is what is seen."""
    for shapes in ([link.visuals for link in mrm.links], [link.collisions for link in mrm.links]):
        [[box], [cylinder]] = shapes
        assert (box.shape, box.origin) == (Box((1.0, 1.0, 1.0)), Origin())
        assert (cylinder.shape, cylinder.origin) == (Cylinder(0.35, 0.4), Origin((0.0, 0.0, 0.2)))


def test_inertias_are_those_of_the_solids(mrm):
    """Textbook moments of a cuboid and of a cylinder, about their centers."""
    base, link = (link.inertial for link in mrm.links)
    side, across = base.mass / 6.0, link.mass * (3 * 0.35**2 + 0.4**2) / 12
    along = link.mass * 0.35**2 / 2
    assert base.mass > 0 and base.inertia == pytest.approx((side, 0, 0, side, 0, side))
    assert link.mass > 0 and link.inertia == pytest.approx((across, 0, 0, across, 0, along))
    assert (base.origin, link.origin) == (Origin(), Origin((0.0, 0.0, 0.2)))


def test_its_motion_keeps_to_its_limits(mrm):
    """The sine that comes with it never asks for more than the joint can."""
    config = yaml.safe_load((SHARE / "config/joints.yaml").read_text())
    [section] = config.values()
    motion = section["ros__parameters"]["motions"]["base_link__link_01"]
    [joint] = mrm.joints
    assert motion["offset"] + motion["amplitude"] <= joint.upper
    assert 2 * math.pi * motion["frequency"] * motion["amplitude"] <= joint.velocity
