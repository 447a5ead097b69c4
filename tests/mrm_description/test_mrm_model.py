"""MRM is exactly the robot that its users know."""

import math
from xml.etree import ElementTree

import pytest
import yaml

from onebot_description.description import load_description
from onebot_description.elements.packages import package_share

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


@pytest.mark.parametrize("kind", ["visual", "collision"])
def test_shapes_are_exact(mrm, kind):
    """A box of 1 m at the origin, and a cylinder on the joint; collision is what is seen."""
    base, link = ElementTree.fromstring(mrm.urdf).findall("link")
    box = base.find(f"{kind}/geometry/box")
    assert [float(side) for side in box.get("size").split()] == [1.0, 1.0, 1.0]
    assert base.find(f"{kind}/origin") is None
    cylinder = link.find(f"{kind}/geometry/cylinder")
    assert (float(cylinder.get("radius")), float(cylinder.get("length"))) == (0.35, 0.4)
    origin = link.find(f"{kind}/origin")
    assert [float(x) for x in origin.get("xyz").split()] == [0.0, 0.0, 0.2]


def test_inertias_are_those_of_the_solids(mrm):
    """Textbook moments of a cuboid and of a cylinder, about their centres."""
    base, link = ElementTree.fromstring(mrm.urdf).findall("link")

    def moments(element):
        mass = float(element.find("inertial/mass").get("value"))
        inertia = element.find("inertial/inertia")
        return mass, [float(inertia.get(name)) for name in ("ixx", "iyy", "izz")]

    mass, (ixx, iyy, izz) = moments(base)
    assert mass > 0 and (ixx, iyy, izz) == pytest.approx([mass / 6.0] * 3)
    mass, (ixx, iyy, izz) = moments(link)
    assert ixx == iyy == pytest.approx(mass * (3 * 0.35**2 + 0.4**2) / 12)
    assert izz == pytest.approx(mass * 0.35**2 / 2)
    origin = link.find("inertial/origin")
    assert [float(x) for x in origin.get("xyz").split()] == [0.0, 0.0, 0.2]


def test_its_motion_keeps_to_its_limits(mrm):
    """The sine that comes with it never asks for more than the joint can."""
    config = yaml.safe_load((SHARE / "config/joints.yaml").read_text())
    [section] = config.values()
    motion = section["ros__parameters"]["motions"]["base_link__link_01"]
    [joint] = mrm.joints
    assert motion["offset"] + motion["amplitude"] <= joint.upper
    assert 2 * math.pi * motion["frequency"] * motion["amplitude"] <= joint.velocity


def test_its_view_is_the_old_config_rviz():
    """Fixed frame base_link, axes with names, the model without its collision, a joint plot."""
    view = yaml.safe_load((SHARE / "config/view.yaml").read_text())
    assert view["fixed_frame"] == "base_link"
    assert view["axes"]["visible"] and view["axes"]["names"]
    assert view["collision"] is False
    assert view["joint_plot"]["positions"] is True
