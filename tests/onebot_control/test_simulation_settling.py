"""A robot is placed at rest, tilted or not, or rejected with the reason."""

import logging
import math
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from onebot_control.physics.engine import Bullet, PhysicsSettings, engine
from onebot_control.physics.spawning import RobotSpawn
from onebot_description.description import parse_description
from onebot_description.elements.urdf import Box
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose, yaw_of
from tests.onebot_control.simulation_support import DRIVEN, LEFT, Simulation, robot, simulate

_QUICK = PhysicsSettings(settling=1.0, iterations=50)
_INERTIA = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'
_LIMIT = '<limit lower="-9" upper="9" effort="1" velocity="1"/>'


def _block(xyz="0 0 0", rpy="0 0 0", mass=1.0, joint='type="continuous"', limit=_LIMIT, arm=""):
    """A flat box at a pose in its link's frame, and a joint in its middle that has no shape."""
    body = f'<mass value="{mass}"/>{_INERTIA}</inertial>'
    return parse_description(
        f'<robot name="r"><link name="base"><inertial><origin xyz="{xyz}"/>{body}'
        f'<collision><origin xyz="{xyz}" rpy="{rpy}"/>'
        '<geometry><box size="0.4 0.4 0.1"/></geometry></collision></link>'
        f'<link name="arm"><inertial><mass value="0.01"/>{_INERTIA}</inertial>{arm}</link>'
        f'<joint name="j" {joint}><parent link="base"/><child link="arm"/><origin xyz="{xyz}"/>'
        f'<axis xyz="0 0 1"/>{limit}</joint></robot>',
        "block.urdf",
    )


def _stand(description, settings=_QUICK, **start):
    return simulate(description, ("j",), settings, **start)


@pytest.mark.parametrize("z", [0.7, 0.0, -0.7])
def test_the_lowest_point_touches_the_ground(z):
    """Wherever the root link's frame is: above it all, in the middle, or below the ground."""
    with _stand(_block(f"0 0 {z}")) as simulation:
        assert simulation.base_pose().translation == pytest.approx([0, 0, 0.05 - z], abs=1e-3)
        assert simulation.rest_pose.height == simulation.base_pose().translation[2]
        assert simulation.base_pose().rotation == pytest.approx([0, 0, 0, 1], abs=1e-3)


@pytest.mark.parametrize(("z", "depth"), [(0.7, 0.03), (-0.7, 0.001)])
def test_a_base_that_stands_still_stands_on_the_ground(z, depth, caplog):
    """Level, and without a word unless a link on it starts in the ground; "world" is not lifted."""
    ball = f'<origin xyz="0 0 {-0.03 - depth}"/><geometry><sphere radius="0.02"/></geometry>'
    description = _block(f"0 0 {z}", arm=f"<collision>{ball}</collision>")
    spawn = RobotSpawn(description, (), PlanarPose(1.0), fixed_base=True)
    with Simulation([spawn], _QUICK) as simulation:
        found = simulation.base_pose()
    assert found.translation == pytest.approx((1.0, 0.0, 0.05 - z), abs=1e-9)
    assert found.rotation == (0.0, 0.0, 0.0, 1.0)
    text = f'block.urdf: link "arm" starts {depth:g} m deep in the ground, '
    assert [text in message for message in caplog.messages] == [True] * (depth > 0.002)
    world = parse_description(description.urdf.replace('"base"', '"world"'))
    with Simulation([spawn._replace(description=world)], _QUICK) as simulation:
        assert simulation.base_pose().translation == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("xyz", "size", "reason"),
    [
        ("0 0 0", "0.4 0.3 940", "the robot would start at z = 470 m; is a <collision> or an"),
        ("0 0 49.95", "400 300 100", 'the <collision> of link "base" is 400 m large, including'),
        ("0 0 2000", "0.4 0.3 0.1", "the robot would start at z = -2000 m; is a <collision> or"),
    ],
)
def test_a_robot_in_millimeters_is_refused(xyz, size, reason):
    """Whether it would start high in the air, deep in the ground, or be as large as a hall."""
    description = _block(xyz)
    [collision] = description.links[0].collisions
    box = replace(collision, shape=Box(tuple(map(float, size.split()))))
    base = replace(description.links[0], collisions=(box,))
    with pytest.raises(OneBotError, match="^block.urdf: ") as caught:
        _stand(replace(description, links=(base, *description.links[1:])))
    assert reason in str(caught.value)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_robot_that_stands_tilted_is_set_down_tilted(sign):
    """Heading and place are those asked for; the tilt is its own, and w is above 0."""
    tilt = Rotation.from_euler("y", -30.0 * sign, degrees=True)
    with _stand(_block(rpy=f"0 {sign * math.radians(30)} 0"), x=2.0, y=-1.0, yaw=-4.0) as one:
        assert one.base_pose().translation == pytest.approx([2.0, -1.0, 0.05], abs=1e-3)
        for yaw in (-4.0, 0.5):
            expected = Rotation.from_euler("z", yaw) * tilt
            found = one.base_pose().rotation
            assert found == pytest.approx(expected.as_quat(canonical=True), abs=1e-2)
            assert found[3] > 0.0
            one.teleport(0.0, 0.0, 0.5)
        assert yaw_of(*one.rest_pose.tilt) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("rpy", [(52.0, 0.0), (0.0, -52.0)])
def test_a_tilt_above_45_degrees_has_toppled(rpy):
    roll, pitch = map(math.radians, rpy)
    with pytest.raises(OneBotError, match=r"^block.urdf: the robot topples over"):
        _stand(_block(rpy=f"{roll} {pitch} 0"))


def test_a_robot_that_does_not_stay_on_the_ground_is_refused():
    """It jumps: at 0 its leg is 3 cm beyond its limit, and PyBullet pushes it back at once."""
    sphere = '<geometry><sphere radius="0.02"/></geometry>'
    leg = f'<collision><origin xyz="0 0 -0.2"/>{sphere}</collision>'
    limit = '<limit lower="-3" upper="-0.03" effort="1" velocity="1"/>'
    description = _block(joint='type="prismatic"', limit=limit, arm=leg)
    with pytest.raises(
        OneBotError, match=r"^block.urdf: the robot does not stay on the ground .*z = "
    ):
        _stand(description, PhysicsSettings(settling=0.1))


@pytest.mark.parametrize(("mass", "arm"), [("1e300", "1"), ("1e-160", "1e-160")])
def test_a_robot_that_breaks_the_physics_is_refused(mass, arm):
    urdf = _block(mass=mass).urdf.replace('value="0.01"', f'value="{arm}"')
    with pytest.raises(OneBotError, match=r"^block.urdf: the robot does not stay .*masses"):
        _stand(parse_description(urdf, "block.urdf"))


def test_wheels_on_the_ground_give_no_warning(caplog):
    """Each of the driven is looked at; those that are not driven are not."""
    with caplog.at_level(logging.WARNING), simulate():
        assert caplog.records == []
    shape = r'(<link name="left_wheel">.*?)<collision>.*?</collision>'
    with caplog.at_level(logging.WARNING), simulate(robot(shape, r"\1", 1), driven=(LEFT,)):
        assert len([text for text in caplog.messages if "does not touch" in text]) == 1
    caplog.clear()
    with caplog.at_level(logging.WARNING), simulate(robot(shape, r"\1", 1), driven=DRIVEN[1:]):
        assert not [text for text in caplog.messages if "does not touch" in text]


def test_joints_stand_at_zero_whatever_they_did_while_settling(monkeypatch):
    """The caster swings while a robot falls onto it; the start is at 0 all the same.

    It is at rest once nothing moves, wherever the caster stands then.
    """
    description = robot('<origin xyz="-0.22 0 0"/>', '<origin xyz="-0.22 0.02 0.01"/>')
    steps, step = [], engine.stepSimulation
    monkeypatch.setattr(engine, "stepSimulation", lambda **world: steps.append(step(**world)))
    with simulate(description) as one:
        assert one.joint_states().positions == (0.0,) * 4
    assert 40 < len(steps) < 300


def test_the_ground_is_level_at_zero_with_friction_and_gravity():
    """As the settings say, once and downwards; the time step is that of the rate."""
    settings = PhysicsSettings(rate=500, gravity=3.5, friction=0.25, iterations=30)
    with closing(Bullet(settings)) as bullet:
        bullet.set_up()
        parameters = bullet.getPhysicsEngineParameters()
        found = [parameters["gravityAcceleration" + axis] for axis in "XYZ"]
        assert found == [0.0, 0.0, -3.5]
        assert parameters["fixedTimeStep"] == pytest.approx(1 / 500)
        assert parameters["numSolverIterations"] == 30
        assert bullet.getDynamicsInfo(bullet.ground, -1)[:2] == (0.0, 0.25)
        assert bullet.getBasePositionAndOrientation(bullet.ground) == ((0, 0, 0), (0, 0, 0, 1))


def test_each_body_gets_its_friction_and_no_damping():
    """What the URDF states, also of a fixed link; else the setting. Only <dynamics> dampens."""
    text = robot().urdf
    friction = '<contact><lateral_friction value="{}"/></contact>'
    for old, new in (
        ('<link name="lidar" />', f'<link name="lidar">{friction.format(0.25)}</link>'),
        ('<link name="right_wheel">', f'<link name="right_wheel">{friction.format(0)}'),
        ('<child link="caster_wheel" />', '<child link="caster_wheel" /><dynamics damping="0.5"/>'),
    ):
        text = text.replace(old, new)
    settings = PhysicsSettings(friction=0.75, settling=0.01)
    with simulate(parse_description(text), settings=settings) as simulation:
        body, bullet = simulation.parts.body, simulation.bullet
        rows = [-1, *simulation.parts.joints.values()]
        frictions = [bullet.getDynamicsInfo(body, row)[1] for row in rows]
        assert frictions == [0.25, 0.75, 0.0, 0.75, 0.75]
        assert [bullet.getJointInfo(body, row)[6] for row in rows[1:]] == [0, 0, 0, 0.5]


def test_a_robot_in_free_flight_is_not_slowed_down():
    """PyBullet would dampen it by 4 % a second; its frame's velocity is that of its own axes."""
    with _stand(_block("0 0 -0.7")) as simulation:
        body, bullet = simulation.parts.body, simulation.bullet
        bullet.setGravity(0, 0, 0)
        pose = [0.0, 0.0, 50.0], Rotation.from_euler("z", 0.5).as_quat().tolist()
        bullet.resetBasePositionAndOrientation(body, *pose)
        bullet.resetBaseVelocity(body, (3.0, 0, 0), (0, 0, 0.5))
        simulation.step([0.0], 0.5)
        linear, angular = bullet.getBaseVelocity(body)
        assert np.linalg.norm(linear) == pytest.approx(3.0, rel=1e-3)
        assert angular[2] == pytest.approx(0.5, rel=1e-2)
