"""Links joined by fixed joints become one rigid body, and the URDF for PyBullet says the same."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from onebot_control.physics.physics_urdf import SkidAxle, physics_urdf, rigid_bodies
from onebot_description.description import parse_description
from onebot_description.errors import OneBotError
from onebot_description.model import RobotModel
from tests.random_robots import angles, robots, triples

_UNIT = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
_SOLID = f"{_UNIT}</inertial>"
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

positive = st.floats(0.125, 4.0).map(lambda value: round(value, 6))
masses = st.one_of(st.just(0.0), positive)
origins = st.tuples(triples, st.tuples(angles, angles, angles))
matrices = st.tuples(
    *[positive if name[1] == name[2] else st.floats(-0.5, 0.5) for name in _MOMENTS]
)
parts = st.lists(st.tuples(origins, origins, masses, matrices), min_size=1, max_size=4)


def _words(values):
    return " ".join(repr(float(value)) for value in values)


def _origin(pose):
    return f'<origin xyz="{_words(pose[0])}" rpy="{_words(pose[1])}"/>'


def _inertial(mass, moments, pose=((0, 0, 0), (0, 0, 0))):
    values = " ".join(f'{name}="{value!r}"' for name, value in zip(_MOMENTS, moments, strict=True))
    return f'<inertial>{_origin(pose)}<mass value="{mass!r}"/><inertia {values}/></inertial>'


def _matrix(pose):
    result = np.eye(4)
    result[:3, :3] = Rotation.from_euler("xyz", pose[1]).as_matrix()
    result[:3, 3] = pose[0]
    return result


def _tensor(moments):
    xx, xy, xz, yy, yz, zz = moments
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def origin(element):
    """The transform of what an element's <origin> says."""
    found = element.find("origin")
    xyz, rpy = ([float(word) for word in found.get(name).split()] for name in ("xyz", "rpy"))
    return _matrix((xyz, rpy))


def _pseudo_inertia(mass, center, tensor):
    """Integral of p p' dm with p = (x, y, z, 1), (4, 4): those of parts just add up."""
    center = np.asarray(center, float)
    result = np.zeros((4, 4))
    result[:3, :3] = np.trace(tensor) / 2.0 * np.eye(3) - tensor + mass * np.outer(center, center)
    result[:3, 3] = result[3, :3] = mass * center
    result[3, 3] = mass
    return result


def _robot(*inside, extra=""):
    """Links l0, l1, ... with these contents, each fixed to the one before; ``extra`` at the end."""
    links = "".join(f'<link name="l{row}">{text}</link>' for row, text in enumerate(inside))
    joints = "".join(
        f'<joint name="f{row}" type="fixed"><parent link="l{row}"/>'
        f'<child link="l{row + 1}"/></joint>'
        for row in range(len(inside) - 1)
    )
    return parse_description(f'<robot name="r">{links}{joints}{extra}</robot>', "r.urdf")


def _turning(kind="revolute", inside="", link="wheel", parent="l0", contents=_SOLID):
    """A link that moves, and its joint."""
    return (
        f'<link name="{link}">{contents}</link><joint name="to_{link}" type="{kind}">'
        f'<parent link="{parent}"/><child link="{link}"/>{inside}</joint>'
    )


def _only(description):
    (body,) = rigid_bodies(description).values()
    return body


def _text(description):
    return ElementTree.fromstring(physics_urdf(description, rigid_bodies(description), {}))


@given(parts)
def test_mass_center_and_inertia_add_up(parts):
    """A chain of turned links with turned inertials, some massless, weighs what its parts weigh."""
    text, pose, expected = '<link name="l0"/>', np.eye(4), np.zeros((4, 4))
    for row, (joint, inertial, mass, moments) in enumerate(parts):
        text += (
            f'<link name="l{row + 1}">{_inertial(mass, moments, inertial)}</link>'
            f'<joint name="f{row}" type="fixed"><parent link="l{row}"/>'
            f'<child link="l{row + 1}"/>{_origin(joint)}</joint>'
        )
        pose = pose @ _matrix(joint)
        where = pose @ _matrix(inertial)
        own = _pseudo_inertia(mass, (0, 0, 0), _tensor(moments))
        expected += where @ own @ where.T
    body = _only(parse_description(f'<robot name="r">{text}</robot>'))
    found = _pseudo_inertia(body.mass, body.center, body.inertia)
    assert body.link == "l0"
    np.testing.assert_allclose(found, expected, atol=1e-9 * (1 + np.abs(expected).max()))
    np.testing.assert_array_equal(body.inertia.shape, (3, 3))
    assert body.inertial.mass == body.mass and body.inertial.origin.xyz == tuple(body.center)
    assert body.inertial.inertia[:4] == (*body.inertia[0], body.inertia[1, 1])


def test_a_link_fixed_to_one_that_moves_is_part_of_that():
    extra = (
        '<link name="tyre"><inertial><mass value="3"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
        '<joint name="glue" type="fixed"><parent link="wheel"/><child link="tyre"/></joint>'
        + _turning("continuous")
    )
    bodies = rigid_bodies(_robot(_SOLID, extra=extra))
    assert {name: body.mass for name, body in bodies.items()} == {"l0": 1.0, "wheel": 4.0}


def _contact(value):
    return f'{_SOLID}<contact><lateral_friction value="{value}"/></contact>'


@pytest.mark.parametrize(
    ("contents", "friction"),
    [
        ((_SOLID,), None),
        ((_contact("0"),), 0.0),
        ((_contact("0"), _contact("0.5")), 0.0),
        ((_SOLID, _contact("0.5")), 0.5),
        ((f"{_SOLID}<contact><rolling_friction value='2'/></contact>",), None),
    ],
)
def test_the_least_friction_stated_is_the_bodys(contents, friction):
    assert _only(_robot(*contents)).friction == friction


_MOVED = "the simulation moves revolute, continuous, prismatic joints"
_MOMENTS_OF = ': link "l0" has the principal moments of inertia'


@pytest.mark.parametrize(
    ("contents", "extra", "text"),
    [
        (_SOLID, _turning("floating"), f':1: joint "to_wheel" is floating; {_MOVED}'),
        (_SOLID, _turning("planar"), f':1: joint "to_wheel" is planar; {_MOVED}'),
        ("", _turning("continuous"), ': link "l0" cannot move without a mass'),
        (_SOLID, _turning("continuous", contents=""), ': link "wheel" cannot move without a mass'),
        (_inertial(1.0, (0.0, 0, 0, 1.0, 0, 1.0)), "", f"{_MOMENTS_OF} 0, 1, 1 kg m^2"),
        (_inertial(1.0, (1.0, 2.0, 0, 1.0, 0, 2.0)), "", f"{_MOMENTS_OF} -1, 2, 3 kg m^2"),
    ],
)
def test_what_is_not_simulated_is_refused(contents, extra, text):
    """The message names file, line and part."""
    with pytest.raises(OneBotError) as caught:
        _text(_robot(contents, extra=extra))
    assert str(caught.value).startswith(f"r.urdf{text}")


def test_a_link_fixed_to_one_without_mass_lends_its_mass():
    assert len(_text(_robot("", _SOLID, extra=_turning("continuous"))).findall("link")) == 2


@given(robots(), st.data())
def test_the_reduced_robot_moves_as_the_whole_one(urdf, data):
    """Bodies and collisions are, at any positions, where the description has them."""
    shape = '<geometry><sphere radius="1"/></geometry>'
    poses = data.draw(st.lists(origins, min_size=9, max_size=9))
    for row, pose in enumerate(poses):
        inside = f"{_SOLID}<collision>{_origin(pose)}{shape}</collision>"
        urdf = urdf.replace(
            f'<link name="link_{row}" />', f'<link name="link_{row}">{inside}</link>'
        )
    whole = parse_description(urdf)
    bodies = rigid_bodies(whole)
    text = physics_urdf(whole, bodies, {})
    small = parse_description(text)
    assert small.link_names == tuple(str(row) for row in range(len(bodies)))
    assert [joint.name for joint in small.joints] == [str(row) for row in range(len(bodies) - 1)]
    model, reduced = RobotModel.from_description(whole), RobotModel.from_description(small)
    count = len(model.joints)
    q = np.array(data.draw(st.lists(st.floats(-3, 3), min_size=count, max_size=count)), float)
    expected = dict(zip(model.links, model.link_poses(q), strict=True))
    found = dict(zip(bodies, reduced.link_poses(q), strict=True))
    for link, pose in found.items():
        np.testing.assert_allclose(pose[:3], expected[link][:3], atol=1e-9)
        assert abs(pose[3:] @ expected[link][3:]) == pytest.approx(1.0, abs=1e-9)
    shapes = _shapes(small, reduced, q)
    np.testing.assert_allclose(shapes, _shapes(whole, model, q), atol=1e-8)


def _shapes(description, model, q):
    """Where a mark on each <collision> is, sorted: its origin, and a point ahead of each axis."""
    rows = []
    root = ElementTree.fromstring(description.urdf)
    for link, pose in zip(model.links, model.link_poses(q), strict=True):
        where = np.eye(4)
        where[:3, :3], where[:3, 3] = Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]
        element = root.find(f'link[@name="{link}"]')
        for collision in element.findall("collision"):
            at = collision.find("origin")
            own = tuple([float(w) for w in at.get(name).split()] for name in ("xyz", "rpy"))
            rows.append((where @ _matrix(own))[:3].ravel().tolist())
    return sorted([round(value, 6) + 0.0 for value in row] for row in rows)


@given(st.tuples(positive, positive, positive), st.tuples(angles, angles, angles))
def test_principal_axes_give_the_inertia_back(halves, rpy):
    """Moments in a right-handed frame of their own, which is turned, not mirrored."""
    a, b, c = halves
    pose = ((0.5, -0.25, 1.0), rpy)
    description = _robot(_inertial(2.0, (b + c, 0, 0, c + a, 0, a + b), pose))
    inertial = _text(description).find("link/inertial")
    where, inertia = origin(inertial), inertial.find("inertia")
    assert [inertia.get(name) for name in ("ixy", "ixz", "iyz")] == ["0"] * 3
    moments = np.diag([float(inertia.get(name)) for name in ("ixx", "iyy", "izz")])
    turn = _matrix(pose)[:3, :3]
    written = turn @ np.diag([b + c, c + a, a + b]) @ turn.T
    np.testing.assert_allclose(where[:3, :3] @ moments @ where[:3, :3].T, written, atol=1e-7)
    np.testing.assert_allclose(where[:3, 3], pose[0], atol=1e-12)
    assert float(inertial.find("mass").get("value")) == 2.0


def test_axes_as_written_are_kept(caplog):
    """An inertia without products keeps its frame, even where the moments are equal or unsorted."""
    edge = (1, 1e-12, 0, 1, 0, 1)
    for moments in ((3, 0, 0, 2, 0, 2), (1, 0, 0, 1, 0, 1), (2, 1e-13, 0, 3, 0, 4), edge):
        inertial = _text(_robot(_inertial(1.0, moments))).find("link/inertial")
        np.testing.assert_array_equal(origin(inertial), np.eye(4))
        values = [float(inertial.find("inertia").get(name)) for name in ("ixx", "iyy", "izz")]
        assert values == pytest.approx([moments[0], moments[3], moments[5]], rel=1e-12)
    products = _text(_robot(_inertial(1.0, (2, 1e-6, 0, 2, 0, 2)))).find("link/inertial")
    assert np.abs(origin(products) - np.eye(4)).max() > 0.1
    assert not caplog.records


def test_a_moment_that_is_somewhat_too_great_is_repaired(caplog):
    """As Panda's link4 has it: makers' numbers are sometimes rounded, or measured one by one."""
    moments = 0.00368, 0.0, 0.0, 0.00796, 0.0, 0.0127
    inertia = _text(_robot(_inertial(1.0, moments))).find("link/inertial/inertia")
    assert float(inertia.get("izz")) == pytest.approx(0.00368 + 0.00796, rel=1e-8)
    [record] = caplog.records
    assert "0.00368, 0.00796, 0.0127 kg m^2; the largest is simulated as 0.0116" in record.message


def test_the_hub_of_a_wheel_that_skids_slides_along_its_axle():
    """It is a hundredth as heavy, and stands where the wheel would; the wheel turns on it."""
    place = '<origin xyz="0 0.2 0"/><axis xyz="0 1 0"/>'
    description = _robot(_SOLID, extra=_turning("continuous", place))
    [joint] = description.joints
    text = _text(replace(description, joints=(SkidAxle(**vars(joint)),)))
    masses = {
        link.get("name"): link.find("inertial/mass").get("value") for link in text.iter("link")
    }
    assert masses == {"0": "1.0", "1": "1.0", "hub0": "0.01"}
    assert text.find('link[@name="hub0"]/inertial/inertia').get("ixx") == "0.01"
    slide, turn = text.findall("joint")
    ends = [[one.find(end).get("link") for end in ("parent", "child")] for one in (slide, turn)]
    assert ends == [["0", "hub0"], ["hub0", "1"]]
    assert [one.get("type") for one in (slide, turn)] == ["prismatic", "continuous"]
    assert [origin(one)[:3, 3].tolist() for one in (slide, turn)] == [[0.0, 0.2, 0.0], [0.0] * 3]
    assert {one.find("axis").get("xyz") for one in (slide, turn)} == {"0.0 1.0 0.0"}
    limit = slide.find("limit")
    assert float(limit.get("lower")) > float(limit.get("upper"))  # for PyBullet, without limits


def _limits(kind, inside):
    joint = _text(_robot(_SOLID, extra=_turning(kind, inside))).find("joint")
    return joint.find("limit").attrib, joint.find("dynamics")


def test_limits_and_dynamics_of_a_joint_are_kept():
    """Positions but for 1e-4 rad: at its limit a joint is held by its motor, not by a stop."""
    written = '<limit lower="-0.5" upper="0.75" effort="2" velocity="3"/>'
    dynamics = '<dynamics damping="0.25" friction="0.5"/>'
    limits, found = _limits("revolute", written + dynamics)
    assert limits == {"lower": "-0.5001", "upper": "0.7501", "effort": "2.0", "velocity": "3.0"}
    assert found.attrib == {"damping": "0.25", "friction": "0.5"}
    limits, found = _limits("continuous", written.replace('lower="-0.5" upper="0.75" ', ""))
    assert limits == {"effort": "2.0", "velocity": "3.0"}
    assert found is None
    assert _limits("continuous", "")[0] == {}
    assert _limits("continuous", written)[0] == {"effort": "2.0", "velocity": "3.0"}
    assert _limits("prismatic", written + "<dynamics/>")[1] is None
    assert _limits("continuous", '<dynamics damping="nan" friction="nan"/>')[1] is None
