"""Simulation, the way in from Python: equal to the bit, exact, and clear about mistakes."""

import gc
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from onebot_control import OneBotError, RobotSetup, SimulatedRobot, Simulation
from onebot_control.sensing.surroundings import VisibleSurfaces
from onebot_control.simulation import ONEBOT
from onebot_description.description import parse_description
from tests.onebot_control.control_support import urdf

ROBOTS = Path(__file__).parents[1] / "robots"
DIFF_DRIVE = ROBOTS / "diff_drive.urdf"
BOX = """<robot name="w"><link name="world"/>
  <link name="box"><visual><geometry><box size="1 4 1"/></geometry></visual>
    <collision><geometry><box size="1 4 1"/></geometry></collision></link>
  <joint name="j" type="fixed"><parent link="world"/><child link="box"/><origin xyz="3 0 0.5"/>
  </joint></robot>"""


def observed(robot: SimulatedRobot) -> list[Any]:
    """All that can be known of a robot, as bytes and numbers."""
    imu = robot.imu()
    assert imu.orientation is not None
    arrays = [robot.scan().ranges, robot.image(), robot.depth(), robot.points("camera")]
    arrays += [imu.orientation, imu.angular_velocity, imu.linear_acceleration]
    values = [robot.pose, robot.twist, robot.odometry, robot.joints]
    return values + [array.tobytes() for array in arrays]


def drive(simulation: Simulation) -> list[Any]:
    """Drive to a wall of the maze, and against it; what is observed on the way."""
    robot = simulation.robot
    found = [observed(robot)]
    for linear, angular, seconds in ((0.5, 0.0, 1.0), (0.4, 0.8, 1.53), (1.0, 0.0, 2.0)):
        robot.drive(linear, angular)
        simulation.run(seconds)
        found.append(observed(robot))
    return found


def test_after_a_reset_all_equals_a_new_simulation():
    with Simulation(world="maze", sensors=True, seed=7) as first:
        began = drive(first)
        first.reset()
        assert first.time == 0.0
        again = drive(first)
        first.reset(seed=8)
        otherwise = drive(first)
    with Simulation(world="maze", sensors=True, seed=8) as second:
        anew = drive(second)
    assert began == again
    assert otherwise == anew != began
    # The noise is another one, in each measurement that has any; what moves is the same.
    assert [each[:4] for each in began] == [each[:4] for each in anew]
    assert all(one[4] != other[4] for one, other in zip(began, anew, strict=True))


def test_what_is_observed_does_not_depend_on_when_it_is():
    with (
        Simulation(world="maze", sensors=True) as often,
        Simulation(world="maze", sensors=True) as once,
    ):
        for each in (often, once):
            each.robot.drive(0.5, 0.2)
        for _ in range(50):
            often.run(often.period)
            observed(often.robot)
        once.run(0.5)
        assert observed(often.robot) == observed(once.robot)


def test_where_a_robot_is_and_what_is_ahead():
    """By arithmetic: a face at 2.5 m, an acceleration of 0.5 m/s^2."""
    with Simulation(world=parse_description(BOX), sensors=True, noise=False) as world:
        robot = world.robot
        robot.drive(0.5)
        world.run(3.0)
        assert world.time == 3.0
        assert robot.pose.x == pytest.approx(0.5 * 2.5, abs=0.005)
        assert robot.twist.linear == pytest.approx(0.5, abs=1e-3)
        assert robot.odometry.x == pytest.approx(robot.pose.x, abs=0.002)
        ahead = robot.distance_ahead()
        assert robot.scan().ahead == pytest.approx(ahead, abs=1e-5)
        assert robot.points("lidar")[:, 0].max() <= ahead + 1e-5
        lidar_x = 2.5 - ahead - robot.pose.x
        assert abs(lidar_x) < 0.1  # where it stands on the robot
        assert robot.joints["left_wheel_joint"].position == pytest.approx(
            robot.odometry.x / 0.06, abs=1e-6
        )
        assert robot.image().shape == (*robot.depth().shape, 3)
        assert robot.imu().linear_acceleration[2] == pytest.approx(9.81, abs=1e-3)
        robot.teleport(-1.0, 0.5, math.pi)
        assert robot.pose.yaw == pytest.approx(math.pi, abs=1e-6)
        assert robot.distance_ahead() == math.inf
        world.run(0.5)
        assert robot.pose.x < -1.0


def test_rays():
    with Simulation(world=parse_description(BOX), x=-1.0) as world:
        assert world.ray((0, 0, 0.3), (1, 0, 0)) == pytest.approx(2.5, abs=1e-6)
        assert world.ray((0, 0, 0.3), (2, 0, 0.2)) == pytest.approx(2.5 * math.hypot(1, 0.1))
        assert world.ray((0, 0, 0.3), (0, 0, -7)) == pytest.approx(0.3, abs=1e-6)  # the ground
        assert world.ray((0, 0, 0.3), (0, 0, 1)) == math.inf
        assert 0.6 < world.ray((0, 0, 0.06), (-1, 0, 0)) < 1.0  # the robot
        # A robot without a lidar looks along x of its root link, and not at itself.
        assert world.robot.distance_ahead() == pytest.approx(3.5, abs=1e-3)


def test_boxes():
    """Where they truly are: the crate, by the end, between the robot and the wall at 2.78 m."""
    with Simulation(world="maze") as world:
        crate, parcel = world.boxes["crate"], world.boxes["parcel"]
        assert set(world.boxes) == {"crate", "parcel"}
        assert (crate.x, crate.y, crate.z) == pytest.approx((1.52, 0.0, 0.1))
        assert (parcel.x, parcel.y, parcel.yaw) == pytest.approx((2.4, 1.6, 0.4))
        world.robot.drive(0.5)
        world.run(6.0)
        pushed = world.boxes["crate"]
        assert (pushed.x, pushed.y, pushed.z) == pytest.approx((2.68, 0.0, 0.1), abs=5e-3)
        assert (pushed.roll, pushed.pitch) == pytest.approx((0.0, 0.0), abs=1e-3)
        world.reset()
        assert world.boxes["crate"] == crate
    with Simulation() as bare:
        assert bare.boxes == {}


def test_until_something_is_true():
    with Simulation() as world:
        robot = world.robot
        world.run(until=lambda: True)
        assert world.time == 0.0
        robot.drive(0.5)
        world.run(until=lambda: robot.pose.x > 0.3)
        assert robot.pose.x == pytest.approx(0.3, abs=0.005 + 1e-3)
        robot.drive(0.0)
        with pytest.raises(TimeoutError, match=r"in 1.5 s of simulated time.*at x 0\.\d+ m"):
            world.run(until=lambda: robot.pose.x > 9.0, timeout=1.5)


def test_several_robots():
    """Each is driven for itself, sees the others, and has noise of its own."""
    robots = {
        "one": RobotSetup(),
        "two": RobotSetup(x=1.5, parameters={"linear.x.max_velocity": 0.2}),
    }
    with Simulation(robots=robots, sensors=True) as world:
        one, two = world.robots.values()
        assert 0.9 < one.distance_ahead() < 1.5
        two.drive(0.5)
        world.run(3.0)
        assert one.pose.x == pytest.approx(0.0, abs=1e-3)
        assert two.twist.linear == pytest.approx(0.2, abs=1e-3)
        with pytest.raises(OneBotError, match=r"2 robots here: one, two; .*robots\[name\]"):
            world.robot  # noqa: B018
        with pytest.raises(OneBotError, match="two"):
            one.teleport(two.pose.x, 0.0)
    setups = {"one": RobotSetup(model=ONEBOT), "two": RobotSetup(x=2.0, model=DIFF_DRIVE)}
    with Simulation(robots=setups, sensors=True) as world:
        assert len(world.robots["one"].scan().ranges) > 100
    with pytest.raises(OneBotError, match="would stand in the same place"):
        Simulation(robots={"one": RobotSetup(), "two": RobotSetup(x=0.1)})
    with pytest.raises(OneBotError, match="give each RobotSetup its own"):
        Simulation(robots=robots, x=1.0)


def test_any_robot(tmp_path: Path):
    """With its own sensors, and those of a file; parameters by their ROS names."""
    block = """<robot><gazebo reference="base_link"><sensor name="eye" type="ray"><ray><scan>
      <horizontal><samples>3</samples><min_angle>-1</min_angle><max_angle>1</max_angle></horizontal>
      </scan><range><min>0.1</min><max>9</max></range></ray></sensor></gazebo></robot>"""
    (tmp_path / "eye.urdf").write_text(block)
    model = tmp_path / "bot.urdf"
    model.write_text(urdf())
    with Simulation(
        model, sensors=tmp_path / "eye.urdf", parameters={"wheel_radius": 0.03, "update_rate": 50}
    ) as world:
        assert world.period == 0.02
        assert world.robot.scan().angles.tolist() == [-1.0, 0.0, 1.0]
        world.robot.drive(0.2)
        world.run(2.0)
        assert world.robot.pose.x == pytest.approx(2.0 * world.robot.odometry.x, rel=0.01)


def test_closing_frees_what_the_sensors_see():
    """At once, not when garbage is collected: studies run a simulation after the other."""

    def count() -> int:
        return sum(type(thing) is VisibleSurfaces for thing in gc.get_objects())

    gc.collect()
    before = count()
    gc.disable()
    try:
        with Simulation(world="maze", sensors=True) as simulation:
            simulation.robot.scan()
            assert count() == before + 1
        assert count() == before
    finally:
        gc.enable()


def test_what_is_slow_to_import_is_imported_only_when_needed():
    """PyBullet not before there is a world; what reads any mesh not for OneBot in the maze."""
    code = (
        "import sys; from onebot_control import *; from onebot_description import *;"
        "slow = {'rclpy', 'rerun', 'yourdfpy', 'trimesh', 'networkx', 'collada', 'scipy'};"
        "assert not (slow | {'pybullet'}) & set(sys.modules); RobotModel;"
        "world = Simulation(world='maze', sensors=True);"
        "world.robot.drive(0.1, 0.0); world.run(0.1); world.reset();"
        "assert world.robot.distance_ahead() > 0.0; assert len(world.robot.scan().ranges) > 100;"
        "world.robot.image(); assert not slow & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
