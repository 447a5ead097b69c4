"""The model's transforms are those an independent reader of the same URDF finds."""

import dataclasses
import io

import numpy as np
import pytest
import yourdfpy
from hypothesis import given
from hypothesis import strategies as st

from onebot_description.description import Mimic, parse_description
from onebot_description.errors import OneBotError
from onebot_description.geometry.matrices import of_poses
from onebot_description.model import RobotModel
from tests.random_robots import chain, robots


def _peer(urdf):
    """Read by yourdfpy, with axes of unit length, as KDL takes them; a text's may be 1e-6 off."""
    peer = yourdfpy.URDF.load(io.BytesIO(urdf.encode()), load_meshes=False, build_scene_graph=True)
    for joint in peer.robot.joints:
        joint.axis = joint.axis / np.linalg.norm(joint.axis)
    return peer


@given(robots(), st.data())
def test_joint_transforms_equal_yourdfpys(urdf, data):
    model = RobotModel.from_description(parse_description(urdf))
    peer = _peer(parse_description(urdf).urdf)
    free = [j for j in model.joints if peer.joint_map[j].mimic is None]
    positions = {j: data.draw(st.floats(-3, 3), label=j) for j in free}
    q = model.positions(positions)
    for row, name in enumerate(model.joints):
        # yourdfpy knows no chains of mimics: give it the position, not the rule.
        joint = dataclasses.replace(peer.joint_map[name], mimic=None)
        expected, _ = peer._forward_kinematics_joint(joint, q[row])
        actual = of_poses(model.moving.transforms(q))[row]
        np.testing.assert_allclose(actual, expected, atol=1e-9)
    for row, child in enumerate(model.fixed.children):
        joint = next(j for j in peer.robot.joints if j.child == child)
        expected, _ = peer._forward_kinematics_joint(joint)
        np.testing.assert_allclose(of_poses(model.fixed.constant)[row], expected, atol=1e-9)


@given(robots(kinds=("fixed", "revolute", "prismatic", "continuous")), st.data())
def test_link_poses_are_the_chain_of_transforms(urdf, data):
    model = RobotModel.from_description(parse_description(urdf))
    size = len(model.joints)
    batch = np.array(data.draw(st.lists(st.floats(-3, 3), min_size=3 * size, max_size=3 * size)))
    poses = of_poses(model.link_poses(batch.reshape(3, size)))
    steps = of_poses(model.moving.transforms(batch.reshape(3, size)))
    fixed = np.broadcast_to(of_poses(model.fixed.constant), (3, len(model.fixed.children), 4, 4))
    edges = [*zip(model.moving.parents, model.moving.children, steps.swapaxes(0, 1), strict=True)]
    edges += [*zip(model.fixed.parents, model.fixed.children, fixed.swapaxes(0, 1), strict=True)]
    assert len(edges) == len(model.links) - 1
    for parent, child, step in edges:
        expected = poses[:, model.links.index(parent)] @ step
        np.testing.assert_allclose(poses[:, model.links.index(child)], expected, atol=1e-9)
    root = poses[:, model.links.index(model.root_link)]
    np.testing.assert_array_equal(root, np.broadcast_to(np.eye(4), root.shape))


@given(robots(kinds=("fixed", "revolute", "prismatic", "continuous")), st.data())
def test_the_jacobian_is_the_derivative_of_the_link_poses(urdf, data):
    model = RobotModel.from_description(parse_description(urdf))
    size, step = len(model.joints), 1e-6
    values = st.lists(st.floats(-3, 3), min_size=2 * size, max_size=2 * size)
    batch = np.array(data.draw(values)).reshape(2, size)
    for row, link in enumerate(model.links):
        jacobians = model.jacobian(link, batch)
        assert jacobians.shape == (2, 6, size)
        for joint, change in enumerate(step * np.eye(size)):
            after, before = (
                of_poses(model.link_poses(batch + each))[:, row] for each in (change, -change)
            )
            rates = (after - before) / (2.0 * step)
            linear, angular = jacobians[:, :3, joint], jacobians[:, 3:, joint]
            np.testing.assert_allclose(rates[:, :3, 3], linear, atol=1e-6)
            spin = rates[:, :3, :3] @ np.swapaxes(after + before, -1, -2)[:, :3, :3] / 2.0
            found = np.stack((spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]), axis=-1)
            np.testing.assert_allclose(found, angular, atol=1e-6)
    with pytest.raises(OneBotError, match='has no link "nowhere"'):
        model.jacobian("nowhere", batch)


def _formula(joints, q):
    """The transforms as robot_model's docstring has them."""
    half = np.asarray(q * joints.half_turns, np.longdouble)[..., None]
    translations = joints.constant[:, :3] + joints.slide * q[..., None]
    rotations = joints.constant[:, 3:] * np.cos(half) + joints.sine * np.sin(half)
    return np.concatenate((translations, rotations), axis=-1).astype(float)


@given(robots(), st.data())
def test_batches_follow_the_formula(urdf, data):
    model = RobotModel.from_description(parse_description(urdf))
    size = len(model.joints)
    numbers = data.draw(st.lists(st.floats(-4, 4), min_size=6 * size, max_size=6 * size))
    for shape in ((2, 3, size), (6, size)):
        q = np.array(numbers, float).reshape(shape)
        values = np.concatenate(model.transforms(q), axis=-1)
        np.testing.assert_allclose(values, _formula(model.moving, q), rtol=0, atol=1e-14)
        assert model.link_poses(q).shape == (*shape[:-1], len(model.links), 7)
    if size:
        view = np.frombuffer(b"1234" + q[0].tobytes(), "<f8", size, 4)
        np.testing.assert_array_equal(model.link_poses(view), model.link_poses(q[0]))


def test_sines_of_any_angle():
    joints = RobotModel.from_description(parse_description(chain(7))).moving
    random = np.random.default_rng(3)
    quarters = np.arange(-40, 41) * np.pi / 2
    near = np.concatenate([np.nextafter(quarters, way) for way in (-np.inf, 0.0, np.inf)])
    angles = np.concatenate(
        (near, random.uniform(-4, 4, 1000), random.uniform(-1, 1, 1000) * 2.0**18, [1e22, -1e99])
    )
    for first in range(len(angles) - 6):
        half = angles[first : first + 7]
        exact = [np.sin(half.astype(np.longdouble)), np.cos(half.astype(np.longdouble))]
        sine, cosine = (numbers.astype(float)[:, None] for numbers in exact)
        expected = joints.constant[:, 3:] * cosine + joints.sine * sine
        assert np.abs(joints.transforms(2.0 * half)[:, 3:] - expected).max() < 4e-16


_ARM = """<robot name="arm"><link name="base"/><link name="a"/><link name="b"/><link name="c"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="a"/>
<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><axis xyz="0 0 2"/>
<limit lower="-1" upper="2" effort="1" velocity="3"/></joint>
<joint name="slide" type="prismatic"><parent link="a"/><child link="b"/>
<origin xyz="0 0 1" rpy="0 0 1.5707963267948966"/><axis xyz="-4 0 0"/>
<limit lower="-0.5" upper="0.25" effort="1" velocity="4"/></joint>
<joint name="spin" type="continuous"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/>
</joint></robot>"""


def test_limits_are_the_joints_own():
    model = RobotModel.from_description(parse_description(_ARM))
    np.testing.assert_array_equal(model.lower, [-1.0, -0.5, -np.inf])
    np.testing.assert_array_equal(model.upper, [2.0, 0.25, np.inf])


def test_rows_taken_are_those_joints_in_that_order():
    moving = RobotModel.from_description(parse_description(_ARM)).moving
    q = np.array([0.3, -0.4, 0.5])
    for rows in ([2, 0], [1], [0, 2, 1], []):
        taken = moving.take(rows)
        assert taken.children == tuple(moving.children[row] for row in rows)
        assert taken.parents == tuple(moving.parents[row] for row in rows)
        np.testing.assert_array_equal(taken.transforms(q[rows]), moving.transforms(q)[rows])


def _mimic_chain(*rules):
    """joint_0 follows joint_1, which follows joint_2, ..., by these multipliers and offsets."""
    urdf = chain(len(rules) + 1)
    for row, (multiplier, offset) in enumerate(rules):
        name = f'name="joint_{row}" type="revolute">'
        tag = f'<mimic joint="joint_{row + 1}" multiplier="{multiplier!r}" offset="{offset!r}"/>'
        urdf = urdf.replace(name, name + tag)
    return RobotModel.from_description(parse_description(urdf))


_number = st.floats(-2.0, 2.0)


@given(st.lists(st.tuples(_number, _number), min_size=1, max_size=4), _number)
def test_a_chain_of_mimics_is_folded_from_its_leader(rules, leader):
    model = _mimic_chain(*rules)
    q = model.positions({f"joint_{len(rules)}": leader})
    assert q[-1] == leader
    for row, (multiplier, offset) in enumerate(rules):
        assert q[row] == pytest.approx(multiplier * q[row + 1] + offset, abs=1e-9)


def test_who_determines_a_joint():
    """Itself if it is given, else the first given one that it follows; None if there is none."""
    model = _mimic_chain((2.0, 0.5), (-1.0, 0.25))
    assert model.followers({"joint_0": 0})["joint_0"] == Mimic("joint_0", 1.0, 0.0)
    assert model.followers({"joint_1": 0, "joint_2": 0})["joint_0"] == Mimic("joint_1", 2.0, 0.5)
    assert model.followers({"joint_2": 0})["joint_0"] == Mimic("joint_2", -2.0, 1.0)
    assert "joint_0" not in model.followers({})
    assert "joint_2" not in model.followers({"joint_0": 0, "joint_1": 0})


def test_what_nothing_determines_stands_at_zero_and_its_followers_at_their_offset():
    model = _mimic_chain((2.0, 0.5), (-1.0, 0.25))
    np.testing.assert_allclose(model.positions({}), [1.0, 0.25, 0.0])
    np.testing.assert_allclose(model.positions({"joint_0": 3.0}), [3.0, 0.25, 0.0])
    np.testing.assert_allclose(model.positions({"joint_1": 1.0}), [2.5, 1.0, 0.0])


def test_unknown_joint_and_wrong_size_are_named():
    model = RobotModel.from_description(parse_description(chain(2)))
    with pytest.raises(OneBotError, match=r'"joint_9".*joint_0, joint_1'):
        model.transforms({"joint_9": 1.0})
    with pytest.raises(OneBotError, match=r"2 moving joints.*\(\.\.\., 2\), not \(3,\)"):
        model.transforms([1.0, 2.0, 3.0])


GRIPPER = """<robot name="gripper">
  <link name="palm"/><link name="left"/><link name="right"/><link name="lid"/>
  <joint name="left_slide" type="prismatic">
    <parent link="palm"/><child link="left"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.1" effort="1" velocity="1"/>
  </joint>
  <joint name="right_slide" type="prismatic">
    <parent link="palm"/><child link="right"/><axis xyz="0 -1 0"/>
    <limit lower="0" upper="0.05" effort="1" velocity="1"/>
    <mimic joint="left_slide" multiplier="1.0" offset="0.0"/>
  </joint>
  <joint name="lid_hinge" type="revolute">
    <parent link="palm"/><child link="lid"/><axis xyz="0 0 1"/>
    <limit lower="0.5" upper="1.5" effort="1" velocity="1"/>
  </joint>
</robot>"""


def resting(**given):
    model = RobotModel.from_description(parse_description(GRIPPER))
    return dict(zip(model.joints, model.pose(given).tolist(), strict=True))


def test_joints_rest_at_zero_or_in_the_middle_of_their_range():
    """As joint_state_publisher has it; one that follows another needs no position of its own."""
    assert resting() == {"left_slide": 0.0, "right_slide": 0.0, "lid_hinge": 1.0}
    given = {"left_slide": 0.03, "lid_hinge": 0.5}
    assert resting(**given) == {**given, "right_slide": 0.03}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"left_slid": 0.1}, ['no moving joint "left_slid"', 'did you mean "left_slide"?']),
        ({"right_slide": 0.01}, ['joint "right_slide" follows joint "left_slide"']),
        ({"lid_hinge": 0.4}, ['joint "lid_hinge": 0.4 is beyond its limits, 0.5 to 1.5']),
        ({"lid_hinge": 2.0}, ['joint "lid_hinge": 2 is beyond its limits, 0.5 to 1.5']),
        ({"lid_hinge": float("nan")}, ['joint "lid_hinge": nan is beyond its limits']),
        ({"left_slide": 0.08}, ['joint "right_slide": 0.08 is beyond its limits, 0 to 0.05']),
    ],
)
def test_a_wrong_pose_is_explained(given, words):
    """What is wrong, and what would be right."""
    with pytest.raises(OneBotError) as caught:
        resting(**given)
    for word in words:
        assert word in str(caught.value)
